"""All cells of the estimator's grid in a few lines: pooled, the worst one, and how many miss the goal."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from vbaa_calib.core.console import progress
from vbaa_calib.rig import Rig

from .bound import bound
from .scenes import STEEPEST_RAD, Scenes, push_for_deflection, push_for_slope, rolled, scenes
from .setup import LENSES, SIGMA_PX, TOWARDS_CLAMP, Setup
from .statistics import QUANTITIES, Estimates, estimate, quality, standard_errors, truth

REACHES = (0.1, 0.25, 0.5, 0.75, 0.95)
TILTS_DEG = (0.0, 30.0, 60.0, 75.0)
ROLLS_DEG = (0.0, 40.0, 80.0)
LEAST_DEFLECTION_SIGMA = 20.0
LARGEST_BOUND = 0.05
"""Of the contact distance."""
FROM_TIP_STD = 6.0
"""The bound does not hold at the border l ≤ L: so many deviations the contact must be away from it."""
_HARDER = 1.25 ** np.arange(26)
"""Deflections that are tried, over the least one."""


@dataclass(frozen=True)
class CellRow:
    """One quantity in one cell.

    Attributes
    ----------
    tilt_deg, azimuth_deg : of the camera, see `estimator_setup.Setup`. reach : contact distance over length.
    deflection_m : at the contact. bound_l : the distance's bound over the distance.
    left_out : why the cell was not run; then draws is 0 and what follows None.
    ok, tip_contact, without_numbers : shares of the draws.
    quantity : l, f_y or f_z.
    of_bound, bias, covered : see `estimator_statistics.Quality`; over the draws that came with numbers.
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
    ok: float | None
    tip_contact: float | None
    without_numbers: float | None
    quantity: str
    of_bound: float | None
    bias: float | None
    covered: float | None

    @property
    def cell(self) -> str:
        """In words."""
        return f"{self.lens}, tilt {self.tilt_deg:.0f}°, roll {self.roll_deg:.0f}°, l/L {self.reach:g}"


