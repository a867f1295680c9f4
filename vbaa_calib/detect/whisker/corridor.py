"""Where the antenna can be in the picture, and the shapes that it can have there."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from vbaa_calib.antenna.shape import Curves, bend
from vbaa_calib.antenna.taper import UNIFORM, Taper
from vbaa_calib.camera import Camera
from vbaa_calib.camera.lens import lens_of
from vbaa_calib.core.polyline import arc_lengths, followed, offsets_from, resample
from vbaa_calib.geometry import Pose
from vbaa_calib.native import core

from .settings import AcceptanceSettings, SearchSettings

STARTS = np.zeros((6, 5))
STARTS[:, 3], STARTS[:, 4] = [0.0, 0.0, 0.7, -0.7, 0.7, -0.7], np.log([0.6, 0.3, 0.6, 0.6, 0.3, 0.3])
"""Initial bends by a force towards the camera, rad, and its places, as logarithms of parts of the length; the first two
in the picture alone."""
SHAPE_POINTS = 40
"""Runs of points whose means are compared with a shape, at most."""
LEAST_SHAPE_POINTS = 12
"""Fewest of these, or of points, that a shape is fitted to."""
SHAPE_SEGMENTS = 48
"""Segments of a shape."""


@dataclass(frozen=True, eq=False)
class _FreeShape:
    """The free antenna in space, with the camera that sees it.

    Attributes
    ----------
    clamp_m : (3,) camera frame.
    axes : (3, 3) rows in the camera frame: along the antenna at its clamp, lateral in the picture, and the third.
    segments_m : (SHAPE_SEGMENTS, 3) equal ones from clamp to tip, along these axes.
    """

    camera: Camera
    clamp_m: np.ndarray
    axes: np.ndarray
    segments_m: np.ndarray

    @staticmethod
    def of(camera: Camera, points_m: np.ndarray) -> _FreeShape:
        """The free shape from points (K, 3) from clamp to tip in the camera frame."""
        along = np.append(0.0, np.linalg.norm(np.diff(points_m, axis=0), axis=1).cumsum())
        at = np.linspace(0.0, along[-1], SHAPE_SEGMENTS + 1)
        points = np.stack([np.interp(at, along, values) for values in points_m.T], axis=1)
        segments = np.diff(points, axis=0)
        lateral = np.cross(points[0], segments[0])
        axes = np.stack([segments[0], lateral, np.cross(segments[0], lateral)])
        axes /= np.linalg.norm(axes, axis=1, keepdims=True)
        return _FreeShape(camera, points[0], axes, segments @ axes.T)

    @cached_property
    def focal_px(self) -> float:
        """Mean focal length."""
        return 0.5 * float(self.camera.matrix[0, 0] + self.camera.matrix[1, 1])

    @property
    def clamp_px_per_m(self) -> float:
        """Magnification at the clamp, px per metre, for lengths perpendicular to the line of sight."""
        return self.focal_px / float(self.clamp_m[2])


@dataclass(frozen=True, eq=False)
class Corridor:
    """The region of the picture in which the antenna can be.

    Attributes
    ----------
    axis_px : (M, 2) the free antenna from clamp to tip, pixels.
    reach_px : (M,) how far to either side it can be at each of these points.
    width_px : the antenna's width, half way. taper : part of it by which it is broader at its tip than at its clamp.
    clamp_px, clamp_rad : how far from the axis, and at what angle to it, the antenna may leave its clamp.
    shape_px : root mean square distance by which it may differ from its free shape, bent by a force; None without a
    calibrated rig: its free shape is unknown then.
    free : its free shape in space.
    """

    axis_px: np.ndarray
    reach_px: np.ndarray
    width_px: float
    clamp_px: float = SearchSettings.clamp_px
    clamp_rad: float = SearchSettings.clamp_rad
    shape_px: float | None = None
    free: _FreeShape | None = None
    taper: float = 0.0

    def coordinates(self, points_px: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Coordinates of points (N, 2) along the axis, and along its normals, (N,) px."""
        fine, along = resample(self.axis_px, 1.0)
        nearest, distance = offsets_from(fine, points_px)
        return along[nearest], distance

    def misfit(self, points_px: np.ndarray, sigma_px: np.ndarray, enough: float = 1.0) -> float:
        """Distance of points (N, 2), with standard deviations (N,), beginning at the clamp, from the nearest
        possible antenna.

        The sum of the squares of offset and turn at the clamp and of the distance from the shape, each over its allowed
        value: more than 1 is no antenna. Points beyond the tip count by their distance from it. The shape is the free
        antenna's, bent to any side by a force at any place; the search ends at the first one with a misfit of `enough`
        or less. 0 where the lens does not show enough of the points.
        """
        assert self.shape_px is not None
        assert self.free is not None
        means, variance = core.search.means_of_runs(points_px, sigma_px, SHAPE_POINTS)
        seen, valid, *_ = lens_of(self.free.camera.intrinsics).normalized(means)
        if np.count_nonzero(valid) < LEAST_SHAPE_POINTS:
            return 0.0
        variance = (variance[valid] + self.shape_px**2) / self.free.focal_px**2
        known = (self.clamp_px / self.free.clamp_px_per_m, self.clamp_rad, AcceptanceSettings.depth_rad)
        return float(core.search.misfit(self.free, seen[valid], variance, known, enough, STARTS))


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
    reach: float = SearchSettings.reach,
    taper: Taper = UNIFORM,
) -> Corridor:
    """The corridor of possible antennas of known free shape in the picture, which extends by `reach` of the way from
    the clamp to either side.

    diameter_m : at its clamp, from where it changes by the taper.
    """
    points = free.points_m[0]
    axis, shape = pixels(camera, T_camera_antenna, points), _FreeShape.of(camera, T_camera_antenna @ points)
    width = width_px(camera, T_camera_antenna, points, diameter_m * taper.middle)
    nearness, _ = _nearness(T_camera_antenna, points)
    thick, thin = taper.diameter(np.array([0.0, 1.0])) * (1.0 if nearness is None else nearness)
    broader = float((thin - thick) / (0.5 * (thin + thick)))
    return Corridor(axis, SearchSettings.clamp_px + reach * arc_lengths(axis), width, free=shape, taper=broader)
