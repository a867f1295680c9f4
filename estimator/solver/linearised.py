"""Many contacts at once, each linearised where it is: predictions and their derivatives, without a fit."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vbaa_calib.antenna.rungs import RUNGS, curves
from vbaa_calib.antenna.shape import Curves
from vbaa_calib.camera.compiled_lens import Lens
from vbaa_calib.core.compiled import kernel

from .convergence import empty_work
from .fit import NODES
from .frames import Frames, frame_of
from .initialization import free_antenna, grid_search, largest_gain
from .linear_algebra import put
from .normal_equations import linearise, nearest_feet, normal_equations, prior_of, residuals_with_rig
from .numbers import angle_edge_on
from .prediction import predict
from .rig_arrays import ANTENNA, UNKNOWNS, RigArrays, RigRecord
from .rig_jacobian import rig_jacobian
from .uncertainty import huber_excess


class Linearised(NamedTuple):
    """B contacts, in K = 4 + R unknowns and rig steps.

    Attributes
    ----------
    tangents : (B, 3, M) of the nodes, antenna frame.
    point_force : (B, 6) contact point, m, and force, N, antenna frame. columns : (B, 6, K) their derivatives.
    residual : (B, 3) of the readings, in deviations. readings : (B, 3, K) derivatives of what is predicted of them.
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


def linearised(frames: Frames, rung: str, unknowns: np.ndarray) -> Linearised:
    """The frames at unknowns (B, 4), the rig as calibrated."""
    count, size = len(frames), UNKNOWNS + frames.rig_arrays.steps
    shapes = ((3, NODES), (6,), (6, size), (3,), (3, size), (size, size), (size,), (size,), ())
    found = Linearised(*(np.empty((count, *shape)) for shape in shapes))
    rig = frames.rig_arrays
    _linearise(rig.tables, rig.lens, frames.tables, RUNGS.index(rung), np.ascontiguousarray(unknowns, float), found)
    return found


@kernel
def _linearise(rig_tables, lens_tables, tables, rung, unknowns, found):
    rig, lens = RigRecord(*rig_tables), Lens(*lens_tables)
    for index in range(len(unknowns)):
        frame = frame_of(tables, index)
        work = empty_work(rig, lens, len(frame.u))
        fit = work.best
        put(unknowns[index], fit.unknowns)
        predict(rig, frame, rung, work.bent, fit, True)
        rig_jacobian(rig, frame, rung, work.bent, fit)
        nearest_feet(rig, frame, fit)
        linearise(rig, frame, fit, work)
        normal_equations(rig, fit, 0, work.product)
        found.tangents[index] = fit.tangents
        found.point_force[index], found.columns[index] = fit.point_force, fit.point_force_columns[:, : fit.size]
        found.residual[index], found.readings[index] = fit.residual, fit.reading_columns[:, : fit.size]
        found.information[index] = fit.information[: fit.size, : fit.size]
        found.side[index] = fit.side[: fit.size]
        for a in range(fit.size):
            found.prior[index, a] = prior_of(rig, fit, a)
        found.excess[index] = huber_excess(fit)


def edge_on(rig_arrays: RigArrays, unknowns: np.ndarray) -> np.ndarray:
    """(B,) angle between the deformation plane 𝒟 of unknowns (B, 4) and the ray to the contact, rad; at 0 the antenna
    looks straight however it bends."""
    found = np.empty(len(unknowns))
    _edge_on(rig_arrays.tables, np.ascontiguousarray(unknowns, float), found)
    return found


@kernel
def _edge_on(rig_tables, unknowns, found):
    rig = RigRecord(*rig_tables)
    for index in range(len(found)):
        found[index] = angle_edge_on(rig, unknowns[index])


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
    _free(rig.tables, rig.lens, frames.tables, at, farthest_std, found)
    return found


@kernel
def _free(rig_tables, lens_tables, tables, steps, farthest_std, found):
    rig, lens = RigRecord(*rig_tables), Lens(*lens_tables)
    for index in range(len(steps)):
        frame = frame_of(tables, index)
        work = empty_work(rig, lens, len(frame.u))
        fit = work.best
        free_antenna(rig, frame, fit, work)
        found.gain[index] = largest_gain(grid_search(rig, frame, fit, 1, work))
        variance = 1.0
        for k in range(len(fit.steps)):
            variance += fit.reading_columns[2, UNKNOWNS + k] ** 2
        if not abs(fit.residual[2]) <= farthest_std * np.sqrt(variance):
            fit.predicted_residual[2] = 0.0
            fit.reading_columns[2] = 0.0
        put(steps[index], fit.steps)
        residuals_with_rig(fit, work.shift)
        normal_equations(rig, fit, UNKNOWNS, work.product)
        found.information[index] = fit.information[UNKNOWNS : fit.size, UNKNOWNS : fit.size]
        found.side[index] = fit.side[UNKNOWNS : fit.size]
