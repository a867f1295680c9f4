"""Covariance, contact evidence and model bias of a converged fit."""

from __future__ import annotations

import numpy as np

from vbaa_calib.antenna.nodes import CONTACT
from vbaa_calib.core.compiled import compiled, record
from vbaa_calib.core.lanes import LANES, load_from, spread, store, store_to
from vbaa_calib.core.robust import HUBER

from .convergence import EXCESS_SCATTER, moved_unknowns
from .fit import COST, LAST, NODES, SCATTER, copy_fit
from .linear_algebra import factorise, fill, solve_many, symmetric_eigen
from .normal_equations import huber_weight, least_cost, linearise, times_tridiagonal, total_cost
from .prediction import (
    ELASTICA,
    PAPER,
    REFERENCE,
    bend_and_see,
    fitted_tip_axis,
    lay,
    predict,
    predicted_moment,
)
from .rig_arrays import UNKNOWNS

_ROUNDS, _CLOSE_ROUNDS = 4, 2
"""IRLS rounds of a linear problem: far from the solution, and beside it."""
_LEAST_REDUNDANCY = 0.03
"""Least deviation of a moment's residual in its own deviations: with less the moment was fitted, not tested."""
_PROFILE_STEPS = (3.0, 6.0, -3.0, -6.0)
"""Deviations from the minimum at which the cost is profiled."""
_BEYOND_DOUBT = 100.0
"""Evidence of a contact above which the fit's own cost is taken as it is."""
_SINGULAR = 1e14
"""Condition number of the scaled information beyond which the covariance is infinite."""


@record
class Uncertainty:
    """First-order uncertainty of a fit.

    Attributes
    ----------
    covariance : (4, 4) of the unknowns, from noise and rig together; infinite where they are not observable.
    rig_response : (R, 4) how the rig's likeliest steps go with the unknowns.
    touch : (6, 4) derivatives of contact point and force by the unknowns, the rig's steps going with them.
    rig_touch : (R, 6) covariance of the rig's steps, for a known contact, with contact point and force.
    touch_by_rig : (6, 6) what the rig's steps, for a known contact, make of the covariance of point and force.
    condition : (1,) condition number of the contact's own information, scaled to a unit diagonal.
    reading_std : (3,) deviation of each reading's whitened residual, below one as far as the moment was fitted.
    """

    covariance: np.ndarray
    rig_response: np.ndarray
    touch: np.ndarray
    rig_touch: np.ndarray
    touch_by_rig: np.ndarray
    condition: np.ndarray
    reading_std: np.ndarray


@compiled
def empty_uncertainty(steps):
    """Room for it."""
    return Uncertainty(
        np.empty((UNKNOWNS, UNKNOWNS)),
        np.empty((steps, UNKNOWNS)),
        np.empty((6, UNKNOWNS)),
        np.empty((steps, 6)),
        np.empty((6, 6)),
        np.empty(1),
        np.empty(3),
    )


@compiled
def uncertainty(fit, found, work):
    """Invert the fit's information by the Schur complement of the rig's part, whose prior keeps it regular.

    A distance fixed at the tip gets the deviation that it would have if it were free.
    """
    whole, steps, response = fit.information, len(fit.steps), found.rig_response
    fitted = _rig_part(fit, found, work)
    own = np.empty((UNKNOWNS, UNKNOWNS))
    regular = True
    for a in range(UNKNOWNS):
        for b in range(UNKNOWNS):
            own[a, b] = whole[a, b]
            for k in range(steps):
                own[a, b] += whole[a, UNKNOWNS + k] * response[k, b]
            regular = regular and np.isfinite(own[a, b])
    for a in range(UNKNOWNS):
        regular = regular and own[a, a] > 0.0
    covariance = found.covariance
    covariance[:] = np.inf
    found.condition[0] = np.inf
    fill(found.reading_std, 1.0)
    if not regular:
        return
    scale, values, vectors = np.empty(UNKNOWNS), np.empty(UNKNOWNS), np.empty((UNKNOWNS, UNKNOWNS))
    for a in range(UNKNOWNS):
        scale[a] = 1.0 / np.sqrt(own[a, a])
    for a in range(UNKNOWNS):
        for b in range(UNKNOWNS):
            own[a, b] *= scale[a] * scale[b]
    symmetric_eigen(own, values, vectors)
    if not values[0] > values[-1] / _SINGULAR:
        return
    for a in range(UNKNOWNS):
        for b in range(UNKNOWNS):
            total = 0.0
            for k in range(UNKNOWNS):
                total += vectors[a, k] * vectors[b, k] / values[k]
            covariance[a, b] = total * scale[a] * scale[b]
    found.condition[0] = values[-1] / values[0]
    _reading_std(fit, found, fitted)
    covariance *= _huber_variance_inflation(fit)


