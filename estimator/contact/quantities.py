"""From settled frames to plain numbers: contact points, forces and their covariances, as NumPy arrays."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from estimator.solver.ladder import Solution
from estimator.solver.rig_arrays import POSES, UNKNOWNS, RigArrays
from vbaa_calib.antenna.nodes import CONTACT
from vbaa_calib.antenna.rungs import RUNGS
from vbaa_calib.core.arrays import Array, namespace
from vbaa_calib.geometry import Pose
from vbaa_calib.rig import Rig

from .hinge_plane import camera_angle
from .inertia import by_inertia, pieces
from .motion import PIECES, Beam

FLOATS = {
    **dict.fromkeys(("unknowns", "std", "rival_unknowns"), (4,)),
    **dict.fromkeys(("point_m", "force_N", "tangent", "deflection_m"), (3,)),
    **dict.fromkeys(("covariance", "with_pose"), (6, 6)),
    **dict.fromkeys(("residual", "residual_std"), (2,)),
    **dict.fromkeys(("strange", "evidence", "scatter", "condition", "rival"), ()),
    **dict.fromkeys(("second", "second_place", "second_harm", "edge_on_rad"), ()),
    "bias": (len(RUNGS),),
    "pieces_m": (PIECES, 3),
    "pieces_std_m": (PIECES,),
    "push": (PIECES, 2),
}
"""The shape of a frame's entry in each array of floats."""


@dataclass(frozen=True, eq=False)
class Numbers:
    """B frames' numbers, whatever they are worth; arrays of B rows.

    Attributes
    ----------
    points : (B,) how many could be used.
    rung : index in `antenna.rungs.RUNGS`.
    unknowns, std : (B, 4), see `rig_arrays.UNKNOWNS`.
    point_m, force_N, deflection_m : (B, 3) antenna frame. tangent : (B, 3) of the antenna at the contact, likewise.
    covariance : (B, 6, 6) of point and force. with_pose : (B, 6, 6) theirs with the camera pose's tangent.
    residual, residual_std : (B, 2) readings' misfits, whitened, and the deviations these should have.
    felt : (B, 2) bool, whether there was a reading.
    evidence : (B,) for a contact, see `uncertainty.contact_evidence`. condition : (B,) see `uncertainty.Uncertainty`.
    converged, at_tip, scatter : (B,) see `state.State`. finite : (B,) bool, the fit stayed in the domain.
    strange : (B,) sum of squares of the rig's steps, which has `rig_axes` (B,) degrees of freedom.
    rival, rival_unknowns, blind, second, second_place, second_harm : see `ladder.Solution`.
    edge_on_rad : angle between the deformation plane and the ray from the camera's centre to the contact.
    explained_alone : (B,) bool, the picture alone is that of one contact; asked only where it is not with the readings.
    bias : (B, len(RUNGS)), NaN where not weighed.
    pieces_m, pieces_std_m, push : see `inertia`; NaN where motion is not to be judged.
    """

    points: np.ndarray
    rung: np.ndarray
    unknowns: np.ndarray
    std: np.ndarray
    point_m: np.ndarray
    force_N: np.ndarray
    tangent: np.ndarray
    deflection_m: np.ndarray
    covariance: np.ndarray
    with_pose: np.ndarray
    residual: np.ndarray
    residual_std: np.ndarray
    felt: np.ndarray
    strange: np.ndarray
    rig_axes: np.ndarray
    evidence: np.ndarray
    converged: np.ndarray
    at_tip: np.ndarray
    scatter: np.ndarray
    condition: np.ndarray
    finite: np.ndarray
    rival: np.ndarray
    rival_unknowns: np.ndarray
    blind: np.ndarray
    second: np.ndarray
    second_place: np.ndarray
    second_harm: np.ndarray
    edge_on_rad: np.ndarray
    explained_alone: np.ndarray
    bias: np.ndarray
    pieces_m: np.ndarray
    pieces_std_m: np.ndarray
    push: np.ndarray

    def __len__(self) -> int:
        return len(self.rung)

    def row(self, index: int) -> Numbers:
        """One frame's."""
        return Numbers(*(getattr(self, f.name)[index : index + 1] for f in fields(self)))


def none_of(count: int) -> Numbers:
    """Numbers of frames that nothing is known of."""
    floats = {name: np.full((count, *shape), np.nan) for name, shape in FLOATS.items()}
    return Numbers(
        points=np.zeros(count, int),
        rung=np.zeros(count, int),
        rig_axes=np.zeros(count, int),
        felt=np.zeros((count, 2), bool),
        **{name: np.zeros(count, bool) for name in ("converged", "at_tip", "finite", "blind", "explained_alone")},
        **floats,
    )


def placed(whole: Numbers, rows: np.ndarray, part: Numbers) -> None:
    """Write the numbers of some frames into their rows."""
    for f in fields(Numbers):
        getattr(whole, f.name)[rows] = getattr(part, f.name)


