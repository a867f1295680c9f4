"""`vbaa bench coverage`: do whole calibrations know how wrong they are?"""

from __future__ import annotations

import multiprocessing
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.figures import AMBER, GREEN, GREY, SHADE, VIOLET, label, legend, panels
from benchmarks.harness import Findings, Options, column, table
from vbaa_calib.camera import CameraOnPlane
from vbaa_calib.core.console import progress
from vbaa_calib.core.errors import VbaaError

from .rigs import CoverageRig, Draw, coverage_rigs, draw
from .solve import Errors, Solved, solve, statistics

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_RATIO_GOAL = 0.15
COVERED_GOAL = (0.93, 0.97)
JUDGED = ("points on C", "camera pose", "EI")
"""The quantities that the goal is about."""
_POINTS = "points on C"
_QUANTITIES = {
    _POINTS: (slice(0), "mm", 1e3),
    "camera turn": (slice(0, 3), "mrad", 1e3),
    "camera place": (slice(3, 6), "mm", 1e3),
    "camera pose": (slice(0, 6), "", 0.0),
    "EI": (slice(12, 13), "%", 1e2),
    "mass": (slice(13, 14), "%", 1e2),
    "clamp": (slice(6, 10), "", 0.0),
    "bow": (slice(10, 12), "1/m", 1.0),
    "clamp give": (slice(14, 15), "", 0.0),
    "gain": (slice(15, 16), "%", 1e2),
    "offset": (slice(16, 17), "mN·m", 1e3),
    "pose, antenna, sensor": (slice(0, 17), "", 0.0),
}
"""Name → rows among `RIG_PARAMETERS`, unit, and its factor on SI; none where units are mixed."""


@dataclass(frozen=True)
class Row:
    """One quantity on one rig, over the draws.

    judged : whether the goal is about it. met : within 15 % (`ratio` and `worst_ratio`) and 93 to 97 %.
    draws, failed : how many draws count, and how many could not be solved.
    ratio : sampled over predicted standard deviation, in the mean square over the quantity's numbers. ratio_error : its
        standard error. worst_ratio : that of the number whose ratio is furthest from 1.
    covered : share of the 95 % regions that hold the truth. covered_error : its standard error.
    bias : mean error in predicted standard deviations, of the number where it is largest; its standard error is
        1/√draws where only noise is at work.
    predicted_std : typical predicted standard deviation (rms over draws and numbers); None, and no unit, where units
        are mixed.
    """

    rig: str = column("rig")
    quantity: str = column("quantity")
    judged: bool = column()
    met: bool = column()
    draws: int = column()
    failed: int = column()
    ratio: float = column("ratio", ".3f")
    ratio_error: float = column("±", ".3f")
    worst_ratio: float = column("worst", ".3f")
    covered: float = column("covered %", ".1f", 100)
    covered_error: float = column("±", ".1f", 100)
    bias: float = column("bias", ".2f")
    predicted_std: float | None = column("predicted", ".3g")
    unit: str = column("unit")


def errors_of(given: Draw, solved: Solved) -> dict[str, Errors]:
    """Solved less true by quantity, with the predicted covariances."""
    pose = solved.T_antenna_camera.tangent_from(given.rig.T_antenna_camera)
    step = np.concatenate([pose, solved.parameters - given.truth])
    points, pixels = given.rig.points_on_c()
    layer = CameraOnPlane(solved.camera, solved.T_antenna_camera)
    jacobian = layer.calibration_jacobian(pixels)
    of_points = jacobian @ solved.plane_covariance @ np.swapaxes(jacobian, 1, 2)
    found = {
        name: Errors(step[None, own], solved.covariance[None, own, own]) for name, (own, *_) in _QUANTITIES.items()
    }
    return found | {_POINTS: Errors(layer.project(pixels)[0] - points, of_points)}


@cache
def _rigs() -> list[CoverageRig]:
    return coverage_rigs()


def outcome(task: tuple[int, int, int]) -> Mapping[str, Errors] | str:
    """One draw solved: (seed, number of the rig, number of the draw). Depends on nothing else.

    Its errors by quantity, or why there are none.
    """
    given = draw(_rigs()[task[1]], task)
    try:
        found = errors_of(given, solve(given))
    except VbaaError as error:
        return str(error).splitlines()[0]
    known = all(np.isfinite(errors.errors).all() for errors in found.values())
    return found if known else "a pixel of C has no ray through the solved lens"


def outcomes(tasks: Sequence[tuple[int, int, int]], jobs: int) -> Iterator[Mapping[str, Errors] | str]:
    """Of every task in order, by so many processes."""
    if jobs == 1:
        yield from map(outcome, tasks)
        return
    # torch does not survive a fork
    with ProcessPoolExecutor(jobs, mp_context=multiprocessing.get_context("spawn")) as pool:
        yield from pool.map(outcome, tasks, chunksize=4)


