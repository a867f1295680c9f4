"""The Cramér–Rao bound of a scene's contact: what no unbiased estimator can do better than.

From the scene's own forward model by difference quotients: all points, each along the seen curve's normal with σ px,
and the moment. Friction and the rig's parameters are nuisances with their priors.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag

from benchmarks.estimator.scenes import Scenes, Shapes, Touches, bending_at, rod_shapes, seen
from benchmarks.harness import concatenated
from vbaa_calib.geometry.covariance import independent_axes
from vbaa_calib.rig import POSE_PARAMETERS, RIG_PARAMETERS, RIG_STEPS, Rig

STEP = 1e-4
"""Of the contact distance in itself, of the push in EI/l², of the friction angle in rad."""
_ILL_CONDITIONED = 1e13
_CONTACT = 3
_PIECE = 100
_RIG_STEPS = np.append(RIG_STEPS, [STEP, STEP])
_GIVE = RIG_PARAMETERS.index("clamp_give_m")


@dataclass(frozen=True, eq=False)
class Bound:
    """Of B scenes.

    joint : (B, 4, 4) least covariance of l and the force (3,); infinite where the data do not hold them.
    condition : (B,) condition number of the information matrix, scaled to a unit diagonal.
    """

    joint: np.ndarray
    condition: np.ndarray

    @property
    def covariance(self) -> np.ndarray:
        """(B, 3, 3) of l, f_y and f_z."""
        kept = [0, 2, 3]
        return self.joint[:, kept][:, :, kept]

    def drawn(self, which: np.ndarray, draws: int) -> np.ndarray:
        """(draws, K, 3) errors of l, f_y and f_z of the picked frames, normally distributed; NaN without a bound."""
        rng, covariance = np.random.default_rng(0), self.covariance[which]
        known = np.isfinite(covariance).all(axis=(1, 2))
        found = np.full((draws, len(covariance), 3), np.nan)
        root = np.linalg.cholesky(covariance[known])
        found[:, known] = np.einsum("kij,dkj->dki", root, rng.normal(size=(draws, int(known.sum()), 3)))
        return found

    @property
    def force_std(self) -> np.ndarray:
        """(B,) least root mean square of the force's error as a vector."""
        return np.sqrt(np.trace(self.joint[:, 1:, 1:], axis1=1, axis2=2))

    @property
    def std(self) -> np.ndarray:
        """(B, 3) least standard deviations of l, f_y and f_z."""
        return np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2))


def bound(scenes: Scenes, friction_std_rad: float = 0.0) -> Bound:
    """The bound at the truth of scenes; whether noise was added to them does not matter.

    friction_std_rad : prior of the friction angle; with 0 the angle counts as known.

    The rig's parameters take part where `scenes.rig.covariance` is not zero, and then by the rod; only the clamp's give
    does not, which the simulated clamps have not.
    """
    pieces = np.split(np.arange(len(scenes)), range(_PIECE, len(scenes), _PIECE))
    return concatenated([_piece(scenes.picked(piece), friction_std_rad) for piece in pieces])


def _piece(scenes: Scenes, friction_std_rad: float) -> Bound:
    table, force = _slopes(scenes)
    axes = np.diag([1.0, 1.0, 1.0, friction_std_rad])
    if scenes.rig.covariance.any():
        axes = block_diag(axes, independent_axes(scenes.rig.covariance_with_tip))
    table, force = table @ axes, force @ axes
    information = np.swapaxes(table, 1, 2) @ table + np.diag(np.arange(axes.shape[1]) >= _CONTACT)
    inverse, condition = _inverse(information)
    wanted = np.concatenate([np.broadcast_to(axes[:1], (len(scenes), 1, axes.shape[1])), force], axis=1)
    joint = wanted @ inverse @ np.swapaxes(wanted, 1, 2)
    # where nothing is known a product of infinities would not say so
    joint[~np.isfinite(condition)] = np.where(np.eye(4) > 0, np.inf, np.nan)
    return Bound(joint, condition)


def _slopes(scenes: Scenes) -> tuple[np.ndarray, np.ndarray]:
    """How whitened data (B, N + 1, K) and the force (B, 3, K) move with touch (4) and rig (K − 4)."""
    rig, touches = scenes.rig, scenes.touches
    normal = _normals(scenes)
    below, above, spans = _touch_steps(rig, touches)
    # one call for all of them: few rods take as long as many
    either = concatenated([*below, *above])
    data, force = _data(scenes, rig, either, np.tile(normal, (len(below + above), 1, 1)))
    columns = _differences(data, spans)
    forces = _differences(force, spans)
    if rig.covariance.any():
        for index in range(len(rig.covariance_with_tip)):
            column, by_force = _by_rig(scenes, index, normal)
            columns.append(column)
            forces.append(by_force)
    return np.stack(columns, axis=-1), np.stack(forces, axis=-1)


def _differences(values: np.ndarray, spans: list[np.ndarray]) -> list[np.ndarray]:
    """Difference quotients, each (B, ...), of values (2·K·B, ...) below and then above, K spans (B,) apart."""
    low, high = values.reshape(2, len(spans), -1, *values.shape[1:])
    return [(above - below) / span[:, None] for below, above, span in zip(low, high, spans, strict=True)]


