"""`vbaa bench estimator`: contacts against the Cramér–Rao bound, hard cases, random scenes.

Matched scenes over lenses, camera tilts, rolls and contact distances: each cell against its bound.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from benchmarks.harness import Draws, Findings, Options, column, covered, mean, rms, rms_known, row_of, table
from estimator.contact.contacts import Contacts
from vbaa_calib.core.console import progress
from vbaa_calib.rig import Rig

from . import hard
from .bound import bound
from .scenes import STEEPEST_RAD, Scenes, push_for_deflection, push_for_slope, rolled, scenes
from .setup import LENSES, SIGMA_PX, Setup

QUANTITIES = ("l", "f_y", "f_z")
_REGION = 0.95
_MATCHED = "elastica"
"""The rung without error on the grid's straight, weightless antenna: the grid is to show noise, not the ladder."""
_REACHES = (0.1, 0.25, 0.5, 0.75, 0.95)
_TILTS_DEG = (0.0, 30.0, 60.0, 75.0)
_ROLLS_DEG = (0.0, 40.0, 80.0)
_LEAST_DEFLECTION_SIGMA = 20.0
LARGEST_BOUND = 0.05
"""Of the contact distance."""
FROM_TIP_STD = 6.0
"""The bound does not hold at the border l ≤ L: so many deviations the contact must be away from it."""
_HARDER = 1.25 ** np.arange(26)
"""Deflections that are tried, over the least one."""


@dataclass(frozen=True)
class CellRow:
    """One quantity in one cell. Shares and statistics are NaN in a cell that was not run, which `left_out` explains.

    tilt_deg, azimuth_deg : of the camera, see `setup.Setup`. reach : contact distance over length.
    bound_l : the distance's bound over the distance. of_bound : rms error over the bound's. bias : mean error over the
    sampled standard deviation. covered : share of the 95 % intervals that hold the truth.
    """

    lens: str
    tilt_deg: float
    azimuth_deg: float
    roll_deg: float
    reach: float
    deflection_m: float
    bound_l: float
    left_out: str
    draws: int
    ok: float
    tip_contact: float
    without_numbers: float
    quantity: str
    of_bound: float
    bias: float
    covered: float

    @property
    def cell(self) -> str:
        """In words."""
        return f"{self.lens}, tilt {self.tilt_deg:.0f}°, roll {self.roll_deg:.0f}°, l/L {self.reach:g}"


@dataclass(frozen=True, eq=False)
class Plan:
    """The K cells of one rig: reach, roll_deg, deflection_m (K,), push_N (K, 2), bound_std (K, 3) of l, f_y and f_z.

    `left_out` (K,) says why a cell is not to be run, or nothing.
    """

    reach: np.ndarray
    roll_deg: np.ndarray
    push_N: np.ndarray
    deflection_m: np.ndarray
    bound_std: np.ndarray
    left_out: tuple[str, ...]


def run(
    draws: int,
    seed: int,
    *,
    model: str = "auto",
    lenses: Sequence[str] = tuple(LENSES),
    tilts_deg: Sequence[float] = _TILTS_DEG,
) -> list[CellRow]:
    """Every cell, each with so many noise draws, without friction."""
    rows: list[CellRow] = []
    rigs = list(product(lenses, tilts_deg))
    for number, (lens, tilt_deg) in enumerate(progress(rigs, "rigs", len(rigs))):
        setup = Setup(lens, float(np.radians(tilt_deg)))
        rig = setup.rig()
        plan = planned(rig)
        cells = np.flatnonzero([not why for why in plan.left_out])
        clean = scenes(rig, plan.reach[cells] * rig.antenna.length_m, plan.push_N[cells])
        frames = clean.noisy(np.random.default_rng((seed, number)), draws)
        found = frames.estimated(model)
        for index in range(len(plan.left_out)):
            done = np.flatnonzero(cells == index)
            own = (done[:, None] * draws + np.arange(draws)).ravel()
            rows += _rows(setup, plan, index, frames.picked(own), found.picked(own))
    return rows


