"""The fits of frames in plain numbers: contact points, forces and their covariances."""

from __future__ import annotations

from collections import namedtuple
from dataclasses import Field, dataclass, field, fields
from typing import Any

import numpy as np

from vbaa_calib.antenna.nodes import CONTACT
from vbaa_calib.antenna.rungs import RUNGS
from vbaa_calib.core.compiled import compiled, record

from .fit import AT_TIP, CONVERGED, COST, NODES, SCATTER, arclength_of_node, locate
from .initialization import deflection
from .linear_algebra import factorise, fill, put, solve_factorised, symmetric_eigen
from .normal_equations import huber_weight, times_tridiagonal
from .prediction import ELASTICA, REFERENCE
from .rig_arrays import UNKNOWNS
from .second_contact import force_columns
from .uncertainty import touch_covariance

PIECES = 12
"""Pieces of the antenna whose places are given for the test of motion."""
SMALL_BIAS = 1 / 3
"""A rung's predicted bias is small below this fraction of the standard deviation; a demanded rung's larger one is added
to the deviations."""
_LEAST_STD_M = 1e-6
"""No place is known better: near the clamp the model's own errors are all there is."""


def _each(*shape: int, dtype: type = float) -> np.ndarray:
    """An array whose entry for each frame has this shape and kind."""
    values: np.ndarray = field(metadata={"shape": shape, "dtype": dtype})
    return values


