"""Speed against error: two points, a straight line, the estimator's rungs and a SciPy loop on the same frames."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import least_squares

from benchmarks.estimator.bound import bound
from benchmarks.estimator.scenes import Scenes, joined, push_for_deflection, rod_shapes, rolled, scenes
from benchmarks.estimator.setup import Setup, drawn_truth
from benchmarks.figures import AMBER, GREEN, GREY, INK, SHADE, VIOLET, label, legend, name_points, panels
from benchmarks.harness import column, least_seconds, or_none, rms_known, table
from estimator import ContactEstimator
from estimator.paper.inclined import inclined_two_point_contact, project
from estimator.paper.two_point import straight_line_contact, two_point_contact
from vbaa_calib.antenna import linear
from vbaa_calib.antenna.rungs import RUNGS, curves
from vbaa_calib.camera import CameraOnPlane
from vbaa_calib.core.console import progress
from vbaa_calib.core.robust import NORMAL_QUARTILE

if TYPE_CHECKING:
    from matplotlib.figure import Figure


PARTS = {"two curved points": (0.45, 0.95), "two straight points": (1.1, 2.0), "one of each": (0.6, 2.0)}
"""Where the two points are taken: up to 1 in contact distances, the rest as 1 + the share of the straight part."""
_CAMERA_B_TILT_RAD = np.radians(30.0)
FIRST_GUESS = 0.7
"""Of the length: beyond it the first straight line is drawn."""


Solve = Callable[[np.ndarray], np.ndarray]
"""From frames' indices to their contact distances, both (B,): what a user would have to run for each frame."""


def baselines(scenes: Scenes, rng: np.random.Generator) -> dict[str, Solve]:
    """Name → method made ready for frames that are noisy already; `rng` : for the noise of camera B's pictures."""
    layer, antenna = scenes.rig.camera_on_plane(), scenes.rig.antenna
    stiffness, length = antenna.stiffness_Nm2, antenna.length_m

    def two_points(ends: tuple[float, float]) -> Solve:
        pixels = np.take_along_axis(scenes.points_px, at_shares(scenes, ends)[..., None], axis=1)

        def solve(which: np.ndarray) -> np.ndarray:
            plane = layer.project(pixels[which])[0]
            return np.asarray(two_point_contact(plane[..., 0], plane[..., 1], stiffness, length).contact_m)

        return solve

    picked = _camera_b(scenes, layer, rng)

    def inclined(which: np.ndarray) -> np.ndarray:
        x, y = np.moveaxis(picked[which], -1, 0)
        found = inclined_two_point_contact(x, y, scenes.moment_Nm[which], stiffness, _CAMERA_B_TILT_RAD, length)
        return np.asarray(found.contact_m)

    def line(which: np.ndarray) -> np.ndarray:
        x, y = np.moveaxis(layer.project(scenes.points_px[which])[0], -1, 0)
        guess = np.full(len(which), FIRST_GUESS * length)
        return np.asarray(straight_line_contact(x, y, guess, stiffness)[0])

    ready = {name: two_points(ends) for name, ends in PARTS.items()}
    return ready | {"one of each, camera B at 30°": inclined, "straight line": line}


def at_shares(scenes: Scenes, ends: tuple[float, float]) -> np.ndarray:
    """(B, 2) indices of the points that lie nearest to the places that `PARTS` names."""
    contact, length = scenes.distance_m[:, None], scenes.rig.antenna.length_m
    share = np.array(ends)
    wanted = np.where(share <= 1.0, share * contact, contact + (share - 1.0) * (length - contact))
    return np.round(np.interp(wanted, scenes.arclength_m, np.arange(len(scenes.arclength_m)))).astype(int)


def _camera_b(scenes: Scenes, layer: CameraOnPlane, rng: np.random.Generator) -> np.ndarray:
    """(B, 2, 2) of the points "one of each" as the paper's orthographic camera B would see them.

    The benchmark's cameras are perspective ones, for which the inclined formulas were not made. The noise is what the
    points have on plane C through the real camera.
    """
    which = at_shares(scenes, PARTS["one of each"])
    points = np.take_along_axis(scenes.shapes.points_m, which[..., None], axis=1)
    middle = np.nanmean(scenes.points_px, axis=(0, 1))
    a, b = layer.project(middle + np.array([[-0.5, 0.0], [0.5, 0.0]]))[0]
    m_per_px = float(np.linalg.norm(b - a))
    image = np.asarray(project(points, _CAMERA_B_TILT_RAD))
    return image + rng.normal(0.0, scenes.sigma_px * m_per_px, image.shape)