@compiled
def _rig_part(fit, found, work):
    """What the rig's steps do for a known contact, and how they go with it. Returns (3,) what they make of the
    readings' variances."""
    whole, steps, touch, readings = fit.information, len(fit.steps), fit.point_force_columns, fit.reading_columns
    sides, fitted = np.zeros((steps, 2 * LANES)), np.zeros(3)
    for k in range(steps):
        for a in range(UNKNOWNS):
            sides[k, a] = -whole[UNKNOWNS + k, a]
        for q in range(6):
            sides[k, UNKNOWNS + q] = touch[q, UNKNOWNS + k]
        for reading in range(3):
            sides[k, UNKNOWNS + 6 + reading] = readings[reading, UNKNOWNS + k]
    factorise(whole, UNKNOWNS, steps, 0.0, work.factor, work.scale)
    solve_many(work.factor, work.scale, steps, sides, True)
    own_touch, response, rig_touch, by_rig = found.touch, found.rig_response, found.rig_touch, found.touch_by_rig
    for p in range(6):
        for a in range(UNKNOWNS):
            own_touch[p, a] = touch[p, a]
        for q in range(6):
            by_rig[p, q] = 0.0
    for k in range(steps):
        for a in range(UNKNOWNS):
            response[k, a] = sides[k, a]
        for reading in range(3):
            fitted[reading] += readings[reading, UNKNOWNS + k] * sides[k, UNKNOWNS + 6 + reading]
        for p in range(6):
            rig_touch[k, p] = sides[k, UNKNOWNS + p]
            for a in range(UNKNOWNS):
                own_touch[p, a] += touch[p, UNKNOWNS + k] * sides[k, a]
            for q in range(6):
                by_rig[p, q] += touch[p, UNKNOWNS + k] * sides[k, UNKNOWNS + q]
    return fitted


@compiled
def _reading_std(fit, found, fitted):
    """How much of each reading's residual was fitted; `fitted` (3,) is the rig's part of that."""
    total = np.empty(UNKNOWNS)
    for reading in range(3):
        row, own = fit.reading_columns[reading], fitted[reading]
        for a in range(UNKNOWNS):
            total[a] = row[a]
            for k in range(len(fit.steps)):
                total[a] += row[UNKNOWNS + k] * found.rig_response[k, a]
        for a in range(UNKNOWNS):
            for b in range(UNKNOWNS):
                own += total[a] * found.covariance[a, b] * total[b]
        weight = huber_weight(fit.residual[reading])
        found.reading_std[reading] = np.sqrt(max(1.0 - weight * own, _LEAST_REDUNDANCY**2))


@compiled
def huber_excess(fit):
    """Σψ²/Σw of Huber's ψ and weights."""
    count, square, total, by_scatter = len(fit.distance), 0.0, 0.0, 1.0 / fit.numbers[SCATTER]
    for i in range(count):
        whitened = abs(fit.distance[i]) * np.sqrt(fit.precision[i]) * by_scatter
        weight = HUBER / max(whitened, HUBER)
        square += (weight * whitened) ** 2
        total += weight
    return square / max(total, 1e-30)


@compiled
def _huber_variance_inflation(fit):
    """`huber_excess` where it is more than noise gives, else 1."""
    factor = huber_excess(fit)
    return factor if factor > 1.0 + EXCESS_SCATTER / np.sqrt(len(fit.distance) + 1e-30) else 1.0


@compiled
def touch_covariance(found, total):
    """Covariance (6, 6) of contact point and force."""
    for p in range(6):
        for q in range(6):
            value = found.touch_by_rig[p, q]
            for a in range(UNKNOWNS):
                for b in range(UNKNOWNS):
                    value += found.touch[p, a] * found.covariance[a, b] * found.touch[q, b]
            total[p, q] = value


