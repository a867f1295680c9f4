"""The fits of frames in plain numbers: contact points, forces and their covariances, as NumPy arrays."""

from __future__ import annotations

from dataclasses import Field, dataclass, field, fields, replace
from typing import Any

import numpy as np

from estimator.solver.ladder import Solution
from estimator.solver.normal_equations import solve_columns
from estimator.solver.prediction import point_jacobian, reading_response
from estimator.solver.rig_arrays import POSES, UNKNOWNS, RigArrays
from estimator.solver.state import Fits
from estimator.solver.uncertainty import Uncertainty
from vbaa_calib.antenna.linear import deflection, deflection_by_contact
from vbaa_calib.antenna.nodes import CONTACT
from vbaa_calib.antenna.rungs import RUNGS
from vbaa_calib.core.arrays import Array, arange_like, like, namespace
from vbaa_calib.core.robust import huber_weights
from vbaa_calib.geometry import Pose
from vbaa_calib.rig import Rig

from .motion import PIECES, Beam

_LEAST_STD_M = 1e-6
"""No place is known better: near the clamp the model's own errors are all there is."""


_AS_THEY_ARE = {
    *("unknowns", "converged", "at_tip", "scatter", "evidence", "condition", "ambiguous"),
    *("alternative_cost", "alternative_unknowns", "second_gain", "second_place", "second_shift"),
}
"""Numbers that the solver's state, solution or uncertainty have by the same name."""


def _each(*shape: int, dtype: type = float) -> np.ndarray:
    """An array whose entry for each frame has this shape and kind."""
    values: np.ndarray = field(metadata={"shape": shape, "dtype": dtype})
    return values


@dataclass(frozen=True, eq=False)
class FitNumbers:
    """The fits of B frames in plain numbers, before it is decided what the data support; arrays of B rows.

    Attributes
    ----------
    points : (B,) how many could be used.
    rung : index in `antenna.rungs.RUNGS`.
    unknowns, std : (B, 4), see `rig_arrays.UNKNOWNS`.
    point_m, force_N, deflection_m : (B, 3) antenna frame. tangent : (B, 3) of the antenna at the contact, likewise.
    covariance : (B, 6, 6) of point and force. with_pose : (B, 6, 6) theirs with the camera pose's tangent.
    shared : (B, 6, 6) the part of it that all frames of a recording have in common, the rig's. shared_std : (B,) that
        part of the distance's deviation.
    friction_share : (B,) of the distance's variance, the part by friction's angle: gone, were that known.
    tip_std : (B,) how far the antenna's end lies off its place, in the deviations that are expected of that; NaN
        without one.
    residual, residual_std : (B, 2) whitened residuals of the readings, and their expected standard deviations.
    sensor_available : (B, 2) bool, whether there was a reading.
    rig_chi_square : (B,) sum of squares of the rig's steps, which has `rig_axes` (B,) degrees of freedom.
    evidence, condition, converged, at_tip, scatter, alternative_cost, alternative_unknowns, ambiguous, second_gain,
    second_place, second_shift : see `solver.ladder.Solution` and what it holds.
    finite : (B,) bool, the fit stayed in the model's domain.
    edge_on_rad : angle between the deformation plane and the ray from the camera's centre to the contact.
    explained_drifted : (B,) bool, one contact explains the frame if the rig has changed, by which the picture moves by
        drift_px (B,) and the readings by drift_readings (B,), in deviations; looked at only where nothing fits.
    explained_alone : (B,) bool, one contact explains the picture alone; looked at only where the readings do not fit.
    bias : (B, len(RUNGS)), NaN where it was not compared.
    pieces_m, pieces_std_m : points of the fitted antenna at `Beam.pieces_m`, antenna frame, and their deviations by
        the noise of one frame. push : how far a load of 1 N/m on each piece, along y and z, would move the distance,
        in deviations. NaN where motion is not tested.
    """

    points: np.ndarray = _each(dtype=int)
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
    bias: np.ndarray = _each(len(RUNGS))
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

    def row(self, index: int) -> FitNumbers:
        """One frame's."""
        return FitNumbers(*(getattr(self, f.name)[index : index + 1] for f in fields(self)))

    def put(self, rows: np.ndarray, part: FitNumbers) -> None:
        """Write the numbers of some frames into their rows."""
        for f in fields(self):
            getattr(self, f.name)[rows] = getattr(part, f.name)


def fit_numbers(parts: list[Solution], beam: Beam | None = None) -> FitNumbers:
    """The numbers of all frames, in the order of their rows; with a beam, also what testing for motion needs."""
    order = np.concatenate([plain(part.rows) for part in parts])
    whole = FitNumbers.empty(len(order))
    for part in parts:
        whole.put(plain(part.rows), _numbers(part, beam))
    return whole


