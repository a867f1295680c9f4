"""What others would do with the frames: the paper's two points, a straight line, a SciPy loop."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import least_squares

from benchmarks.estimator.scenes import Scenes
from estimator.paper.inclined import inclined_two_point_contact, project
from estimator.paper.two_point import straight_line_contact, two_point_contact
from vbaa_calib.antenna.rungs import curves
from vbaa_calib.camera import CameraOnPlane

PARTS = {"two curved points": (0.45, 0.95), "two straight points": (1.1, 2.0), "one of each": (0.6, 2.0)}
"""Where the two points are taken: up to 1 in contact distances, the rest as 1 + the share of the straight part."""
_CAMERA_B_TILT_RAD = np.radians(30.0)
FIRST_GUESS = 0.7
"""Of the length: beyond it the first straight line is drawn."""
Solve = Callable[[np.ndarray], np.ndarray]
"""From frames' indices to their contact distances, both (B,): what a user would have to run for each frame."""


def baselines(scenes: Scenes, rng: np.random.Generator) -> dict[str, Solve]:
    """Name → method made ready for frames that are noisy already; `rng` : for the noise of camera B's pictures."""
    layer, antenna = scenes.rig.camera_on_plane(), scenes.rig.antenna
    stiffness, length = antenna.stiffness_Nm2, antenna.length_m

    def two_points(ends: tuple[float, float]) -> Solve:
        pixels = np.take_along_axis(scenes.points_px, at_shares(scenes, ends)[..., None], axis=1)

        def solve(which: np.ndarray) -> np.ndarray:
            plane = layer.project(pixels[which])[0]
            return np.asarray(two_point_contact(plane[..., 0], plane[..., 1], stiffness, length).contact_m)

        return solve

    picked = _camera_b(scenes, layer, rng)

    def inclined(which: np.ndarray) -> np.ndarray:
        x, y = np.moveaxis(picked[which], -1, 0)
        found = inclined_two_point_contact(x, y, scenes.moment_Nm[which], stiffness, _CAMERA_B_TILT_RAD, length)
        return np.asarray(found.contact_m)

    def line(which: np.ndarray) -> np.ndarray:
        x, y = np.moveaxis(layer.project(scenes.points_px[which])[0], -1, 0)
        guess = np.full(len(which), FIRST_GUESS * length)
        return np.asarray(straight_line_contact(x, y, guess, stiffness)[0])

    ready = {name: two_points(ends) for name, ends in PARTS.items()}
    return ready | {"one of each, camera B at 30°": inclined, "straight line": line}


def at_shares(scenes: Scenes, ends: tuple[float, float]) -> np.ndarray:
    """(B, 2) indices of the points that lie nearest to the places that `PARTS` names."""
    contact, length = scenes.distance_m[:, None], scenes.rig.antenna.length_m
    share = np.array(ends)
    wanted = np.where(share <= 1.0, share * contact, contact + (share - 1.0) * (length - contact))
    return np.round(np.interp(wanted, scenes.arclength_m, np.arange(len(scenes.arclength_m)))).astype(int)


def _camera_b(scenes: Scenes, layer: CameraOnPlane, rng: np.random.Generator) -> np.ndarray:
    """(B, 2, 2) of the points "one of each" as the paper's orthographic camera B would see them.

    The benchmark's cameras are perspective ones, for which the inclined formulas were not made. The noise is what the
    points have on plane C through the real camera.
    """
    which = at_shares(scenes, PARTS["one of each"])
    points = np.take_along_axis(scenes.shapes.points_m, which[..., None], axis=1)
    middle = np.nanmean(scenes.points_px, axis=(0, 1))
    a, b = layer.project(middle + np.array([[-0.5, 0.0], [0.5, 0.0]]))[0]
    m_per_px = float(np.linalg.norm(b - a))
    image = np.asarray(project(points, _CAMERA_B_TILT_RAD))
    return image + rng.normal(0.0, scenes.sigma_px * m_per_px, image.shape)


_FORCE_SCALE_N, _DISTANCE_SCALE_M = 0.01, 0.01
_START = 0.6
"""Contact distance over length that is tried where the straight line says nothing."""


def one_contact(scenes: Scenes, index: int) -> np.ndarray:
    """(3,) contact distance in m, f_y and f_z in N of one frame; NaN where the fit breaks down.

    Levenberg–Marquardt over the three on the rung `elastica`, SciPy's own difference quotients, for a camera that sees
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
        found = least_squares(residuals, _start(scenes, index, reading), method="lm")
    except ValueError:  # a step to a shape that runs back in the picture, which the spline refuses
        return np.full(3, np.nan)
    return np.asarray(found.x * [_DISTANCE_SCALE_M, _FORCE_SCALE_N, _FORCE_SCALE_N])


def _start(scenes: Scenes, index: int, reading_Nm: float) -> np.ndarray:
    """The straight line's contact and f_y, and the moment's f_z, in the unknowns' scales."""
    antenna = scenes.rig.antenna
    x, y = np.moveaxis(scenes.rig.camera_on_plane().project(scenes.points_px[index])[0], -1, 0)
    contact, force = map(float, straight_line_contact(x, y, _START * antenna.length_m, antenna.stiffness_Nm2))
    if not 0.0 < contact < antenna.length_m:
        contact = _START * antenna.length_m
        force = 3.0 * antenna.stiffness_Nm2 * float(np.nanmax(np.abs(y))) / contact**3
    return np.array([contact / _DISTANCE_SCALE_M, force / _FORCE_SCALE_N, reading_Nm / contact / _FORCE_SCALE_N])
