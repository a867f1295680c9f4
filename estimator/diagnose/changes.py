"""Hypotheses of a rig that has changed since its calibration: which of its parameters, and by how much."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from vbaa_calib.core.errors import Severity, VbaaError
from vbaa_calib.rig import Rig

from .evidence import Case, Recorded, weighed
from .settings import RecordingSettings


class Change(NamedTuple):
    """A row of the table: parameters of a rig that may have changed together since its calibration.

    std : standard deviation of each parameter beforehand, in its own unit, or relative to its value for "f" (both focal
    lengths) and the sensor's gain, and in standard deviations of the sensor's noise for its zero. "length_m": of the
    antenna, which only its visible end shows well.
    unit : of the value in words. least : size, in that unit, below which it is no mistake.
    """

    name: str
    std: Mapping[str, float]
    words: str
    remedy: str
    unit: str = ""
    least: float = 0.0
    severity: Severity = "wrong"
    log_prior: float = 0.0  # against the other rows
    measures: int = 9  # how many of the parameters, the first ones, are its size
    starts: tuple[float, ...] = ()  # scales of the picture, or sizes of an offset, from which it is sought, too
    by: Callable[[Recorded], np.ndarray | None] | None = None  # (F, K) what an error of the moments is linear in
    changed: Callable[[np.ndarray, Recorded], Recorded | None] | None = None  # an offset (K,) of readings put right
    part: str = "antenna"  # of the rig that has changed: camera, antenna, sensor, base; none where it has not

    @property
    def factor(self) -> float:
        """How many of `unit` are one of the parameters' own."""
        return {"°": 57.29578, "mm": 1e3, "%": 100.0}.get(self.unit, 1.0)


AGAIN = "calibrate again, or put the rig back"
CHANGES = (
    Change(
        "picture_moved",
        {"cx": 20.0, "cy": 20.0},
        "the picture has moved by {} since the calibration, as by a camera "
        "that was knocked or a picture that was cropped",
        AGAIN,
        "px",
        1.0,
        log_prior=6.0,
        part="camera",
    ),
    Change(
        "camera_turned",
        dict.fromkeys(("camera_about_x_rad", "camera_about_y_rad", "camera_about_z_rad"), 0.02),
        "the camera has turned by {} since the calibration",
        AGAIN,
        "°",
        0.05,
        log_prior=6.0,
        part="camera",
    ),
    Change(
        "camera_moved",
        dict.fromkeys(("camera_x_m", "camera_y_m", "camera_z_m"), 5e-3),
        "the camera has moved by {} since the calibration",
        AGAIN,
        "mm",
        0.3,
        part="camera",
    ),
    Change(
        "focus_changed",
        {"f": 0.02},
        "the focal length has changed by {} since the calibration",
        "focus as calibrated, fix the ring, or calibrate again",
        "%",
        0.1,
        part="camera",
    ),
    Change(
        "picture_scaled",
        {"f": 0.2, "cx": 50.0, "cy": 50.0},
        "the pictures are scaled or cropped: their focal length differs by {}",
        "record pictures of the calibration's size and part",
        "%",
        1.0,
        measures=1,
        starts=(0.5, 0.7, 0.85, 1.15, 1.4, 2.0),
        part="camera",
    ),
    Change(
        "other_rig",
        {
            **dict.fromkeys(("camera_about_x_rad", "camera_about_y_rad", "camera_about_z_rad"), 0.05),
            **dict.fromkeys(("camera_x_m", "camera_y_m", "camera_z_m"), 20e-3),
            **{"f": 0.03, "cx": 20.0, "cy": 20.0},
            **dict.fromkeys(("bow_about_y_per_m", "bow_about_z_per_m"), 0.3),
            **dict.fromkeys(("clamp_about_y_rad", "clamp_about_z_rad"), 0.03),
        },
        "camera and antenna are not as calibrated, the camera turned by {}: the rig.json is that of another rig",
        "use the rig.json of this rig, or calibrate it",
        "°",
        0.3,
        measures=3,
    ),
    Change(
        "antenna_bent",
        {"bow_about_y_per_m": 0.3, "bow_about_z_per_m": 0.3},
        "the antenna has been bent by {} since the calibration",
        "straighten or replace the wire and calibrate again",
        "per m",
        0.03,
    ),
    Change(
        "antenna_bent",
        {
            **dict.fromkeys(("bow_about_y_per_m", "bow_about_z_per_m"), 0.3),
            **dict.fromkeys(("clamp_about_y_rad", "clamp_about_z_rad"), 0.03),
        },
        "the antenna has a bend or a kink since the calibration, about {} in the middle",
        "straighten or replace the wire and calibrate again",
        "per m",
        0.03,
        log_prior=-3.0,
        measures=2,
    ),
    Change(
        "clamp_turned",
        {"clamp_about_y_rad": 0.03, "clamp_about_z_rad": 0.03},
        "the clamp has turned by {} since the calibration",
        "tighten the clamp, and calibrate again",
        "°",
        0.1,
        log_prior=-3.0,
    ),
    Change(
        "clamp_moved",
        {"clamp_y_m": 3e-3, "clamp_z_m": 3e-3},
        "the clamp has moved by {} since the calibration",
        "tighten the clamp, and calibrate again",
        "mm",
        0.2,
        log_prior=-3.0,
    ),
    Change(
        "antenna_slid",
        {"length_m": 2e-3},
        "the antenna sticks {} further out of its clamp: it has slid",
        "push it back, tighten the clamp, or calibrate again",
        "mm",
        0.3,
        log_prior=2.0,
    ),
    Change(
        "other_length",
        {"length_m": 0.02},
        "the antenna is {} longer than the rig's: it is another one, or has slid in its clamp",
        "calibrate with this antenna",
        "mm",
        1.0,
    ),
    Change(
        "other_stiffness",
        {"log_stiffness_Nm2": 0.1},
        "the antenna's EI differs by {} from the rig's: it is another antenna, or a thinner one",
        "calibrate with this antenna",
        "%",
        1.0,
        log_prior=2.0,
    ),
    Change(
        "other_diameter",
        {"log_stiffness_Nm2": 0.4, "log_mass_per_length_kg_m": 0.2},
        "the antenna's EI and mass differ by {} from the rig's: it has another diameter",
        "calibrate with this antenna",
        "%",
        4.0,
    ),
    Change(
        "moment_gain",
        {"moment_gain": 0.3},
        "the moment sensor's gain differs by {} from the rig's",
        "check its amplifier and the unit of moment_Nm",
        "%",
        2.0,
        log_prior=0.5,  # a stiff antenna that gravity hardly bends does not tell it from another EI
        part="sensor",
    ),
    Change(
        "moment_zero",
        {"moment_offset_Nm": 100.0},
        "the moment sensor's zero has moved by {} of its noise",
        "zero it again before a recording, or give --track-zero",
        "standard deviations",
        5.0,
        part="sensor",
    ),
)


