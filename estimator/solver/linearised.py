"""Many contacts at once, each linearised where it is: predictions and their derivatives, without a fit."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vbaa_calib.antenna.rungs import RUNGS, curves
from vbaa_calib.antenna.shape import Curves
from vbaa_calib.native import core

from .frames import Frames
from .rig_arrays import ANTENNA, UNKNOWNS, RigArrays


class LinearisedFrames(NamedTuple):
    """B contacts, in K = 4 + R unknowns and rig steps.

    Attributes
    ----------
    tangents : (B, 3, M) of the nodes, antenna frame.
    point_force : (B, 6) contact point, m, and force, N, antenna frame. columns : (B, 6, K) their derivatives.
    residual : (B, 3 or 7) of the readings, in deviations. readings : (B, 3 or 7, K) derivatives of the prediction.
    information, side, prior : (B, K, K), (B, K), (B, K) normal equations about the contacts, and what of the diagonal
        is prior.
    excess : (B,) Σψ²/Σw of the points' Huber ψ and weights, about 1 where they scatter as their deviations say.
    """

    tangents: np.ndarray
    point_force: np.ndarray
    columns: np.ndarray
    residual: np.ndarray
    readings: np.ndarray
    information: np.ndarray
    side: np.ndarray
    prior: np.ndarray
    excess: np.ndarray


def linearised(frames: Frames, rung: str, unknowns: np.ndarray) -> LinearisedFrames:
    """The frames at unknowns (B, 4), the rig as calibrated."""
    count, size = len(frames), UNKNOWNS + frames.rig_arrays.steps
    read = len(frames.rig_arrays.std)
    shapes = ((3, core.solver.NODES), (6,), (6, size), (read,), (read, size), (size, size), (size,), (size,), ())
    found = LinearisedFrames(*(np.empty((count, *shape)) for shape in shapes))
    rig, at = frames.rig_arrays.core, np.ascontiguousarray(unknowns, float)
    core.solver.linearise(rig, frames, RUNGS.index(rung), at, found)
    return found


def edge_on(rig_arrays: RigArrays, unknowns: np.ndarray) -> np.ndarray:
    """(B,) angle between the deformation plane 𝒟 of unknowns (B, 4) and the ray to the contact, rad; at 0 the antenna
    looks straight however it bends."""
    return np.asarray(core.solver.edge_on(rig_arrays.core, np.ascontiguousarray(unknowns, float)))


def bend(frames: Frames, rung: str, unknowns: np.ndarray, steps: np.ndarray | None = None) -> Curves:
    """B·K antenna shapes for unknowns (B, K, 4); `steps` (B, K, 9) are added to the antenna's parameters."""
    rig_arrays, grid = frames.rig_arrays, unknowns.shape[:2]
    parameters = rig_arrays.rig.antenna.parameters + (0.0 if steps is None else steps)
    flat = unknowns.reshape(-1, UNKNOWNS)
    return curves(
        rung,
        np.broadcast_to(parameters, (*grid, ANTENNA)).reshape(-1, ANTENNA),
        rig_arrays.length_m,
        np.broadcast_to(frames.gravity_m_s2[:, None], (*grid, 3)).reshape(-1, 3),
        flat[:, 0] * rig_arrays.length_m,
        flat[:, 1:3] * rig_arrays.force_unit_N,
        flat[:, 3] * rig_arrays.friction_rad,
        rig_arrays.rig.antenna.taper,
    )


class FreeAntennas(NamedTuple):
    """Frames as the free antenna: normal equations (B, R, R), (B, R) of the rig's steps, its prior included, and the
    most (B,) that a force would explain."""

    information: np.ndarray
    side: np.ndarray
    gain: np.ndarray


def free_antennas(frames: Frames, steps: np.ndarray | None = None, farthest_std: float = np.inf) -> FreeAntennas:
    """About rig steps (B, R), by default none. An end of the antenna farther off than so many deviations, the rig's
    included, is another thing's and not used."""
    count, size, rig = len(frames), frames.rig_arrays.steps, frames.rig_arrays
    found = FreeAntennas(np.empty((count, size, size)), np.empty((count, size)), np.empty(count))
    at = np.zeros((count, size)) if steps is None else np.ascontiguousarray(steps, float)
    core.solver.free_antennas(rig.core, frames, at, farthest_std, found)
    return found
