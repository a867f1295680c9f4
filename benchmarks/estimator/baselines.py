"""What others would do with the frames: the paper's two points, a straight line, a SciPy loop."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import least_squares

from benchmarks.estimator.scenes import Scenes
from vbaa_calib.antenna.rungs import curves

_FORCE_SCALE_N, _DISTANCE_SCALE_M = 0.01, 0.01
_MOST = 400
"""Evaluations at most."""
_START = 0.6
"""Contact distance over length that is tried where the straight line says nothing."""


def one_contact(scenes: Scenes, index: int) -> np.ndarray:
    """(3,) contact distance in m, f_y and f_z in N of one frame; NaN where the fit breaks down.

    Levenberg–Marquardt over the three on the rung `elastica`, by SciPy's difference quotients, for a camera that sees
    the antenna along the picture's u. Rig and friction are taken as exactly known.
    """
    rig, sensor = scenes.rig, scenes.rig.moment_sensor
    antenna, to_camera = rig.antenna, rig.T_antenna_camera.inverse()
    rotation = rig.kinematics.T_world_antenna(scenes.pan_rad[index], scenes.tilt_rad[index]).rotation
    gravity = (rotation.T @ rig.gravity_world_m_s2)[None]
    parameters = antenna.parameters[None]
    points = scenes.points_px[index]
    u, v = points[np.isfinite(points).all(axis=1)].T
    reading = (scenes.moment_Nm[index] - sensor.offset_Nm) / sensor.gain

    def residuals(unknowns: np.ndarray) -> np.ndarray:
        contact = np.clip(unknowns[:1] * _DISTANCE_SCALE_M, 1e-3, antenna.length_m)
        force = unknowns[None, 1:] * _FORCE_SCALE_N
        shape = curves("elastica", parameters, antenna.length_m, gravity, contact, force, taper=antenna.taper)
        pixels, _ = rig.camera.project(to_camera @ shape.points_m[0])
        curve = CubicSpline(pixels[:, 0], pixels[:, 1])
        across = (v - curve(u)) / np.sqrt(1.0 + curve(u, 1) ** 2)
        by_moment = sensor.gain * (reading - shape.moment_Nm[0]) / sensor.std_Nm
        return np.append(across / scenes.sigma_px, by_moment)

    try:
        found = least_squares(residuals, _start(scenes, index, reading), method="lm", max_nfev=_MOST)
    except ValueError:  # a step to a shape that runs back in the picture, which the spline refuses
        return np.full(3, np.nan)
    return np.asarray(found.x * [_DISTANCE_SCALE_M, _FORCE_SCALE_N, _FORCE_SCALE_N])


def _start(scenes: Scenes, index: int, reading_Nm: float) -> np.ndarray:
    """The straight line's contact and f_y, and the moment's f_z, in the unknowns' scales."""
    antenna = scenes.rig.antenna
    x, y = np.moveaxis(scenes.rig.camera_on_plane().project(scenes.points_px[index])[0], -1, 0)
    contact, force = _straight_line(x, y, _START * antenna.length_m, antenna.stiffness_Nm2)
    if not 0.0 < contact < antenna.length_m:
        contact = _START * antenna.length_m
        force = 3.0 * antenna.stiffness_Nm2 * float(np.nanmax(np.abs(y))) / contact**3
    return np.array([contact / _DISTANCE_SCALE_M, force / _FORCE_SCALE_N, reading_Nm / contact / _FORCE_SCALE_N])


def _straight_line(x_m: np.ndarray, y_m: np.ndarray, guess_m: float, stiffness_Nm2: float) -> tuple[float, float]:
    """Contact distance l and f_y by points (N,) on plane C, upright camera; NaN where there is no l > 0.

    The first of three lines goes through the points beyond `guess_m`, each further one beyond the l before.
    """
    contact, slope = guess_m, np.nan
    for _ in range(3):
        beyond = (x_m >= contact) & np.isfinite(y_m)
        if beyond.sum() < 2:
            return np.nan, np.nan
        slope, level = np.polyfit(x_m[beyond], y_m[beyond], 1)
        contact = -3.0 * float(level) / float(slope) if slope else np.inf
        if not 0.0 < contact < np.inf:
            return np.nan, np.nan
    return contact, 2.0 * stiffness_Nm2 * float(slope) / contact**2