def planned(rig: Rig) -> Plan:
    """Which cells of a rig can be run, and with which push."""
    reach, roll_deg = (values.ravel() for values in np.meshgrid(_REACHES, _ROLLS_DEG, indexing="ij"))
    antenna = rig.antenna
    distance = reach * antenna.length_m
    # what a pixel is at points of the straight antenna, for a camera that looked straight at them
    points = distance[:, None] * np.array([1.0, 0.0, 0.0]) - rig.T_antenna_camera.translation_m
    metres_per_px = np.linalg.norm(points, axis=1) / rig.camera.matrix[0, 0]
    least = _LEAST_DEFLECTION_SIGMA * SIGMA_PX * metres_per_px
    tried = least[:, None] * _HARDER
    size = push_for_deflection(tried, distance[:, None], antenna.stiffness_Nm2)
    steepest = push_for_slope(np.full(len(distance), STEEPEST_RAD), distance, antenna.stiffness_Nm2)
    size = np.where(size <= steepest[:, None], size, np.nan)
    cell, step = np.nonzero(np.isfinite(size))
    trial = scenes(rig, distance[cell], rolled(size[cell, step], np.radians(roll_deg[cell])))
    std = np.full((*size.shape, 3), np.inf)
    std[cell, step] = bound(trial).std
    whole = np.zeros(size.shape, bool)
    whole[cell, step] = np.isfinite(trial.points_px).all(axis=(1, 2))
    enough = whole & (std[..., 0] <= LARGEST_BOUND * distance[:, None])
    enough &= std[..., 0] * FROM_TIP_STD <= (antenna.length_m - distance)[:, None]
    # the first that is enough, or else the hardest that the picture holds
    hardest = len(_HARDER) - 1 - np.argmax(whole[:, ::-1], axis=1)
    chosen = np.where(enough.any(axis=1), np.argmax(enough, axis=1), hardest)
    at = np.arange(len(reach)), chosen
    shares, from_tip = 100 * std[at][:, 0] / distance, (antenna.length_m - distance) / std[at][:, 0]
    reasons = tuple(
        "" if good else f"at the hardest push the bound of l is {share:.1f} %, and the tip {away:.1f} deviations away"
        for good, share, away in zip(enough[at], shares, from_tip, strict=True)
    )
    return Plan(reach, roll_deg, rolled(size[at], np.radians(roll_deg)), tried[at], std[at], reasons)


def _rows(setup: Setup, plan: Plan, index: int, frames: Scenes, found: Contacts) -> Iterator[CellRow]:
    """One cell's rows, from its own frames; without frames it was left out."""
    values, std = np.c_[found.distance_m, found.force_N[:, 1:]], np.c_[found.distance_std_m, found.force_std_N[:, 1:]]
    good = np.isfinite(values).all(axis=1) & np.isfinite(std).all(axis=1)
    errors = (values - np.c_[frames.distance_m, frames.force_N[:, 1:]])[good]
    tilt, azimuth = (round(float(np.degrees(angle)), 6) for angle in (setup.tilt_rad, setup.azimuth_rad))
    reach, bounds = float(plan.reach[index]), plan.bound_std[index]
    shares = mean(found.status == "ok"), mean(found.status == "tip_contact"), 1.0 - mean(good)
    cell = setup.lens, tilt, azimuth, float(plan.roll_deg[index]), reach, float(plan.deflection_m[index])
    bound_l = float(bounds[0] / (reach * frames.rig.antenna.length_m))
    for which, quantity in enumerate(QUANTITIES):
        judged = _quality(errors[:, which], std[good, which], float(bounds[which]))
        yield CellRow(*cell, bound_l, plan.left_out[index], len(frames), *shares, quantity, *judged)


def _quality(errors: np.ndarray, predicted_std: np.ndarray, bound_std: float) -> tuple[float, float, float]:
    """`of_bound`, `bias` and `covered` of errors (D,) with predicted deviations (D,); NaN with fewer than two."""
    if len(errors) < 2:
        return np.nan, np.nan, np.nan
    scaled = errors / bound_std
    return rms(scaled), float(scaled.mean() / scaled.std(ddof=1)), covered(errors, predicted_std)


_OF_BOUND_GOAL = 1.05
_GOALS = {"of_bound": (0.0, _OF_BOUND_GOAL), "bias": (-0.1, 0.1), "covered": (0.93, 0.97)}
"""Measure → least and largest that are all right."""
_IN_WORDS = {"of_bound": f"≤ {_OF_BOUND_GOAL}", "bias": "|…| ≤ 0.1", "covered": "0.93 to 0.97"}
_CLEARLY = 2.5
"""A cell misses its goal clearly when it is beyond it by more than so many standard errors: noise alone does so for a
cell that just meets the goal in six of a thousand."""


@dataclass(frozen=True)
class SummaryRow:
    """One measure of one quantity over all cells that were run.

    pooled : root mean square over the cells of of_bound, mean of the others. pooled_error : its standard error.
    worst : in the cell furthest from the goal. cell_error : standard error in one cell, from noise alone.
    beyond, clearly : number of cells beyond the goal, and by more than `_CLEARLY` standard errors.
    """

    quantity: str = column("quantity")
    measure: str = column("measure")
    goal: str = column("goal")
    cells: int = column("cells", "d")
    draws: int = column("draws", "d")
    pooled: float = column("all cells", ".3f")
    pooled_error: float = column("±", ".3f")
    worst: float = column("worst", ".3f")
    cell_error: float = column("± in a cell", ".3f")
    beyond: int = column("beyond", "d")
    clearly: int = column("clearly", "d")
    worst_cell: str = column("worst cell")


