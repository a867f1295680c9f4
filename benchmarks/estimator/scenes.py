"""Frames with a known truth for the estimator's benchmark, thousands at a time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from benchmarks.estimator.setup import SIGMA_PX, inside, rod_of
from benchmarks.harness import concatenated, picked
from estimator import ContactEstimator
from estimator.contact.contacts import Contacts
from vbaa_calib.antenna.elastica import _planar_elastica as planar_elastica
from vbaa_calib.antenna.elastica import normal_load
from vbaa_calib.antenna.rod import Rod, RodShape, sample_shape, solve_rod
from vbaa_calib.camera import Camera
from vbaa_calib.core.errors import InputError, SolveError
from vbaa_calib.geometry import Pose
from vbaa_calib.rig import RIG_PARAMETERS, Rig

_TOLERANCE, _TURNS = 1e-10, 100
"""Of the force's angle, rad; turns of the force until it stands."""


@dataclass(frozen=True, eq=False)
class Touches:
    """B contacts, of an antenna each.

    distance_m : (B,) arc length of the contact from the clamp.
    push_N : (B, 2) size of the force, in the direction of its components y and z.
    friction_rad : (B,) angle of the force from the antenna's normal at the contact, positive towards the clamp.
    gravity_m_s2 : (B, 3) antenna frame.
    """

    distance_m: np.ndarray
    push_N: np.ndarray
    friction_rad: np.ndarray
    gravity_m_s2: np.ndarray

    def __len__(self) -> int:
        return len(self.distance_m)


@dataclass(frozen=True, eq=False)
class Shapes:
    """B antennas under their touches, antenna frame.

    points_m : (B, N, 3) at the arc lengths that were asked for. contact_m : (B, 3). force_N : (B, 3) on the antenna.
    moment_Nm : (B,) x·f_z − z·f_x of force and weight, the paper's τ_y. tangent : (B, 3) unit, at the contact.
    """

    points_m: np.ndarray
    contact_m: np.ndarray
    force_N: np.ndarray
    moment_Nm: np.ndarray
    tangent: np.ndarray


ShapesOf = Callable[[Rig, Touches, np.ndarray], Shapes]
"""(rig, touches, arc lengths (N,)) → shapes: what a scene is made by."""


def elastica_shapes(rig: Rig, touches: Touches, arclength_m: np.ndarray) -> Shapes:
    """In closed form. Raises InputError for an antenna with weight, bow or a clamp that gives."""
    parameters = rig.antenna.parameters
    if touches.gravity_m_s2.any() or parameters[4:6].any() or parameters[8]:
        raise InputError("the elastica knows neither weight, bow nor give", where="scene", remedy="make it by the rod")
    size, toward = _size_and_direction(touches.push_N)
    s = np.concatenate([np.broadcast_to(arclength_m, (len(size), len(arclength_m))), touches.distance_m[:, None]], 1)
    shape = planar_elastica(s, touches.distance_m, size, rig.antenna.stiffness_Nm2, touches.friction_rad)
    in_clamp = np.concatenate([shape.x_m[..., None], shape.w_m[..., None] * toward[:, None]], axis=2)
    theta = shape.theta_rad[:, -1]
    T_antenna_clamp = rod_of(rig).T_antenna_clamp
    points = T_antenna_clamp @ in_clamp
    force = size[:, None] * _leaning(theta + touches.friction_rad, toward) @ T_antenna_clamp.rotation.T
    contact = points[:, -1]
    tangent = _leaning(theta - np.pi / 2, toward) @ T_antenna_clamp.rotation.T
    moment = contact[:, 0] * force[:, 2] - contact[:, 2] * force[:, 0]
    return Shapes(points[:, :-1], contact, force, moment, tangent)


def rod_shapes(rig: Rig, touches: Touches, arclength_m: np.ndarray) -> Shapes:
    """By the static rod, rigidly clamped. Raises SolveError naming the touch for which no equilibrium was found."""
    gravity, distance = touches.gravity_m_s2, touches.distance_m
    shape, force = press(rod_of(rig), gravity, distance, touches.push_N, touches.friction_rad)
    at = np.broadcast_to(arclength_m, (len(distance), len(arclength_m)))
    points, tangents = sample_shape(shape, np.column_stack([at, distance]))
    return Shapes(points[:, :-1], points[:, -1], force, -shape.clamp_moment_Nm[:, 1], tangents[:, -1])


