"""The paper's antenna and picture: 0.8 mm × 240 mm of steel, 512×512 pixels, camera A, as far as the paper tells them.

It tells neither lens nor distance: here a lens as long as 2.5 widths of its chip (16 mm on half an inch) stands 0.65 m
off. Neither does it tell the noise: 0.1 px is what a subpixel detector reaches, 0.3 px what whole pixels leave.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..antenna.rod import RodShape, sample_shape, solve_rod
from ..camera import Camera
from ..rig import Rig
from .estimator_scenes import seen
from .estimator_setup import TOWARDS_CLAMP, Setup, filling_pose
from .rod_of_rig import rod_of

POINTS = 200
FOCAL_WIDTHS, WIDTH_PX, SWING_M = 2.5, 512, 0.03


def paper_rig() -> Rig:
    """The rig as calibrated: weight, bow and a clamp that is off, known as well as an ordinary calibration knows."""
    focal = FOCAL_WIDTHS * WIDTH_PX
    middle = 0.5 * (WIDTH_PX - 1)
    camera = Camera(
        "opencv", (WIDTH_PX, WIDTH_PX), np.array([[focal, 0, middle], [0, focal, middle], [0, 0, 1.0]]), np.zeros(0)
    )
    rig = Setup("none", image_size=(WIDTH_PX, WIDTH_PX), real=True, exact=False).rig()
    return replace(rig, camera=camera, T_antenna_camera=filling_pose(camera, 0.0, TOWARDS_CLAMP, SWING_M))


def free_shape(rig: Rig, gravity_m_s2: np.ndarray) -> RodShape:
    """The true antenna without contact, under gravity (B, 3), antenna frame."""
    rod = rod_of(rig)
    return solve_rod(rod, gravity_m_s2, np.full(len(gravity_m_s2), 0.5 * rod.length_m), np.zeros_like(gravity_m_s2))


@dataclass(frozen=True, eq=False)
class Pictures:
    """B frames as the true rig sees and feels them, without noise.

    Attributes
    ----------
    points_px : (B, N, 2). moment_Nm : (B, 2) readings (τ_z, τ_y); the sensor about z is as good as the rig's.
    """

    points_px: np.ndarray
    moment_Nm: np.ndarray

    def noisy(self, rig: Rig, sigma_px: float, rng: np.random.Generator) -> Pictures:
        """With a draw of noise: points by `sigma_px`, readings by the sensor's."""
        return Pictures(
            self.points_px + rng.normal(0.0, sigma_px, self.points_px.shape),
            self.moment_Nm + rng.normal(0.0, rig.moment_sensor.std_Nm, self.moment_Nm.shape),
        )


def taken(true: Rig, shape: RodShape, points: int = POINTS) -> Pictures:
    """The pictures and readings of antennas, by the true rig."""
    s = true.antenna.length_m * (np.arange(points) + 0.5) / points
    there = sample_shape(shape, np.broadcast_to(s, (len(shape.points_m), points)))[0]
    moment = np.stack([shape.clamp_moment_Nm[:, 2], -shape.clamp_moment_Nm[:, 1]], axis=1)
    sensor = true.moment_sensor
    return Pictures(seen(true.camera, true.T_antenna_camera, there), sensor.gain * moment + sensor.offset_Nm)