_FORCE_SCALE_N, _DISTANCE_SCALE_M = 0.01, 0.01
_START = 0.6
"""Contact distance over length that is tried where the straight line says nothing."""


def one_contact(scenes: Scenes, index: int) -> np.ndarray:
    """(3,) contact distance in m, f_y and f_z in N of one frame; NaN where the fit breaks down.

    Levenberg–Marquardt over the three on the rung `elastica`, SciPy's own difference quotients, for a camera that sees
    the antenna along the picture's u. Rig and friction are taken as exactly known.
    """
    rig, sensor = scenes.rig, scenes.rig.moment_sensor
    antenna, to_camera = rig.antenna, rig.T_antenna_camera.inverse()
    rotation = rig.kinematics.T_world_antenna(scenes.pan_rad[index], scenes.tilt_rad[index]).rotation
    gravity = (rotation.T @ rig.gravity_world_m_s2)[None]
    parameters = antenna.parameters[None]
    points = scenes.points_px[index]
    u, v = points[np.isfinite(points).all(axis=1)].T
    reading = (scenes.moment_Nm[index] - sensor.offset_Nm) / sensor.gain

    def residuals(unknowns: np.ndarray) -> np.ndarray:
        contact = np.clip(unknowns[:1] * _DISTANCE_SCALE_M, 1e-3, antenna.length_m)
        force = unknowns[None, 1:] * _FORCE_SCALE_N
        shape = curves("elastica", parameters, antenna.length_m, gravity, contact, force)
        pixels, _ = rig.camera.project(to_camera @ shape.points_m[0])
        curve = CubicSpline(pixels[:, 0], pixels[:, 1])
        across = (v - curve(u)) / np.sqrt(1.0 + curve(u, 1) ** 2)
        by_moment = sensor.gain * (reading - shape.moment_Nm[0]) / sensor.std_Nm
        return np.append(across / scenes.sigma_px, by_moment)

    try:
        found = least_squares(residuals, _start(scenes, index, reading), method="lm")
    except ValueError:  # a step to a shape that runs back in the picture, which the spline refuses
        return np.full(3, np.nan)
    return np.asarray(found.x * [_DISTANCE_SCALE_M, _FORCE_SCALE_N, _FORCE_SCALE_N])


def _start(scenes: Scenes, index: int, reading_Nm: float) -> np.ndarray:
    """The straight line's contact and f_y, and the moment's f_z, in the unknowns' scales."""
    antenna = scenes.rig.antenna
    x, y = np.moveaxis(scenes.rig.camera_on_plane().project(scenes.points_px[index])[0], -1, 0)
    contact, force = map(float, straight_line_contact(x, y, _START * antenna.length_m, antenna.stiffness_Nm2))
    if not 0.0 < contact < antenna.length_m:
        contact = _START * antenna.length_m
        force = 3.0 * antenna.stiffness_Nm2 * float(np.nanmax(np.abs(y))) / contact**3
    return np.array([contact / _DISTANCE_SCALE_M, force / _FORCE_SCALE_N, reading_Nm / contact / _FORCE_SCALE_N])


MODELS = (*RUNGS, "auto")
REACH, DEFLECTION_M, ROLL_RAD = (0.3, 0.8), (0.004, 0.008), np.radians(60.0)
"""Contact distances over length, deflections there, and the largest roll of the deformation plane."""
_LOOP_FRAMES, _SINGLE_FRAMES = 100, 20
"""Frames that the SciPy loop is judged by, and that single frames are timed with: of few a quarter, and a tenth."""
TRUE_RIGS = 20
_FORMULA_FRAMES = 1_000_000
PAPER, LOOP = "the paper's two points", "SciPy, a loop"
LINE, ESTIMATOR = "straight line", "all points"


@dataclass(frozen=True)
class SpeedRow:
    """One method, one way of calling it.

    family : of methods, for the figure.
    rig : "exact", or "calibrated": a covariance that the estimator takes into account, and true rigs drawn from it.
    frames : that one call was given when it was timed.
    us_per_frame : least of several timings; of single frames the median over frames.
    of_bound, of_bound_flat : rms error of the contact distance in standard deviations of the Cramér–Rao bound; with
        the deformation plane at any roll up to 60°, and within plane C. None where it is not a method's question.
    typical : the same from the median of |error|, as if normal: robust to the few that go far astray.
    answered : share of the frames with a number.
    """

    method: str = column("method")
    family: str = column("family")
    rig: str = column("rig")
    frames: int = column("frames", "d")
    us_per_frame: float = column("µs/frame", ".2f")
    of_bound: float | None = column("error", ".2f")
    of_bound_flat: float | None = column("in C", ".2f")
    typical: float | None = column("typical", ".2f")
    answered: float | None = column("answered %", ".2f", 100)


