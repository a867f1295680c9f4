"""Hard cases one by one, and frames at random over everything: does the estimator raise, or claim what is far off?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.harness import column, or_none, rms, shares, table
from estimator import ContactEstimator
from estimator.contact.contacts import Contacts
from vbaa_calib.core.console import progress
from vbaa_calib.core.errors import InputError

from .hard_cases import CASES, Hard, Maker, with_outliers
from .scenes import Scenes, push_for_slope, rolled, scenes
from .setup import LENGTH_M, LENSES, Setup, drawn_truth
from .shapes import rod_shapes

_CLAIMED = ("ok", "tip_contact")


@dataclass(frozen=True)
class HardRow:
    """One hard case.

    Attributes
    ----------
    numbered : share of the frames that came with numbers. statuses : which there were, with their shares.
    l_rms_std, l_max_std, f_rms_std, f_max_std : errors of distance and of f_y, f_z in their own deviations.
    l_rms_mm : rms error of the distance; of an antenna of another size in mm for each 240 mm.
    condition : median condition number of the information matrix, scaled to unit deviations.
    exception : what the estimator raised instead, or nothing.
    """

    case: str = column("case")
    frames: int = column("frames", "d")
    numbered: float = column("numbers %", ".1f", 100)
    statuses: str = column("statuses")
    l_rms_std: float | None = column("l rms", ".2f", default=None)
    l_max_std: float | None = column("l max", ".2f", default=None)
    l_rms_mm: float | None = column("l mm", ".2f", default=None)
    f_rms_std: float | None = column("force rms", ".2f", default=None)
    f_max_std: float | None = column("max", ".2f", default=None)
    condition: float | None = column("condition", ".1e", default=None)
    exception: str = column("exception", default="")


def run(frames: int, seed: int, cases: dict[str, Maker] | None = None) -> list[HardRow]:
    """Every hard case with so many frames."""
    chosen = CASES if cases is None else cases
    rows = []
    for number, (name, make) in enumerate(progress(chosen.items(), "hard cases", len(chosen))):
        rows.append(judged(name, make(frames, np.random.default_rng((seed, number)))))
    return rows


def judged(name: str, hard: Hard) -> HardRow:
    """One case's row."""
    frames = hard.scenes
    try:
        found = estimated(hard)
    except Exception as error:  # whatever it is: that it was raised at all is the result
        what = f"{type(error).__name__}: {error}"
        return HardRow(name, len(frames), 0.0, "", exception=what)
    off_l, off_f = deviations(found, frames)
    size = frames.rig.antenna.length_m / LENGTH_M
    numbered = np.isfinite(found.distance_m)
    condition = found.numbers.condition[np.isfinite(found.numbers.condition)]
    return HardRow(
        case=name,
        frames=len(frames),
        numbered=float(numbered.mean()),
        statuses=shares(found.status),
        l_rms_std=or_none(rms(off_l[numbered])),
        l_max_std=_max(off_l[numbered]),
        l_rms_mm=or_none(rms(1e3 / size * (found.distance_m - frames.distance_m)[numbered])),
        f_rms_std=or_none(rms(off_f[numbered])),
        f_max_std=_max(off_f[numbered]),
        condition=float(np.median(condition)) if len(condition) else None,
    )


def estimated(hard: Hard, model: str = "auto", friction_std_rad: float = 0.0) -> Contacts:
    """The case's frames by the estimator, which knows the true deviation of a point."""
    frames = hard.scenes
    return ContactEstimator(frames.rig, model=model, friction=friction_std_rad).estimate_batch(
        hard.points_px,
        frames.moment_Nm if hard.with_moment else None,
        frames.pan_rad,
        frames.tilt_rad,
        sigma_px=frames.sigma_px,
    )


def deviations(found: Contacts, frames: Scenes) -> tuple[np.ndarray, np.ndarray]:
    """Errors of the distance (B,) and of f_y and f_z (B, 2) in their own deviations; NaN where nothing is claimed."""
    with np.errstate(divide="ignore", invalid="ignore"):
        off_l = (found.distance_m - frames.distance_m) / found.distance_std_m
        return off_l, ((found.force_N - frames.force_N) / found.force_std_N)[:, 1:]


def _max(values: np.ndarray) -> float | None:
    return float(np.max(np.abs(values))) if values.size else None


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

    Attributes
    ----------
    exceptions : frames that raise one by themselves, or 1 where only all together do; the chunk is not judged then.
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
    worst_std: float | None = None
    failure: str = ""


@dataclass(frozen=True, eq=False)
class Replayed:
    """A chunk's frames, as the estimator gets them: readings (B,) may be NaN, for None. `rig` in words."""

    scenes: Scenes
    readings_Nm: np.ndarray
    touched: np.ndarray
    rig: str


def hostile(count: int, seed: int, chunk: int = _CHUNK) -> list[HostileRow]:
    """So many frames, a chunk of them at a time."""
    sizes = [min(chunk, count - start) for start in range(0, count, chunk)]
    return [judged_at_random(seed, number, size) for number, size in enumerate(progress(sizes, "chunks", len(sizes)))]


