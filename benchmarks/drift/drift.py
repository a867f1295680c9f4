"""`vbaa bench drift`: contacts of rigs that have changed since their calibration, with and without free frames.

Rigs are drawn and calibrated as in `benchmarks.coverage`; the recording's shapes are the static rod's and its pixels
OpenCV's, so that neither shares code with what is measured.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.coverage import coverage
from benchmarks.figures import AMBER, GREEN, GREY, VIOLET, label, panels
from benchmarks.harness import Draws, Findings, Options, column, rms, table, timed
from benchmarks.vision.scenes import normals
from estimator import ContactEstimator
from estimator.contact.contacts import Contact
from estimator.table.contacts import Measured
from vbaa_calib.calibrate.antenna.bundle_adjustment import adjust_bundle
from vbaa_calib.core.console import progress
from vbaa_calib.geometry import Kinematics
from vbaa_calib.rig import Antenna, AntennaImage, MomentSensor, Rig
from vbaa_calib.rig.parts import POSE_PARAMETERS
from vbaa_calib.session import DRIFTS, Drift, Still, gravity_antenna

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FREE, TOUCHED = 10, 30
"""Frames of a recording: of the free antenna, which come first, and of contacts."""
_SILENT = 5.0
"""Deviations beyond which an `ok` frame counts as wrong."""
_OK = ("ok", "tip_contact")
_REACH, _DEFLECTION_M = (0.3, 0.92), (3e-3, 1.2e-2)
"""Contact distances, in antenna lengths, and deflections at 160 mm."""


@dataclass(frozen=True)
class Change:
    """The largest that may have changed; each draw takes it evenly within. Units as in `vbaa_calib.session.Drift`.

    Attributes
    ----------
    light_px : of the line's offset, slope and curvature, the same in all frames. line_px : deviation of each frame's.
    """

    name: str
    turn_rad: float = 0.0
    shift_m: float = 0.0
    picture_px: float = 0.0
    scale: float = 0.0
    stiffness: float = 0.0
    gain: float = 0.0
    zero: float = 0.0
    light_px: float = 0.0
    line_px: float = 0.0


ALL = Change("all of it", 3e-4, 2e-4, 0.5, 1e-4, 5e-3, 2e-3, 10.0, 0.03, 0.0)
CHANGES = (
    Change("nothing"),
    Change("picture 0.02 px", picture_px=0.02),
    Change("picture 0.1 px", picture_px=0.1),
    Change("picture 0.5 px", picture_px=0.5),
    Change("camera 0.3 mrad, 0.2 mm", turn_rad=3e-4, shift_m=2e-4),
    Change("scale 1e-4", scale=1e-4),
    Change("light 0.03 px", light_px=0.03),
    Change("each line 0.01 px", line_px=0.01),
    Change("zero 10 std", zero=10.0),
    Change("EI 0.5 %", stiffness=5e-3),
    ALL,
)
NONE, UNSEEN, SEEN = "as calibrated", "drift, no free frame", "drift, free frames"
WAYS = (NONE, UNSEEN, SEEN)
"""Drift ignored, as before it was modelled; allowed for; and learnt from free frames."""


@dataclass(frozen=True)
class Row:
    """One change, in one way, over rigs and draws.

    Attributes
    ----------
    usable : share of contacts that are located. lost : share of those that were so without the change, and are not now.
    silent : share of located contacts whose distance is off by over five deviations. worst : the largest of these.
    ratio : l_rms_mm over that without the change, drift ignored, of the contacts that are located in both.
    bound : the same of the deviations that the frames' information leaves, with what may have changed unknown: what can
        be known at best.
    held : share of distances within their 95 % intervals. free : share of free frames that are so called.
    """

    change: str = column("change")
    way: str = column("estimated")
    contacts: int = column("contacts", "d")
    usable: float = column("usable %", ".1f", 100.0)
    lost: float = column("lost %", ".1f", 100.0)
    silent: float = column("silent %", ".2f", 100.0)
    worst: float = column("worst", ".1f")
    l_rms_mm: float = column("l rms mm", ".2f")
    l_median_mm: float = column("median", ".2f")
    ratio: float = column("× unchanged", ".2f")
    bound: float = column("bound", ".2f")
    held: float = column("held %", ".1f", 100.0)
    free: float = column("free %", ".1f", 100.0)
    frame_ms: float = column("ms a frame", ".1f")


@dataclass(frozen=True, eq=False)
class Recording:
    """What a changed rig records, the free frames first; distances (F,) are NaN there."""

    frames: list[Measured]
    distance_m: np.ndarray


def calibrated(given: coverage.Draw) -> Rig:
    """The rig that a draw's pictures and readings lead to."""
    before = replace(coverage.prior_of(given), drift=DRIFTS["lab"])
    joint = adjust_bundle(coverage.observations(given), before, coverage.NOMINAL.length_m, coverage.MOMENT_NM)
    gain, offset = joint.sensor_gain_offset
    antenna = joint.parameters[len(POSE_PARAMETERS) : -2]
    return Rig(
        camera=joint.camera,
        T_antenna_camera=joint.T_antenna_camera,
        antenna=Antenna(coverage.NOMINAL.length_m, coverage.NOMINAL.diameter_m, antenna),
        moment_sensor=MomentSensor(gain, offset, coverage.MOMENT_NM),
        kinematics=Kinematics(),
        gravity_world_m_s2=coverage.GRAVITY_WORLD_M_S2,
        image=AntennaImage(coverage.CENTRELINE_PX * joint.noise_scale, joint.noise_scale, True),
        covariance=joint.covariance,
        tip=joint.tip,
    )