@compiled
def widen_by_profile(rig, frame, rung, fit, found, work):
    """Widen the covariance where the cost rises more slowly than its curvature says.

    By vision alone, the picture holds a small deflection along the line of sight by second order only: some deviations
    out along the longest axis the cost is then far from what it should have risen by.
    """
    covariance, steps = found.covariance, len(fit.steps)
    if not np.isfinite(covariance).all():
        return
    std, values = np.empty(UNKNOWNS), np.empty(UNKNOWNS)
    unit, vectors, axis = np.empty((UNKNOWNS, UNKNOWNS)), np.empty((UNKNOWNS, UNKNOWNS)), np.empty(UNKNOWNS)
    for a in range(UNKNOWNS):
        std[a] = np.sqrt(covariance[a, a])
    for a in range(UNKNOWNS):
        for b in range(UNKNOWNS):
            unit[a, b] = covariance[a, b] / (std[a] * std[b])
    symmetric_eigen(unit, values, vectors)
    wider, there = 1.0, work.other
    for far in _PROFILE_STEPS:
        for a in range(UNKNOWNS):
            axis[a] = far * std[a] * vectors[a, UNKNOWNS - 1] * np.sqrt(values[UNKNOWNS - 1])
        copy_fit(fit, there)
        moved_unknowns(rig, fit.unknowns, axis, there.unknowns)
        for k in range(steps):
            for a in range(UNKNOWNS):
                there.steps[k] += found.rig_response[k, a] * (there.unknowns[a] - fit.unknowns[a])
        predict(rig, frame, rung, work.bent, there, False)
        linearise(rig, frame, there, work)
        rise = total_cost(rig, there) - fit.numbers[COST]
        rise = rise if rise == rise else 0.0
        wider = max(wider, 0.5 * far * far / max(rise, 0.01))
    covariance *= wider


@compiled
def first_order_errors(rig, frame, rung, fit, reference, errors, work):
    """First-order errors (5, 10) of unknowns (4), contact point and force (6): what rungs leave out.

    A row for each rung, of a fit on it, if the antenna were the highest rung's; row 4, by one deviation of the friction
    that some rungs do not model. Of a fit on the highest rung all of them, else its own and friction's. Contact point
    and force are moved with the unknowns.

    reference : the highest rung's prediction at the fit's unknowns.
    """
    shift, reading, touch, bent = np.zeros((NODES, LANES)), np.zeros((3, LANES)), np.zeros((6, LANES)), work.bent
    if rung == REFERENCE:
        lay(rig, bent, fit.unknowns)
        for row in range(REFERENCE):
            bend_and_see(rig, frame, row, bent, bent.no_rows)
            _apart(rig, frame, fit, bent, row, -1.0, shift, reading, touch)
        if rig.friction_rad > 0.0:
            for j in range(NODES):
                shift[j, 4] = fit.columns[j, UNKNOWNS - 1]
            for k in range(3):
                reading[k, 4] = fit.reading_columns[k, UNKNOWNS - 1]
            for q in range(6):
                touch[q, 4] = fit.point_force_columns[q, UNKNOWNS - 1]
    else:
        lay(rig, bent, fit.unknowns)
        bend_and_see(rig, frame, REFERENCE, bent, bent.no_rows)
        _apart(rig, frame, fit, bent, rung, 1.0, shift, reading, touch)
        if rung < ELASTICA and rig.friction_rad > 0.0:
            lean = fit.unknowns[UNKNOWNS - 1]
            store(bent.friction_rad, spread((lean + 1.0) * rig.friction_rad))
            bend_and_see(rig, frame, REFERENCE, bent, bent.no_rows)
            _apart(rig, frame, reference, bent, 4, 1.0, shift, reading, touch)
    moved = _linear_shifts(fit, shift, reading, work)
    for row in range(5):
        for a in range(UNKNOWNS):
            errors[row, a] = moved[a, row]
        for q in range(6):
            errors[row, UNKNOWNS + q] = -touch[q, row]
            for a in range(UNKNOWNS):
                errors[row, UNKNOWNS + q] += fit.point_force_columns[q, a] * moved[a, row]


