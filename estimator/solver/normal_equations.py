"""Points and readings against a prediction: residuals, robust weights, normal equations and cost of one frame."""

from __future__ import annotations

import numpy as np

from vbaa_calib.antenna.nodes import NODES_BEYOND
from vbaa_calib.core.compiled import compiled
from vbaa_calib.core.lanes import LANES, lane_of, load, load_from, spread, sqrt, store, store_to, where_positive
from vbaa_calib.core.robust import HUBER

from .fit import CONTACT_M, COST, INNER, LAST, NODES, SCATTER, arclength_of_node
from .linear_algebra import factorise, fill, inner_products, put, solve_factorised
from .prediction import predict
from .rig_arrays import TIP_DEFLECTION_STD, UNKNOWNS, tip_deflection

_EVERY, _FOOT_STEPS = 4, 2
"""A foot is searched from the nearest of every fourth node by Newton steps; later each iteration adds one."""
_BLOCK = 64
"""Points that are looked up before they are used: what was just written one by one is slow to read as a vector."""
_CONVERGED = 1e-4
"""A linear problem is solved once a reweighted step promises to lower the cost by no more than this part."""


@compiled
def huber_weight(residual):
    """Weight of a whitened residual's square (IRLS)."""
    return HUBER / max(abs(residual), HUBER)


@compiled
def _huber_loss(residual):
    """Half the square of a whitened residual, linear beyond `HUBER`."""
    size = abs(residual)
    # NaN must not pass for `HUBER`
    inner = HUBER if size > HUBER else size
    return inner * (size - 0.5 * inner)


@compiled
def prior_of(rig, fit, column):
    """Prior weight of an unknown's or rig step's square."""
    if column == 0:
        return 0.0
    if column < UNKNOWNS - 1:
        bent = tip_deflection(rig, fit.numbers[CONTACT_M] / rig.length_m) / TIP_DEFLECTION_STD
        return bent * bent
    return 1.0


@compiled
def nearest_feet(rig, frame, fit):
    """Feet of the points, searched over the whole curve."""
    seen_u, seen_v, u, v, foot_m = frame.u, frame.v, fit.u, fit.v, fit.foot_m
    for i in range(len(seen_u)):
        best, nearest = np.inf, 0
        for j in range(0, NODES, _EVERY):
            away_u, away_v = seen_u[i] - u[j], seen_v[i] - v[j]
            away = away_u * away_u + away_v * away_v
            if away < best:
                best, nearest = away, j
        foot_m[i] = arclength_of_node(fit, rig.length_m, 1.0 * nearest)
    for _ in range(_FOOT_STEPS):
        point_residuals(rig, frame, fit)


@compiled
def feet_along_chord(rig, frame, fit):
    """Feet on a nearly straight curve, the free antenna's, from places along its chord, in perspective."""
    start_u, start_v = fit.u[0], fit.v[0]
    chord_u, chord_v = fit.u[LAST] - start_u, fit.v[LAST] - start_v
    by_square = 1.0 / (chord_u * chord_u + chord_v * chord_v)
    near, far, length = fit.depth[0], fit.depth[LAST], rig.length_m
    seen_u, seen_v, foot_m = frame.u, frame.v, fit.foot_m
    for i in range(len(seen_u)):
        seen = ((seen_u[i] - start_u) * chord_u + (seen_v[i] - start_v) * chord_v) * by_square
        seen = min(max(seen, 0.0), 1.0)
        foot_m[i] = seen * near / (far - (far - near) * seen) * length


