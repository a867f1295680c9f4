"""Changes of a rig since its calibration, estimated from the free antenna in a recording."""

from __future__ import annotations

from collections.abc import Generator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from estimator.solver.frames import Frames
from estimator.solver.linearised import FreeAntennas, free_antennas
from estimator.solver.rig_arrays import LINE_ERRORS, RigArrays
from vbaa_calib.camera.lens import lens_of
from vbaa_calib.core.arrays import spread_evenly
from vbaa_calib.core.robust import chi_square, finite_or_none
from vbaa_calib.detect.whisker.corridor import free_curve
from vbaa_calib.rig import RIG_PARAMETERS, Rig

from .inputs import Batch


@dataclass(frozen=True)
class DriftSettings:
    """Settings of the estimation of the rig's drift from free frames."""

    free_gain: float = 5.0  # evidence of the best force below which a frame is free: noise exceeds it in 2 %
    fewest_points: int = 20  # of a free frame
    enough_frames: int = 20  # with so many free frames the rig is known
    renewed_s: float = 60.0  # until so much later
    zero_renewed_s: float = 0.5  # until when the sensor's zero is, where it walks
    history_frames: int = 4000  # free frames that are remembered
    frames_at_once: int = 16  # that are used together, at most
    searched_first: int = 1024  # frames without a free one, after which fewer are tested
    then_every: int = 4  # one frame in so many that is tested then: an antenna stays free for longer
    linearisations: int = 2  # of the rig about its changes
    reweightings: int = 3  # of the frames
    wide_line: float = 10.0  # factor on line_px of the prior under which the line errors are measured
    prior_frames: float = 4.0  # that the prior of the line's own errors counts as
    beyond_std: float = 4.0  # standard deviations allowed from which a change is reported


