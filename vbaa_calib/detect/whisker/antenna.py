"""Detection of the antenna in a picture, from the predicted free antenna."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from vbaa_calib.antenna.shape import Curves, bend
from vbaa_calib.antenna.taper import UNIFORM, Taper
from vbaa_calib.camera import Camera
from vbaa_calib.core.polyline import arc_lengths, followed
from vbaa_calib.geometry import Pose

from .corridor import CLAMP_REACH_PX, Corridor, FreeShape
from .finder import AntennaFinder, sampled_axis
from .settings import SearchSettings

REACH_PER_LENGTH = 0.9
"""How far to the side the antenna may be, as a fraction of the distance from the clamp: 42°."""
LEAST_AXIS, LEAST_LENGTH_PX = 4, 10.0
"""Least number of the free antenna's points that the lens must show, and least length: end on, there is no line."""


def free_curve(parameters: np.ndarray, length_m: float, gravity_m_s2: np.ndarray, taper: Taper = UNIFORM) -> Curves:
    """The free antenna under its weight, as a batch of one: parameters (9,), gravity (3,) antenna frame."""
    middle, nothing = np.array([0.5 * length_m]), np.zeros((1, 2))
    return bend(parameters[None], length_m, gravity_m_s2[None], middle, nothing, taper=taper)


def pixels(camera: Camera, T_camera_antenna: Pose, points_m: np.ndarray) -> np.ndarray:
    """(M, 2) pixels of a shape's points (M, 3), antenna frame, within the range of `followed`; points that the lens
    cannot project are left out."""
    projected, valid = camera.project(T_camera_antenna @ points_m)
    return followed(projected[valid], camera.image_size)


def width_px(camera: Camera, T_camera_antenna: Pose, points_m: np.ndarray, diameter_m: float) -> float:
    """The antenna's width in the picture, px, halfway along its points (N, 3), antenna frame; for a strong change of
    depth the mean of its ends. 0 where the camera does not see it there, and at most the picture's shorter side."""
    nearness, halfway = _nearness(T_camera_antenna, points_m)
    if not halfway > 0.0:
        return 0.0
    per_m = halfway if nearness is None else nearness.mean()
    return min(float(diameter_m * 0.5 * (camera.matrix[0, 0] + camera.matrix[1, 1]) * per_m), *camera.image_size)


def _nearness(T_camera_antenna: Pose, points_m: np.ndarray) -> tuple[np.ndarray | None, float]:
    """Reciprocal depths (2,) of the first and the last of points (N, 3), clamp and tip, and the one halfway; 0 behind
    the camera. None in place of the two where they are about the same: the width is then learnt from profiles."""
    depth = (T_camera_antenna @ points_m[[0, len(points_m) // 2, -1]])[:, 2]
    if not depth[1] > 0.0:
        return None, 0.0
    ends = 1.0 / depth[[0, 2]]
    apart = abs(ends[1] - ends[0]) > SearchSettings.perspective * abs(ends.mean())
    return (ends if depth.min() > 0.0 and apart else None), float(1.0 / depth[1])


def corridor(
    camera: Camera,
    T_camera_antenna: Pose,
    free: Curves,
    diameter_m: float,
    reach: float = REACH_PER_LENGTH,
    taper: Taper = UNIFORM,
) -> Corridor:
    """The corridor of possible antennas of known free shape in the picture, which extends by `reach` of the way from
    the clamp to either side.

    diameter_m : at its clamp, from where it changes by the taper.
    """
    points = free.points_m[0]
    axis, shape = pixels(camera, T_camera_antenna, points), FreeShape.of(camera, T_camera_antenna @ points)
    width = width_px(camera, T_camera_antenna, points, diameter_m * taper.middle)
    nearness, _ = _nearness(T_camera_antenna, points)
    thick, thin = taper.diameter(np.array([0.0, 1.0])) * (1.0 if nearness is None else nearness)
    broader = float((thin - thick) / (0.5 * (thin + thick)))
    return Corridor(axis, CLAMP_REACH_PX + reach * arc_lengths(axis), width, free=shape, taper=broader)


def finder(where: Corridor, camera: Camera, alike: AntennaFinder | None = None) -> AntennaFinder | None:
    """The antenna's detector in a corridor of this camera's pictures; None where too little of it is in view.

    alike : the finder of a similar corridor, to take its paths.
    """
    if not _shows(where):
        return None
    return AntennaFinder.prepare(where, camera.image_size) if alike is None else replace(alike, corridor=where)


def _shows(where: Corridor) -> bool:
    return len(where.axis_px) >= LEAST_AXIS and bool(arc_lengths(where.axis_px)[-1] >= LEAST_LENGTH_PX)


def same_paths_m_s2(where: Corridor, parameters: np.ndarray, length_m: float, taper: Taper = UNIFORM) -> float:
    """Resolution of gravity within which the same search paths are used: it moves the free antenna's tip by half the
    distance between two paths. Tabulating these takes ten times as long as everything else."""
    if not _shows(where):
        return 0.0
    _, spacing_px = sampled_axis(where)
    pulls = np.array([[0.0, 0.0, 0.0], [0.0, 10.0, 0.0]])
    tips = [free_curve(parameters, length_m, pull, taper).points_m[0, -1] for pull in pulls]
    sag_px = float(np.linalg.norm(tips[1] - tips[0])) / length_m * arc_lengths(where.axis_px)[-1]
    return 10.0 * float(min(0.5 * spacing_px / max(sag_px, 1e-9), 1.0))
