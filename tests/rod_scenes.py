"""Scenes for the inverse problems: the static rod, seen through OpenCV. Nothing here is the estimator's own model."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import cv2
import numpy as np
from scipy.optimize import least_squares
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from benchmarks.estimator.scenes import press
from benchmarks.estimator.setup import GRAVITY_WORLD_M_S2 as GRAVITY_WORLD
from benchmarks.estimator.setup import LENGTH_M, MASS_KG_M, RIG_STD, STIFFNESS_NM2, looking_pose
from vbaa_calib.antenna.rod import Rod, RodShape, sample_shape
from vbaa_calib.camera import Camera
from vbaa_calib.core.robust import HUBER
from vbaa_calib.geometry import Kinematics, Pose
from vbaa_calib.rig import Antenna, AntennaImage, MomentSensor, Rig

MATRIX = np.array([[1004.0, 0.0, 476.5], [0.0, 1001.0, 363.2], [0.0, 0.0, 1.0]])
BROWN = np.array([-0.182, 0.061, 0.0007, -0.0005])
SIGMA_PX, TIP_PX, UNIT_N = 0.03, 0.1, 0.05


@dataclass(frozen=True, eq=False)
class World:
    """What is true, in the order of the rig's own parameters but for the estimator unseen."""

    T_antenna_camera: Pose
    parameters: np.ndarray = field(
        default_factory=lambda: np.array(
            [3e-4, -2e-4, 0.009, -0.012, 0.05, 0.12, np.log(STIFFNESS_NM2), np.log(MASS_KG_M), 0.0]
        )
    )
    sensor: MomentSensor = field(default_factory=lambda: MomentSensor(1.04, 1.5e-4, 2e-5))

    @property
    def rod(self) -> Rod:
        """The true antenna, of a wire with ν = 0.3."""
        y, z, about_y, about_z, bow_y, bow_z, log_stiffness, log_mass, _ = self.parameters
        stiffness = np.exp(log_stiffness)
        clamp = Pose(Rotation.from_rotvec([0.0, about_y, about_z]).as_matrix(), np.array([0.0, y, z]))
        return Rod(LENGTH_M, stiffness, stiffness / 1.3, np.exp(log_mass), clamp, np.array([bow_y, bow_z]))

    def moved(self, step: np.ndarray) -> World:
        """Another world, `RIG_PARAMETERS` away by (17,)."""
        sensor = self.sensor
        return World(
            self.T_antenna_camera.retract(step[:6]),
            self.parameters + step[6:15],
            MomentSensor(sensor.gain + step[15], sensor.offset_Nm + step[16], sensor.std_Nm),
        )

    def rig(self, std: np.ndarray = RIG_STD, gravity_world: np.ndarray = GRAVITY_WORLD) -> Rig:
        """The rig that a calibration would have found, were it free of error."""
        return Rig(
            camera=Camera("opencv", (960, 720), MATRIX, BROWN),
            T_antenna_camera=self.T_antenna_camera,
            antenna=Antenna(LENGTH_M, 0.8e-3, self.parameters),
            moment_sensor=self.sensor,
            kinematics=Kinematics(),
            gravity_world_m_s2=gravity_world,
            image=AntennaImage(SIGMA_PX, 1.0, True),
            covariance=np.diag(std**2),
        )


@dataclass(frozen=True, eq=False)
class Frame:
    """What one frame gives the estimator, and what is true of it."""

    points_px: np.ndarray
    moment_Nm: float
    tilt_rad: float
    distance_m: float
    force_N: np.ndarray
    contact_world_m: np.ndarray
    tip_px: np.ndarray
    """(3,) the antenna's end, and its deviation."""


def camera_pose(incline_rad: float = 0.0, azimuth_rad: float = 0.0, away_m: float = 0.36) -> Pose:
    """A camera that looks at the antenna's middle, inclined from plane C's normal towards an azimuth from x."""
    return looking_pose(incline_rad, azimuth_rad, away_m)


def gravity_antenna(tilt_rad: float, gravity_world: np.ndarray = GRAVITY_WORLD) -> np.ndarray:
    """(3,) gravity in the antenna frame at a tilt."""
    return Kinematics().T_world_antenna(0.0, tilt_rad).rotation.T @ gravity_world


def seen(T_antenna_camera: Pose, points_m: np.ndarray) -> np.ndarray:
    """(N, 2) pixels of antenna-frame points (N, 3), by OpenCV."""
    T_camera_antenna = T_antenna_camera.inverse()
    turn, _ = cv2.Rodrigues(T_camera_antenna.rotation)
    return cv2.projectPoints(points_m, turn, T_camera_antenna.translation_m, MATRIX, BROWN)[0][:, 0]