@dataclass(frozen=True, eq=False)
class Plan:
    """The K cells of one rig.

    Attributes
    ----------
    reach, roll_deg, deflection_m : (K,). push_N : (K, 2). bound_std : (K, 3) of l, f_y and f_z.
    left_out : (K,) why a cell is not to be run, or nothing.
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
    friction_std_rad: float = 0.0,
    azimuth_rad: float = TOWARDS_CLAMP,
    lenses: Sequence[str] = tuple(LENSES),
    tilts_deg: Sequence[float] = TILTS_DEG,
) -> list[CellRow]:
    """Every cell with so many noise draws.

    Friction, where there is some, is drawn anew for each, and the estimator is told the deviation it is drawn with.
    """
    rows: list[CellRow] = []
    rigs = list(product(lenses, tilts_deg))
    for number, (lens, tilt_deg) in enumerate(progress(rigs, "rigs", len(rigs))):
        setup = Setup(lens, float(np.radians(tilt_deg)), azimuth_rad)
        rig = setup.rig()
        plan = planned(rig, friction_std_rad)
        cells = np.flatnonzero([not why for why in plan.left_out])
        rng = np.random.default_rng((seed, number))
        frames = _frames(rig, plan, cells, draws, friction_std_rad, rng)
        found = estimate(frames, model, friction_std_rad)
        for index in range(len(plan.left_out)):
            done = np.flatnonzero(cells == index)
            own = (done[:, None] * draws + np.arange(draws)).ravel()
            rows += _rows(setup, plan, index, frames.picked(own), found.picked(own))
    return rows


def planned(rig: Rig, friction_std_rad: float) -> Plan:
    """Which cells of a rig can be run, and with which push."""
    reach, roll_deg = (values.ravel() for values in np.meshgrid(REACHES, ROLLS_DEG, indexing="ij"))
    antenna = rig.antenna
    distance = reach * antenna.length_m
    least = LEAST_DEFLECTION_SIGMA * SIGMA_PX * _metres_per_px(rig, distance)
    tried = least[:, None] * _HARDER
    size = push_for_deflection(tried, distance[:, None], antenna.stiffness_Nm2)
    steepest = push_for_slope(np.full(len(distance), STEEPEST_RAD), distance, antenna.stiffness_Nm2)
    size = np.where(size <= steepest[:, None], size, np.nan)
    cell, step = np.nonzero(np.isfinite(size))
    trial = scenes(rig, distance[cell], rolled(size[cell, step], np.radians(roll_deg[cell])))
    std = np.full((*size.shape, 3), np.inf)
    std[cell, step] = bound(trial, friction_std_rad).std
    whole = np.zeros(size.shape, bool)
    whole[cell, step] = np.isfinite(trial.points_px).all(axis=(1, 2))
    enough = whole & (std[..., 0] <= LARGEST_BOUND * distance[:, None])
    enough &= std[..., 0] * FROM_TIP_STD <= (antenna.length_m - distance)[:, None]
    # the first that is enough, or else the hardest that the picture holds
    hardest = len(_HARDER) - 1 - np.argmax(whole[:, ::-1], axis=1)
    chosen = np.where(enough.any(axis=1), np.argmax(enough, axis=1), hardest)
    at = np.arange(len(reach)), chosen
    from_tip = (antenna.length_m - distance) / std[at][:, 0]
    reasons = tuple(
        "" if good else _why(*numbers)
        for good, *numbers in zip(enough[at], std[at][:, 0] / distance, from_tip, whole[at], strict=True)
    )
    return Plan(reach, roll_deg, rolled(size[at], np.radians(roll_deg)), tried[at], std[at], reasons)


def _why(bound_share: float, from_tip_std: float, seen_whole: bool) -> str:
    if not seen_whole:
        return "the antenna leaves the picture at the least deflection"
    if not np.isfinite(bound_share):
        return "the data do not hold the distance"
    if bound_share > LARGEST_BOUND:
        return f"the bound of l is {100 * bound_share:.1f} % at the hardest push that the picture holds"
    return f"the tip is {from_tip_std:.1f} deviations away at the hardest push that the picture holds"


def _metres_per_px(rig: Rig, distance_m: np.ndarray) -> np.ndarray:
    """(K,) what a pixel is at points of the straight antenna, for a camera that looked straight at them."""
    points = distance_m[:, None] * np.array([1.0, 0.0, 0.0]) - rig.T_antenna_camera.translation_m
    return np.linalg.norm(points, axis=1) / rig.camera.matrix[0, 0]


def _frames(
    rig: Rig, plan: Plan, cells: np.ndarray, draws: int, friction_std_rad: float, rng: np.random.Generator
) -> Scenes:
    """Every cell's draws in a row, with noise."""
    distance, push = plan.reach[cells] * rig.antenna.length_m, plan.push_N[cells]
    if friction_std_rad == 0.0:
        return scenes(rig, distance, push).noisy(rng, draws)
    friction = friction_std_rad * rng.normal(size=len(cells) * draws)
    return scenes(rig, np.repeat(distance, draws), np.repeat(push, draws, axis=0), friction).noisy(rng)


def _rows(setup: Setup, plan: Plan, index: int, frames: Scenes, found: Estimates) -> Iterator[CellRow]:
    """One cell's rows, from its own frames; without frames it was left out."""
    good = found.numbered
    errors = (found.values - truth(frames))[good]
    run = len(frames) > 0
    for which, quantity in enumerate(QUANTITIES):
        bound_std = float(plan.bound_std[index, which])
        numbers = quality(errors[:, which], found.std[good, which], bound_std)
        yield CellRow(
            lens=setup.lens,
            tilt_deg=round(float(np.degrees(setup.tilt_rad)), 6),
            azimuth_deg=round(float(np.degrees(setup.azimuth_rad)), 6),
            roll_deg=float(plan.roll_deg[index]),
            reach=float(plan.reach[index]),
            deflection_m=float(plan.deflection_m[index]),
            bound_l=float(plan.bound_std[index, 0] / (plan.reach[index] * frames.rig.antenna.length_m)),
            left_out=plan.left_out[index],
            draws=len(frames),
            ok=found.share("ok") if run else None,
            tip_contact=found.share("tip_contact") if run else None,
            without_numbers=float(1.0 - good.mean()) if run else None,
            quantity=quantity,
            of_bound=numbers.of_bound if run else None,
            bias=numbers.bias if run else None,
            covered=numbers.covered if run else None,
        )