@dataclass(frozen=True, eq=False)
class FitNumbers:
    """The fits of B frames in plain numbers, before it is decided what the data support; arrays of B rows.

    Attributes
    ----------
    points : (B,) how many could be used. evaluations : (B,) of the model that the fit took.
    rung : index in `antenna.rungs.RUNGS`, of the one that was asked for, or of the lowest that is good enough.
    unknowns, std : (B, 4), see `rig_arrays.UNKNOWNS`.
    point_m, force_N, deflection_m : (B, 3) antenna frame. tangent : (B, 3) of the antenna at the contact, likewise.
    covariance : (B, 6, 6) of point and force. with_pose : (B, 6, 6) theirs with the camera pose's tangent.
    shared : (B, 6, 6) the part of it that all frames of a recording have in common, the rig's. shared_std : (B,) that
        part of the distance's deviation.
    friction_share : (B,) of the distance's variance, the part by friction's angle: gone, were that known.
    tip_std : (B,) how far the antenna's end lies off its place, in the deviations that are expected of that; NaN
        without one.
    cost : (B,) half the robust sum of squares with the priors, the points' deviations multiplied by `scatter`.
    residual, residual_std : (B, 2) whitened residuals of the readings, and their expected standard deviations.
    sensor_available : (B, 2) bool, whether there was a reading.
    rig_chi_square : (B,) sum of squares of the rig's steps, which has `rig_axes` (B,) degrees of freedom.
    evidence : (B,) for a contact, see `uncertainty.contact_evidence`. condition : (B,) see `Uncertainty`.
    converged, at_tip, scatter : (B,) see `fit.Fit`.
    alternative_cost : (B,) how much more another minimum costs, infinite without one. alternative_unknowns : (B, 4).
    ambiguous : (B,) bool, see `alternative_minima.mirror_ambiguous`.
    second_gain, second_place, second_shift : (B,) see `second_contact.second_force`.
    finite : (B,) bool, the fit stayed in the model's domain.
    edge_on_rad : angle between the deformation plane and the ray from the camera's centre to the contact.
    explained_drifted : (B,) bool, one contact explains the frame if the rig has changed, by which the picture moves by
        drift_px (B,) and the readings by drift_readings (B,), in deviations; looked at only where nothing fits.
    explained_alone : (B,) bool, one contact explains the picture alone; looked at only where the readings do not fit.
    left_px : (B,) how far most points stay from the nearest antenna; NaN unless that is why the frame was given up.
    bias : (B, len(RUNGS)), NaN where it was not compared.
    farthest : (B,) largest residual of a point, in standard deviations. outliers : (B,) points that lie far off their
        neighbours and were left out.
    pieces_m, pieces_std_m : points of the fitted antenna at `Beam.pieces_m`, antenna frame, and their deviations by
        the noise of one frame. push : how far a load of 1 N/m on each piece, along y and z, would move the distance,
        in deviations. NaN where motion is not tested.
    """

    points: np.ndarray = _each(dtype=int)
    evaluations: np.ndarray = _each(dtype=int)
    rung: np.ndarray = _each(dtype=int)
    unknowns: np.ndarray = _each(4)
    std: np.ndarray = _each(4)
    point_m: np.ndarray = _each(3)
    force_N: np.ndarray = _each(3)
    tangent: np.ndarray = _each(3)
    deflection_m: np.ndarray = _each(3)
    covariance: np.ndarray = _each(6, 6)
    with_pose: np.ndarray = _each(6, 6)
    shared: np.ndarray = _each(6, 6)
    shared_std: np.ndarray = _each()
    friction_share: np.ndarray = _each()
    tip_std: np.ndarray = _each()
    cost: np.ndarray = _each()
    residual: np.ndarray = _each(2)
    residual_std: np.ndarray = _each(2)
    sensor_available: np.ndarray = _each(2, dtype=bool)
    rig_chi_square: np.ndarray = _each()
    rig_axes: np.ndarray = _each(dtype=int)
    evidence: np.ndarray = _each()
    converged: np.ndarray = _each(dtype=bool)
    at_tip: np.ndarray = _each(dtype=bool)
    scatter: np.ndarray = _each()
    condition: np.ndarray = _each()
    finite: np.ndarray = _each(dtype=bool)
    alternative_cost: np.ndarray = _each()
    alternative_unknowns: np.ndarray = _each(4)
    ambiguous: np.ndarray = _each(dtype=bool)
    second_gain: np.ndarray = _each()
    second_place: np.ndarray = _each()
    second_shift: np.ndarray = _each()
    edge_on_rad: np.ndarray = _each()
    explained_alone: np.ndarray = _each(dtype=bool)
    explained_drifted: np.ndarray = _each(dtype=bool)
    drift_px: np.ndarray = _each()
    drift_readings: np.ndarray = _each()
    left_px: np.ndarray = _each()
    bias: np.ndarray = _each(len(RUNGS))
    farthest: np.ndarray = _each()
    outliers: np.ndarray = _each(dtype=int)
    pieces_m: np.ndarray = _each(PIECES, 3)
    pieces_std_m: np.ndarray = _each(PIECES)
    push: np.ndarray = _each(PIECES, 2)

    def __len__(self) -> int:
        return len(self.rung)

    @staticmethod
    def empty(count: int) -> FitNumbers:
        """Of frames without a fit: NaN, 0 and False."""

        def none(f: Field[np.ndarray]) -> np.ndarray:
            dtype = f.metadata["dtype"]
            return np.full((count, *f.metadata["shape"]), np.nan if dtype is float else 0, dtype)

        return FitNumbers(*map(none, fields(FitNumbers)))

    @staticmethod
    def unwritten(count: int) -> FitNumbers:
        """Room for the numbers of fits."""
        return FitNumbers(*(np.zeros((count, *shape), dtype) for shape, dtype in _KINDS))

    def row(self, index: int) -> FitNumbers:
        """One frame's."""
        return self if len(self) == 1 else FitNumbers(*(values[index : index + 1] for values in self.tables))

    @property
    def tables(self) -> tuple[np.ndarray, ...]:
        """For compiled functions."""
        return _NumberTables(*vars(self).values())

    def put(self, rows: np.ndarray, part: FitNumbers) -> None:
        """Write the numbers of some frames into their rows."""
        for whole, values in zip(self.tables, part.tables, strict=True):
            whole[rows] = values


_KINDS = [(f.metadata["shape"], f.metadata["dtype"]) for f in fields(FitNumbers)]
_NumberTables: Any = namedtuple(  # type: ignore[misc]
    "_NumberTables", [f.name for f in fields(FitNumbers)]
)
_NumberTables.__annotations__ = dict.fromkeys(_NumberTables._fields, np.ndarray)
NumberRecord = record(_NumberTables)


