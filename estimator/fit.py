"""Maximum likelihood of (contact distance, force) over all centreline points and the moment, for any camera pose.

The force's two components across the antenna fix the deformation plane 𝒟 (its roll ξ is their direction), so the hinge
plane is not searched: it is part of the fit. The moment is one more measurement, Eq. (16) with weight and offset in.
The rig's parameters take part under their joint covariance: a camera that is a little off is no contact.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from vbaa_calib.antenna.shape import Curves
from vbaa_calib.reprojection import robust_cost, robust_weights

from .scene import TIP, Scene, by_rig, linearised

START_DISTANCES = 14
"""Distances tried for a start, spread over the antenna."""
STARTS = 2
"""The best so many of them, each in a valley of its own, are followed down."""
COARSE_POINTS = 120
"""So many points are enough to follow a start to its valley's floor."""
SAME = 1e-2
"""Distances closer than this, in antenna lengths, are taken for the same valley."""
NEAREST = 0.03
"""Least contact distance that is looked for, in antenna lengths."""
NEAR_TIP, TIP_OBJECTION = 0.03, 2.0
"""A distance this near to the tip is held there if that costs no more than this: if it lies within two deviations."""
ITERATIONS, REWEIGHTINGS = 40, 4
STANDSTILL, COARSE_STANDSTILL = 1e-4, 1e-2
"""A step that promises less than this much of the cost is the last: a hundredth of a standard deviation, or a tenth."""
SCATTERED = 1.15
"""Points whose median misfit exceeds its expectation by this factor scatter more than noise: beyond 95 % of frames."""


FREE = np.array([0.5, 0.0, 0.0])
"""Unknowns of the free antenna."""


@dataclass(frozen=True, eq=False)
class Fit:
    """A fitted contact.

    Attributes
    ----------
    scene : what was fitted, with the scatter that was found.
    unknowns : (3,) as in `Scene`.
    rig_steps : (R,) how far the rig's parameters went along `scene.rig_axes`; R is 0 for an exact rig.
    cost : half the summed robust squares of residuals and rig steps.
    residuals : (N + 1,) whitened, with the rig steps in; the last is the moment's.
    jacobian : (N + 1, 3 + R) of them by unknowns and rig steps.
    converged : whether the solver came to a standstill.
    at_tip : whether the distance was held at the tip.
    """

    scene: Scene
    unknowns: np.ndarray
    rig_steps: np.ndarray
    cost: float
    residuals: np.ndarray
    jacobian: np.ndarray
    converged: bool = False
    at_tip: bool = False

    @property
    def curve(self) -> Curves:
        """The antenna's fitted shape for the rig as calibrated, a batch of one."""
        return self.scene.curves(self.unknowns[None])

    @property
    def prior(self) -> np.ndarray:
        """(3 + R,) weight of the unknowns' and rig steps' own squares: nothing is known of the contact beforehand."""
        return np.repeat([0.0, 1.0], [3, len(self.rig_steps)])


def least_cost(residuals: np.ndarray, table: np.ndarray, prior: np.ndarray) -> tuple[np.ndarray, float]:
    """The z (K,) of least robust cost of residuals (N,) + table·z, with half of prior·z² added, and that cost."""
    best = np.zeros(table.shape[1])
    for _ in range(REWEIGHTINGS):
        weights = robust_weights(residuals + table @ best)
        weighted = table * weights[:, None]
        hessian = weighted.T @ weighted + np.diag(prior)
        scale = np.sqrt(np.diag(hessian)) + 1e-30
        hessian = hessian / np.outer(scale, scale) + 1e-12 * np.eye(len(scale))
        best = -np.linalg.solve(hessian, weighted.T @ (residuals * weights) / scale) / scale
    return best, robust_cost(residuals + table @ best) + 0.5 * float(prior @ best**2)


def evaluated(scene: Scene, unknowns: np.ndarray, rig_steps: np.ndarray | None = None, at_tip: bool = False) -> Fit:
    """What a fit with these unknowns (3,) and rig steps (R,) looks like in a scene; nothing is searched for."""
    residuals, jacobian = linearised(scene, unknowns)
    table = scene.scaled_rig_table()
    steps = np.zeros(table.shape[1]) if rig_steps is None else rig_steps
    residuals = residuals + table @ steps
    cost = robust_cost(residuals) + 0.5 * float(steps @ steps)
    return Fit(scene, unknowns, steps, cost, residuals, np.hstack([jacobian, table]), at_tip=at_tip)


def start_values(scene: Scene) -> np.ndarray:
    """(K, 3) unknowns from a grid of distances: the lowest K ≤ `STARTS` of the cost's local minima.

    For small deflections the picture is linear in the force once the distance is given, so force and rig are profiled
    out by linear least squares over points and moment together.
    """
    grid = np.linspace(0.08, 1.0, START_DISTANCES)
    # Equal tip deflections, so that no column of the small problem is lost in rounding.
    probe = 0.3 / (grid**2 * (3 - grid))
    trials = np.zeros((1 + 2 * len(grid), 3))
    trials[0] = FREE
    trials[1:, 0] = np.repeat(grid, 2)
    trials[1::2, 1] = trials[2::2, 2] = probe
    whitened = scene.whitened(scene.curves(trials))
    table = scene.scaled_rig_table()
    prior = np.repeat([0.0, 1.0], [2, table.shape[1]])
    found, costs = np.empty((len(grid), 3)), np.empty(len(grid))
    for index, distance in enumerate(grid):
        columns = slice(1 + 2 * index, 3 + 2 * index)
        slope = np.hstack([(whitened[:, columns] - whitened[:, :1]) / probe[index], table])
        best, costs[index] = least_cost(whitened[:, 0], slope, prior)
        found[index] = distance, *best[:2]
    around = np.pad(costs, 1, constant_values=np.inf)
    floors = np.flatnonzero((costs <= around[:-2]) & (costs <= around[2:]))
    return found[floors[np.argsort(costs[floors])][:STARTS]]