@dataclass(frozen=True, eq=False)
class LearntRig:
    """A rig with its drift as estimated so far from the free antenna in a recording.

    Attributes
    ----------
    calibrated : the rig as calibrated. now : as it is at present; its covariance contains what is unknown of the drift.
    frames : free frames that it was learnt from. line_frames, line_sum_px2 : number of frames, and sum of squares, of
        the lines' own errors measured so far.
    time_s : of the last of them; NaN where times are not known.
    history : after each lot of free frames the time, the changes (17 + P,), and their standard deviations (17 + P,).
    moments : number of free frames with a moment reading. searched : frames before the first free one.
    """

    calibrated: Rig
    now: Rig
    frames: int = 0
    line_frames: float = 0.0
    line_sum_px2: float = 0.0
    time_s: float = np.nan
    step: np.ndarray = field(default_factory=lambda: np.zeros(0))
    history: tuple[tuple[float, np.ndarray, np.ndarray], ...] = ()
    moments: int = 0
    searched: int = 0

    @staticmethod
    def of(rig: Rig) -> LearntRig:
        """The rig before any free frame was used."""
        now = _in_covariance(rig.drifted(), rig)
        return LearntRig(
            rig,
            now,
            line_frames=DriftSettings.prior_frames,
            line_sum_px2=DriftSettings.prior_frames * rig.drift.line_px**2,
        )

    def due(self, time_s: float) -> bool:
        """Whether free frames at this time would add enough information."""
        return self.calibrated.drift.of_rig and (
            self.frames < DriftSettings.enough_frames or time_s > self.time_s + self.renewed_s
        )

    @property
    def renewed_s(self) -> float:
        """Time, s, after which free frames add information again."""
        return DriftSettings.renewed_s if self.calibrated.drift.zero_hourly == 0.0 else DriftSettings.zero_renewed_s

    def reckoned_s(self, time_s: float) -> float:
        """The time up to which drift is extrapolated for a frame: rounded to steps of `renewed_s`, so that
        neighbouring frames have the same rig."""
        steps = abs(time_s - self.time_s) / self.renewed_s
        return self.time_s + self.renewed_s * np.ceil(steps) if steps > 1.0 else self.time_s

    def later(self, time_s: float) -> LearntRig:
        """The rig with the covariance of a random walk until a time, or since it."""
        hours = abs(time_s - self.time_s) / 3600.0
        if not hours > 0.0:
            return self
        wandering = replace(self.now, drift=self.calibrated.drift)
        part = self.calibrated.drift.hourly * np.sqrt(hours)
        later = wandering.drifted(min(part, 1.0))
        zero = len(RIG_PARAMETERS) - 1
        covariance = (later.covariance_with_tip if later.others else later.covariance).copy()
        if self.now.moment_sensor.exists:
            covariance[zero, zero] += hours * (self.calibrated.drift.zero_hourly * self.now.moment_sensor.std_Nm) ** 2
        return replace(self, now=_in_covariance(later.with_covariance(covariance), self.now), time_s=time_s)

    def learn(self, batch: Batch, time_s: float) -> Generator[None, None, LearntRig]:
        """Updates the drift from the free frames among these, if there are any (generator of work steps)."""
        if self.frames == 0 and self.searched >= DriftSettings.searched_first:
            some = np.arange(-self.searched % DriftSettings.then_every, len(batch), DriftSettings.then_every)
            if not len(some) or not (yield from self._free(batch.picked(some))).any():
                return replace(self, searched=self.searched + len(batch))
        rows = np.flatnonzero((yield from self._free(batch)))
        if len(rows) == 0:
            return replace(self, searched=self.searched + len(batch))
        rows = rows[spread_evenly(len(rows), DriftSettings.frames_at_once)]
        free, now, own, count = batch.picked(rows), self.now, self.line_sum_px2, self.line_frames
        if now.drift.line_px > 0.0:
            # with a prior that is wide, or it would say how large they are
            wide = replace(now, drift=replace(now.drift, line_px=DriftSettings.wide_line * now.drift.line_px))
            _, _, excess_px2 = yield from _posterior(free, wide)
            lines = excess_px2.reshape(-1, LINE_ERRORS)
            own, count = own + float(lines.sum()) / LINE_ERRORS, count + len(lines)
            line_px = max(float(np.sqrt(max(own, 0.0) / count)), self.calibrated.drift.line_px)
            now = replace(now, drift=replace(now.drift, line_px=line_px))
        rig, covariance, agreeing = yield from _posterior(free, now)
        step = rig.step_from(self.calibrated)
        now = rig.with_covariance(covariance)
        past = (*self.history[-DriftSettings.history_frames :], (time_s, step, np.sqrt(np.diag(now.covariance))))
        moments = self.moments + int(np.isfinite(free.readings_Nm[:, 0]).sum())
        return LearntRig(self.calibrated, now, self.frames + len(agreeing), count, own, time_s, step, past, moments)

    def _free(self, batch: Batch) -> Generator[None, None, np.ndarray]:
        """(B,) mask of the frames of the free antenna."""
        frames = batch.frames(RigArrays.from_rig(self.now, 0.0))
        yield
        return (yield from _is_free(frames))


def _in_covariance(widened: Rig, before: Rig) -> Rig:
    """The rig without further drift, which is in its covariance already, but for the lines' own errors."""
    return replace(widened, drift=replace(type(before.drift)(), line_px=before.drift.line_px))


def _is_free(frames: Frames) -> Generator[None, None, np.ndarray]:
    """(B,) mask of the frames in which no force on the antenna improves the fit much."""
    gain = np.empty(len(frames))
    for begin in range(0, len(frames), DriftSettings.frames_at_once):
        rows = slice(begin, begin + DriftSettings.frames_at_once)
        gain[rows] = free_antennas(frames.picked(rows)).gain
        yield
    return (frames.usable.sum(-1) >= DriftSettings.fewest_points) & (gain < DriftSettings.free_gain)


