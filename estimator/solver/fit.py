"""One frame's fit: where it is, the model linearised there, and its normal equations. All inside compiled functions."""

from __future__ import annotations

import numpy as np

from vbaa_calib.antenna.nodes import CONTACT, NODES_BEYOND, NODES_TO_CONTACT
from vbaa_calib.core.compiled import compiled, record
from vbaa_calib.core.lanes import LANES

from .linear_algebra import put
from .rig_arrays import UNKNOWNS

NODES = NODES_TO_CONTACT + NODES_BEYOND
INNER, LAST = CONTACT, NODES - 1
"""The contact's node and the tip's. Nodes are equally spaced on either side of the contact."""
COST, SCATTER, CONVERGED, AT_TIP, CONTACT_M = range(5)
"""What `Fit.numbers` holds: the robust cost with the priors; the factor on the points' deviations; whether the fit
converged, and whether its distance is fixed at the tip, as 1 and 0; the contact's arc length."""


@record
class Fit:
    """A fit of N points on M nodes, in K = 4 + R unknowns and rig steps.

    Attributes
    ----------
    unknowns : (4,) see `rig_arrays.UNKNOWNS`. steps : (R,) along the rig's independent axes, in deviations.
    foot_m : (N,) arc lengths of the points of the curve nearest to the seen ones.
    points_m, tangents : (3, M) of the predicted antenna, antenna frame.
    u, v, depth : (M,) its ideal picture. normal_u, normal_v : (M,) unit normals there.
    cubics : (M, 8) the picture between nodes: four coefficients of u, then of v, by the share of the way.
    columns : (M, K) displacement along the normals by unknowns and rig steps.
    reading_columns : (3, K) of the predicted readings, in deviations: moments about y and z, and the antenna's end
        along it in the picture.
    point_force : (6,) contact point, m, and force, N, antenna frame. point_force_columns : (6, K).
    predicted_residual : (3,) what was read less what is predicted, in deviations; residual : (3,) with the rig's steps.
    node, share : (N,) the node before each foot, and the part of the way to the next one.
    distance : (N,) of the points from the curve, along its normal, the rig's steps taken out.
    precision : (N,) one over the variance of that.
    diagonal, beside, load : (M,) weighted sums of the points over nodes: a tridiagonal information and its right side.
        For values c on the nodes, linear between them: Σ w c² = Σ diagonal·c² + 2 Σ beside·c·c₊₁, Σ w c·r = Σ load·c.
    information, side : (K, K), (K,) of the normal equations, priors included.
    numbers : (5,) `COST` and what follows it.
    size : K. Columns, readings, information and side have room for a few more, zeros, so that rows are whole vectors.
    data : all of these but `node`, one after the other.
    """

    size: int
    data: np.ndarray
    unknowns: np.ndarray
    steps: np.ndarray
    foot_m: np.ndarray
    points_m: np.ndarray
    tangents: np.ndarray
    u: np.ndarray
    v: np.ndarray
    depth: np.ndarray
    normal_u: np.ndarray
    normal_v: np.ndarray
    cubics: np.ndarray
    columns: np.ndarray
    reading_columns: np.ndarray
    point_force: np.ndarray
    point_force_columns: np.ndarray
    predicted_residual: np.ndarray
    residual: np.ndarray
    node: np.ndarray
    share: np.ndarray
    distance: np.ndarray
    precision: np.ndarray
    diagonal: np.ndarray
    beside: np.ndarray
    load: np.ndarray
    information: np.ndarray
    side: np.ndarray
    numbers: np.ndarray