@dataclass(frozen=True, eq=False)
class Judged:
    """Noisy frames with their bound (B,) m."""

    scenes: Scenes
    bound_m: np.ndarray

    def errors(self, distance_m: np.ndarray) -> np.ndarray:
        """(K,) in the bound's standard deviations, of the first K frames."""
        count = len(distance_m)
        return (distance_m - self.scenes.distance_m[:count]) / self.bound_m[:count]


def run(frames: int, seed: int, repeats: int) -> list[SpeedRow]:
    """Every method over so many frames of N = 200 points under an upright camera."""
    exact = population(frames, seed, ROLL_RAD), population(frames, seed + 1, 0.0)
    rows = [_formula_alone(_FORMULA_FRAMES, seed, repeats), *_baselines(*exact, seed, repeats)]
    rows.append(_loop(*exact, min(_LOOP_FRAMES, -(-frames // 4))))
    calibrated = tuple(population(frames, seed + 2, roll, exact=False) for roll in (ROLL_RAD, 0.0))
    for rig, (judged, judged_flat) in {"exact": exact, "calibrated": calibrated}.items():
        for model in progress(MODELS, f"rungs, {rig} rig", len(MODELS)):
            rows += list(_estimator(model, rig, judged, judged_flat, repeats))
    return rows


def population(frames: int, seed: int, roll_rad: float, exact: bool = True) -> Judged:
    """Noisy frames without friction, rolls evenly up to the given one.

    Of a rig that is not exactly known several true ones take part, each one draw of its covariance away.
    """
    given, rng = Setup(exact=exact).rig(), np.random.default_rng(seed)
    antenna = given.antenna
    distance = rng.uniform(*REACH, frames) * antenna.length_m
    size = push_for_deflection(rng.uniform(*DEFLECTION_M, frames), distance, antenna.stiffness_Nm2)
    push = rolled(size * rng.choice([-1.0, 1.0], frames), rng.uniform(-roll_rad, roll_rad, frames))
    if exact:
        clean = scenes(given, distance, push)
        return Judged(clean.noisy(rng), bound(clean).std[:, 0])
    parts = []
    for own in np.array_split(np.arange(frames), min(TRUE_RIGS, frames)):
        truth = drawn_truth(given, rng)
        parts.append(scenes(truth, distance[own], push[own], made_by=rod_shapes, given=given).noisy(rng))
    return Judged(joined(parts), bound(scenes(given, distance, push, made_by=rod_shapes)).std[:, 0])


def _formula_alone(frames: int, seed: int, repeats: int) -> SpeedRow:
    """The two-point formulas on points that are on plane C already, every case."""
    rng, stiffness, length = np.random.default_rng(seed), 3.9e-3, 0.24
    contact, x = rng.uniform(0.02, 1.0, frames) * length, rng.uniform(0.005, 1.0, (frames, 2)) * length
    y = linear.deflection(x, contact[:, None], rng.normal(size=(frames, 1)), stiffness)
    spent = least_seconds(lambda: two_point_contact(x, y, stiffness, length), repeats)
    return SpeedRow("two points, formula alone", PAPER, "exact", frames, 1e6 * spent / frames, None, None, None, None)


def _baselines(judged: Judged, flat: Judged, seed: int, repeats: int) -> Iterator[SpeedRow]:
    rng = np.random.default_rng((seed, 1))
    every = np.arange(len(judged.scenes))
    ready, ready_flat = baselines(judged.scenes, rng), baselines(flat.scenes, rng)
    for name, solve in ready.items():
        family = LINE if name == "straight line" else PAPER
        off, off_flat = judged.errors(solve(every)), flat.errors(ready_flat[name](every))
        for which in (every[:1], every):
            spent = least_seconds(partial(solve, which), repeats) / len(which)
            yield SpeedRow(name, family, "exact", len(which), 1e6 * spent, *_errors(off, off_flat))


def _loop(judged: Judged, flat: Judged, frames: int) -> SpeedRow:
    timings, found = [], []
    for index in range(frames):
        begun = time.perf_counter()
        found.append(one_contact(judged.scenes, index)[0])
        timings.append(time.perf_counter() - begun)
    off_flat = flat.errors(np.array([one_contact(flat.scenes, index)[0] for index in range(frames)]))
    # each frame is timed once: the median leaves out what disturbed some
    off = judged.errors(np.array(found))
    return SpeedRow("elastica", LOOP, "exact", 1, 1e6 * float(np.median(timings)), *_errors(off, off_flat))


def _estimator(model: str, rig: str, judged: Judged, flat: Judged, repeats: int) -> Iterator[SpeedRow]:
    estimator = ContactEstimator(judged.scenes.rig, model=model, friction=0.0)

    def batch(frames: Scenes) -> np.ndarray:
        found = estimator.estimate_batch(
            frames.points_px, frames.moment_Nm, frames.pan_rad, frames.tilt_rad, sigma_px=frames.sigma_px
        )
        return found.distance_m

    off, off_flat = judged.errors(batch(judged.scenes)), flat.errors(batch(flat.scenes))
    single = min(_SINGLE_FRAMES, -(-len(judged.scenes) // 10))
    singles = [judged.scenes.picked(np.array([index])) for index in range(single)]
    each = [least_seconds(partial(batch, one), repeats) for one in singles]
    yield SpeedRow(model, ESTIMATOR, rig, 1, 1e6 * float(np.median(each)), *_errors(off, off_flat))
    together = least_seconds(partial(batch, judged.scenes), repeats) / len(judged.scenes)
    yield SpeedRow(model, ESTIMATOR, rig, len(judged.scenes), 1e6 * together, *_errors(off, off_flat))


def _errors(errors: np.ndarray, flat: np.ndarray) -> tuple[float | None, float | None, float | None, float]:
    """The last four columns of a row."""
    sizes = np.abs(errors[np.isfinite(errors)])
    typical = float(np.median(sizes) / NORMAL_QUARTILE) if len(sizes) else None
    return or_none(rms_known(errors)), or_none(rms_known(flat)), typical, float(np.isfinite(errors).mean())


STYLES = {PAPER: (AMBER, "o"), LINE: (VIOLET, "^"), LOOP: (GREY, "D"), ESTIMATOR: (GREEN, "s")}
"""Of each family of methods: its colour and mark."""


def speed_text(rows: Sequence[SpeedRow]) -> str:
    """The table, and how the loop compares with the batch."""
    title = (
        "200 points a frame; error: rms of the contact distance in standard deviations of the Cramér–Rao bound, at any "
        "roll up to 60° and\nwithin plane C; typical: from the median; least of several timings"
    )
    loop = {row.method: row.us_per_frame for row in rows if row.family == LOOP}
    batch = {row.method: row.us_per_frame for row in rows if row.family == ESTIMATOR and row.rig == "exact"}
    lines = [
        f"the loop takes {spent / batch[rung]:.0f} times as long as the batch on the same rung, {rung}"
        for rung, spent in loop.items()
        if rung in batch
    ]
    return "\n".join([table(rows, title), *lines])


def figure(rows: Sequence[SpeedRow]) -> Figure:
    """Time a frame over error, frame by frame and in a batch; nothing can be left of the bound at 1."""
    shown = [row for row in rows if row.of_bound is not None]
    drawn, every = panels(2, 2, (6, 6), sharex=True, sharey=True)
    for panel, many, title in zip(every, (False, True), ("one frame at a time", "in a batch"), strict=True):
        # the loop knows no batch: it is in both panels
        own = [row for row in shown if row.family == LOOP or (row.frames > 1) == many]
        panel.axvspan(0.5, 1.0, color=SHADE, lw=0)
        panel.axvline(1.0, color=INK, lw=1.2)
        for row in own:
            colour, mark = STYLES[row.family]
            face = colour if row.rig == "exact" else "none"
            panel.loglog(row.of_bound, row.us_per_frame, mark, color=colour, markerfacecolor=face, markersize=6)
        name_points(
            panel, [(r.method, r.of_bound or 0.0, r.us_per_frame, STYLES[r.family][0]) for r in own], character=0.015
        )
        label(panel, title, "rms error of the contact distance over the Cramér–Rao bound")
    every[0].set_xlim(0.7, 3.0 * max([row.of_bound or 0.0 for row in shown], default=1.0))
    every[0].set_ylim(top=5.0 * max([row.us_per_frame for row in shown], default=1.0))
    every[0].set_ylabel("time, µs per frame")
    legend(drawn, STYLES, "rig not exact")
    return drawn