def numbers(parts: list[Solution], beam: Beam | None = None) -> Numbers:
    """The numbers of all frames, in the order of their rows; with a beam, also what judging its motion needs."""
    order = np.concatenate([plain(part.rows) for part in parts])
    whole = none_of(len(order))
    for part in parts:
        placed(whole, plain(part.rows), _numbers(part, beam))
    return whole


def _numbers(part: Solution, beam: Beam | None) -> Numbers:
    fits, uncertainty, rig_arrays = part.fits, part.uncertainty, part.fits.frames.rig_arrays
    state, prediction, by_rig = fits.state, fits.prediction, fits.by_rig
    xp = namespace(state.scatter)
    touch = prediction.point_force + (by_rig.point_force @ state.rig_steps[..., None])[..., 0]
    covariance = uncertainty.propagate(prediction.point_force_jacobian, by_rig.point_force)
    covariance = covariance + _bows(rig_arrays, state.unknowns, uncertainty.covariance, state.at_tip)
    # a rung that was demanded though it is too low: what it makes wrong is doubt
    off = part.model_errors
    covariance = covariance + off[..., UNKNOWNS:].mT @ off[..., UNKNOWNS:]
    std = xp.sqrt(uncertainty.std**2 + (off[..., :UNKNOWNS] ** 2).sum(1))
    free = part.free.points_at(state.unknowns[:, 0] * rig_arrays.length_m)
    unknowns = plain(state.unknowns)
    bias = np.full((len(unknowns), len(RUNGS)), np.nan)
    for rung, values in part.bias.items():
        bias[:, RUNGS.index(rung)] = plain(values)
    finite = xp.isfinite(fits.equations.cost) & xp.isfinite(state.unknowns).all(-1)
    touch, residual = plain(touch), plain(fits.problem.moment_residual)
    return Numbers(
        points=plain(fits.frames.usable.sum(-1)),
        rung=np.full(len(unknowns), RUNGS.index(fits.rung)),
        unknowns=unknowns,
        std=plain(std),
        point_m=touch[:, :3],
        force_N=touch[:, 3:],
        tangent=plain(prediction.tangents[:, CONTACT]),
        deflection_m=touch[:, :3] - plain(free),
        covariance=plain(covariance),
        with_pose=plain(
            uncertainty.covariance_with_rig(prediction.point_force_jacobian, by_rig.point_force)
            @ rig_arrays.axes[:POSES].T
        ),
        residual=residual,
        residual_std=plain(uncertainty.moment_std),
        felt=plain(fits.frames.sensor_available) > 0.0,
        strange=plain((state.rig_steps**2).sum(-1)),
        rig_axes=np.full(len(unknowns), state.rig_steps.shape[1]),
        evidence=plain(part.evidence),
        converged=plain(state.converged),
        at_tip=plain(state.at_tip),
        scatter=plain(state.scatter),
        condition=plain(uncertainty.condition),
        finite=plain(finite),
        rival=plain(part.alternative_cost),
        rival_unknowns=plain(part.alternative_unknowns),
        blind=plain(part.ambiguous),
        second=plain(part.second_gain),
        second_place=plain(part.second_place),
        second_harm=plain(part.second_shift),
        explained_alone=np.zeros(len(unknowns), bool),
        edge_on_rad=edge_on(rig_arrays.rig, unknowns),
        bias=bias,
        **_moving(part, beam),
    )


def _moving(part: Solution, beam: Beam | None) -> dict[str, np.ndarray]:
    names = ("pieces_m", "pieces_std_m", "push")
    if beam is None:
        return {name: np.full((len(part.rows), *FLOATS[name]), np.nan) for name in names}
    values = (*pieces(part.fits, beam), by_inertia(part.fits, part.uncertainty, beam))
    return {name: plain(value) for name, value in zip(names, values, strict=True)}


def edge_on(rig: Rig, unknowns: np.ndarray) -> np.ndarray:
    """(B,) angle between the deformation plane 𝒟 and the ray from the camera's centre to the contact, rad."""
    y_m, z_m, about_y, about_z = rig.antenna.parameters[:4]
    T_antenna_clamp = Pose.from_rotvec(np.array([0.0, about_y, about_z]), np.array([0.0, y_m, z_m]))
    center_m = T_antenna_clamp.inverse() @ rig.T_antenna_camera.translation_m
    line = center_m - unknowns[:, :1] * np.array([rig.antenna.length_m, 0.0, 0.0])
    return camera_angle(line, np.arctan2(unknowns[:, 2], unknowns[:, 1]))


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


def plain(values: Any) -> np.ndarray:
    """NumPy's array of either kind's."""
    return values if isinstance(values, np.ndarray) else values.detach().cpu().numpy()
