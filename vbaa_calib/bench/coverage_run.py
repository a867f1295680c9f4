"""Whether a calibration's uncertainty means what it says: many calibrations of rigs whose truth is known."""

from __future__ import annotations

import multiprocessing
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import cache

import numpy as np

from ..camera import CameraOnPlane
from ..console import progress
from ..errors import VbaaError
from .coverage_draw import Draw, draw
from .coverage_rigs import CoverageRig, coverage_rigs
from .coverage_solve import STAGES, Solved, solve
from .coverage_statistics import Errors, statistics

RATIO_GOAL = 0.15
COVERED_GOAL = (0.93, 0.97)
JUDGED = ("points on C", "camera pose", "EI")
"""The quantities that the goal is about."""
_PARAMETERS = {
    "camera turn": slice(0, 3),
    "camera place": slice(3, 6),
    "camera pose": slice(0, 6),
    "EI": slice(12, 13),
    "mass": slice(13, 14),
    "clamp": slice(6, 10),
    "bow": slice(10, 12),
    "clamp give": slice(14, 15),
    "gain": slice(15, 16),
    "offset": slice(16, 17),
    "pose, antenna, sensor": slice(0, 17),
}
"""Quantity → its rows among `RIG_PARAMETERS`."""
UNITS = {
    "points on C": ("mm", 1e3),
    "camera turn": ("mrad", 1e3),
    "camera place": ("mm", 1e3),
    "EI": ("%", 1e2),
    "mass": ("%", 1e2),
    "bow": ("1/m", 1.0),
    "gain": ("%", 1e2),
    "offset": ("mN·m", 1e3),
}
"""Quantity → unit, and its factor on SI; others mix units."""


@dataclass(frozen=True, eq=False)
class Outcome:
    """One draw's errors by quantity, or why there are none; what else is worth knowing of it."""

    errors: Mapping[str, Errors]
    seconds: tuple[float, ...] = ()
    noise_scale: float = np.nan
    failure: str = ""


@dataclass(frozen=True)
class Row:
    """One quantity on one rig. The numbers are those of `coverage_statistics.Statistics`.

    Attributes
    ----------
    judged : whether the goal is about it. met : within 15 % (`ratio` and `worst_ratio`) and 93 to 97 %.
    draws, failed : how many draws count, and how many could not be solved.
    unit : of `predicted_std`; empty, and no number, where units are mixed.
    """

    rig: str
    quantity: str
    judged: bool
    met: bool
    draws: int
    failed: int
    ratio: float
    ratio_error: float
    worst_ratio: float
    covered: float
    covered_error: float
    bias: float
    predicted_std: float | None
    unit: str


@dataclass(frozen=True)
class RigRow:
    """What holds for a rig as a whole: medians over its draws.

    Attributes
    ----------
    seconds_lens, seconds_plane, seconds_joint : of each stage. noise_scale : centreline noise found over the true one.
    failures : what stopped the draws that failed, each once.
    """

    rig: str
    draws: int
    failed: int
    seconds_lens: float
    seconds_plane: float
    seconds_joint: float
    noise_scale: float
    failures: tuple[str, ...]


def errors_of(given: Draw, solved: Solved) -> dict[str, Errors]:
    """Solved less true by quantity, with the predicted covariances."""
    pose = solved.T_antenna_camera.tangent_from(given.rig.T_antenna_camera)
    step = np.concatenate([pose, solved.parameters - given.truth])
    found = {"points on C": _points(given.rig, solved)}
    for name, which in _PARAMETERS.items():
        found[name] = Errors(step[None, which], solved.covariance[None, which, which])
    return found


def _points(rig: CoverageRig, solved: Solved) -> Errors:
    points, pixels = rig.points_on_c()
    layer = CameraOnPlane(solved.camera, solved.T_antenna_camera)
    jacobian = layer.calibration_jacobian(pixels)
    return Errors(layer.project(pixels)[0] - points, jacobian @ solved.plane_covariance @ np.swapaxes(jacobian, 1, 2))


@cache
def _rigs() -> list[CoverageRig]:
    return coverage_rigs()


def outcome(task: tuple[int, int, int]) -> Outcome:
    """One draw solved: (seed, number of the rig, number of the draw). Depends on nothing else."""
    given = draw(_rigs()[task[1]], task)
    try:
        solved = solve(given)
    except VbaaError as error:
        return Outcome({}, failure=str(error).splitlines()[0])
    found = errors_of(given, solved)
    if not all(np.isfinite(errors.errors).all() for errors in found.values()):
        return Outcome({}, failure="a pixel of C has no ray through the solved lens")
    return Outcome(found, solved.seconds, solved.noise_scale)


def outcomes(tasks: Sequence[tuple[int, int, int]], jobs: int) -> Iterator[Outcome]:
    """Of every task in order, by so many processes."""
    if jobs == 1:
        yield from map(outcome, tasks)
        return
    # torch does not survive a fork
    with ProcessPoolExecutor(jobs, mp_context=multiprocessing.get_context("spawn")) as pool:
        yield from pool.map(outcome, tasks, chunksize=4)


def run(draws: int, seed: int, jobs: int = 1, chosen: Sequence[int] | None = None) -> tuple[list[Row], list[RigRow]]:
    """Every quantity on every rig (or those of the numbers chosen), and the rigs themselves."""
    rigs = list(range(len(_rigs()))) if chosen is None else list(chosen)
    tasks = [(seed, rig, number) for rig in rigs for number in range(draws)]
    found = list(progress(outcomes(tasks, jobs), "draws", len(tasks)))
    rows, rig_rows = [], []
    for place, rig in enumerate(rigs):
        own = found[place * draws : (place + 1) * draws]
        rows += _rows(_rigs()[rig].name, own)
        rig_rows.append(_rig_row(_rigs()[rig].name, own))
    return rows, rig_rows


def _rows(rig: str, found: Sequence[Outcome]) -> list[Row]:
    good = [one.errors for one in found if not one.failure]
    if len(good) < 2:
        return []
    rows = []
    for quantity in good[0]:
        numbers = statistics([errors[quantity] for errors in good])
        unit, factor = UNITS.get(quantity, ("", 0.0))
        low, high = COVERED_GOAL
        near = all(abs(ratio - 1.0) <= RATIO_GOAL for ratio in (numbers.ratio, numbers.worst_ratio))
        rows.append(
            Row(
                rig=rig,
                quantity=quantity,
                judged=quantity in JUDGED,
                met=near and low <= numbers.covered <= high,
                draws=len(good),
                failed=len(found) - len(good),
                ratio=numbers.ratio,
                ratio_error=numbers.ratio_error,
                worst_ratio=numbers.worst_ratio,
                covered=numbers.covered,
                covered_error=numbers.covered_error,
                bias=numbers.bias,
                predicted_std=factor * numbers.predicted_std if unit else None,
                unit=unit,
            )
        )
    return rows


def _rig_row(rig: str, found: Sequence[Outcome]) -> RigRow:
    good = [one for one in found if not one.failure]
    seconds = np.median([one.seconds for one in good], axis=0) if good else np.full(len(STAGES), np.nan)
    return RigRow(
        rig=rig,
        draws=len(good),
        failed=len(found) - len(good),
        seconds_lens=float(seconds[0]),
        seconds_plane=float(seconds[1]),
        seconds_joint=float(seconds[2]),
        noise_scale=float(np.median([one.noise_scale for one in good])) if good else np.nan,
        failures=tuple(sorted({one.failure for one in found if one.failure})),
    )
