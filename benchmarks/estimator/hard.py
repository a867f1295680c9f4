"""Hard cases one by one, and frames at random over everything: does the estimator raise, or claim what is far off?"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np

from benchmarks.harness import column, largest, median, rms, row_of, shares, table
from estimator.contact.contacts import Contacts
from vbaa_calib.core.console import progress
from vbaa_calib.core.errors import InputError
from vbaa_calib.geometry import Pose
from vbaa_calib.rig import Rig

from .scenes import POINTS as FRAME_POINTS
from .scenes import Scenes, push_for_deflection, push_for_slope, rod_shapes, rolled, scenes
from .setup import ACROSS, LENGTH_M, LENSES, SIGMA_PX, TOWARDS_CLAMP, Setup, drawn_truth, looking_pose

Rng = np.random.Generator
Maker = Callable[[int, Rng], Scenes]
"""Makes noisy frames of one case; a moment is NaN where the case has no sensor."""
_UPRIGHT = Setup()
_ORDINARY_M = 0.006
"""Deflection at the contact where a case is hard for something else."""


def _touched(
    rig: Rig, rng: Rng, count: int, reach: tuple[float, float] = (0.3, 0.8), deflection_m: float = _ORDINARY_M
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Distances (B,), size of the pushes (B,) and rolls (B,)."""
    antenna = rig.antenna
    distance = rng.uniform(*reach, count) * antenna.length_m
    deflection = np.minimum(deflection_m * antenna.length_m / LENGTH_M, 0.15 * distance)
    return distance, push_for_deflection(deflection, distance, antenna.stiffness_Nm2), rng.uniform(-1.0, 1.0, count)


def _ordinary(count: int, rng: Rng, rig: Rig | None = None, roll_rad: float | None = None, **touch: Any) -> Scenes:
    rig = rig or _UPRIGHT.rig()
    distance, size, roll = _touched(rig, rng, count, **touch)
    return scenes(rig, distance, rolled(size, roll if roll_rad is None else roll_rad)).noisy(rng)


def _edge_on(count: int, rng: Rng) -> Scenes:
    """The camera's centre within 0.02 rad of the deformation plane."""
    rig = Setup(tilt_rad=np.radians(40.0), azimuth_rad=ACROSS).rig()
    centre = rig.T_antenna_camera.translation_m
    distance, size, _ = _touched(rig, rng, count)
    roll = np.arctan2(centre[2], centre[1]) + rng.uniform(-0.02, 0.02, count)
    return scenes(rig, distance, rolled(size, roll)).noisy(rng)


def _huge_load(count: int, rng: Rng) -> Scenes:
    rig = Setup(swing_m=0.15).rig()
    distance, _, roll = _touched(rig, rng, count)
    size = push_for_slope(np.radians(rng.uniform(45.0, 75.0, count)), distance, rig.antenna.stiffness_Nm2)
    return scenes(rig, distance, rolled(size, roll)).noisy(rng)


def _coincident(count: int, rng: Rng) -> Scenes:
    frames = _ordinary(count, rng)
    one = np.repeat(frames.points_px[:, 150:151], frames.points_px.shape[1], axis=1)
    return replace(frames, points_px=one + rng.normal(0.0, SIGMA_PX, one.shape))


def _with(rig_of: Callable[[], Rig] = _UPRIGHT.rig, **how: Any) -> Maker:
    """Ordinary frames, but for the rig, the roll, the reach or the deflection."""
    return lambda count, rng: _ordinary(count, rng, rig_of(), **how)


def _no_sensor(setup: Setup) -> Maker:
    return lambda count, rng: replace(_ordinary(count, rng, setup.rig()), moment_Nm=np.full(count, np.nan))


def _single(count: int, rng: Rng) -> Scenes:
    frames = _ordinary(count, rng)
    return replace(frames, points_px=frames.points_px.astype(np.float32))


def _without(hidden: Callable[[Scenes, Rng], np.ndarray]) -> Maker:
    """Ordinary frames without the points (N,) or (B, N) that a function names."""

    def make(count: int, rng: Rng) -> Scenes:
        frames = _ordinary(count, rng)
        return replace(frames, points_px=np.where(hidden(frames, rng)[..., None], np.nan, frames.points_px))

    return make


def _few_points(points: int) -> Maker:
    last = FRAME_POINTS - 1
    return _without(lambda *_: ~np.isin(np.arange(last + 1), np.linspace(20, last, points).astype(int)))