@compiled
def _apart(rig, frame, fit, bent, column, sign, shift, reading, touch):
    """What another shape of the antenna says, less the fit's, into a column: along the normals (M, ·), readings in
    deviations (3, ·), and contact point and force (6, ·)."""
    for j in range(NODES):
        u, v = bent.u[j, 0] - fit.u[j], bent.v[j, 0] - fit.v[j]
        shift[j, column] = sign * (u * fit.normal_u[j] + v * fit.normal_v[j])
    for about in range(2):
        apart = predicted_moment(rig, frame, bent, 0, about) - frame.moment_Nm[about] / rig.std[about]
        reading[about, column] = sign * (apart * frame.available[about] + fit.predicted_residual[about])
    end_u, end_v, _ = fitted_tip_axis(rig, frame, fit)
    along = (bent.u[LAST, 0] - fit.u[LAST]) * end_u + (bent.v[LAST, 0] - fit.v[LAST]) * end_v
    reading[2, column] = sign * along * frame.available[2]
    for axis in range(3):
        touch[axis, column] = sign * (bent.points_m[axis, CONTACT, 0] - fit.point_force[axis])
        touch[3 + axis, column] = sign * (bent.force_N[axis, 0] - fit.point_force[3 + axis])


@compiled
def _linear_shifts(fit, shift, reading, work):
    """How far unknowns and rig steps (K, C) would move, to first order, if the data changed by displacements (M, C)
    along the prediction's normals and readings (3, C) in deviations."""
    product, sides = np.empty_like(shift), np.zeros((len(fit.side), shift.shape[1]))
    columns, readings, residual = fit.columns, fit.reading_columns, fit.residual
    times_tridiagonal(fit, shift, product)
    for a in range(fit.size):
        for first in range(0, shift.shape[1], LANES):
            total = load_from(sides, a, first)
            for j in range(NODES):
                total = total + columns[j, a] * load_from(product, j, first)
            for k in range(3):
                pull = huber_weight(residual[k]) * readings[k, a]
                total = total + pull * load_from(reading, k, first)
            store_to(sides, total, a, first)
    factorise(fit.information, 0, fit.size, 0.0, work.factor, work.scale)
    solve_many(work.factor, work.scale, fit.size, sides, True)
    return sides


@compiled
def predicted_bias(errors, found, bias):
    """Each rung's bias (4,) from `first_order_errors`: the largest of distance, f_y and f_z, in deviations.

    On rungs without friction, also by one deviation of friction. Infinite where the deviations are not known.
    """
    covariance, std = np.empty((6, 6)), np.empty(3)
    touch_covariance(found, covariance)
    std[0], std[1], std[2] = found.covariance[0, 0], covariance[4, 4], covariance[5, 5]
    std = np.sqrt(std)
    sound = np.isfinite(std).all()
    off = np.array([0, UNKNOWNS + 4, UNKNOWNS + 5])
    for rung in range(PAPER, REFERENCE + 1):
        bias[rung] = 0.0 if sound else np.inf
        if rung == REFERENCE or not sound:
            continue
        for k in range(3):
            shape, friction = errors[rung, off[k]] / std[k], errors[4, off[k]] / std[k]
            both = abs(shape) if rung >= ELASTICA else np.sqrt(shape * shape + friction * friction)
            if not both <= bias[rung]:
                bias[rung] = both


@compiled
def contact_evidence(rig, rung, fit, problem, work):
    """How much better a contact explains the frame than the free antenna: half the difference of squares.

    Both may move the rig within its joint covariance first, so that a clamp angle that is known badly is not taken for
    a contact. Without contact it is 1.5 to 2 (three unknowns fitted to noise). Both are compared on the highest rung,
    `problem` with its residuals: what a lower one leaves out of the weight must not pass for a force. Spoils the free
    antenna's residuals.
    """
    alone, there = work.free, work.other
    alone.numbers[SCATTER] = fit.numbers[SCATTER]
    without = least_cost(rig, alone, UNKNOWNS, _ROUNDS if len(fit.steps) else 0, work)
    if rung == REFERENCE and without - fit.numbers[COST] > _BEYOND_DOUBT:
        return without - fit.numbers[COST]
    # where a fit ended badly, the linear problem about it says better what a contact explains
    copy_fit(problem, there)
    return without - least_cost(rig, there, 0, _CLOSE_ROUNDS, work)
