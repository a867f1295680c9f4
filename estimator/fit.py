"""Maximum likelihood of (contact distance, force) over all centreline points and the moment, for any camera pose.

The force's two components across the antenna fix the deformation plane 𝒟 (its roll ξ is their direction), so the hinge
plane is not searched: it is part of the fit. The moment is one more measurement, Eq. (16) with weight and offset in.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from vbaa_calib.antenna.shape import Curves, bend
from vbaa_calib.reprojection import SeenPoints, image_curves, whitened_residuals
from vbaa_calib.rig import Rig

START_DISTANCES = 14
"""Distances tried for a start, spread over the antenna."""
STARTS = 2
"""The best so many of them, each in a valley of its own, are followed down."""
COARSE_POINTS = 120
"""So many points are enough to follow a start to its valley's floor."""
SAME = 1e-2
"""Distances closer than this, in antenna lengths, are taken for the same valley."""
ROBUST = 2.5
"""Whitened residuals beyond this count linearly: a few false points must not pull the shape."""
NEAREST, TIP = 0.03, 1.0
"""Least and greatest contact distance that is looked for, in antenna lengths."""
AT_TIP = 2e-3
"""A distance this near to the tip is held there, unless the data object."""
STEPS = np.array([1e-4, 1e-4, 1e-4])
"""Finite-difference steps of the unknowns."""
ITERATIONS = 40
STANDSTILL = 1e-4
"""A step that promises less than this much of the cost is the last: a hundredth of a standard deviation."""


@dataclass(frozen=True, eq=False)
class Scene:
    """One frame's data: seen points, moment reading, gravity in the antenna frame, and the rig they belong to."""

    rig: Rig
    seen: SeenPoints
    moment_reading_Nm: float
    gravity_m_s2: np.ndarray
    sweeps: int

    @property
    def force_unit_N(self) -> float:
        """A force that bends the tip by about a hundredth of the length: the scale of the fit's unknowns."""
        antenna = self.rig.antenna
        return 0.03 * antenna.stiffness_Nm2 / antenna.length_m**2

    def thinned(self, count: int) -> Scene:
        """The same with at most so many points, spread over all of them by lot."""
        if len(self.seen) <= count:
            return self
        chosen = np.random.default_rng(0).permutation(len(self.seen))[:count]
        return replace(self, seen=SeenPoints(self.seen.points[chosen], self.seen.covariance[chosen]))

    def curves(self, contact_m: np.ndarray, lateral_N: np.ndarray, parameters: np.ndarray | None = None) -> Curves:
        """Antenna shapes for contacts (B,) and lateral forces (B, 2), with the rig's antenna or others (B, 8)."""
        antenna = self.rig.antenna
        if parameters is None:
            parameters = np.repeat(antenna.parameters[None], len(contact_m), axis=0)
        gravity = np.repeat(self.gravity_m_s2[None], len(contact_m), axis=0)
        return bend(parameters, antenna.length_m, gravity, contact_m, lateral_N, sweeps=self.sweeps)

    def whitened(self, curves: Curves) -> np.ndarray:
        """(N + 1, B): the points' distances from each of B nearby curves, then the moment's misfit, all in std."""
        sensor = self.rig.moment_sensor
        points = whitened_residuals(self.seen, image_curves(curves, self.rig.T_antenna_camera.inverse()))
        moment = (self.moment_reading_Nm - sensor.gain * curves.moment_Nm - sensor.offset_Nm) / sensor.std_Nm
        return np.vstack([points, moment[None]])


@dataclass(frozen=True, eq=False)
class Fit:
    """A fitted contact.

    Attributes
    ----------
    unknowns : (3,) contact distance in antenna lengths, lateral force (y, z of the clamp's frame) in `force_unit_N`.
    cost : half the summed robust squares.
    residuals : (N + 1,) whitened; the last is the moment's.
    jacobian : (N + 1, 3) of them.
    converged : whether the solver came to a standstill.
    at_tip : whether the distance was held at the tip.
    """

    unknowns: np.ndarray
    cost: float
    residuals: np.ndarray
    jacobian: np.ndarray
    converged: bool
    at_tip: bool


def robust_cost(residuals: np.ndarray) -> float:
    """Half the summed Huber squares of whitened residuals."""
    size = np.abs(residuals)
    return float(np.where(size <= ROBUST, 0.5 * size**2, ROBUST * size - 0.5 * ROBUST**2).sum())


def robust_weights(residuals: np.ndarray) -> np.ndarray:
    """(N,) factors that turn Huber's cost into least squares near the solution."""
    return np.sqrt(ROBUST / np.maximum(np.abs(residuals), ROBUST))