@compiled
def point_residuals(rig, frame, fit):
    """Residuals of the points from feet near the right ones, which come out nearer.

    The curve is taken as its parabola at the given feet: what is left of a foot's error e then counts as e³.
    """
    length, contact = rig.length_m, fit.numbers[CONTACT_M]
    inner, outer = contact / INNER, (length - contact) / NODES_BEYOND
    by_inner, by_outer = 1.0 / inner, 1.0 / outer
    # what is looked up in a record within the loop is looked up again for each point
    cubics, foot_m, nodes, shares = fit.cubics, fit.foot_m, fit.node, fit.share
    distances, precisions, count = fit.distance, fit.precision, len(frame.u)
    seen_u, seen_v, xx, xy, yy = frame.u, frame.v, frame.xx, frame.xy, frame.yy
    # eight points at a time; what is left repeats the last one. All of a block is looked up before it is used
    table, found = np.empty((15, _BLOCK)), np.empty((3, LANES))
    for begin in range(0, count, _BLOCK):
        some = min(_BLOCK, count - begin)
        for k in range((some + LANES - 1) // LANES * LANES):
            i = begin + min(k, some - 1)
            foot = foot_m[i]
            beyond = max(foot - contact, 0.0)
            along = (foot - beyond) * by_inner + beyond * by_outer
            node = int(min(max(along, 0.0), LAST - 1e-6))
            nodes[i], shares[i] = node, along - node
            for q in range(8):
                table[q, k] = cubics[node, q]
            table[8, k], table[9, k] = along - node, inner if node < INNER else outer
            if k >= some // LANES * LANES:
                table[10, k], table[11, k] = seen_u[i], seen_v[i]
                table[12, k], table[13, k], table[14, k] = xx[i], xy[i], yy[i]
        for first in range(0, some, LANES):
            at, whole = begin + first, first + LANES <= some
            if whole:
                off_u, off_v = load_from(seen_u, at), load_from(seen_v, at)
                uu, uv, vv = load_from(xx, at), load_from(xy, at), load_from(yy, at)
            else:
                off_u, off_v, uu = load_from(table, 10, first), load_from(table, 11, first), load_from(table, 12, first)
                uv, vv = load_from(table, 13, first), load_from(table, 14, first)
            share = load_from(table, 8, first)
            rise_u, rise_v, bend_u, bend_v = (
                load_from(table, 3, first) * share,
                load_from(table, 7, first) * share,
                load_from(table, 2, first),
                load_from(table, 6, first),
            )
            off_u = off_u - (
                ((rise_u + bend_u) * share + load_from(table, 1, first)) * share + load_from(table, 0, first)
            )
            off_v = off_v - (
                ((rise_v + bend_v) * share + load_from(table, 5, first)) * share + load_from(table, 4, first)
            )
            u1 = (3.0 * rise_u + 2.0 * bend_u) * share + load_from(table, 1, first)
            v1 = (3.0 * rise_v + 2.0 * bend_v) * share + load_from(table, 5, first)
            u2, v2 = 6.0 * rise_u + 2.0 * bend_u, 6.0 * rise_v + 2.0 * bend_v
            square = u1 * u1 + v1 * v1
            by_square = 1.0 / square
            ahead = (off_u * u1 + off_v * v1) * by_square
            longest = where_positive(ahead - 1.0, 1.0, where_positive(-1.0 - ahead, -1.0, ahead))
            distance = off_v * u1 - off_u * v1 - 0.5 * (v2 * u1 - u2 * v1) * longest * longest
            # the normal is (−v′, u′)/√(u′² + v′²)
            distance = distance * sqrt(by_square)
            precision = square / (uu * v1 * v1 - 2.0 * uv * u1 * v1 + vv * u1 * u1)
            ahead = ahead * load_from(table, 9, first)
            if whole:
                store_to(distances, distance, at)
                store_to(precisions, precision, at)
                foot_there = load_from(foot_m, at) + ahead
                # a prediction that left the domain of the model is rejected by its cost, not here
                foot_there = where_positive(foot_there, foot_there, 0.0)
                store_to(foot_m, where_positive(foot_there - length, length, foot_there), at)
            else:
                store(found, distance, 0)
                store(found, precision, 1)
                store(found, ahead, 2)
                for lane in range(some - first):
                    i = at + lane
                    distances[i], precisions[i] = found[0, lane], found[1, lane]
                    foot = foot_m[i] + found[2, lane]
                    foot = foot if foot == foot else 0.0
                    foot_m[i] = min(max(foot, 0.0), length)


@compiled
def shift_by_steps(fit, first, steps, shift):
    """Displacement (M,) by steps (K − first,) of the columns from `first` on."""
    columns, count = fit.columns, len(steps)
    for j in range(NODES):
        total = 0.0
        for k in range(count):
            total += columns[j, first + k] * steps[k]
        shift[j] = total


@compiled
def _take_out(fit, shift):
    """Take a displacement (M,) of the curve out of the points' distances."""
    distance, node, share = fit.distance, fit.node, fit.share
    for i in range(len(distance)):
        first = shift[node[i]]
        distance[i] -= first + share[i] * (shift[node[i] + 1] - first)


@compiled
def residuals_with_rig(fit, shift):
    """Take the rig's steps out of the residuals. `shift` (M,) is scratch room."""
    put(fit.predicted_residual, fit.residual)
    if len(fit.steps) == 0:
        return
    shift_by_steps(fit, UNKNOWNS, fit.steps, shift)
    _take_out(fit, shift)
    steps, readings, residual = fit.steps, fit.reading_columns, fit.residual
    for reading in range(3):
        total = 0.0
        for k in range(len(steps)):
            total += readings[reading, UNKNOWNS + k] * steps[k]
        residual[reading] -= total


@compiled
def points_cost(fit):
    """Robust cost of the points, whose weighted sums over the nodes are renewed."""
    diagonal, beside, pulls = fit.diagonal, fit.beside, fit.load
    distances, precisions, shares, nodes = fit.distance, fit.precision, fit.share, fit.node
    fill(diagonal, 0.0)
    fill(beside, 0.0)
    fill(pulls, 0.0)
    by_scatter = 1.0 / fit.numbers[SCATTER]
    square = by_scatter * by_scatter
    cost, count, before = 0.0, len(distances), 0
    table, costs = np.empty((5, LANES)), spread(0.0)
    # sums over neighbours between the same nodes are written when the next node comes
    own, next_own, mixed, pulled, next_pulled = 0.0, 0.0, 0.0, 0.0, 0.0
    for begin in range(0, count, LANES):
        some = min(LANES, count - begin)
        if some == LANES:
            precision, distance, share = (
                load_from(precisions, begin),
                load_from(distances, begin),
                load_from(shares, begin),
            )
        else:
            for row in range(3):
                store(table, spread(0.0), row)
            for lane in range(some):
                i = begin + lane
                table[0, lane], table[1, lane], table[2, lane] = precisions[i], distances[i], shares[i]
            precision, distance, share = load(table, 0), load(table, 1), load(table, 2)
        size = distance * sqrt(precision) * by_scatter
        size = where_positive(-size, -size, size)
        inner = where_positive(size - HUBER, HUBER, size)
        costs = costs + inner * (size - 0.5 * inner)
        # NaN has full weight here: its cost shows it
        weight = HUBER / where_positive(size - HUBER, size, HUBER) * precision * square
        ahead, pull = weight * share, weight * distance
        second, pull_ahead = ahead * share, pull * share
        store(table, weight - 2.0 * ahead + second, 0)
        store(table, second, 1)
        store(table, ahead - second, 2)
        store(table, pull - pull_ahead, 3)
        store(table, pull_ahead, 4)
        for lane in range(some):
            node = nodes[begin + lane]
            if node != before:
                diagonal[before] += own
                diagonal[before + 1] += next_own
                beside[before] += mixed
                pulls[before] += pulled
                pulls[before + 1] += next_pulled
                own, next_own, mixed, pulled, next_pulled, before = 0.0, 0.0, 0.0, 0.0, 0.0, node
            own += table[0, lane]
            next_own += table[1, lane]
            mixed += table[2, lane]
            pulled += table[3, lane]
            next_pulled += table[4, lane]
    for lane in range(LANES):
        cost += lane_of(costs, lane)
    diagonal[before] += own
    diagonal[before + 1] += next_own
    beside[before] += mixed
    pulls[before] += pulled
    pulls[before + 1] += next_pulled
    return cost


@compiled
def times_tridiagonal(fit, columns, product):
    """The points' tridiagonal information times columns (M, C), C a multiple of LANES."""
    diagonal, beside, size = fit.diagonal, fit.beside, columns.shape[1]
    for first in range(0, size, LANES):
        before, here, by_before = spread(0.0), load_from(columns, 0, first), 0.0
        for j in range(LAST):
            after = load_from(columns, j + 1, first)
            store_to(product, by_before * before + diagonal[j] * here + beside[j] * after, j, first)
            before, here, by_before = here, after, beside[j]
        store_to(product, by_before * before + diagonal[LAST] * here, LAST, first)


@compiled
def normal_equations(rig, fit, first, product):
    """Information, right side and cost of the columns from `first` on (4: the rig alone), at the residuals as they are.

    product : (M, K) scratch room.
    """
    size = fit.size
    cost = points_cost(fit)
    columns, pulls, readings, information, side = fit.columns, fit.load, fit.reading_columns, fit.information, fit.side
    times_tridiagonal(fit, columns, product)
    inner_products(columns, product, information)
    for k in range(0, len(side), LANES):
        total = spread(0.0)
        for j in range(NODES):
            total = total + pulls[j] * load_from(columns, j, k)
        store_to(side, total, k)
    residual, weight = fit.residual, np.empty(3)
    for reading in range(3):
        weight[reading] = huber_weight(residual[reading])
        cost += _huber_loss(residual[reading])
    for a in range(first, size):
        by_y, by_z, by_end = weight[0] * readings[0, a], weight[1] * readings[1, a], weight[2] * readings[2, a]
        side[a] += by_y * residual[0] + by_z * residual[1] + by_end * residual[2]
        # what comes after the diagonal is overwritten below
        for b in range(0, a + 1, LANES):
            row = load_from(information, a, b) + by_y * load_from(readings, 0, b) + by_z * load_from(readings, 1, b)
            store_to(information, row + by_end * load_from(readings, 2, b), a, b)
    for a in range(first, size):
        prior = prior_of(rig, fit, a)
        at = fit.unknowns[a] if a < UNKNOWNS else fit.steps[a - UNKNOWNS]
        information[a, a] += prior
        side[a] -= prior * at
        cost += 0.5 * prior * at * at
        for b in range(first, a):
            information[b, a] = information[a, b]
    fit.numbers[COST] = cost


@compiled
def linearise(rig, frame, fit, work):
    """Residuals about the fit's prediction, the rig's steps taken out. Feet come out nearer to the right ones."""
    point_residuals(rig, frame, fit)
    residuals_with_rig(fit, work.shift)


@compiled
def evaluate(rig, frame, rung, fit, work):
    """A fit as it is at its state, without a step: prediction, residuals and normal equations."""
    work.evaluations[0] += 1
    predict(rig, frame, rung, work.bent, fit, True)
    linearise(rig, frame, fit, work)
    normal_equations(rig, fit, 0, work.product)


@compiled
def total_cost(rig, fit):
    """Robust cost with the priors, at the residuals as they are; nothing of the fit changes."""
    cost, by_scatter, distance, precision = 0.0, 1.0 / fit.numbers[SCATTER], fit.distance, fit.precision
    for i in range(len(distance)):
        cost += _huber_loss(distance[i] * np.sqrt(precision[i]) * by_scatter)
    for reading in range(3):
        cost += _huber_loss(fit.residual[reading])
    for a in range(1, fit.size):
        at = fit.unknowns[a] if a < UNKNOWNS else fit.steps[a - UNKNOWNS]
        cost += 0.5 * prior_of(rig, fit, a) * at * at
    return cost


@compiled
def least_cost(rig, fit, first, rounds, work):
    """Least cost of the linear problem about a fit by IRLS, in so many rounds at most. Spoils the fit's state.

    first : 0, or 4 where only the rig may move. The step is taken from where the fit is, priors included.
    """
    size = fit.size - first
    for _ in range(rounds):
        normal_equations(rig, fit, first, work.product)
        factorise(fit.information, first, size, 0.0, work.factor, work.scale)
        step = work.step[:size]
        solve_factorised(work.factor, work.scale, size, fit.side[first:], step)
        promise = 0.0
        for k in range(size):
            promise += fit.side[first + k] * step[k]
        shift_by_steps(fit, first, step, work.shift)
        _take_out(fit, work.shift)
        for reading in range(3):
            for k in range(size):
                fit.residual[reading] -= fit.reading_columns[reading, first + k] * step[k]
        for k in range(size):
            a = first + k
            if a < UNKNOWNS:
                fit.unknowns[a] += step[k]
            else:
                fit.steps[a - UNKNOWNS] += step[k]
        if promise < _CONVERGED * (1.0 + fit.numbers[COST]):
            break
    return total_cost(rig, fit)


@compiled
def unscaled_cost(rig, fit):
    """The cost with the deviations that the points came with: only these compare between fits."""
    scatter = fit.numbers[SCATTER]
    if scatter == 1.0:
        return fit.numbers[COST]
    fit.numbers[SCATTER] = 1.0
    cost = total_cost(rig, fit)
    fit.numbers[SCATTER] = scatter
    return cost
