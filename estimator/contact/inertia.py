"""What judging motion needs of fits: where the antenna's pieces are, how well, and what their inertia would do."""

from __future__ import annotations

from estimator.solver.curves import cubic, cubics
from estimator.solver.normal_equations import solved_columns
from estimator.solver.prediction import by_point
from estimator.solver.residuals import arclength, between_nodes, rows
from estimator.solver.rig_arrays import UNKNOWNS
from estimator.solver.state import Settled
from estimator.solver.uncertainty import Worth
from vbaa_calib.antenna.linear import deflection, deflection_by_contact
from vbaa_calib.core.arrays import Array, counted, like, namespace
from vbaa_calib.core.robust import huber_weights

from .motion import PIECES, Beam

LEAST_STD_M = 1e-6
"""No place is known better: near the clamp the model's own errors are all there is."""


def pieces(fits: Settled, beam: Beam) -> tuple[Array, Array]:
    """Points (B, G, 3) of the fitted antennas at the beam's pieces, antenna frame, their deviations (B, G) by noise.

    The deviations are those from frame to frame: the rig's errors are the same in all.
    """
    view, state = fits.view, fits.state
    xp = namespace(state.scatter)
    at = like(state.scatter, beam.pieces_m) + 0.0 * view.contact_m[:, None]
    table = cubics(view.points_m, view.tangents, view.contact_m, view.length_m)
    left, share, _ = between_nodes(view, at)
    points = xp.stack([value for value, _, _ in cubic(table, rows(left, table.shape[1]), share)], -1)
    return points, xp.sqrt(_scatter(fits, at))


def _scatter(fits: Settled, at_m: Array) -> Array:
    """(B, G) variance of the antenna at arc lengths by the noise of one frame, for the rig as it is: linear beam."""
    known, unknowns = fits.frames.known, fits.state.unknowns
    xp = namespace(at_m)
    stiffness, contact = xp.exp(known.parameters[6]), unknowns[:, :1] * known.length_m
    by_force = deflection(at_m, contact, known.force_unit_N, stiffness)
    by_distance = deflection_by_contact(at_m, contact, known.force_unit_N, stiffness) * known.length_m
    information = fits.equations.information[:, :UNKNOWNS, :UNKNOWNS]
    total = 0.0 * at_m
    for axis in (1, 2):
        parts = [unknowns[:, axis : axis + 1] * by_distance, *(by_force * (axis == a) for a in (1, 2)), 0.0 * at_m]
        slopes = xp.stack(parts, -1)
        total = total + (slopes * solved_columns(information, slopes.mT).mT).sum(-1)
    return xp.clip(total, LEAST_STD_M**2, None)


def by_inertia(fits: Settled, known: Worth, beam: Beam) -> Array:
    """(B, G, 2) how far a load of 1 N/m on each piece, along y and z, would move the distance, in deviations."""
    about, frame = fits.problem, fits.frames.known
    nodes = counted(about.scatter, fits.view.nodes.shape[1]) + 0.0 * fits.view.nodes[..., 0]
    at, places = arclength(fits.view, nodes), like(about.scatter, beam.pieces_m)
    bent = deflection(at[..., None], places, 1.0, beam.stiffness_Nm2) * (beam.length_m / PIECES)
    columns = (bent[..., None] * by_point(frame, fits.view)[:, :, None, 1:]).reshape(len(at), at.shape[1], 2 * PIECES)
    felt = frame.felt_by(places * (beam.length_m / PIECES)).reshape(2, -1) * fits.frames.felt[..., None]
    held = huber_weights(about.misfit)[..., None]
    pull = about.columns.mT @ about.summed.times(columns) + about.felt.mT @ (held * felt)
    moved = solved_columns(fits.equations.information, pull)[:, 0]
    return (moved / known.std[:, :1]).reshape(len(at), PIECES, 2)