def run(draws: int, seed: int, jobs: int = 1, chosen: Sequence[int] | None = None) -> tuple[list[Row], list[str]]:
    """Every quantity on every rig (or those of the numbers chosen), and a line for each rig of which draws failed."""
    rigs = list(range(len(_rigs()))) if chosen is None else list(chosen)
    tasks = [(seed, rig, number) for rig in rigs for number in range(draws)]
    found = list(progress(outcomes(tasks, jobs), "draws", len(tasks)))
    rows, failed = list[Row](), []
    for place, rig in enumerate(rigs):
        name, own = _rigs()[rig].name, found[place * draws : (place + 1) * draws]
        failures = [one for one in own if isinstance(one, str)]
        rows += _rows(name, [one for one in own if not isinstance(one, str)], len(failures))
        if failures:
            failed.append(f"{name}, {len(failures)} of {draws} failed: {'; '.join(sorted(set(failures)))}")
    return rows, failed


def _rows(rig: str, good: Sequence[Mapping[str, Errors]], failed: int) -> Iterator[Row]:
    for quantity in good[0] if len(good) > 1 else ():
        numbers = statistics([errors[quantity] for errors in good])
        _, unit, factor = _QUANTITIES[quantity]
        near = all(abs(numbers[name] - 1.0) <= _RATIO_GOAL for name in ("ratio", "worst_ratio"))
        numbers["predicted_std"] = factor * numbers["predicted_std"] if unit else None
        met = near and COVERED_GOAL[0] <= numbers["covered"] <= COVERED_GOAL[1]
        yield Row(rig, quantity, quantity in JUDGED, met, len(good), failed, **numbers, unit=unit)


_SHOWN = {"points on C": GREEN, "camera pose": AMBER, "EI": VIOLET, "pose, antenna, sensor": GREY}
"""Quantities of the figure → colour."""


def as_text(rows: Sequence[Row], failed: Sequence[str], draws: int) -> str:
    """The table for people."""
    title = (
        f"{draws} draws a rig; ratio: sampled over predicted standard deviation, then that of the worst number of the "
        "quantity;\ncovered: 95 % regions that hold the truth; bias: largest mean error, in predicted deviations; "
        f"goal: ratios within {_RATIO_GOAL:.0%} and {COVERED_GOAL[0]:.0%} to {COVERED_GOAL[1]:.0%}"
    )
    goal = {"goal": lambda row: ("met" if row.met else "missed") if row.judged else ""}
    return "\n".join([table(rows, title, 1, goal) if rows else title, *failed])


def figure(rows: Sequence[Row], draws: int) -> Figure:
    """Ratio and coverage of the main quantities, rig by rig, with two standard errors and the goal's band."""
    names = list(dict.fromkeys(row.rig for row in rows))
    drawn, (left, right) = panels(2, 2, (5.5, 1.3 + 0.75 * len(names)), sharey=True)
    left.axvspan(1 - _RATIO_GOAL, 1 + _RATIO_GOAL, color=SHADE)
    right.axvspan(*(100 * share for share in COVERED_GOAL), color=SHADE)
    left.axvline(1.0, color=GREY, lw=0.8)
    right.axvline(95.0, color=GREY, lw=0.8)
    for shift, (quantity, colour) in enumerate(_SHOWN.items()):
        own = [row for row in rows if row.quantity == quantity]
        y = [names.index(row.rig) + 0.18 * (shift - 1.5) for row in own]
        for panel, name, scale in ((left, "ratio", 1), (right, "covered", 100)):
            values, errors = ([scale * getattr(row, f"{name}{end}") for row in own] for end in ("", "_error"))
            panel.errorbar(values, y, xerr=2 * np.array(errors), fmt="o", color=colour, markersize=4, lw=1.2)
    left.set_yticks(range(len(names)), names, fontsize=9)
    left.invert_yaxis()
    label(left, x="sampled over predicted standard deviation")
    label(right, x="95 % regions that hold the truth, %")
    legend(drawn, {quantity: (colour, "o") for quantity, colour in _SHOWN.items()})
    drawn.suptitle(f"{draws} noise draws a rig; bars: two standard errors; grey: the goal", fontsize=10)
    return drawn


def measure(options: Options) -> Findings:
    """Every quantity on every rig; a draw is one calibration."""
    rows, failed = run(options.draws, options.seed, options.jobs)
    judged = [row for row in rows if row.judged]
    ratios = [row.ratio for row in judged]
    return Findings(
        as_text(rows, failed, options.draws),
        {"coverage.csv": rows},
        {"coverage.png": lambda: figure(rows, options.draws)},
        {"rows": rows},
        f"goal met by {sum(row.met for row in judged)} of {len(judged)}; sampled over predicted deviation "
        f"{min(ratios):.2f} to {max(ratios):.2f}"
        if judged
        else "no rig could be calibrated twice",
    )