def fit(scene: Scene, start: np.ndarray | None = None) -> Fit:
    """The best contact for one frame, from a start (3,) near it, or from several of its own.

    Own starts are followed down on a part of the points; what they lead to is polished on all of them, and the lowest
    cost taken. A distance that the data cannot tell from the tip is held there.
    """
    starts = valleys(scene.thinned(COARSE_POINTS)) if start is None else [start]
    best = min((_polished(scene, start) for start in starts), key=_plain_cost)
    if best.unknowns[0] > TIP - NEAR_TIP:
        at_tip = np.array([TIP, *best.unknowns[1:]])
        held = _descend(evaluated(best.scene, at_tip, best.rig_steps, at_tip=True))
        if held.cost <= best.cost + TIP_OBJECTION:
            return held
    return best


def valleys(scene: Scene) -> list[np.ndarray]:
    """The floors (3,) that the start values lead to, each once."""
    scene = replace(scene, rig_table=by_rig(scene, FREE))
    floors: list[np.ndarray] = []
    for start in start_values(scene):
        begin = evaluated(scene, start)
        floor = _descend(_rescaled(begin, _scatter(begin)), COARSE_STANDSTILL).unknowns
        if all(abs(floor[0] - other[0]) > SAME for other in floors):
            floors.append(floor)
    return floors


def _polished(scene: Scene, start: np.ndarray) -> Fit:
    """The floor below a start, with the rig's parameters in it, and deviations scaled to what the points scatter there.

    What neither noise nor rig explains — friction, a second contact — must not be fitted as if it were exact, nor must
    most points count as outliers for it.
    """
    result = _descend(evaluated(replace(scene, scatter=1.0, rig_table=by_rig(scene, start)), start))
    scatter = _scatter(result)
    return result if scatter == 1.0 else _descend(_rescaled(result, scatter))


def _scatter(result: Fit) -> float:
    median = 1.4826 * float(np.median(np.abs(result.residuals[:-1]))) * result.scene.scatter
    return median if median > SCATTERED else 1.0


def _rescaled(result: Fit, scatter: float) -> Fit:
    return evaluated(replace(result.scene, scatter=scatter), result.unknowns, result.rig_steps, result.at_tip)


def _plain_cost(result: Fit) -> float:
    """The cost with the deviations that the points came with: only these compare between fits."""
    plain = np.append(result.residuals[:-1] * result.scene.scatter, result.residuals[-1])
    return robust_cost(plain) + 0.5 * float(result.rig_steps @ result.rig_steps)


def _descend(begin: Fit, standstill: float = STANDSTILL) -> Fit:
    """From a beginning to the floor of its valley, by Levenberg and Marquardt's steps."""
    now, damping = begin, 0.0
    for _ in range(ITERATIONS):
        step, promise = _step(now, damping)
        trial = evaluated(now.scene, _moved(now.unknowns, step), now.rig_steps + step[3:], now.at_tip)
        better = trial.cost <= now.cost
        now = trial if better else now
        if promise < standstill:
            return replace(now, converged=True)
        damping = 0.1 * damping if better else max(10.0 * damping, 1e-3)
    return now


def _moved(unknowns: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Unknowns (3,) after a step (3 + R,), taken straight in l and l·f: in f the valley of equal moments is bent."""
    old = unknowns[0]
    distance = np.clip(old + step[0], max(NEAREST, 0.5 * old), TIP)
    return np.array([distance, *(old * (unknowns[1:] + step[1:3]) + step[0] * unknowns[1:]) / distance])


def _step(result: Fit, damping: float) -> tuple[np.ndarray, float]:
    """Levenberg–Marquardt step (3 + R,) on the reweighted residuals, and how much of the cost it promises to take."""
    weights = robust_weights(result.residuals)
    jacobian = result.jacobian * weights[:, None]
    hessian = jacobian.T @ jacobian + np.diag(result.prior)
    slope = jacobian.T @ (result.residuals * weights)
    slope[3:] += result.rig_steps
    scale = np.sqrt(np.diag(hessian))
    scale[scale == 0.0] = 1.0
    hessian, slope = hessian / np.outer(scale, scale), slope / scale

    def solved(first: int) -> np.ndarray:
        step = np.zeros(len(slope))
        inner = hessian[first:, first:]
        step[first:] = -np.linalg.solve(inner + (damping + 1e-12) * np.eye(len(inner)), slope[first:])
        return step

    step = solved(1 if result.at_tip else 0)
    distance = result.unknowns[0]
    if (distance <= NEAREST and step[0] < 0.0) or (distance >= TIP and step[0] > 0.0):
        step = solved(1)
    return step / scale, float(-(slope @ step + 0.5 * step @ hessian @ step))
