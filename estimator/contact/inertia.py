"""What judging motion needs of fits: where the antenna's pieces are, how well, and what their inertia would do."""

from __future__ import annotations

from estimator.solver.curves import cubics, evaluate_cubics, flat_rows
from estimator.solver.normal_equations import solve_columns
from estimator.solver.prediction import point_jacobian
from estimator.solver.rig_arrays import UNKNOWNS
from estimator.solver.state import Fits
from estimator.solver.uncertainty import Uncertainty
from vbaa_calib.antenna.linear import deflection, deflection_by_contact
from vbaa_calib.core.arrays import Array, arange_like, like, namespace
from vbaa_calib.core.robust import huber_weights

from .motion import PIECES, Beam

LEAST_STD_M = 1e-6
"""No place is known better: near the clamp the model's own errors are all there is."""


def pieces(fits: Fits, beam: Beam) -> tuple[Array, Array]:
    """Points (B, G, 3) of the fitted antennas at the beam's pieces, antenna frame, their deviations (B, G) by noise.

    The deviations are those from frame to frame: the rig's errors are the same in all.
    """
    prediction, state = fits.prediction, fits.state
    xp = namespace(state.scatter)
    at = like(state.scatter, beam.pieces_m) + 0.0 * prediction.contact_m[:, None]
    table = cubics(prediction.points_m, prediction.tangents, prediction.contact_m, prediction.length_m)
    left, share, _ = prediction.locate(at)
    points = xp.stack([value for value, _, _ in evaluate_cubics(table, flat_rows(left, table.shape[1]), share)], -1)
    return points, xp.sqrt(_scatter(fits, at))


def _scatter(fits: Fits, at_m: Array) -> Array:
    """(B, G) variance of the antenna at arc lengths by the noise of one frame, for the rig as it is: linear beam."""
    rig_arrays, unknowns = fits.frames.rig_arrays, fits.state.unknowns
    xp = namespace(at_m)
    stiffness, contact = xp.exp(rig_arrays.antenna_parameters[6]), unknowns[:, :1] * rig_arrays.length_m
    by_force = deflection(at_m, contact, rig_arrays.force_unit_N, stiffness)
    by_distance = deflection_by_contact(at_m, contact, rig_arrays.force_unit_N, stiffness) * rig_arrays.length_m
    information = fits.equations.information[:, :UNKNOWNS, :UNKNOWNS]
    total = 0.0 * at_m
    for axis in (1, 2):
        parts = [unknowns[:, axis : axis + 1] * by_distance, *(by_force * (axis == a) for a in (1, 2)), 0.0 * at_m]
        slopes = xp.stack(parts, -1)
        total = total + (slopes * solve_columns(information, slopes.mT).mT).sum(-1)
    return xp.clip(total, LEAST_STD_M**2, None)


def by_inertia(fits: Fits, uncertainty: Uncertainty, beam: Beam) -> Array:
    """(B, G, 2) how far a load of 1 N/m on each piece, along y and z, would move the distance, in deviations."""
    problem, rig_arrays = fits.problem, fits.frames.rig_arrays
    nodes = arange_like(problem.scatter, fits.prediction.nodes.shape[1]) + 0.0 * fits.prediction.nodes[..., 0]
    at, places = fits.prediction.arclength(nodes), like(problem.scatter, beam.pieces_m)
    bent = deflection(at[..., None], places, 1.0, beam.stiffness_Nm2) * (beam.length_m / PIECES)
    columns = (bent[..., None] * point_jacobian(rig_arrays, fits.prediction)[:, :, None, 1:]).reshape(
        len(at), at.shape[1], 2 * PIECES
    )
    moment = (
        rig_arrays.moment_response(places * (beam.length_m / PIECES)).reshape(2, -1)
        * fits.frames.sensor_available[..., None]
    )
    weights = huber_weights(problem.moment_residual)[..., None]
    pull = problem.jacobian.mT @ problem.sums.times(columns) + problem.moment_jacobian.mT @ (weights * moment)
    moved = solve_columns(fits.equations.information, pull)[:, 0]
    return (moved / uncertainty.std[:, :1]).reshape(len(at), PIECES, 2)