OF_BOUND_GOAL, BIAS_GOAL, COVERED_GOAL = 1.05, 0.1, (0.93, 0.97)
CLEARLY = 2.5
"""A cell misses its goal clearly when it is beyond it by more than so many standard errors: noise alone does so for a
cell that just meets the goal in six of a thousand."""


@dataclass(frozen=True)
class SummaryRow:
    """One measure of one quantity over all cells that were run.

    Attributes
    ----------
    measure : of_bound, bias or covered. goal : in words.
    pooled : root mean square over the cells of of_bound, mean of the others. pooled_error : its standard error.
    worst : in the cell furthest from the goal. cell_error : standard error in one cell, from noise alone.
    beyond, clearly : number of cells beyond the goal, and by more than `CLEARLY` standard errors.
    """

    quantity: str
    measure: str
    goal: str
    cells: int
    draws: int
    pooled: float
    pooled_error: float
    worst: float
    worst_cell: str
    cell_error: float
    beyond: int
    clearly: int

    @property
    def met(self) -> bool:
        """Whether no cell misses the goal clearly."""
        return self.clearly == 0


@dataclass(frozen=True)
class _Measure:
    """One measure: its goal in words, how far values (K,) are beyond it, and how cells are pooled."""

    name: str
    goal: str
    beyond: Callable[[np.ndarray], np.ndarray]
    pooled: Callable[[np.ndarray], float]


_MEASURES = (
    _Measure(
        "of_bound",
        f"≤ {OF_BOUND_GOAL}",
        lambda values: values - OF_BOUND_GOAL,
        lambda values: float(np.sqrt(np.mean(values**2))),
    ),
    _Measure(
        "bias", f"|…| ≤ {BIAS_GOAL}", lambda values: np.abs(values) - BIAS_GOAL, lambda values: float(values.mean())
    ),
    _Measure(
        "covered",
        f"{COVERED_GOAL[0]} to {COVERED_GOAL[1]}",
        lambda values: np.maximum(COVERED_GOAL[0] - values, values - COVERED_GOAL[1]),
        lambda values: float(values.mean()),
    ),
)


def summary(rows: Sequence[CellRow]) -> list[SummaryRow]:
    """Nine lines: every measure of every quantity. Cells in which fewer than two draws came with numbers are beyond."""
    found = []
    for quantity in QUANTITIES:
        own = [row for row in rows if row.quantity == quantity and row.draws]
        found += [_line(measure, quantity, own) for measure in _MEASURES if own]
    return found


def _line(measure: _Measure, quantity: str, rows: Sequence[CellRow]) -> SummaryRow:
    values = np.array([getattr(row, measure.name) for row in rows], float)
    counts = np.array([row.draws * (1.0 - (row.without_numbers or 0.0)) for row in rows])
    errors = np.array([getattr(standard_errors(max(count, 1.0)), measure.name) for count in counts])
    beyond = np.where(np.isfinite(values), measure.beyond(values), np.inf)
    worst = int(np.argmax(beyond))
    there = np.isfinite(values)
    return SummaryRow(
        quantity=quantity,
        measure=measure.name,
        goal=measure.goal,
        cells=len(rows),
        draws=rows[0].draws,
        pooled=measure.pooled(values[there]) if there.any() else np.nan,
        pooled_error=float(np.sqrt(np.mean(errors[there] ** 2) / there.sum())) if there.any() else np.nan,
        worst=float(values[worst]),
        worst_cell=rows[worst].cell,
        cell_error=float(np.median(errors)),
        beyond=int((beyond > 0).sum()),
        clearly=int((beyond > CLEARLY * errors).sum()),
    )