def recorded(given: coverage.Draw, change: Change, seed: tuple[int, ...]) -> Recording:
    """A recording of a drawn rig after a change; the same seed gives the same contacts, noise and directions."""
    rng, count = np.random.default_rng(seed), FREE + TOUCHED
    pan, tilt = rng.uniform(-0.5, 0.5, count), rng.uniform(-0.8, 0.8, count)
    distance, roll = rng.uniform(*_REACH, count) * coverage.NOMINAL.length_m, rng.uniform(-np.pi, np.pi, count)
    deflection = rng.uniform(*_DEFLECTION_M, count) * (distance / 0.16) ** 1.5
    parts = rng.uniform(-1.0, 1.0, 16)
    truth = given.truth.copy()
    truth[6] += change.stiffness * parts[0]
    truth[9] *= 1.0 + change.gain * parts[1]
    truth[10] += change.zero * coverage.MOMENT_NM * parts[2]
    size_N = np.where(np.arange(count) < FREE, 0.0, 3.0 * np.exp(truth[6]) * deflection / distance**3)
    hung = np.stack([distance, np.zeros(count), size_N * np.cos(roll), size_N * np.sin(roll)], axis=1)
    stills = [Still(image=None, pan_rad=p, tilt_rad=t, moment_Nm=0.0) for p, t in zip(pan, tilt, strict=True)]
    gravity = gravity_antenna(Kinematics(), coverage.GRAVITY_WORLD_M_S2, stills)
    bent = coverage.Bent.of(truth, gravity, hung)
    readings = bent.readings_Nm + coverage.MOMENT_NM * rng.normal(size=count)
    step = np.concatenate([change.turn_rad * parts[3:6], change.shift_m * parts[6:9]])
    rig = replace(given.rig, T_antenna_camera=given.rig.T_antenna_camera.retract(step))
    frames, ends, centre = [], np.random.default_rng((*seed, coverage.ENDS)), rig.lens.matrix[:2, 2]

    def in_picture(pixels: np.ndarray) -> np.ndarray:
        return (pixels - centre) * (1.0 + change.scale * parts[14]) + centre + change.picture_px * parts[9:11]

    for index in range(count):
        exact = bent.line_px(rig, index)
        off = change.light_px * parts[11:14] + change.line_px * rng.normal(size=3)
        aside = np.polynomial.legendre.legval(np.linspace(-1.0, 1.0, len(exact)), off)  # offset, slope, curvature
        line = exact + normals(exact) * aside[:, None]
        line = in_picture(line) + coverage.CENTRELINE_PX * rng.normal(size=line.shape)
        end = bent.tip_px(rig, index, given.tip_m) + coverage.TIP_PX * ends.normal(size=2)
        tip_px = np.append(in_picture(end), coverage.TIP_PX)
        sigma = np.full(len(line), coverage.CENTRELINE_PX)
        angles = float(pan[index]), float(tilt[index])
        frames.append(Measured(line, sigma, float(readings[index]), *angles, tip_px=tip_px))
    return Recording(frames, np.where(size_N > 0.0, distance, np.nan))


def estimated(rig: Rig, way: str, recording: Recording) -> list[Contact]:
    """All frames in one of `WAYS`; where no free frame may tell of the drift, each is estimated by itself."""
    estimator = ContactEstimator(replace(rig, drift=Drift() if way == NONE else DRIFTS["lab"]))
    if way == SEEN:
        return list(estimator.run(recording.frames))
    return list(estimator.measure_batch(recording.frames))