def axes_of(rig: Rig, rows: Sequence[Change]) -> tuple[np.ndarray, list[np.ndarray]]:
    """(18 + P, Q) parameter steps by one standard deviation of each row's change, and each row's columns (K,), empty
    where the rig does not have the parameter."""
    more = () if rig.wrench_sensor is None else rig.wrench_sensor.parameter_names
    names = [*rig.parameter_names, *more, *["tip_offset_m"] * (rig.tip is not None)]
    if rig.others:  # nothing is supposed of further cameras' own parameters
        names += [""] * (len(rig.covariance_with_tip) - len(names))
    sensor = rig.moment_sensor
    units = {"moment_gain": abs(sensor.gain), "moment_offset_Nm": sensor.std_Nm} if sensor.exists else {}
    columns: list[np.ndarray] = []
    which = []
    for row in rows:
        own = []
        for name, std in row.std.items():
            step = np.zeros(len(names))
            if name == "f":
                for axis, each in enumerate(("fx", "fy")):
                    if each in names:
                        step[names.index(each)] = std * rig.camera.matrix[axis, axis]
            elif name.startswith("moment_") and not sensor.exists:
                continue
            elif (known := "tip_offset_m" if name == "length_m" else name) in names:
                step[names.index(known)] = std * units.get(name, 1.0)
            if step.any():
                own.append(len(columns))
                columns.append(step)
        which.append(np.array(own if len(own) == len(row.std) else [], int))
    return np.array(columns).reshape(-1, len(names)).T, which


@dataclass(frozen=True, eq=False)
class _Changed:
    """A fitted change: its size, in units of its row's standard deviations, and its evidence."""

    row: Change
    steps: np.ndarray  # (K,)
    covariance: np.ndarray  # (K, K)
    log_odds: float
    recorded: Recorded  # with the rig so changed, or the readings put right

    @cached_property
    def size(self) -> float:
        """Size of the change in the row's unit."""
        values = (self.row.factor * self.steps * list(self.row.std.values()))[: self.row.measures]
        return float(np.linalg.norm(values)) if len(values) > 1 else float(values[0])

    @property
    def words(self) -> str:
        """The change in words, with its value and standard deviation."""
        std = (self.row.factor * np.sqrt(np.diag(self.covariance)) * list(self.row.std.values()))[: self.row.measures]
        steps = self.steps[: self.row.measures]
        parts = steps * std / max(float(np.linalg.norm(steps)), 1e-12)
        spread = float(np.linalg.norm(parts)) if len(std) > 1 else float(std[0])
        sign = "+" if len(std) == 1 else ""
        return self.row.words.format(f"{self.size:{sign}.3g} ± {spread:.2g} {self.row.unit}")