def along(shape: RodShape, arclength_m: np.ndarray, index: int = 0) -> np.ndarray:
    """(N, 3) points of one rod of a batch at arc lengths (N,)."""
    one = RodShape(*(values[index : index + 1] for values in vars(shape).values()))
    return sample_shape(one, arclength_m[None])[0][0]


def frames(
    world: World,
    contact_m: Sequence[float],
    lateral_N: Sequence[Sequence[float]],
    tilt_rad: Sequence[float],
    rng: np.random.Generator,
    *,
    points: int = 300,
    sigma_px: float = SIGMA_PX,
    gravity_world: np.ndarray = GRAVITY_WORLD,
) -> list[Frame]:
    """One noisy frame per contact."""
    contact, lateral = np.asarray(contact_m, float), np.asarray(lateral_N, float)
    rotation, shift = Kinematics().world_antenna(np.zeros(len(contact)), np.asarray(tilt_rad, float))
    shape, force = press(world.rod, gravity_world @ rotation, contact, lateral)
    s = np.linspace(0.01, 1.0, points) * LENGTH_M
    at = np.column_stack([np.broadcast_to(s, (len(contact), points)), contact])
    every_m = sample_shape(shape, at)[0]
    every_px = seen(world.T_antenna_camera, every_m[:, :-1].reshape(-1, 3)).reshape(-1, points, 2)
    sensor, result = world.sensor, []
    for index, (tilt, pixels) in enumerate(zip(tilt_rad, every_px, strict=True)):
        moment = -shape.clamp_moment_Nm[index, 1]
        result.append(
            Frame(
                points_px=pixels + rng.normal(0.0, sigma_px, pixels.shape),
                moment_Nm=float(sensor.gain * moment + sensor.offset_Nm + rng.normal(0.0, sensor.std_Nm)),
                tilt_rad=float(tilt),
                distance_m=float(contact[index]),
                force_N=force[index],
                contact_world_m=rotation[index] @ every_m[index, -1] + shift[index],
                tip_px=np.append(pixels[-1] + rng.normal(0.0, TIP_PX * np.sign(sigma_px), 2), TIP_PX),
            )
        )
    return result


def pushing(direction_rad: float, tip_m: float, contact_m: float) -> np.ndarray:
    """(2,) lateral force that would push the tip aside by about so much, by the paper's beam."""
    size = 6 * STIFFNESS_NM2 * tip_m / (contact_m**2 * (3 * LENGTH_M - contact_m))
    return size * np.array([np.cos(direction_rad), np.sin(direction_rad)])


def blunt(world: World, **changes: float) -> World:
    """The same world with another moment sensor."""
    return replace(world, sensor=replace(world.sensor, **changes))


Guess = tuple[Pose, RodShape, np.ndarray, np.ndarray]
"""Camera pose, rod, force (3,) on it, and residuals of the readings in standard deviations."""


def fitted(one: Frame, start: np.ndarray, at: Callable[[np.ndarray], Guess]) -> tuple[np.ndarray, np.ndarray, float]:
    """Distance in lengths and force along y and z, N, by SciPy's least squares; their standard deviations; the cost.

    start : distance, lateral force in `UNIT_N`, and steps of what is known beforehand in standard deviations. at : what
    these make. The rod is solved for each, and seen by OpenCV: the fit's own model has no line in it.
    """
    places, steps = np.linspace(0.0, 1.0, 1500) * LENGTH_M, np.diag([1e-4] * 3 + [0.02] * (len(start) - 3))

    def residuals(x: np.ndarray) -> np.ndarray:
        T_antenna_camera, shape, _, read = at(x)
        curve = seen(T_antenna_camera, along(shape, places))
        nearest = cKDTree(curve).query(one.points_px)[1].clip(1, len(curve) - 2)
        way, off = curve[nearest + 1] - curve[nearest - 1], one.points_px - curve[nearest]
        across = (way[:, 0] * off[:, 1] - way[:, 1] * off[:, 0]) / np.linalg.norm(way, axis=1)
        return np.concatenate([across / SIGMA_PX, read, x[3:]])

    def touch(x: np.ndarray) -> np.ndarray:
        return np.append(x[0], at(x)[2][1:])

    def slopes(values: Callable[[np.ndarray], np.ndarray], x: np.ndarray) -> np.ndarray:
        return np.stack([(values(x + step) - values(x - step)) / (2.0 * step.max()) for step in steps], axis=1)

    robust = {"loss": "huber", "f_scale": HUBER, "x_scale": "jac", "max_nfev": 12}
    found = least_squares(residuals, start, lambda x: slopes(residuals, x), **robust)
    # SciPy's Jacobian is scaled by the roots of its own weights
    root = slopes(touch, found.x) @ np.linalg.pinv(found.jac)
    return touch(found.x), np.sqrt((root**2).sum(axis=1)), found.cost