CASES: dict[str, Maker] = {
    "l → 0": _with(reach=(0.01, 0.05)),
    "l → L": _with(reach=(0.97, 1.0)),
    "δ → 0": _with(deflection_m=3e-5),
    "all points in one place": _coincident,
    "points before the contact only": _without(lambda frames, _: frames.arclength_m > frames.distance_m[:, None]),
    "points beyond the contact only": _without(lambda frames, _: frames.arclength_m < frames.distance_m[:, None]),
    "ξ = 90°, upright camera": _with(roll_rad=np.pi / 2),
    "camera inclined by 87°": _with(Setup(tilt_rad=np.radians(87.0)).rig),
    "camera's centre almost in 𝒟": _edge_on,
    "camera 60 mm away": _with(
        lambda: replace(_UPRIGHT.rig(), T_antenna_camera=looking_pose(0.2, TOWARDS_CLAMP, 0.06))
    ),
    "τ = 0": _with(roll_rad=0.0),
    "no sensor, camera at 45°": _no_sensor(Setup(tilt_rad=np.radians(45.0))),
    "no sensor, upright camera": _no_sensor(_UPRIGHT),
    "slopes of 45 to 75°": _huge_load,
    "2 points": _few_points(2),
    "3 points": _few_points(3),
    "5 points": _few_points(5),
    "40 % missing": _without(lambda frames, rng: rng.random(frames.points_px.shape[:2]) < 0.4),
    "20 % outliers": lambda count, rng: with_outliers(_ordinary(count, rng), 0.2, rng),
    "float32 pixels": _single,
    "1000 times larger": _with(lambda: resized(_UPRIGHT.rig(), 1e3)),
    "1000 times smaller": _with(lambda: resized(_UPRIGHT.rig(), 1e-3)),
}
"""Name → what makes its frames."""


def with_outliers(frames: Scenes, share: np.ndarray | float, rng: Rng) -> Scenes:
    """Frames of whose points a share, () or (B, 1), lies up to 50 px off along u and v."""
    points = frames.points_px
    off = rng.uniform(-50.0, 50.0, points.shape)
    return replace(frames, points_px=np.where((rng.random(points.shape[:2]) < share)[..., None], points + off, points))


def resized(rig: Rig, factor: float) -> Rig:
    """A weightless rig in which all lengths are multiplied, forces stay, and so does the picture."""
    antenna, sensor, pose = rig.antenna, rig.moment_sensor, rig.T_antenna_camera
    parameters = antenna.parameters.copy()
    parameters[6] += 2.0 * np.log(factor)
    length, diameter = factor * antenna.length_m, factor * antenna.diameter_m
    return replace(
        rig,
        T_antenna_camera=Pose(pose.rotation, factor * pose.translation_m),
        antenna=replace(antenna, length_m=length, diameter_m=diameter, parameters=parameters),
        moment_sensor=replace(sensor, std_Nm=factor * sensor.std_Nm),
    )


@dataclass(frozen=True)
class HardRow:
    """One hard case.

    numbered : share of the frames that came with numbers. statuses : which there were, with their shares.
    l_rms_std, l_max_std, f_rms_std, f_max_std : errors of distance and of f_y, f_z in their own deviations.
    l_rms_mm : rms error of the distance; of an antenna of another size in mm for each 240 mm.
    condition : median condition number of the information matrix, scaled to unit deviations.
    exception : what the estimator raised instead, or nothing.
    """

    case: str = column("case")
    frames: int = column("frames", "d")
    numbered: float = column("numbers %", ".1f", 100, lambda d: float(d.numbered.mean()))
    statuses: str = column("statuses", of=lambda d: shares(d.status))
    l_rms_std: float = column("l rms", ".2f", of=lambda d: rms(d.off_l), default=np.nan)
    l_max_std: float = column("l max", ".2f", of=lambda d: largest(d.off_l), default=np.nan)
    l_rms_mm: float = column("l mm", ".2f", of=lambda d: rms(d.miss_mm), default=np.nan)
    f_rms_std: float = column("force rms", ".2f", of=lambda d: rms(d.off_f), default=np.nan)
    f_max_std: float = column("max", ".2f", of=lambda d: largest(d.off_f), default=np.nan)
    condition: float = column("condition", ".1e", of=lambda d: median(d.condition), default=np.nan)
    exception: str = column("exception", default="")


def run(frames: int, seed: int) -> list[HardRow]:
    """Every hard case with so many frames."""
    each = enumerate(progress(CASES.items(), "hard cases", len(CASES)))
    return [_judged(name, make(frames, np.random.default_rng((seed, number)))) for number, (name, make) in each]