def _numbers(part: Solution, beam: Beam | None) -> FitNumbers:
    fits, uncertainty, rig_arrays = part.fits, part.uncertainty, part.fits.frames.rig_arrays
    state, prediction, by_rig = fits.state, fits.prediction, fits.by_rig
    xp, shared = namespace(state.scatter), rig_arrays.axes.shape[1]
    touch = prediction.point_force + (by_rig.point_force @ state.rig_steps[..., None])[..., 0]
    covariance = uncertainty.propagate(prediction.point_force_jacobian, by_rig.point_force)
    # how far a unit error of each of the rig's axes, which all frames share, turns a result
    with_rig = uncertainty.covariance_with_rig(prediction.point_force_jacobian, by_rig.point_force)[..., :shared]
    distance_with_rig = (uncertainty.covariance @ uncertainty.rig_response.mT)[:, 0, :shared]
    covariance = covariance + _bows(rig_arrays, state.unknowns, uncertainty.covariance, state.at_tip)
    # a rung that was demanded though it is too low: what it makes wrong is doubt
    off = part.model_errors
    covariance = covariance + off[..., UNKNOWNS:].mT @ off[..., UNKNOWNS:]
    std = xp.sqrt(uncertainty.std**2 + (off[..., :UNKNOWNS] ** 2).sum(1))
    free = part.free.prediction.points_at(state.unknowns[:, :1] * rig_arrays.length_m)[:, 0]
    unknowns, touch = plain(state.unknowns), plain(touch)
    count = len(unknowns)
    numbers = FitNumbers.empty(count)
    for source in (state, part, uncertainty):
        for name in _AS_THEY_ARE & vars(source).keys():
            getattr(numbers, name)[:] = plain(getattr(source, name))
    for rung, values in part.bias.items():
        numbers.bias[:, RUNGS.index(rung)] = plain(values)
    if beam is not None:
        pieces = (*_pieces(fits, beam), _by_inertia(fits, uncertainty, beam))
        numbers = replace(numbers, **dict(zip(("pieces_m", "pieces_std_m", "push"), map(plain, pieces), strict=True)))
    return replace(
        numbers,
        points=plain(fits.frames.usable.sum(-1)),
        rung=np.full(count, RUNGS.index(fits.rung)),
        std=plain(std),
        point_m=touch[:, :3],
        force_N=touch[:, 3:],
        tangent=plain(prediction.tangents[:, CONTACT]),
        deflection_m=touch[:, :3] - plain(free),
        covariance=plain(covariance),
        with_pose=plain(with_rig @ rig_arrays.axes[:POSES].T),
        shared=plain(with_rig @ with_rig.mT),
        shared_std=plain(xp.sqrt((distance_with_rig**2).sum(-1))),
        friction_share=plain(uncertainty.correlation(0, 3) ** 2),
        tip_std=plain(
            xp.where(
                fits.frames.available[:, 2] > 0.0,
                fits.problem.reading_residual[:, 2] / uncertainty.reading_std[:, 2],
                xp.nan,
            )
        ),
        residual=plain(fits.problem.reading_residual[:, :2]),
        residual_std=plain(uncertainty.reading_std[:, :2]),
        sensor_available=plain(fits.frames.sensor_available) > 0.0,
        rig_chi_square=plain((state.rig_steps**2).sum(-1)),
        rig_axes=np.full(count, state.rig_steps.shape[1]),
        finite=plain(xp.isfinite(fits.equations.cost) & xp.isfinite(state.unknowns).all(-1)),
        edge_on_rad=edge_on(rig_arrays.rig, unknowns),
    )


def drift_of(fits: Fits) -> tuple[np.ndarray, np.ndarray]:
    """(B,) by how many px, rms along the antenna, and deviations of the readings the rig's steps of fits move both."""
    shared = fits.frames.rig_arrays.axes.shape[1]
    steps = fits.state.rig_steps[:, :shared, None]
    focal_px = float(np.sqrt(np.prod(np.diag(fits.frames.rig_arrays.rig.camera.matrix)[:2])))
    image, moment = fits.by_rig.image[..., :shared] @ steps, fits.by_rig.reading[:, :2, :shared] @ steps
    return focal_px * np.sqrt((plain(image)[..., 0] ** 2).mean(axis=1)), np.abs(plain(moment)).max(axis=(1, 2))