def summary(rows: Sequence[CellRow]) -> list[SummaryRow]:
    """Nine lines: every measure of every quantity. Cells in which fewer than two draws came with numbers are beyond."""
    found = []
    for quantity in QUANTITIES:
        own = [row for row in rows if row.quantity == quantity and row.draws]
        found += [_line(measure, quantity, own) for measure in _GOALS if own]
    return found


def _line(measure: str, quantity: str, rows: Sequence[CellRow]) -> SummaryRow:
    values = np.array([getattr(row, measure) for row in rows], float)
    counts = np.array([row.draws * (1.0 - row.without_numbers) for row in rows])
    # by what it scatters from noise alone, for draws of an efficient estimator
    one = {"of_bound": 0.5, "bias": 1.0, "covered": _REGION * (1 - _REGION)}[measure]
    errors = np.sqrt(one / np.maximum(counts, 1.0))
    (low, high), there = _GOALS[measure], np.isfinite(values)
    beyond = np.where(there, np.maximum(low - values, values - high), np.inf)
    worst = int(np.argmax(beyond))
    pooled = rms(values[there]) if measure == "of_bound" else float(values[there].mean()) if there.any() else np.nan
    return SummaryRow(
        quantity=quantity,
        measure=measure,
        goal=_IN_WORDS[measure],
        cells=len(rows),
        draws=rows[0].draws,
        pooled=pooled,
        pooled_error=rms(errors[there]) / float(np.sqrt(max(there.sum(), 1))),
        worst=float(values[worst]),
        worst_cell=rows[worst].cell,
        cell_error=float(np.median(errors)),
        beyond=int((beyond > 0).sum()),
        clearly=int((beyond > _CLEARLY * errors).sum()),
    )


@dataclass(frozen=True)
class _RigRow:
    """The cells of one rig."""

    lens: str = column("lens")
    tilt_deg: float = column("tilt", ".0f")
    cells: int = column("cells", "d", of=len)
    ok: float = column("ok %", ".2f", 100, lambda cells: mean(cells.ok))
    tip_contact: float = column("tip %", ".2f", 100, lambda cells: mean(cells.tip_contact))
    without_numbers: float = column("without %", ".2f", 100, lambda cells: mean(cells.without_numbers))
    of_bound: float = column("l of bound", ".3f", of=lambda cells: rms_known(cells.of_bound))


def grid_text(rows: Sequence[CellRow], lines: Sequence[SummaryRow]) -> str:
    """The summary, the statuses rig by rig, and the cells left out."""
    cells = [row for row in rows if row.quantity == "l"]
    run = [row for row in cells if row.draws]
    title = (
        f"matched scenes: {len(run)} of {len(cells)} cells, {run[0].draws if run else 0} draws each; of_bound: rms "
        "error over the Cramér–Rao bound; bias: mean error in sampled\ndeviations; covered: 95 % intervals that hold "
        f"the truth; clearly: cells beyond the goal by more than {_CLEARLY} standard errors"
    )
    keys = dict.fromkeys((row.lens, row.tilt_deg) for row in run)
    rigs = [row_of(_RigRow, Draws([row for row in run if (row.lens, row.tilt_deg) == key]), *key) for key in keys]
    left_out = [f"{row.cell}: {row.left_out}" for row in cells if row.left_out]
    text = [table(lines, title) if lines else title, "", table(rigs)]
    return "\n".join([*text, *(["", "left out:", *left_out] if left_out else [])])


def measure(options: Options) -> Findings:
    """All parts, in proportion to the draws of a cell of the grid."""
    draws, seed, quick = options.draws, options.seed, options.quick
    cells = run(draws, seed, model=_MATCHED)
    lines, cases = summary(cells), hard.run(max(draws // 2, 4), seed)
    random = hard.hostile((50 if quick else 100) * draws, seed)
    found: dict[str, Sequence[Any]] = {"estimator": cells, "estimator_hard": cases, "estimator_random": random}
    distance = {line.measure: line for line in lines if line.quantity == "l"}
    headline = "no kind of scene could be judged"
    if distance:
        of_bound, inside = distance["of_bound"], 100 * distance["covered"].pooled
        headline = (
            f"distance: rms error {of_bound.pooled:.2f} × the bound over {of_bound.cells} kinds of scene, "
            f"{inside:.0f} % covered"
        )
    return Findings(
        "\n\n".join((grid_text(cells, lines), hard.hard_text(cases), hard.hostile_text(random))),
        {f"{name}.csv": rows for name, rows in found.items()},
        numbers={**found, "lines": lines},
        headline=headline,
    )