_Start = tuple[np.ndarray, np.ndarray | None]
"""Steps (K,) from which a change is sought, and a mask (F,) of frames that count as free of contact at first."""


def fitted(case: Case, row: Change, axes: np.ndarray, first: int = 0) -> _Changed | None:
    """A row's change from the frame `first` on, by Gauss–Newton from no change, from what single frames and most frames
    would show if they are free, and from other scales of the picture. None where the frames do not determine it."""
    if row.by is not None:
        return _error_fitted(case, row, axes)
    few, begin, best = case, first, None
    if case.many_lost:
        # frames that nothing explains take long: a few of them lead there
        rows = np.arange(0, len(case.recorded), 2)
        few, begin = case.picked(rows), int(np.sum(rows < first))

    def sought(case: Case, first: int, start: _Start) -> _Changed | None:
        def changed(steps: np.ndarray) -> Recorded:
            return case.recorded.with_rig(_moved(case.recorded.rig, row, axes @ steps), first)

        return _descended(case, row, changed, (axes, case.since(first, axes.shape[1])), start)

    none = np.zeros(axes.shape[1])
    starts: list[_Start] = [(none, None)]
    if case.many_lost:
        starts += [(steps, None) for steps in few.by_one(axes, begin)]
    starts += [(none, free) for free in few.frees]
    if row.starts:
        matrix = case.recorded.rig.camera.matrix
        lens = np.array([1.0, matrix[0, 2], matrix[1, 2]]) / list(row.std.values())
        starts += [((scale - 1.0) * lens, np.ones(len(few.recorded), bool)) for scale in row.starts]
    for start in starts:
        found = sought(few, begin, start)
        if found is not None and (best is None or found.log_odds > best.log_odds):
            best = found
            if few.cost - best.log_odds < RecordingSettings.sound_cost * len(few.recorded):
                break
    return best if best is None or few is case else sought(case, first, (best.steps, None))


def _error_fitted(case: Case, row: Change, axes: np.ndarray) -> _Changed | None:
    """A row's error of the moments. axes : (18 + P, 1) of their zero."""
    recorded, by = case.recorded, None if row.by is None else row.by(case.recorded)
    if by is None:
        return None
    readings, unit_Nm = recorded.batch.readings_Nm, next(iter(row.std.values())) * recorded.rig.moment_sensor.std_Nm

    def changed(steps: np.ndarray) -> Recorded:
        return recorded.with_readings(
            readings_Nm=np.column_stack([readings[:, 0] - unit_Nm * (by @ steps), readings[:, 1:]])
        )

    along = np.repeat(axes, by.shape[1], axis=1)
    return _descended(case, row, changed, (along, by), (np.zeros(by.shape[1]), None))


def _moved(rig: Rig, row: Change, step: np.ndarray) -> Rig:
    """A rig changed by a step (18 + P,); the end of a longer antenna lies farther out, and it weighs more."""
    if "length_m" not in row.std:
        return rig.moved(step)
    return replace(rig, antenna=replace(rig.antenna, length_m=max(rig.antenna.length_m + float(step[-1]), 1e-3)))


def _descended(
    case: Case,
    row: Change,
    changed: Callable[[np.ndarray], Recorded],
    along: tuple[np.ndarray, np.ndarray],
    start: _Start,
) -> _Changed | None:
    """The change that minimises the cost, by damped Gauss–Newton steps; None where none improves it.

    changed : the frames with steps (K,). along : the rig's parameters (18 + P, K) that the steps are like, and how much
    of each step a frame has (F, K).
    """
    (axes, by), (steps, free) = along, start
    settings, cost, best = RecordingSettings, np.inf, None
    for turn in range(settings.iterations):
        try:
            now = changed(steps) if steps.any() else case.recorded
            fit = now.fit
        except (VbaaError, np.linalg.LinAlgError):
            break  # no such lens, or a rig so far off that it predicts nothing finite
        together = weighed(fit, case.best, case.scale, axes, None if turn else free)
        information, score = together.about_others(by)
        unit = information + np.eye(len(steps))
        if not np.isfinite(unit).all():
            break
        if free is None or turn:
            total = together.cost + 0.5 * float(steps @ steps) + 0.5 * float(np.linalg.slogdet(unit)[1])
            if best is not None and total > cost:
                steps = 0.5 * (best.steps + steps)
                continue
            if total > cost - settings.gain:
                break
            cost = total
            odds = case.cost - cost - case.of_one(together)
            best = _Changed(row, steps, np.linalg.inv(unit), odds, now)
        steps = steps + np.linalg.solve(unit, score - steps)
        if not np.abs(steps).max() < settings.farthest:
            break
    return best if best is not None and best.steps.any() else None