def edge_on(rig: Rig, unknowns: np.ndarray) -> np.ndarray:
    """(B,) angle between the deformation plane 𝒟 and the ray from the camera's centre to the contact, rad.

    At 0 the camera's centre lies in 𝒟 and the antenna looks straight however it bends.
    """
    y_m, z_m, about_y, about_z = rig.antenna.parameters[:4]
    T_antenna_clamp = Pose.from_rotvec(np.array([0.0, about_y, about_z]), np.array([0.0, y_m, z_m]))
    center_m = T_antenna_clamp.inverse() @ rig.T_antenna_camera.translation_m
    line = center_m - unknowns[:, :1] * np.array([rig.antenna.length_m, 0.0, 0.0])
    roll = np.arctan2(unknowns[:, 2], unknowns[:, 1])
    height = np.cos(roll) * line[:, 2] - np.sin(roll) * line[:, 1]
    return np.arctan2(np.abs(height), np.sqrt(np.maximum((line**2).sum(axis=-1) - height**2, 0.0)))


def _bows(rig_arrays: RigArrays, unknowns: Array, covariance: Array, at_tip: Array) -> Array:
    """(B, 6, 6) second order of contact point and force in the unknowns: linear beam, foreshortening, slope.

    A point known badly along a bent antenna is known within a bow, which a thin straight ellipsoid would leave.
    """
    xp = namespace(unknowns)
    sound = xp.isfinite(covariance).all(-1).all(-1) & ~at_tip
    part = xp.where(sound[:, None, None], covariance, xp.zeros_like(covariance))[:, :3, :3]
    sizes, axes = xp.linalg.eigh(part)
    steps = (axes * xp.sqrt(xp.clip(sizes, 0.0, None))[:, None]).mT
    middle = unknowns[:, None, :3]

    def touch(at: Array) -> Array:
        distance = at[..., :1] * rig_arrays.length_m
        shift = at[..., 1:] * (rig_arrays.force_unit_N / 3.0) * distance**3 / xp.exp(rig_arrays.antenna_parameters[6])
        shorter = 0.6 * (shift * shift).sum(-1)[..., None] / xp.clip(distance, 1e-9, None)
        pull = -1.5 * (at[..., 1:] * shift).sum(-1)[..., None] * rig_arrays.force_unit_N / xp.clip(distance, 1e-9, None)
        return xp.concat([distance - shorter, shift, pull, 0.0 * shift], -1)

    bows = touch(middle + steps) + touch(middle - steps) - 2.0 * touch(middle)
    return 0.75 * bows.mT @ bows  # the mean square of z²/2 is 3/4


def _pieces(fits: Fits, beam: Beam) -> tuple[Array, Array]:
    """Points (B, G, 3) of the fitted antennas at the beam's pieces, antenna frame, their deviations (B, G) by noise.

    The deviations are those from frame to frame: the rig's errors are the same in all.
    """
    prediction, state = fits.prediction, fits.state
    xp = namespace(state.scatter)
    at = like(state.scatter, beam.pieces_m) + 0.0 * prediction.contact_m[:, None]
    return prediction.points_at(at), xp.sqrt(_scatter(fits, at))


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
    return xp.clip(total, _LEAST_STD_M**2, None)


def _by_inertia(fits: Fits, uncertainty: Uncertainty, beam: Beam) -> Array:
    """(B, G, 2) how far a load of 1 N/m on each piece, along y and z, would move the distance, in deviations."""
    problem, rig_arrays = fits.problem, fits.frames.rig_arrays
    nodes = arange_like(problem.scatter, fits.prediction.nodes.shape[1]) + 0.0 * fits.prediction.nodes[..., 0]
    at, places = fits.prediction.arclength(nodes), like(problem.scatter, beam.pieces_m)
    bent = deflection(at[..., None], places, 1.0, beam.stiffness_Nm2) * (beam.length_m / PIECES)
    columns = (bent[..., None] * point_jacobian(rig_arrays, fits.prediction)[:, :, None, 1:]).reshape(
        len(at), at.shape[1], 2 * PIECES
    )
    moment = reading_response(fits.frames, fits.prediction, places * (beam.length_m / PIECES), bent[:, -1])
    weights = huber_weights(problem.reading_residual)[..., None]
    pull = problem.jacobian.mT @ problem.sums.times(columns) + problem.reading_jacobian.mT @ (weights * moment)
    moved = solve_columns(fits.equations.information, pull)[:, 0]
    return (moved / uncertainty.std[:, :1]).reshape(len(at), PIECES, 2)


def plain(values: Any) -> np.ndarray:
    """NumPy's array of either kind's."""
    return values if isinstance(values, np.ndarray) else values.detach().cpu().numpy()
