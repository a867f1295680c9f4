"""The synthetic rigs of the benchmarks: camera, antenna and sensor by a few words, and true rigs drawn around them."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from vbaa_calib.antenna.rod import Rod
from vbaa_calib.camera import Camera
from vbaa_calib.core.errors import InputError
from vbaa_calib.geometry import Kinematics, Pose
from vbaa_calib.rig import RIG_PARAMETERS, Antenna, AntennaImage, MomentSensor, Rig
from vbaa_calib.simulate.scene.scene import camera_pose

LENGTH_M, DIAMETER_M, STIFFNESS_NM2, MASS_KG_M = 0.24, 0.8e-3, 3.9e-3, 3.97e-3
GRAVITY_WORLD_M_S2 = np.array([0.0, 0.0, -9.80665])
SENSOR = MomentSensor(1.0, 0.0, 2e-5)
SIGMA_PX = 0.1
LENSES = {
    "none": ("opencv", 0.8, ()),
    "brown": ("opencv", 0.8, (-0.18, 0.06, 7e-4, -5e-4)),
    "fisheye": ("fisheye", 0.45, (0.05, -0.01, 0.003, -0.001)),
}
"""Name → OpenCV's model, focal length over the picture's width, distortion."""
TOWARDS_CLAMP, ACROSS = math.pi, math.pi / 2
"""Azimuths of the camera's tilt. Towards the clamp is the paper's camera B: x_p = x + z·tan φ, Eq. (24)."""
REAL = np.array([3e-4, -2e-4, 0.009, -0.012, 0.05, 0.12])
"""Clamp offset m, clamp rotation rad and bow 1/m of a real antenna, the first six of its parameters."""
RIG_STD = np.array([2e-4] * 3 + [5e-5] * 3 + [2e-5] * 2 + [2e-4] * 2 + [2e-3] * 2 + [1e-3, 1e-2, 1e-5] + [2e-3, 5e-6])
"""Standard deviations of `RIG_PARAMETERS` after an ordinary calibration."""
_MARGIN = 0.04


@dataclass(frozen=True)
class Setup:
    """How one rig is built.

    lens : one of `LENSES`.
    tilt_rad, azimuth_rad : the camera's axis is inclined by the tilt from plane C's normal; the camera stands off that
        normal in the direction of plane C that the azimuth gives, counted from the antenna's x towards y.
    image_size : (width, height) px.
    swing_m : the picture holds the box of the straight antenna and so much beside it, along y and z.
    real : with weight, bow and a clamp that is off; otherwise straight, weightless and clamped along x.
    exact : the rig is known exactly; otherwise as well as `RIG_STD` says.
    tip : diameter at the antenna's tip over that at its clamp.
    """

    lens: str = "brown"
    tilt_rad: float = 0.0
    azimuth_rad: float = TOWARDS_CLAMP
    image_size: tuple[int, int] = (1280, 720)
    swing_m: float = 0.03
    real: bool = False
    exact: bool = True
    tip: float = 1.0

    @property
    def camera(self) -> Camera:
        """Its principal point lies a little off the picture's centre."""
        model, focal, distortion = LENSES[self.lens]
        width, height = self.image_size
        matrix = np.array(
            [[focal * width, 0.0, 0.505 * width - 0.5], [0.0, focal * width, 0.49 * height - 0.5], [0.0, 0.0, 1.0]]
        )
        return Camera(model, self.image_size, matrix, np.array(distortion))

    def rig(self) -> Rig:
        """The rig as a calibration free of error would have found it."""
        parameters = np.zeros(9)
        parameters[6:8] = np.log([STIFFNESS_NM2, MASS_KG_M])
        if self.real:
            parameters[:6] = REAL
        camera = self.camera
        profile = None if self.tip == 1.0 else ((0.0, DIAMETER_M), (LENGTH_M, self.tip * DIAMETER_M))
        return Rig(
            camera=camera,
            T_antenna_camera=filling_pose(camera, self.tilt_rad, self.azimuth_rad, self.swing_m),
            antenna=Antenna(LENGTH_M, DIAMETER_M, parameters, profile),
            moment_sensor=SENSOR,
            kinematics=Kinematics(),
            gravity_world_m_s2=GRAVITY_WORLD_M_S2 if self.real else np.zeros(3),
            image=AntennaImage(SIGMA_PX, 1.0, True),
            covariance=np.diag((0.0 if self.exact else 1.0) * RIG_STD**2),
        )


def filling_pose(camera: Camera, tilt_rad: float, azimuth_rad: float, swing_m: float) -> Pose:
    """T_antenna_camera of the nearest camera of that direction that sees the whole box of `Setup.swing_m`.

    It looks at the antenna's middle, the picture's u axis along the antenna. Raises InputError where the box does not
    fit at any distance up to 3 m.
    """
    low, high = 0.02, 3.0
    if not _sees_box(camera, looking_pose(tilt_rad, azimuth_rad, high), swing_m):
        raise InputError("the antenna does not fit into the picture", where="setup", remedy="give a wider lens")
    while high - low > 1e-4:
        middle = 0.5 * (low + high)
        sees = _sees_box(camera, looking_pose(tilt_rad, azimuth_rad, middle), swing_m)
        low, high = (low, middle) if sees else (middle, high)
    return looking_pose(tilt_rad, azimuth_rad, high)


def looking_pose(tilt_rad: float, azimuth_rad: float, away_m: float) -> Pose:
    """T_antenna_camera at a distance from the antenna's middle, which it looks at."""
    return camera_pose(tilt_rad, azimuth_rad, 0.0, away_m, np.array([LENGTH_M / 2, 0.0, 0.0]))


def inside(pixels: np.ndarray, image_size: tuple[int, int], margin: float = 0.0) -> np.ndarray:
    """(...) which pixels (..., 2) lie in the picture, by a margin in shares of its sides. NaN does not."""
    size = np.array(image_size, float)
    return np.all((pixels >= margin * size) & (pixels <= (1.0 - margin) * size - 1.0), axis=-1)


def drawn_truth(rig: Rig, rng: np.random.Generator) -> Rig:
    """A true rig, all of its cameras, that the given one may be the calibration of: off by one draw of its joint
    covariance.

    The clamp's give stays as it is: the simulated clamps are rigid.
    """
    count = len(rig.covariance)
    root = rig.axes if rig.others else np.linalg.cholesky(rig.covariance + 1e-30 * np.eye(count))
    step = root @ rng.normal(size=root.shape[1])
    step[RIG_PARAMETERS.index("clamp_give_m")] = 0.0
    return rig.moved(step)


def _sees_box(camera: Camera, T_antenna_camera: Pose, swing_m: float) -> bool:
    x, y, z = np.linspace(0.0, LENGTH_M, 5), *2 * [np.array([-swing_m, 0.0, swing_m])]
    corners = np.stack(np.meshgrid(x, y, z), axis=-1).reshape(-1, 3)
    pixels, valid = camera.project(T_antenna_camera.inverse() @ corners)
    return bool((valid & inside(pixels, camera.image_size, _MARGIN)).all())


def rod_of(rig: Rig) -> Rod:
    """The rig's antenna as a round wire, rigidly clamped."""
    return replace(rig.antenna.rod, clamp_give_m=0.0)