def _posterior(batch: Batch, rig: Rig) -> Generator[None, None, tuple[Rig, np.ndarray, np.ndarray]]:
    """The rig that explains frames of the free antenna best, its covariance, and the part of the squared errors (K,
    L) of their lines, px², that is not noise, for the K frames that do not contradict the others."""
    rig_arrays, moving = RigArrays.from_rig(rig, 0.0), rig
    axes, line = rig_arrays.axes, rig_arrays.line
    size, at = axes.shape[1], np.zeros(axes.shape[1])
    for turn in range(DriftSettings.linearisations):
        if turn:
            rig_arrays = replace(RigArrays.from_rig(moving, 0.0), axes=axes)
        frames = batch.frames(rig_arrays)
        yield
        steps, kept = np.zeros((len(batch), size + line.size)), np.ones(len(batch), bool)
        for _ in range(DriftSettings.reweightings):
            equations = free_antennas(frames, steps, DriftSettings.beyond_std)
            information, sides, by_shared = _on_the_rig(equations, steps, size)
            # the prior is about the rig as it came, not about where it was linearised
            from_prior = at + steps[0, :size]
            kept = _agreeing(information, sides, from_prior)
            total = information[kept].sum(axis=0) + np.eye(size)
            change = np.linalg.solve(total, sides[kept].sum(axis=0) - from_prior)
            own = by_shared[..., size] - (by_shared[..., :size] @ change) if line.size else steps[:, size:]
            steps = steps + np.concatenate([np.broadcast_to(change, (len(batch), size)), own], axis=1)
            yield
        at = at + steps[0, :size]
        moving = rig.moved(axes @ at)
    lens_of(moving.camera.intrinsics)  # remembered: tabled here, it delays no frame
    yield
    covariance = axes @ np.linalg.solve(total, axes.T)
    own_information = equations.information[:, size:, size:]
    variance = np.diagonal(np.linalg.inv(own_information), axis1=1, axis2=2) if line.size else steps[:, size:]
    excess_px2 = (steps[:, size:] ** 2 - variance) * rig.drift.line_px**2
    return moving, 0.5 * (covariance + covariance.T), excess_px2[kept]


def _agreeing(information: np.ndarray, sides: np.ndarray, from_prior: np.ndarray) -> np.ndarray:
    """(B,) mask of the frames that do not contradict the rig determined by the others and its prior: a frame that
    was moved or misread must not move the rig for all. All frames where more than a third would be rejected.

    information : (B, R, R), sides : (B, R) of each. from_prior : (R,) how far the rig is from its prior.
    """
    misfit, everything = np.zeros(len(sides)), np.ones(len(sides), bool)
    if len(sides) < 4:  # which of three is wrong is not known
        return everything
    total, side = information.sum(axis=0) + np.eye(len(from_prior)), sides.sum(axis=0) - from_prior
    for row, (own, right) in enumerate(zip(information, sides, strict=True)):
        without = np.linalg.inv(total - own)
        values, axes = np.linalg.eigh(own)
        some = values > 1e-9 * values[-1]  # a line determines but a few directions
        root, axes = np.sqrt(values[some]), axes[:, some]
        off = axes.T @ (right - own @ (without @ (side - right))) / root
        covariance = np.eye(len(root)) + (root[:, None] * axes.T) @ without @ (axes * root)
        misfit[row] = np.sqrt(chi_square(off, covariance) / len(off))
    agreeing = misfit <= DriftSettings.beyond_std * max(1.0, float(np.median(misfit)))
    return agreeing if 3 * agreeing.sum() >= 2 * len(sides) else everything