@compiled
def write_numbers(rig, frame, rung, found, bias, errors, other, scalars, ambiguous, pieces_m, numbers, index, work):
    """A frame's fit in plain numbers.

    bias : (4,) of the rungs. errors : (5, 10) see `uncertainty.first_order_errors`. other : (4,) the next best
    unknowns. scalars : evidence, the next best's extra cost; a second force's gain, place and shift.
    """
    fit, free = work.best, work.free
    steps, shared = len(fit.steps), rig.axes.shape[1]
    covariance = np.empty((6, 6))
    touch_covariance(found, covariance)
    response = np.zeros((UNKNOWNS, steps))
    own, rig_response, found_touch, rig_touch = found.covariance, found.rig_response, found.touch, found.rig_touch
    for a in range(UNKNOWNS):
        for k in range(steps):
            for b in range(UNKNOWNS):
                response[a, k] += own[a, b] * rig_response[k, b]
    # how far a unit error of each of the rig's axes, which all frames share, turns a result
    with_rig, by_distance = np.zeros((6, shared)), 0.0
    for k in range(shared):
        by_distance += response[0, k] * response[0, k]
        for q in range(6):
            for a in range(UNKNOWNS):
                with_rig[q, k] += found_touch[q, a] * response[a, k]
            with_rig[q, k] += rig_touch[k, q]
    if fit.numbers[AT_TIP] == 0.0:
        _add_bows(rig, fit.unknowns, found.covariance, covariance)
    _add_model_errors(rig, rung, bias, errors, found, covariance, numbers.std[index])
    free_point, axes, columns, moved = np.empty(3), rig.axes, fit.point_force_columns, fit.steps
    _point_at(free, rig.length_m, fit.unknowns[0] * rig.length_m, free_point)
    for q in range(6):
        touch = fit.point_force[q]
        for k in range(steps):
            touch += columns[q, UNKNOWNS + k] * moved[k]
        if q < 3:
            numbers.point_m[index, q], numbers.deflection_m[index, q] = touch, touch - free_point[q]
            numbers.tangent[index, q] = fit.tangents[q, CONTACT]
        else:
            numbers.force_N[index, q - 3] = touch
        for p in range(6):
            numbers.covariance[index, q, p] = covariance[q, p]
            pose, both = 0.0, 0.0
            for k in range(shared):
                pose += with_rig[q, k] * axes[p, k]
                both += with_rig[q, k] * with_rig[p, k]
            numbers.with_pose[index, q, p], numbers.shared[index, q, p] = pose, both
    numbers.shared_std[index] = np.sqrt(by_distance)
    numbers.points[index] = len(frame.u)
    numbers.evaluations[index] = work.evaluations[0]
    numbers.unknowns[index] = fit.unknowns
    std = np.sqrt(np.diag(found.covariance))
    numbers.friction_share[index] = (found.covariance[0, 3] / (std[0] * std[3])) ** 2
    numbers.tip_std[index] = fit.residual[2] / found.reading_std[2] if frame.available[2] > 0.0 else np.nan
    numbers.cost[index] = fit.numbers[COST]
    numbers.residual[index] = fit.residual[:2]
    numbers.residual_std[index] = found.reading_std[:2]
    for reading in range(2):
        numbers.sensor_available[index, reading] = frame.available[reading] > 0.0
    numbers.rig_chi_square[index], numbers.rig_axes[index] = (fit.steps**2).sum(), steps
    numbers.converged[index], numbers.at_tip[index] = fit.numbers[CONVERGED] > 0.0, fit.numbers[AT_TIP] > 0.0
    numbers.scatter[index], numbers.condition[index] = fit.numbers[SCATTER], found.condition[0]
    numbers.finite[index] = np.isfinite(fit.numbers[COST]) and np.isfinite(fit.unknowns).all()
    numbers.evidence[index], numbers.alternative_cost[index] = scalars[0], scalars[1]
    numbers.second_gain[index], numbers.second_place[index], numbers.second_shift[index] = scalars[2:]
    numbers.alternative_unknowns[index], numbers.ambiguous[index] = other, ambiguous
    numbers.bias[index], largest, distance, precision = bias, 0.0, fit.distance, fit.precision
    for i in range(len(distance)):
        largest = max(largest, distance[i] * distance[i] * precision[i])
    numbers.farthest[index], numbers.outliers[index] = np.sqrt(largest), 0
    numbers.edge_on_rad[index] = angle_edge_on(rig, fit.unknowns)
    numbers.drift_px[index], numbers.drift_readings[index] = _drift(rig, fit)
    numbers.pieces_m[index], numbers.pieces_std_m[index], numbers.push[index] = np.nan, np.nan, np.nan
    if len(pieces_m):
        _pieces(rig, fit, pieces_m, numbers.pieces_m[index], numbers.pieces_std_m[index], work)
        _push(rig, frame, fit, pieces_m, std[0], numbers.push[index], work)


