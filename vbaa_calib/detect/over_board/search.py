"""Find a thin antenna over a board without knowing where: ridges of the difference, and the line most of them share."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.polynomial import Polynomial
from numpy.polynomial.polynomial import polyval

from vbaa_calib.camera import Camera
from vbaa_calib.geometry import Pose

from .picture import BoardPicture

_STANDS_OUT = 5.0
"""Least ridge response of a candidate pixel over its noise."""
_MOST_CANDIDATES = 20000
_ANGLES = 360
_BIN_M = 1e-3
_LEAST_BIN_PX = 2.0
_BANDS = (6.0, 3.0, 1.5)
"""Half widths, in bins, of the band around the path from which it is fitted again."""
_STEP_PX = 2.0
_LEAST_STEPS = 12
_LEAST_COVER = 0.5
"""Least part of the steps along the line, where the antenna would show, that must show it."""


@dataclass(frozen=True, eq=False)
class PlaneAbove:
    """The plane parallel to a board, `height_m` nearer to the viewer; (x, y) on it are those of the board frame."""

    camera: Camera
    T_camera_board: Pose
    height_m: float

    def to_plane(self, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Coordinates (N, 2) m of pixels (N, 2), and validity (N,)."""
        rays, valid = self.camera.unproject(pixels)
        rays = np.where(valid[:, None], rays, 0.0)
        rotation, shift = self.T_camera_board.rotation, self.T_camera_board.translation_m
        away = rays @ rotation[:, 2]
        valid = valid & (away > 1e-6)
        reach = (rotation[:, 2] @ shift - self.height_m) / np.where(valid, away, 1.0)
        return ((rays * reach[:, None] - shift) @ rotation)[:, :2], valid & (reach > 0)

    def to_pixels(self, points_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Pixels (N, 2) of coordinates (N, 2) m, and validity (N,)."""
        raised = np.column_stack([points_m, np.full(len(points_m), -self.height_m)])
        return self.camera.project(self.T_camera_board @ raised)

    def metres_per_pixel(self) -> float:
        """At the board frame's origin, seen squarely."""
        focal_px = np.sqrt(np.prod(np.diag(self.camera.matrix)[:2]))
        return float(np.linalg.norm(self.T_camera_board.translation_m) / focal_px)


@dataclass(frozen=True, eq=False)
class PlanePath:
    """A bent line on the plane: origin + s·direction + (c0 + c1·s + …)·normal, from s = start to end, m."""

    origin: np.ndarray
    direction: np.ndarray
    coefficients: np.ndarray
    start: float
    end: float

    @property
    def normal(self) -> np.ndarray:
        """(2,) across the direction."""
        return np.array([-self.direction[1], self.direction[0]])

    def along(self, points_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Coordinate s (N,) and distance (N,) of points (N, 2) from the path, m."""
        offset = points_m - self.origin
        s = offset @ self.direction
        return s, offset @ self.normal - polyval(s, self.coefficients)

    def points(self, s: np.ndarray) -> np.ndarray:
        """(N, 2) points at s (N,)."""
        aside = polyval(s, self.coefficients)
        return self.origin + s[:, None] * self.direction + aside[:, None] * self.normal

    def fitted(self, points_m: np.ndarray, weights: np.ndarray, degree: int = 2) -> PlanePath:
        """The path through points (N, 2) with weights (N,) on their squares."""
        s, aside = (points_m - self.origin) @ self.direction, (points_m - self.origin) @ self.normal
        coefficients = Polynomial.fit(s, aside, degree, w=np.sqrt(weights)).convert().coef
        return PlanePath(self.origin, self.direction, coefficients, float(s.min()), float(s.max()))


def search(picture: BoardPicture, plane: PlaneAbove, width_px: float, bright: bool) -> PlanePath | None:
    """The path of the antenna over the board; None without one.

    Works on the board alone, where the background is known, for a line brighter (or darker) than the print behind it.
    """
    pixels, strength = _candidates(picture, width_px, bright)
    points, valid = plane.to_plane(pixels)
    points, strength = points[valid], strength[valid]
    if len(points) < _LEAST_STEPS:
        return None
    scale = plane.metres_per_pixel()
    width = max(_BIN_M, _LEAST_BIN_PX * scale)
    path = _strongest_line(points, strength, width)
    for band in _BANDS:
        near = np.abs(path.along(points)[1]) < band * width
        if near.sum() < _LEAST_STEPS:
            return None
        path = path.fitted(points[near], strength[near], 1 if band == _BANDS[0] else 2)
    return _covered(picture, plane, path, points[np.abs(path.along(points)[1]) < width], scale * _STEP_PX, bright)


def _candidates(picture: BoardPicture, width_px: float, bright: bool) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (N, 2) on ridges of the difference and their weights (N,)."""
    known = np.isfinite(picture.pattern)
    difference = np.where(known, picture.seen - np.nan_to_num(picture.pattern), 0.0) * (1.0 if bright else -1.0)
    over_noise = (difference / picture.noise).astype(np.float32)
    smooth = cv2.GaussianBlur(over_noise, (0, 0), max(0.4 * width_px, 0.8))
    xx, yy = (cv2.Sobel(smooth, cv2.CV_32F, 2 * (1 - i), 2 * i, ksize=3) for i in (0, 1))
    xy = cv2.Sobel(smooth, cv2.CV_32F, 1, 1, ksize=3)
    ridge = 0.5 * (np.hypot(xx - yy, 2 * xy) - xx - yy)
    inner = cv2.erode(known.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    noise = float(np.median(ridge[inner])) if inner.any() else np.inf
    response = np.where(inner & (smooth > 2.0), ridge / max(noise, 1e-6), 0.0)
    rows, columns = np.nonzero(response > _STANDS_OUT)
    strength = np.minimum(response[rows, columns], 4 * _STANDS_OUT)
    best = np.argsort(-strength, kind="stable")[:_MOST_CANDIDATES]
    return np.column_stack([columns[best], rows[best]]).astype(float), strength[best]


def _strongest_line(points: np.ndarray, strength: np.ndarray, width: float) -> PlanePath:
    """The line of the greatest summed strength, by Hough's transform about the points' middle."""
    middle = points.mean(axis=0)
    offset = points - middle
    reach = int(np.ceil(np.linalg.norm(offset, axis=1).max() / width)) + 2
    best, chosen = -1.0, (0.0, 0)
    for angle in np.arange(_ANGLES) * np.pi / _ANGLES:
        bins = np.round(offset @ [-np.sin(angle), np.cos(angle)] / width).astype(int) + reach
        votes = np.convolve(np.bincount(bins, strength, 2 * reach + 1), [0.5, 1.0, 0.5], mode="same")
        if votes.max() > best:
            best, chosen = float(votes.max()), (float(angle), int(votes.argmax()) - reach)
    direction = np.array([np.cos(chosen[0]), np.sin(chosen[0])])
    return PlanePath(middle, direction, np.array([chosen[1] * width]), 0.0, 0.0)


def _covered(
    picture: BoardPicture, plane: PlaneAbove, path: PlanePath, points: np.ndarray, step: float, bright: bool
) -> PlanePath | None:
    """The path with its ends; None where it shows too seldom."""
    s = path.along(points)[0]
    steps = np.arange(path.start, path.end, step)
    if len(s) < _LEAST_STEPS or len(steps) < _LEAST_STEPS:
        return None
    pixels, valid = plane.to_pixels(path.points(steps))
    height, width = picture.pattern.shape
    column, row = np.clip(np.round(np.nan_to_num(pixels)), 0, [width - 1, height - 1]).astype(int).T
    behind = np.where(valid, picture.pattern[row, column], np.nan)
    shows = behind < 0.2 if bright else behind > 0.8
    hit = np.isin(np.arange(len(steps)), np.round((s - path.start) / step).astype(int))
    seen = float((shows & hit).sum())
    if seen < _LEAST_STEPS or seen < _LEAST_COVER * shows.sum():
        return None
    return PlanePath(path.origin, path.direction, path.coefficients, float(s.min()), float(s.max()))
