"""The estimator's hard cases judged one by one: errors in its own deviations, statuses, conditions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimator import ContactEstimator
from estimator.contacts import Contacts

from ..console import progress
from .averages import or_none, rms
from .estimator_hard_cases import CASES, Hard, Maker
from .estimator_scenes import Scenes
from .estimator_setup import LENGTH_M
from .estimator_statistics import words

CLAIMED = ("ok", "tip_contact")


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

    case: str
    frames: int
    numbered: float
    statuses: str
    l_rms_std: float | None
    l_max_std: float | None
    l_rms_mm: float | None
    f_rms_std: float | None
    f_max_std: float | None
    condition: float | None
    exception: str = ""


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
        return HardRow(name, len(frames), 0.0, "", None, None, None, None, None, None, what)
    off_l, off_f = deviations(found, frames)
    size = frames.rig.antenna.length_m / LENGTH_M
    numbered = np.isfinite(found.distance_m)
    condition = found.numbers.condition[np.isfinite(found.numbers.condition)]
    return HardRow(
        case=name,
        frames=len(frames),
        numbered=float(numbered.mean()),
        statuses=words(found.status),
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