@compiled
def _point_at(fit, length_m, arclength_m, point_m):
    """The point (3,) of the predicted antenna at an arc length, antenna frame."""
    node, share, width = locate(fit, length_m, arclength_m)
    for axis in range(3):
        start, end = fit.points_m[axis, node], fit.points_m[axis, node + 1]
        leave, arrive = fit.tangents[axis, node] * width, fit.tangents[axis, node + 1] * width
        gap = end - start
        bend, twist = 3.0 * gap - 2.0 * leave - arrive, leave + arrive - 2.0 * gap
        point_m[axis] = ((twist * share + bend) * share + leave) * share + start


@compiled
def _add_model_errors(rig, rung, bias, errors, found, covariance, std):
    """A rung that was demanded though it is too low: what it makes wrong is doubt. Writes the deviations (4,)."""
    with_errors = rung != REFERENCE and bias[rung] > SMALL_BIAS and np.isfinite(bias[rung])
    off = np.zeros((2, 10))
    if with_errors:
        off[0] = errors[rung]
        if rung < ELASTICA and rig.friction_rad > 0.0:
            off[1] = errors[4]
            # that friction turns the force along the antenna is in the point and force's own covariance already
            off[1, 7] = 0.0
    for a in range(UNKNOWNS):
        square = off[0, a] ** 2 + off[1, a] ** 2
        std[a] = np.sqrt(np.sqrt(found.covariance[a, a]) ** 2 + square)
    for p in range(6):
        for q in range(6):
            for kind in range(2):
                covariance[p, q] += off[kind, UNKNOWNS + p] * off[kind, UNKNOWNS + q]


@compiled
def _add_bows(rig, unknowns, covariance, total):
    """Add (6, 6) the second order of contact point and force in the unknowns: linear beam, foreshortening, slope.

    A point known badly along a bent antenna is known within a bow, which a thin straight ellipsoid would leave.
    """
    if not np.isfinite(covariance).all():
        return
    part, sizes, axes = covariance[:3, :3].copy(), np.empty(3), np.empty((3, 3))
    symmetric_eigen(part, sizes, axes)
    there, middle, bow = np.empty(3), np.zeros(6), np.empty(6)
    _touch_of_beam(rig, unknowns[:3], -2.0, middle)
    for k in range(3):
        put(middle, bow)
        for side in (-1.0, 1.0):
            for a in range(3):
                there[a] = unknowns[a] + side * axes[a, k] * np.sqrt(max(sizes[k], 0.0))
            _touch_of_beam(rig, there, 1.0, bow)
        for p in range(6):
            for q in range(6):
                # the mean square of z²/2 is 3/4
                total[p, q] += 0.75 * bow[p] * bow[q]


@compiled
def _touch_of_beam(rig, at, part, total):
    """Add a part of contact point and force (6,) of a linear beam, foreshortened, for distance and force (3,)."""
    distance = at[0] * rig.length_m
    by_force = rig.force_unit_N / 3.0 * distance**3 / rig.stiffness_Nm2
    shift_y, shift_z = at[1] * by_force, at[2] * by_force
    near = max(distance, 1e-9)
    total[0] += part * (distance - 0.6 * (shift_y * shift_y + shift_z * shift_z) / near)
    total[1] += part * shift_y
    total[2] += part * shift_z
    total[3] += part * -1.5 * (at[1] * shift_y + at[2] * shift_z) * rig.force_unit_N / near


@compiled
def angle_edge_on(rig, unknowns):
    """Angle between the deformation plane 𝒟 and the ray from the camera's centre to the contact, rad.

    At 0 the camera's centre lies in 𝒟 and the antenna looks straight however it bends.
    """
    x, y, z = rig.eye_m[0] - unknowns[0] * rig.length_m, rig.eye_m[1], rig.eye_m[2]
    roll = np.arctan2(unknowns[2], unknowns[1])
    height = np.cos(roll) * z - np.sin(roll) * y
    return np.arctan2(abs(height), np.sqrt(max(x * x + y * y + z * z - height * height, 0.0)))