def _on_the_rig(equations: FreeAntennas, steps: np.ndarray, size: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Information (B, R, R) and right side (B, R) of each frame on the rig, without its prior and with the lines'
    own steps eliminated; and (B, L, R + 1) the lines' steps by the rig's, and at zero."""
    whole, side = equations.information, equations.side
    across = np.concatenate([whole[:, size:, :size], side[:, size:, None]], axis=2)
    by_shared = np.linalg.solve(whole[:, size:, size:], across) if whole.shape[1] > size else across
    information = whole[:, :size, :size] - np.eye(size) - whole[:, :size, size:] @ by_shared[..., :size]
    right = side[:, :size] + steps[:, :size] - (whole[:, :size, size:] @ by_shared[..., size:])[..., 0]
    return information, right, by_shared


def parameter_changes(calibrated: Rig, change: np.ndarray, std: np.ndarray) -> dict[str, dict[str, float]]:
    """By parameter: its change since the calibration, the standard deviation of that, and the prior one."""
    wide = calibrated.drifted()
    rows = zip(wide.parameter_names, change, std, np.sqrt(np.diag(wide.covariance)), strict=True)
    return {name: {"change": float(by), "std": float(own), "prior_std": float(was)} for name, by, own, was in rows}


def summary(learnt: LearntRig) -> dict[str, Any]:
    """The rig's changes in numbers: each parameter's change, its posterior and its prior standard deviation; SI
    units and px.

    `picture_px` is how far the free antenna has moved in the picture, rms along the part that is visible before and
    after, None where there is none; `moment_zero_std` the sensor's zero, in standard deviations of its noise, None
    where no moment was read, as the sensor's parameters are left out then; `beyond` names the parameters that changed
    by more than four standard deviations.
    """
    rig, now = learnt.calibrated, learnt.now
    if not learnt.history:
        return {"free_frames": 0, "picture_px": None, "moment_zero_std": None, "beyond": [], "parameters": {}}
    parameters = parameter_changes(rig, learnt.step, np.sqrt(np.diag(now.covariance)))
    offset = parameters["moment_offset_Nm"]["change"] / rig.moment_sensor.std_Nm
    # of a sensor that was not read, only the correlation of its parameters with others is known
    kept = [not name.startswith("moment_") or learnt.moments > 0 for name in parameters]
    parameters = {name: one for (name, one), known in zip(parameters.items(), kept, strict=True) if known}
    return {
        "free_frames": learnt.frames,
        "picture_px": _moved_px(rig, now),
        "moment_zero_std": float(offset) if learnt.moments else None,
        "beyond": [
            name for name, one in parameters.items() if abs(one["change"]) > DriftSettings.beyond_std * one["prior_std"]
        ],
        "parameters": parameters,
        "over_time": [
            {
                "time_s": time_s if np.isfinite(time_s) else None,
                "change": step[: len(kept)][kept].tolist(),
                "std": std[: len(kept)][kept].tolist(),
            }
            for time_s, step, std in learnt.history
        ],
    }


def drift_in_words(changed: Mapping[str, Any], *, watched: bool = True) -> list[str]:
    """A recording's `summary` in sentences. watched : whether free frames would have been used."""
    if not changed.get("free_frames"):
        return ["no frame shows the free antenna: begin with some, and the rig's drift costs less"] if watched else []
    seen = f"the free antenna, seen in {changed['free_frames']} frames"
    words = [f"since the calibration {seen}, {_moved_in_words(changed)}"]
    if changed["beyond"]:
        names = ", ".join(changed["beyond"])
        words.append(f"warning: {names} changed more than drift does: run vbaa check, or calibrate again")
    return words


def _moved_in_words(changed: Mapping[str, Any]) -> str:
    """The displacement of the free antenna and, where the moment was read, of the sensor's zero, in words."""
    picture, zero = changed["picture_px"], changed["moment_zero_std"]
    words = "shows no part that was in the picture before" if picture is None else f"has moved by {picture:.2g} px"
    return words if zero is None else f"{words}, and the sensor's zero by {zero:.2g} std"


def _moved_px(rig: Rig, now: Rig) -> float | None:
    """Lateral displacement of the weightless free antenna in the picture, px rms over the part visible with both
    rigs; None without one."""
    before, after = (_free_pixels(each) for each in (rig, now))
    with np.errstate(invalid="ignore"):
        tangent = np.gradient(before, axis=0)
        across = np.stack([-tangent[:, 1], tangent[:, 0]], axis=1) / np.linalg.norm(tangent, axis=1, keepdims=True)
    lateral = ((after - before) * across).sum(axis=1)[rig.camera.in_picture(before)]
    both = lateral[np.isfinite(lateral)]
    return finite_or_none(np.sqrt(np.mean(both**2))) if len(both) else None


def _free_pixels(rig: Rig) -> np.ndarray:
    """(M, 2) pixels of the weightless free antenna; NaN where the lens cannot project it."""
    nodes = free_curve(rig.antenna.parameters, rig.antenna.length_m, np.zeros(3), rig.antenna.taper)
    return rig.camera.project(rig.T_antenna_camera.inverse() @ nodes.points_m[0])[0]