def _touch_steps(rig: Rig, touches: Touches) -> tuple[list[Touches], list[Touches], list[np.ndarray]]:
    """Touches a little below and above, and how far apart (B,), for distance, both pushes and friction."""
    distance, push, friction = touches.distance_m, touches.push_N, touches.friction_rad
    further = np.minimum(distance * (1 + STEP), rig.antenna.length_m)
    size = STEP * bending_at(rig, distance) / distance**2
    ends: list[tuple[str, np.ndarray, np.ndarray]] = [
        ("distance_m", further - 2 * STEP * distance, further),
        *(("push_N", push - size[:, None] * way, push + size[:, None] * way) for way in np.eye(2)),
        ("friction_rad", friction - STEP, friction + STEP),
    ]
    below = [replace(touches, **{name: low}) for name, low, _ in ends]
    above = [replace(touches, **{name: high}) for name, _, high in ends]
    return below, above, [further - ends[0][1], 2 * size, 2 * size, np.full(len(touches), 2 * STEP)]


def _data(scenes: Scenes, rig: Rig, touches: Touches, normal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Whitened data (B, N + 1) of one rig and its touches, and the force (B, 3)."""
    made_by = rod_shapes if scenes.rig.covariance.any() else scenes.made_by
    return _seen_as(scenes, rig, made_by(rig, touches, scenes.arclength_m), normal)


def _seen_as(scenes: Scenes, rig: Rig, shapes: Shapes, normal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """As `_data`, of shapes that are known already."""
    sensor = rig.moment_sensor
    pixels = _pixels(rig, shapes)
    across = (np.where(np.isfinite(pixels), pixels, 0.0) * normal).sum(axis=-1) / scenes.sigma_px
    moment = (sensor.gain * shapes.moment_Nm + sensor.offset_Nm) / sensor.std_Nm
    return np.concatenate([across, moment[:, None]], axis=1), shapes.force_N


def _by_rig(scenes: Scenes, index: int, normal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Slopes (B, N + 1) and (B, 3) by one of the rig's parameters; of the lens in steps of a tenth deviation."""
    rig, steps = scenes.rig, np.zeros(0)
    for number, one in enumerate(rig.cameras.values()):
        covariance = one.covariance if number else one.covariance_with_tip
        deviations = np.sqrt(np.diag(covariance)[len(RIG_PARAMETERS) :])
        first = _RIG_STEPS[: len(POSE_PARAMETERS) if number else None]
        steps = np.concatenate([steps, first, np.where(deviations > 0.0, 0.1 * deviations, STEP)])
    size = steps[index]
    step = np.where(np.arange(len(steps)) == index, size, 0.0)
    bends = len(POSE_PARAMETERS) <= index < len(RIG_STEPS) and index != _GIVE

    def data(rig: Rig) -> tuple[np.ndarray, np.ndarray]:
        return _data(scenes, rig, scenes.touches, normal) if bends else _seen_as(scenes, rig, scenes.shapes, normal)

    below, above = data(scenes.rig.moved(-step)), data(scenes.rig.moved(step))
    return (above[0] - below[0]) / (2 * size), (above[1] - below[1]) / (2 * size)


def _normals(scenes: Scenes) -> np.ndarray:
    """(B, N, 2) unit normals of the true seen curves; 0 where a point is not given."""
    parts = np.split(_pixels(scenes.rig, scenes.shapes), len(scenes.rig.cameras), axis=1)
    along = np.concatenate([np.gradient(part, axis=1) for part in parts], axis=1)
    normal = np.stack([-along[..., 1], along[..., 0]], axis=-1) / np.linalg.norm(along, axis=-1, keepdims=True)
    given = np.isfinite(_pixels(scenes.rig, scenes.shapes, False)).all(axis=-1) & np.isfinite(normal).all(axis=-1)
    if not scenes.rig.others:
        given &= np.isfinite(scenes.points_px).all(axis=-1)
    return np.where(given[..., None], normal, 0.0)


def _pixels(rig: Rig, shapes: Shapes, anywhere: bool = True) -> np.ndarray:
    """(B, V·N, 2) of all points in each of a rig's V cameras in turn, as `seen`."""
    cameras = rig.cameras.values()
    return np.concatenate(
        [seen(one.camera, one.T_antenna_camera, shapes.points_m, anywhere) for one in cameras], axis=1
    )


def _inverse(information: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Inverses (B, K, K), zero where there is none, and condition numbers (B,), infinite there."""
    scale = np.sqrt(np.diagonal(information, axis1=1, axis2=2))
    sound = np.isfinite(scale).all(axis=1) & (scale > 0).all(axis=1)
    scale = np.where(sound[:, None], scale, 1.0)
    unit = np.where(sound[:, None, None], information / (scale[:, :, None] * scale[:, None, :]), 0.0)
    sizes, axes = np.linalg.eigh(unit)
    condition = np.where(sizes[:, 0] > 0, sizes[:, -1] / np.where(sizes[:, 0] > 0, sizes[:, 0], 1.0), np.inf)
    sound &= condition < _ILL_CONDITIONED
    inverse = np.einsum(
        "bik,bk,bjk->bij", axes, np.where(sound[:, None], 1.0 / np.where(sizes > 0, sizes, 1.0), 0.0), axes
    )
    return inverse / (scale[:, :, None] * scale[:, None, :]), np.where(sound, condition, np.inf)