def press(
    rod: Rod,
    gravity_m_s2: np.ndarray,
    distance_m: np.ndarray,
    push_N: np.ndarray,
    friction_rad: np.ndarray | float = 0.0,
) -> tuple[RodShape, np.ndarray]:
    """B rods under gravity (B, 3) and forces (B, 3) of the sizes of `push_N` (B, 2) at arc lengths (B,); and these.

    Each force turns against x, in the plane of its push, until it is the angle of friction from the rod's normal there.
    Raises SolveError where it does not come to rest.
    """
    size, toward = _size_and_direction(push_N)
    lean = before = friction_rad + 0.0 * size
    last, guess = 0.0 * size, None
    for _ in range(_TURNS):  # by secants, each force by itself
        force = size[:, None] * _leaning(lean, toward)
        shape = solve_rod(rod, gravity_m_s2, distance_m, force, guess)
        tangent, guess = sample_shape(shape, distance_m[:, None])[1][:, 0], shape.clamp_moment_Nm
        across = (tangent[:, 1:] * toward).sum(axis=1)
        sine = np.sin(friction_rad) / np.hypot(tangent[:, 0], across)
        missed = np.arctan2(across, tangent[:, 0]) + np.arcsin(np.clip(sine, -1.0, 1.0)) - lean
        if (np.abs(missed)[size > 0.0] < _TOLERANCE).all():
            return shape, force
        step = lean - before
        slope = np.divide(missed - last, step, out=np.full_like(step, -1.0), where=step != 0.0)
        before, last, lean = lean, missed, lean - missed / np.minimum(slope, -0.2)
    worst = int(np.argmax(np.abs(missed)))
    raise SolveError(f"no equilibrium for a push of {size[worst]:.3g} N at {distance_m[worst]:.4f} m")


def _leaning(lean_rad: np.ndarray, toward: np.ndarray) -> np.ndarray:
    """(B, 3) unit vectors that lean from the directions (B, 2) across x by so much against x."""
    return np.concatenate([-np.sin(lean_rad)[:, None], np.cos(lean_rad)[:, None] * toward], axis=1)