@compiled
def empty_fit(points, steps):
    """Room for a fit of so many points and rig steps."""
    size = UNKNOWNS + steps
    wide = (size + LANES - 1) // LANES * LANES
    state, curve, columns = UNKNOWNS + steps + points + 5, NODES * 22, (NODES + 9) * wide
    data = np.zeros(state + curve + columns + 12 + 3 * points + wide * wide + wide)
    at, begin = np.zeros(26, np.int64), 0
    lengths = (UNKNOWNS, steps, points, 5, 3 * NODES, 3 * NODES, NODES, NODES, NODES, NODES, NODES, 8 * NODES)
    for k in range(12):
        at[k] = begin
        begin += lengths[k]
    more = (NODES * wide, 3 * wide, 6, 6 * wide, 3, 3, points, points, points, NODES, NODES, NODES, wide * wide, wide)
    for k in range(14):
        at[12 + k] = begin
        begin += more[k]
    fit = Fit(
        size,
        data,
        data[at[0] : at[0] + UNKNOWNS],
        data[at[1] : at[1] + steps],
        data[at[2] : at[2] + points],
        data[at[4] : at[5]].reshape((3, NODES)),
        data[at[5] : at[6]].reshape((3, NODES)),
        data[at[6] : at[7]],
        data[at[7] : at[8]],
        data[at[8] : at[9]],
        data[at[9] : at[10]],
        data[at[10] : at[11]],
        data[at[11] : at[12]].reshape((NODES, 8)),
        data[at[12] : at[13]].reshape((NODES, wide)),
        data[at[13] : at[14]].reshape((3, wide)),
        data[at[14] : at[15]],
        data[at[15] : at[16]].reshape((6, wide)),
        data[at[16] : at[17]],
        data[at[17] : at[18]],
        np.zeros(points, np.int64),
        data[at[18] : at[19]],
        data[at[19] : at[20]],
        data[at[20] : at[21]],
        data[at[21] : at[22]],
        data[at[22] : at[23]],
        data[at[23] : at[24]],
        data[at[24] : at[25]].reshape((wide, wide)),
        data[at[25] : begin],
        data[at[3] : at[4]],
    )
    fit.numbers[SCATTER] = 1.0
    return fit


@compiled
def copy_fit(source, target):
    """All of a fit into another of the same sizes."""
    put(source.data, target.data)
    put(source.node, target.node)


@record
class State:
    """What a descent goes back to: unknowns, steps, feet and numbers of a fit, and its normal equations."""

    state: np.ndarray
    information: np.ndarray
    side: np.ndarray


@compiled
def empty_state(points, steps):
    """Room for the state of a fit of so many points and rig steps."""
    wide = (UNKNOWNS + steps + LANES - 1) // LANES * LANES
    return State(np.empty(UNKNOWNS + steps + points + 5), np.empty((wide, wide)), np.empty(wide))


@compiled
def keep(fit, kept):
    """Keep a fit's state."""
    state, data, information, own = kept.state, fit.data, kept.information, fit.information
    for k in range(len(state)):
        state[k] = data[k]
    for a in range(fit.size):
        for b in range(len(own)):
            information[a, b] = own[a, b]
    put(fit.side, kept.side)


@compiled
def go_back(kept, fit):
    """Return to a state; what belongs to the curve stays as it is."""
    state, data, information, own = kept.state, fit.data, kept.information, fit.information
    for k in range(len(state)):
        data[k] = state[k]
    for a in range(fit.size):
        for b in range(len(own)):
            own[a, b] = information[a, b]
    put(kept.side, fit.side)


@compiled
def arclength_of_node(fit, length_m, node):
    """Arc length, m, of a place given in nodes."""
    contact = fit.numbers[CONTACT_M]
    past = max(node - INNER, 0.0)
    return (node - past) * (contact / INNER) + past * ((length_m - contact) / NODES_BEYOND)


@compiled
def locate(fit, length_m, arclength_m):
    """The node before an arc length, the share of the way to the next one, and the interval's width."""
    contact = fit.numbers[CONTACT_M]
    inner, outer = contact / INNER, (length_m - contact) / NODES_BEYOND
    beyond = max(arclength_m - contact, 0.0)
    along = (arclength_m - beyond) / inner + beyond / outer
    within = min(max(along, 0.0), LAST - 1e-6)
    node = int(within) if within == within else 0
    return node, along - node, inner if node < INNER else outer