def judged_at_random(seed: int, chunk: int, frames: int) -> HostileRow:
    """One chunk's row."""
    drawn = replay(seed, chunk, frames)
    try:
        found = estimated_at_random(drawn)
    except Exception as error:  # whatever it is: that it was raised at all is the result
        what = f"{type(error).__name__}: {error}"
        return HostileRow(seed, chunk, drawn.rig, frames, _raising(drawn), failure=what)
    claimed = np.isin(found.status, _CLAIMED)
    off = np.column_stack(deviations(found, drawn.scenes))
    off = np.where((claimed & drawn.touched)[:, None], np.abs(off), 0.0)
    ranked = np.where(np.isnan(off), np.inf, off)
    index, quantity = np.unravel_index(np.argmax(ranked), off.shape)
    any_claimed = bool((claimed & drawn.touched).any())
    return HostileRow(
        seed=seed,
        chunk=chunk,
        rig=drawn.rig,
        frames=frames,
        nan=int((claimed & ~complete(found)).sum()),
        claimed=int(claimed.sum()),
        beyond=int((off > _FAR_STD).any(axis=1).sum()),
        imagined=int((claimed & ~drawn.touched).sum()),
        statuses=shares(found.status),
        worst=f"{('l', 'f_y', 'f_z')[quantity]} of frame {index}" if any_claimed else "",
        worst_std=float(ranked[index, quantity]) if any_claimed else None,
    )


def _raising(drawn: Replayed) -> int:
    """How many frames of a chunk that raised do so alone; at least the one that must be there."""
    count = 0
    for index in range(len(drawn.touched)):
        own = np.array([index])
        try:
            estimated_at_random(
                Replayed(drawn.scenes.picked(own), drawn.readings_Nm[own], drawn.touched[own], drawn.rig)
            )
        except Exception:
            count += 1
    return max(count, 1)


def estimated_at_random(drawn: Replayed) -> Contacts:
    """The chunk by the estimator as it comes."""
    frames = drawn.scenes
    estimator = ContactEstimator(frames.rig, friction=FRICTION_STD_RAD)
    readings = [None if np.isnan(reading) else float(reading) for reading in drawn.readings_Nm]
    return estimator.estimate_batch(
        frames.points_px, readings, frames.pan_rad, frames.tilt_rad, sigma_px=frames.sigma_px
    )


_NUMBERS = (
    *("distance_m", "distance_std_m", "force_N", "force_std_N", "deflection_m", "point_antenna_m"),
    *("point_world_m", "covariance_world_m2", "force_world_N"),
)


def complete(found: Contacts) -> np.ndarray:
    """(B,) whether everything that a contact claims is a finite number, and no deviation negative."""
    finite = [np.isfinite(getattr(found, name)).reshape(len(found), -1).all(axis=1) for name in _NUMBERS]
    positive = (found.distance_std_m > 0.0) & (found.force_std_N[:, 1:] > 0.0).all(axis=1)
    return np.all(finite, axis=0) & positive


def replay(seed: int, chunk: int, frames: int = _CHUNK) -> Replayed:
    """The frames of one chunk again. Another number of frames makes others: give the row's own."""
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
    words_ = f"{setup.lens}, tilt {np.degrees(setup.tilt_rad):.0f}°, azimuth {np.degrees(setup.azimuth_rad):.0f}°"
    exact = "exact" if setup.exact else "calibrated"
    return Replayed(
        noisy, readings, touched, f"{words_}, {exact}, {len(clean.arclength_m)} points, {clean.sigma_px:.2f} px"
    )


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
        try:
            setup.rig()
        except InputError:
            continue
        return setup


def hard_text(rows: Sequence[HardRow]) -> str:
    """The hard cases."""
    title = (
        "hard cases; errors of the frames that came with numbers: rms and largest in their own deviations, rms in mm; "
        "condition: median, of the scaled information"
    )
    return table(rows, title)


def hostile_text(rows: Sequence[HostileRow]) -> str:
    """Totals over all chunks, and the worst frames with what replays them."""
    total = {name: sum(getattr(row, name) for row in rows) for name in _COUNTS}
    lines = [
        f"{total['frames']} frames at random over everything: {total['exceptions']} exceptions, {total['nan']} with "
        f"NaN in what is claimed, {total['claimed']} ok or tip_contact, of which {total['beyond']} beyond 6 deviations "
        f"({1e5 * total['beyond'] / max(total['claimed'], 1):.1f} in 100,000) and {total['imagined']} of a free antenna"
    ]
    worst = sorted((row for row in rows if row.worst_std is not None), key=lambda row: -(row.worst_std or 0.0))
    listed = [(f"{row.worst_std:.1f} deviations in {row.worst}", row) for row in worst[:10]]
    listed += [(row.failure, row) for row in rows if row.failure]
    lines += [f"    {what}: replay(seed={r.seed}, chunk={r.chunk}, frames={r.frames})" for what, r in listed]
    return "\n".join(lines)


_COUNTS = ("frames", "exceptions", "nan", "claimed", "beyond", "imagined")
