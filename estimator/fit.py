"""Maximum likelihood of (contact distance, force) over all centreline points and the moment, for any camera pose.

The force's two components across the antenna fix the deformation plane 𝒟 (its roll ξ is their direction), so the hinge
plane is not searched: it is part of the fit. The moment is one more measurement, Eq. (16) with weight and offset in.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from vbaa_calib.antenna.shape import Curves, bend
from vbaa_calib.reprojection import SeenPoints, image_curves, whitened_residuals
from vbaa_calib.rig import Rig

START_DISTANCES = 14
"""Distances tried for a start, spread over the antenna."""
STARTS = 2
"""The best so many of them are polished."""
ROBUST = 2.5
"""Whitened residuals beyond this count linearly: a few false points must not pull the shape."""
NEAREST, TIP = 0.03, 1.0
"""Least and greatest contact distance that is looked for, in antenna lengths."""


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
    jacobian : (N + 1, 3) of them; a distance held at the tip has a column of zeros.
    converged : whether the solver ended by its own criteria.
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
    """(STARTS, 3) unknowns from a grid of distances.

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
    best = []
    for index, distance in enumerate(grid):
        columns = slice(1 + 2 * index, 3 + 2 * index)
        slope = (whitened[:, columns] - whitened[:, :1]) / probe[index]
        force, *_ = np.linalg.lstsq(slope, -whitened[:, 0], rcond=None)
        best.append((robust_cost(whitened[:, 0] + slope @ force), [distance, *force]))
    best.sort(key=lambda pair: pair[0])
    return np.array([unknowns for _, unknowns in best[:STARTS]])


STEPS = np.array([1e-4, 1e-4, 1e-4])


def linearised(scene: Scene, unknowns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Whitened residuals (N + 1,) at the unknowns and their Jacobian (N + 1, 3)."""
    length, unit = scene.rig.antenna.length_m, scene.force_unit_N
    steps = STEPS.copy()
    if unknowns[0] + steps[0] > 1.0:
        steps[0] = -steps[0]
    trials = np.vstack([unknowns, unknowns + np.diag(steps)])
    whitened = scene.whitened(scene.curves(trials[:, 0] * length, trials[:, 1:] * unit))
    return whitened[:, 0], (whitened[:, 1:] - whitened[:, :1]) / steps


def _polish(scene: Scene, start: np.ndarray, at_tip: bool):
    kept: dict[bytes, tuple[np.ndarray, np.ndarray]] = {}

    def both(free: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        key = free.tobytes()
        if key not in kept:
            kept.clear()
            residuals, jacobian = linearised(scene, np.concatenate([[TIP], free]) if at_tip else free)
            kept[key] = residuals, jacobian[:, 1:] if at_tip else jacobian
        return kept[key]

    bounds = ([-np.inf] * 2, [np.inf] * 2) if at_tip else ([NEAREST, -np.inf, -np.inf], [TIP, np.inf, np.inf])
    begin = start[1:] if at_tip else np.concatenate([[np.clip(start[0], NEAREST + 1e-3, TIP - 1e-3)], start[1:]])
    return least_squares(
        lambda x: both(x)[0],
        begin,
        jac=lambda x: both(x)[1],
        bounds=bounds,
        x_scale="jac",
        loss="huber",
        f_scale=ROBUST,
        xtol=1e-9,
        ftol=1e-9,
        max_nfev=60,
    )


def fit(scene: Scene, starts: np.ndarray | None = None) -> Fit:
    """The best contact for one frame: every start polished on the full model, the lowest cost taken.

    When the distance runs to the tip, or cannot be told from it, the fit with the distance held there is returned.
    """
    solutions = [_polish(scene, start, False) for start in (start_values(scene) if starts is None else starts)]
    best = min(solutions, key=lambda solution: solution.cost)
    at_tip = False
    if best.x[0] > TIP - 2e-3:
        held = _polish(scene, best.x, True)
        at_tip = held.cost <= best.cost + 0.5
    solution, unknowns = (held, np.concatenate([[TIP], held.x])) if at_tip else (best, best.x)
    residuals, jacobian = linearised(scene, unknowns)
    if at_tip:
        jacobian[:, 0] = 0.0
    return Fit(unknowns, float(solution.cost), residuals, jacobian, solution.status > 0, at_tip)