@dataclass(frozen=True, eq=False)
class _Judged:
    """One recording, one way: errors and deviations (F,) m, NaN where nothing is located; free (F,); seconds."""

    error_m: np.ndarray
    std_m: np.ndarray
    free: np.ndarray
    touched: np.ndarray
    seconds: float


def _judge(rig: Rig, way: str, recording: Recording) -> _Judged:
    found, seconds = timed(lambda: estimated(rig, way, recording))
    located = np.array([one.status in _OK for one in found])
    distance = np.where(located, [one.distance_m for one in found], np.nan)
    std = np.where(located, [one.distance_std_m for one in found], np.nan)
    free = np.array([one.status == "no_contact" for one in found])
    return _Judged(distance - recording.distance_m, std, free, np.isfinite(recording.distance_m), seconds)


def run(options: Options) -> list[Row]:
    """Every change and way over all rigs and draws."""
    judged: dict[tuple[str, str], list[_Judged]] = {}
    kinds = coverage.coverage_rigs()[: 1 if options.quick else 3]
    for number in progress(range(options.draws), "rigs"):
        given = coverage.draw(kinds[number % len(kinds)], (options.seed, number))
        rig = calibrated(given)
        for change in CHANGES:
            recording = recorded(given, change, (options.seed, number, 5))
            for way in WAYS:
                judged.setdefault((change.name, way), []).append(_judge(rig, way, recording))
    base = judged[CHANGES[0].name, NONE]
    return [_row(change, way, several, base) for (change, way), several in judged.items()]


def _row(change: str, way: str, several: Sequence[_Judged], base: Sequence[_Judged]) -> Row:
    now, was_so = Draws(several), Draws(base)
    error, std, free, touched, before = now.error_m, now.std_m, now.free, now.touched, was_so.error_m
    located, was = touched & np.isfinite(error), touched & np.isfinite(before)
    off = np.abs(error[located] / std[located])
    both = located & was
    return Row(
        change=change,
        way=way,
        contacts=int(touched.sum()),
        usable=float(located.sum() / touched.sum()),
        lost=float((was & ~located).sum() / max(was.sum(), 1)),
        silent=float((off > _SILENT).mean()) if len(off) else 0.0,
        worst=float(off.max(initial=0.0)),
        l_rms_mm=1e3 * rms(error[located]),
        l_median_mm=1e3 * float(np.median(np.abs(error[located]))) if located.any() else float("nan"),
        ratio=rms(error[both]) / rms(before[both]),
        bound=rms(std[both]) / rms(was_so.std_m[both]),
        held=float((off < 1.96).mean()) if len(off) else float("nan"),
        free=float(free[~touched].mean()),
        frame_ms=1e3 * float(now.seconds.sum()) / len(touched),
    )


def figure(rows: Sequence[Row]) -> Figure:
    """Lost and silently wrong contacts, and the distance's error, of every change."""
    drawn, every = panels(3, 3, (3.4, 3.6), sharey=True)
    names, shown = [change.name for change in CHANGES], {"lost": "contacts lost, %", "worst": "worst l, deviations"}
    shown["l_rms_mm"] = "l rms, mm"
    for panel, (name, what) in zip(every, shown.items(), strict=True):
        scale = 100.0 if name == "lost" else 1.0
        for way, colour in zip(WAYS, (GREY, AMBER, GREEN), strict=True):
            own = {row.change: scale * getattr(row, name) for row in rows if row.way == way}
            panel.plot([own[one] for one in names], range(len(names)), "o", color=colour, label=way)
        label(panel, "", what)
        panel.set_yticks(range(len(names)), names)
    every[0].axvline(5.0, color=VIOLET, lw=0.6)
    every[0].invert_yaxis()
    drawn.legend(*every[0].get_legend_handles_labels(), loc="outside lower center", ncols=3, fontsize=8)
    return drawn


def measure(options: Options) -> Findings:
    """Every change and way; a draw is a rig with its own calibration, change and recording."""
    rows = run(options)
    worst = {way: max(row.worst for row in rows if row.way == way) for way in WAYS}
    lost = {way: max(row.lost for row in rows if row.way == way) for way in WAYS}
    title = (
        f"{FREE} free frames and {TOUCHED} contacts a rig; lost: located without the change, and not with it; "
        f"silent: off by over {_SILENT:g} deviations"
    )
    return Findings(
        table(rows, title, once=1),
        {"drift.csv": rows},
        {"drift.png": lambda: figure(rows)},
        {"rows": rows},
        f"lost at most {100 * lost[SEEN]:.0f} % (as calibrated {100 * lost[NONE]:.0f}), "
        f"worst {worst[SEEN]:.1f} deviations ({worst[NONE]:.0f})",
    )
