"""The estimator against the Cramér–Rao bound on matched scenes: distance × camera tilt × roll × lens.

A cell is pressed no harder than it must be: from 20 points' deviations of deflection on, until the bound of the
distance is good enough to be given out. Where no push up to the steepest slope does that, the cell is named with the
reason, and left out.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from ..console import progress
from ..rig import Rig
from .estimator_bound import bound
from .estimator_scenes import (
    STEEPEST_RAD,
    Scenes,
    push_for_deflection,
    push_for_slope,
    rolled,
    scenes,
)
from .estimator_setup import LENSES, SIGMA_PX, TOWARDS_CLAMP, Setup
from .estimator_statistics import QUANTITIES, Estimates, estimate, quality, truth

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