def _judged(name: str, frames: Scenes) -> HardRow:
    try:
        found = frames.estimated()
    except Exception as error:  # whatever it is: that it was raised at all is the result
        return HardRow(name, len(frames), 0.0, "", exception=f"{type(error).__name__}: {error}")
    numbered, condition = np.isfinite(found.distance_m), found.numbers.condition
    off_l, off_f = (off[numbered] for off in deviations(found, frames))
    per_mm = 1e3 * LENGTH_M / frames.rig.antenna.length_m
    judged = SimpleNamespace(
        numbered=numbered,
        status=found.status,
        off_l=off_l,
        off_f=off_f,
        miss_mm=per_mm * (found.distance_m - frames.distance_m)[numbered],
        condition=condition[np.isfinite(condition)],
    )
    return row_of(HardRow, judged, name, len(frames))


def deviations(found: Contacts, frames: Scenes) -> tuple[np.ndarray, np.ndarray]:
    """Errors of the distance (B,) and of f_y and f_z (B, 2) in their own deviations; NaN where nothing is claimed."""
    with np.errstate(divide="ignore", invalid="ignore"):
        off_l = (found.distance_m - frames.distance_m) / found.distance_std_m
        return off_l, ((found.force_N - frames.force_N) / found.force_std_N)[:, 1:]


_CHUNK = 1000
_FAR_STD = 6.0
FRICTION_STD_RAD = 0.2
POINTS = (5, 200)
_NOISE_PX = (0.02, 1.0)
FREE, _NO_READING, _HOLED, _FOULED = 0.1, 0.2, 0.3, 0.1
"""Shares of frames without contact, without a moment, with up to 60 % of the points missing, with 20 % outliers."""


@dataclass(frozen=True)
class HostileRow:
    """One chunk: one rig, one deviation of the points; `replay` makes it again from seed, chunk and frames.

    exceptions : 1 where the estimator raised one; the chunk is not judged then.
    nan : frames with NaN among what they claim. claimed : ok or tip_contact.
    beyond : claimed frames with the distance or a force component more than 6 deviations off. imagined : claimed
        frames of a free antenna. statuses : which there were, with their shares.
    worst, worst_std : the frame and quantity furthest off, in its own deviations. failure : what was raised.
    """

    seed: int
    chunk: int
    rig: str
    frames: int
    exceptions: int = 0
    nan: int = 0
    claimed: int = 0
    beyond: int = 0
    imagined: int = 0
    statuses: str = ""
    worst: str = ""
    worst_std: float = np.nan
    failure: str = ""