@compiled
def _drift(rig, fit):
    """By how many px, rms along the antenna, and deviations of the readings the rig's own steps move both."""
    shared, square, most, columns, steps = rig.axes.shape[1], 0.0, 0.0, fit.columns, fit.steps
    for j in range(NODES):
        moved = 0.0
        for k in range(shared):
            moved += columns[j, UNKNOWNS + k] * steps[k]
        square += moved * moved
    for reading in range(2):
        moved = 0.0
        for k in range(shared):
            moved += fit.reading_columns[reading, UNKNOWNS + k] * fit.steps[k]
        most = max(most, abs(moved))
    return rig.focal * np.sqrt(square / NODES), most


@compiled
def _pieces(rig, fit, pieces_m, points_m, std_m, work):
    """Points (G, 3) of the fitted antenna at the pieces, antenna frame, their deviations (G,) by one frame's noise.

    The deviations are those from frame to frame, for the rig as it is, of the linear beam: the rig's errors are the
    same in all.
    """
    information, slopes, moved = fit.information[:UNKNOWNS, :UNKNOWNS].copy(), np.empty(UNKNOWNS), np.empty(UNKNOWNS)
    factorise(information, 0, UNKNOWNS, 0.0, work.factor, work.scale)
    contact = fit.unknowns[0] * rig.length_m
    for g in range(len(pieces_m)):
        at = pieces_m[g]
        _point_at(fit, rig.length_m, at, points_m[g])
        by_force = rig.force_unit_N * deflection(at, contact) / rig.stiffness_Nm2
        near = min(at, contact)
        by_distance = rig.force_unit_N * near * (2.0 * at - near) / (2.0 * rig.stiffness_Nm2) * rig.length_m
        total = 0.0
        for axis in (1, 2):
            fill(slopes, 0.0)
            slopes[0], slopes[axis] = fit.unknowns[axis] * by_distance, by_force
            solve_factorised(work.factor, work.scale[:UNKNOWNS], UNKNOWNS, slopes, moved)
            for a in range(UNKNOWNS):
                total += slopes[a] * moved[a]
        std_m[g] = np.sqrt(max(total, _LEAST_STD_M**2))


@compiled
def _push(rig, frame, fit, pieces_m, distance_std, push, work):
    """(G, 2) how far a load of 1 N/m on each piece, along y and z, would move the distance, in deviations."""
    count, width, size = len(pieces_m), rig.length_m / len(pieces_m), fit.size
    bent, lever = np.empty((NODES, count)), np.empty(count)
    for g in range(count):
        lever[g] = pieces_m[g] * width
        for j in range(NODES):
            at = arclength_of_node(fit, rig.length_m, 1.0 * j)
            bent[j, g] = deflection(at, pieces_m[g]) / rig.stiffness_Nm2 * width
    columns, weighted = np.empty((NODES, 2 * count)), np.empty((NODES, 2 * count))
    readings = np.empty((3, 2 * count))
    force_columns(rig, frame, fit, pieces_m, bent, lever, columns, readings)
    times_tridiagonal(fit, columns, weighted)
    factorise(fit.information, 0, size, 0.0, work.factor, work.scale)
    # of each pull only the distance's answer is wanted: the first row of the inverse
    row, side = np.empty(size), np.zeros(size)
    side[0] = 1.0
    solve_factorised(work.factor, work.scale, size, side, row)
    by_node, by_reading = np.zeros(NODES), np.zeros(3)
    for a in range(size):
        for j in range(NODES):
            by_node[j] += row[a] * fit.columns[j, a]
        for reading in range(3):
            by_reading[reading] += row[a] * fit.reading_columns[reading, a]
    for g in range(count):
        for axis in range(2):
            moved = 0.0
            for j in range(NODES):
                moved += by_node[j] * weighted[j, 2 * g + axis]
            for reading in range(3):
                weight = huber_weight(fit.residual[reading])
                moved += by_reading[reading] * weight * readings[reading, 2 * g + axis]
            push[g, axis] = moved / distance_std