def start_values(scene: Scene) -> np.ndarray:
    """(K, 3) unknowns from a grid of distances: the lowest K ≤ `STARTS` of the cost's local minima.

    For small deflections the picture is linear in the force once the distance is given, so the force is profiled out by
    linear least squares over points and moment together.
    """
    length, unit = scene.rig.antenna.length_m, scene.force_unit_N
    grid = np.linspace(0.08, 1.0, START_DISTANCES)
    contact = np.repeat(grid * length, 2)
    # Equal tip deflections, so that no column of the small problem is lost in rounding.
    probe = 0.3 / (grid**2 * (3 - grid))
    lateral = np.stack([np.stack([probe, 0 * probe], 1), np.stack([0 * probe, probe], 1)], axis=1).reshape(-1, 2)
    contact = np.concatenate([[0.5 * length], contact])
    whitened = scene.whitened(scene.curves(contact, np.vstack([[0.0, 0.0], lateral]) * unit))
    found, costs = np.empty((len(grid), 3)), np.empty(len(grid))
    for index, distance in enumerate(grid):
        columns = slice(1 + 2 * index, 3 + 2 * index)
        slope = (whitened[:, columns] - whitened[:, :1]) / probe[index]
        force, *_ = np.linalg.lstsq(slope, -whitened[:, 0], rcond=None)
        found[index] = distance, *force
        costs[index] = robust_cost(whitened[:, 0] + slope @ force)
    around = np.pad(costs, 1, constant_values=np.inf)
    floors = np.flatnonzero((costs <= around[:-2]) & (costs <= around[2:]))
    return found[floors[np.argsort(costs[floors])][:STARTS]]


def linearised(scene: Scene, unknowns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Whitened residuals (N + 1,) at the unknowns and their Jacobian (N + 1, 3)."""
    length, unit = scene.rig.antenna.length_m, scene.force_unit_N
    steps = np.where(unknowns + STEPS > TIP, [-1.0, 1.0, 1.0], 1.0) * STEPS
    trials = np.vstack([unknowns, unknowns + np.diag(steps)])
    whitened = scene.whitened(scene.curves(trials[:, 0] * length, trials[:, 1:] * unit))
    return whitened[:, 0], (whitened[:, 1:] - whitened[:, :1]) / steps


def evaluated(scene: Scene, unknowns: np.ndarray, at_tip: bool = False) -> Fit:
    """What a fit with these unknowns (3,) looks like in a scene; nothing is searched for."""
    residuals, jacobian = linearised(scene, unknowns)
    return Fit(unknowns, robust_cost(residuals), residuals, jacobian, False, at_tip)


def _step(result: Fit, damping: float) -> tuple[np.ndarray, float]:
    """Levenberg–Marquardt step (3,) on the reweighted residuals, and how much of the cost it promises to take."""
    weights = robust_weights(result.residuals)
    jacobian = result.jacobian * weights[:, None]
    scale = np.linalg.norm(jacobian, axis=0)
    scale[scale == 0.0] = 1.0
    jacobian /= scale
    hessian, slope = jacobian.T @ jacobian, jacobian.T @ (result.residuals * weights)

    def solved(free: slice) -> np.ndarray:
        step = np.zeros(3)
        inner = hessian[free, free]
        step[free] = -np.linalg.solve(inner + (damping + 1e-12) * np.eye(len(inner)), slope[free])
        return step

    step = solved(slice(1, 3) if result.at_tip else slice(0, 3))
    distance = result.unknowns[0]
    if (distance <= NEAREST and step[0] < 0.0) or (distance >= TIP and step[0] > 0.0):
        step = solved(slice(1, 3))
    return step / scale, float(-(slope @ step + 0.5 * step @ hessian @ step))


def _descend(scene: Scene, start: np.ndarray, at_tip: bool = False) -> Fit:
    """From a start to the floor of its valley.

    Reweighting keeps every point in the step. SciPy's robust solver leaves out those that count linearly, far from the
    floor most of them, and needs three to eight times as many evaluations.
    """
    now = evaluated(scene, np.array([TIP if at_tip else np.clip(start[0], NEAREST, TIP), *start[1:]]), at_tip)
    damping = 0.0
    for _ in range(ITERATIONS):
        step, promise = _step(now, damping)
        unknowns = now.unknowns + step
        unknowns[0] = np.clip(unknowns[0], NEAREST, TIP)
        trial = evaluated(scene, unknowns, at_tip)
        better = trial.cost <= now.cost
        now = trial if better else now
        if promise < STANDSTILL:
            return replace(now, converged=True)
        damping = 0.1 * damping if better else max(10.0 * damping, 1e-3)
    return now


def fit(scene: Scene, start: np.ndarray | None = None) -> Fit:
    """The best contact for one frame, from a start (3,) near it, or from several of its own.

    Own starts are followed down on a part of the points; what they lead to is polished on all of them, and the lowest
    cost taken. A distance that runs to the tip is held there unless that costs more than half a standard deviation.
    """
    starts = _valleys(scene.thinned(COARSE_POINTS)) if start is None else [start]
    best = min((_descend(scene, start) for start in starts), key=lambda result: result.cost)
    if best.unknowns[0] > TIP - AT_TIP:
        held = _descend(scene, best.unknowns, at_tip=True)
        if held.cost <= best.cost + 0.5:
            return held
    return best


def _valleys(scene: Scene) -> list[np.ndarray]:
    """The floors (3,) that the start values lead to, each once."""
    floors: list[np.ndarray] = []
    for start in start_values(scene):
        floor = _descend(scene, start).unknowns
        if all(abs(floor[0] - other[0]) > SAME for other in floors):
            floors.append(floor)
    return floors