def hostile(count: int, seed: int) -> list[HostileRow]:
    """So many frames, a chunk of them at a time."""
    starts = progress(range(0, count, _CHUNK), "chunks", -(-count // _CHUNK))
    return [judged_at_random(seed, start // _CHUNK, min(_CHUNK, count - start)) for start in starts]


def judged_at_random(seed: int, chunk: int, frames: int) -> HostileRow:
    """One chunk's row."""
    drawn, rig = replay(seed, chunk, frames)
    try:
        found = drawn.estimated(friction_std_rad=FRICTION_STD_RAD)
    except Exception as error:  # whatever it is: that it was raised at all is the result
        return HostileRow(seed, chunk, rig, frames, exceptions=1, failure=f"{type(error).__name__}: {error}")
    claimed, touched = np.isin(found.status, ("ok", "tip_contact")), drawn.touches.push_N.any(axis=1)
    judged = claimed & touched
    off = np.where(judged[:, None], np.abs(np.column_stack(deviations(found, drawn))), 0.0)
    unclaimed = np.isnan(found.force_N) & np.array([False, True, True])
    ranked = np.where(unclaimed, 0.0, np.where(np.isnan(off), np.inf, off))
    index, quantity = np.unravel_index(np.argmax(ranked), off.shape)
    return HostileRow(
        *(seed, chunk, rig, frames),
        nan=int((claimed & ~complete(found, drawn.moment_Nm)).sum()),
        claimed=int(claimed.sum()),
        beyond=int((off > _FAR_STD).any(axis=1).sum()),
        imagined=int((claimed & ~touched).sum()),
        statuses=shares(found.status),
        worst=f"{('l', 'f_y', 'f_z')[quantity]} of frame {index}" if judged.any() else "",
        worst_std=float(ranked[index, quantity]) if judged.any() else np.nan,
    )


_PLACE = ("distance_m", "distance_std_m", "point_antenna_m", "point_world_m", "covariance_world_m2")
_FORCE = ("force_N", "force_std_N", "deflection_m", "force_world_N")


def complete(found: Contacts, readings: np.ndarray) -> np.ndarray:
    """(B,) whether everything that a contact claims is a finite number, and no deviation negative. The force is claimed
    by every frame with a reading (B,)."""

    def known(name: str) -> np.ndarray:
        return np.isfinite(getattr(found, name)).reshape(len(found), -1)

    place = np.all([known(name).all(axis=1) for name in _PLACE], axis=0) & (found.distance_std_m > 0.0)
    force = np.all([known(name).all(axis=1) for name in _FORCE], axis=0) | np.isnan(readings)
    alike = (known("force_N") == known("force_std_N")).all(axis=1)
    return place & force & alike & ~(found.force_std_N[:, 1:] <= 0.0).any(axis=1)


def replay(seed: int, chunk: int, frames: int = _CHUNK) -> tuple[Scenes, str]:
    """The frames of one chunk again, without a reading NaN, and their rig in words. Another number of frames makes
    others: give the row's own."""
    rng = np.random.default_rng((seed, chunk))
    setup = _setup(rng)
    given = setup.rig()
    true = given if setup.exact else drawn_truth(given, rng)
    antenna = given.antenna
    distance = antenna.length_m * rng.uniform(0.02, 1.0, frames)
    slope = np.radians(35.0) * 10.0 ** rng.uniform(-3.0, 0.0, frames)
    touched = rng.random(frames) >= FREE
    push = rolled(touched * push_for_slope(slope, distance, antenna.stiffness_Nm2), rng.uniform(-np.pi, np.pi, frames))
    clean = scenes(
        true,
        distance,
        push,
        np.clip(FRICTION_STD_RAD * rng.normal(size=frames), -1.0, 1.0),
        made_by=rod_shapes,
        pan_rad=rng.uniform(-1.5, 1.5, frames),
        tilt_rad=rng.uniform(-1.5, 1.5, frames),
        sigma_px=float(np.exp(rng.uniform(*np.log(_NOISE_PX)))),
        points=int(rng.integers(*POINTS, endpoint=True)),
        given=given,
    )
    noisy = clean.noisy(rng)
    fouled = np.where(rng.random(frames) < _FOULED, rng.uniform(0.0, 0.2, frames), 0.0)
    noisy = with_outliers(noisy, fouled[:, None], rng)
    holed = np.where(rng.random(frames) < _HOLED, rng.uniform(0.0, 0.6, frames), 0.0)
    lost = rng.random(noisy.points_px.shape[:2]) < holed[:, None]
    noisy = replace(noisy, points_px=np.where(lost[..., None], np.nan, noisy.points_px))
    readings = np.where(rng.random(frames) < _NO_READING, np.nan, noisy.moment_Nm)
    words = (
        f"{setup.lens}, tilt {np.degrees(setup.tilt_rad):.0f}°, azimuth {np.degrees(setup.azimuth_rad):.0f}°, "
        f"{'exact' if setup.exact else 'calibrated'}, {len(clean.arclength_m)} points, {clean.sigma_px:.2f} px"
    )
    return replace(noisy, moment_Nm=readings), words


def _setup(rng: np.random.Generator) -> Setup:
    """A rig at random; drawn again where the antenna does not fit into the picture."""
    while True:
        setup = Setup(
            lens=str(rng.choice(list(LENSES))),
            tilt_rad=float(np.radians(rng.uniform(0.0, 85.0))),
            azimuth_rad=float(rng.uniform(-np.pi, np.pi)),
            image_size=(1280, 720) if rng.random() < 0.7 else (512, 512),
            swing_m=float(rng.uniform(0.02, 0.08)),
            real=bool(rng.random() < 0.7),
            exact=bool(rng.random() < 0.3),
        )
        with suppress(InputError):
            setup.rig()
            return setup


def hard_text(rows: Sequence[HardRow]) -> str:
    """The hard cases."""
    errors = "errors of the frames that came with numbers: rms and largest in their own deviations, rms in mm"
    return table(rows, f"hard cases; {errors}; condition: median, of the scaled information")


def hostile_text(rows: Sequence[HostileRow]) -> str:
    """Totals over all chunks, and the worst frames with what replays them."""
    counted = ("frames", "exceptions", "nan", "claimed", "beyond", "imagined")
    total = {name: sum(getattr(row, name) for row in rows) for name in counted}
    lines = [
        f"{total['frames']} frames at random over everything: {total['exceptions']} exceptions, {total['nan']} with "
        f"NaN in what is claimed, {total['claimed']} ok or tip_contact, of which {total['beyond']} beyond 6 deviations "
        f"({1e5 * total['beyond'] / max(total['claimed'], 1):.1f} in 100,000) and {total['imagined']} of a free antenna"
    ]
    worst = sorted((row for row in rows if np.isfinite(row.worst_std)), key=lambda row: -row.worst_std)
    listed = [(f"{row.worst_std:.1f} deviations in {row.worst}", row) for row in worst[:10]]
    listed += [(row.failure, row) for row in rows if row.failure]
    lines += [f"    {what}: replay(seed={r.seed}, chunk={r.chunk}, frames={r.frames})" for what, r in listed]
    return "\n".join(lines)