def _size_and_direction(push_N: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sizes (B,) and unit directions (B, 2); along y where there is no push."""
    size = np.hypot(push_N[:, 0], push_N[:, 1])
    there = size[:, None] > 0.0
    return size, np.where(there, push_N / np.where(there, size[:, None], 1.0), [1.0, 0.0])


POINTS = 200
STEEPEST_RAD = np.radians(35.0)
_LARGEST_LOAD = 6.0


@dataclass(frozen=True, eq=False)
class Scenes:
    """B frames of N points: what the estimator is given, and the truth.

    rig : as the estimator is to know it.
    points_px : (B, N, 2); NaN where the point is not in the picture.
    sigma_px : standard deviation of a point along u and along v, for which the pictures are meant, in them or not.
    moment_Nm, pan_rad, tilt_rad : (B,) the sensor's reading and the joints.
    touches, shapes : the truth, at the arc lengths (N,) of the points.
    made_by : what made the shapes.
    """

    rig: Rig
    points_px: np.ndarray
    sigma_px: float
    moment_Nm: np.ndarray
    pan_rad: np.ndarray
    tilt_rad: np.ndarray
    touches: Touches
    shapes: Shapes
    arclength_m: np.ndarray
    made_by: ShapesOf

    def __len__(self) -> int:
        return len(self.moment_Nm)

    @property
    def distance_m(self) -> np.ndarray:
        """(B,) true arc length of the contact."""
        return self.touches.distance_m

    @property
    def force_N(self) -> np.ndarray:
        """(B, 3) true force on the antenna, antenna frame."""
        return self.shapes.force_N

    def picked(self, which: np.ndarray) -> Scenes:
        """Those with the indices or the mask; indices may repeat."""
        return replace(
            self,
            points_px=self.points_px[which],
            moment_Nm=self.moment_Nm[which],
            pan_rad=self.pan_rad[which],
            tilt_rad=self.tilt_rad[which],
            touches=picked(self.touches, which),
            shapes=picked(self.shapes, which),
        )

    def noisy(self, rng: np.random.Generator, draws: int = 1) -> Scenes:
        """Each frame `draws` times in a row with fresh noise: points by `sigma_px`, moments by the sensor's."""
        drawn = self.picked(np.repeat(np.arange(len(self)), draws))
        return replace(
            drawn,
            points_px=drawn.points_px + rng.normal(0.0, self.sigma_px, drawn.points_px.shape),
            moment_Nm=drawn.moment_Nm + rng.normal(0.0, self.rig.moment_sensor.std_Nm, len(drawn)),
        )

    def estimated(self, model: str = "auto", friction_std_rad: float = 0.0, **instead: Any) -> Contacts:
        """Every frame by the estimator, given the points' true deviation; `instead` of the frames' own inputs."""
        given = {name: getattr(self, name) for name in ("points_px", "moment_Nm", "pan_rad", "tilt_rad")} | instead
        estimator = ContactEstimator(self.rig, model=model, friction=friction_std_rad)
        return estimator.estimate_batch(*given.values(), sigma_px=self.sigma_px)


def joined(parts: Sequence[Scenes]) -> Scenes:
    """Frames of one rig, one after the other."""
    columns: dict[str, Any] = {
        name: np.concatenate([getattr(part, name) for part in parts])
        for name in ("points_px", "moment_Nm", "pan_rad", "tilt_rad")
    }
    touches, shapes = (concatenated([getattr(part, name) for part in parts]) for name in ("touches", "shapes"))
    return replace(parts[0], **columns, touches=touches, shapes=shapes)


def scenes(
    rig: Rig,
    distance_m: np.ndarray,
    push_N: np.ndarray,
    friction_rad: np.ndarray | float = 0.0,
    *,
    made_by: ShapesOf = elastica_shapes,
    pan_rad: np.ndarray | float = 0.0,
    tilt_rad: np.ndarray | float = 0.0,
    sigma_px: float = SIGMA_PX,
    points: int = POINTS,
    given: Rig | None = None,
) -> Scenes:
    """Frames without noise, of touches (B,), (B, 2), () or (B,); the points are spread evenly over the arc length.

    `rig` is the true one; `given`, where the two differ, the one that the estimator is to know.
    """
    pan, tilt, friction = (
        np.broadcast_to(np.asarray(v, float), distance_m.shape) for v in (pan_rad, tilt_rad, friction_rad)
    )
    touches = Touches(np.asarray(distance_m, float), np.asarray(push_N, float), friction, gravity(rig, pan, tilt))
    arclength = rig.antenna.length_m * (np.arange(points) + 0.5) / points
    shapes = made_by(rig, touches, arclength)
    sensor = rig.moment_sensor
    return Scenes(
        rig=rig if given is None else given,
        points_px=seen(rig.camera, rig.T_antenna_camera, shapes.points_m),
        sigma_px=sigma_px,
        moment_Nm=sensor.gain * shapes.moment_Nm + sensor.offset_Nm,
        pan_rad=pan,
        tilt_rad=tilt,
        touches=touches,
        shapes=shapes,
        arclength_m=arclength,
        made_by=made_by,
    )


def seen(camera: Camera, T_antenna_camera: Pose, points_m: np.ndarray, anywhere: bool = False) -> np.ndarray:
    """(..., 2) pixels of points (..., 3) of the antenna frame; NaN outside the picture, unless `anywhere`."""
    pixels, valid = camera.project(T_antenna_camera.inverse() @ points_m)
    given = valid if anywhere else valid & inside(pixels, camera.image_size)
    return np.where(given[..., None], pixels, np.nan)


def gravity(rig: Rig, pan_rad: np.ndarray, tilt_rad: np.ndarray) -> np.ndarray:
    """(B, 3) in the antenna frame at the joint angles (B,)."""
    if not rig.gravity_world_m_s2.any():
        return np.zeros((len(pan_rad), 3))
    angles, which = np.unique(np.stack([pan_rad, tilt_rad], axis=1), axis=0, return_inverse=True)
    turns = np.array([rig.kinematics.T_world_antenna(pan, tilt).rotation for pan, tilt in angles])
    return np.einsum("bji,j->bi", turns, rig.gravity_world_m_s2)[which.reshape(-1)]


def random_scenes(
    rig: Rig,
    count: int,
    rng: np.random.Generator,
    *,
    made_by: ShapesOf = rod_shapes,
    reach: tuple[float, float] = (0.1, 0.95),
    slope_rad: tuple[float, float] = (0.02, STEEPEST_RAD),
    friction_std_rad: float = 0.0,
    given: Rig | None = None,
) -> Scenes:
    """Frames without noise, every roll alike, evenly over contact distances (in lengths) and slopes at the contact.

    Pan and tilt lie within ± 1 rad. The slope is the one that the push alone would give.
    """
    distance = rig.antenna.length_m * rng.uniform(*reach, count)
    friction = friction_std_rad * rng.normal(size=count)
    roll = rng.uniform(-np.pi, np.pi, count)
    size = push_for_slope(rng.uniform(*slope_rad, count), distance, bending_at(rig, distance))
    joints = rng.uniform(-1.0, 1.0, (2, count))
    return scenes(
        rig,
        distance,
        rolled(size, roll),
        np.clip(friction, -1.2, 1.2),
        made_by=made_by,
        pan_rad=joints[0],
        tilt_rad=joints[1],
        given=given,
    )


def bending_at(rig: Rig, distance_m: np.ndarray) -> np.ndarray:
    """(B,) EI of a uniform antenna that a small force at each distance would give the same slope there."""
    taper, share = rig.antenna.taper, (np.arange(400) + 0.5) / 400
    softer = 1.0 / taper.stiffness(share * distance_m[:, None] / rig.antenna.length_m)
    return rig.antenna.stiffness_Nm2 / (2.0 * softer * (1.0 - share)).mean(axis=1)


def rolled(size_N: np.ndarray, roll_rad: np.ndarray | float) -> np.ndarray:
    """(B, 2) pushes of that size in the deformation plane of roll ξ."""
    return np.stack(np.broadcast_arrays(size_N * np.cos(roll_rad), size_N * np.sin(roll_rad)), axis=-1)


def push_for_slope(slope_rad: np.ndarray, distance_m: np.ndarray, stiffness_Nm2: np.ndarray | float) -> np.ndarray:
    """(B,) size of the frictionless push that gives the antenna that slope at the contact; up to 75°."""
    loads, _, slopes = _single_loads()
    return np.interp(slope_rad, slopes, loads) * stiffness_Nm2 / distance_m**2


def push_for_deflection(deflection_m: np.ndarray, distance_m: np.ndarray, stiffness_Nm2: float) -> np.ndarray:
    """(B,) size of the frictionless push that moves the contact aside by so much; NaN where no push does."""
    loads, aside, _ = _single_loads()
    top = int(np.argmax(aside)) + 1
    load = np.interp(deflection_m / distance_m, aside[:top], loads[:top], right=np.nan)
    return load * stiffness_Nm2 / distance_m**2


def _single_loads() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Loads F·l²/EI, and deflection over distance and slope that they give a frictionless contact."""
    loads = np.linspace(0.0, _LARGEST_LOAD, 600)
    shape = normal_load([1.0], loads)
    return loads, shape.w_m[:, 0], shape.theta_rad[:, 0]


# --- rigs with two cameras, and what both see


def with_second(rig: Rig, angle_rad: float = np.pi / 2) -> Rig:
    """The rig with a second camera like the first, `right`, turned by an angle about the antenna's x axis; the first is
    `left`."""
    count = len(RIG_PARAMETERS) + len(rig.camera.parameter_names)
    covariance = np.zeros((count, count))
    covariance[: len(rig.covariance), : len(rig.covariance)] = rig.covariance
    first, turn = (
        replace(rig, covariance=covariance, camera_name="left"),
        Pose.from_rotvec(np.array([angle_rad, 0.0, 0.0]), np.zeros(3)),
    )
    second = replace(first, T_antenna_camera=turn @ rig.T_antenna_camera, camera_name="right")
    return replace(first, others={"right": second})


def centrelines(rig: Rig, frames: Scenes, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Pixels (B, N, 2) of each of a rig's cameras, with the frames' noise."""
    pictures = (seen(one.camera, one.T_antenna_camera, frames.shapes.points_m) for one in rig.cameras.values())
    noisy = [points + rng.normal(0.0, frames.sigma_px, points.shape) for points in pictures]
    return dict(zip(rig.cameras, noisy, strict=True))
