"""Antialiased tubes drawn here, not by the simulator: blurred, on uneven light, with noise."""

from __future__ import annotations

from itertools import pairwise

import cv2
import numpy as np

from vbaa_calib.detect.whisker.corridor import Corridor
from vbaa_calib.detect.whisker.finder import AntennaFinder

SIZE = (240, 320)
"""(height, width) of the pictures."""
_FINE = 6


def background(rng: np.random.Generator, clutter: float = 6.0, size: tuple[int, int] = SIZE) -> np.ndarray:
    """(H, W) grey levels: a slope of light, soft blots and a few blurred edges."""
    height, width = size
    v, u = np.mgrid[:height, :width]
    picture = 60.0 + 25.0 * u / width - 15.0 * v / height
    for cells in (5, 12):
        picture = picture + clutter * cv2.resize(rng.normal(size=(cells, cells)), (width, height), interpolation=2)
    for _ in range(6):
        corner, span = rng.uniform(0, [width, height]).astype(int), rng.uniform(10, 90, 2).astype(int)
        blot = np.zeros(size)
        cv2.rectangle(blot, corner.tolist(), (corner + span).tolist(), float(clutter * rng.normal()), -1)
        picture += cv2.GaussianBlur(blot, (0, 0), 2.0)
    return picture


def tube(
    path_px: np.ndarray,
    width_px: float,
    height: float,
    blur_px: float = 0.8,
    size: tuple[int, int] = SIZE,
    cut: bool = False,
) -> np.ndarray:
    """(H, W) grey levels of a shaded tube along a polyline (K, 2): distances on a fine grid, blurred, then averaged.

    cut : its end is cut off square; otherwise it is round.
    """
    picture, margin = np.zeros(size), width_px + 4.0 * blur_px + 1.0
    around = np.floor(path_px.min(axis=0) - margin), np.ceil(path_px.max(axis=0) + margin)
    (left, top), (right, bottom) = (np.clip(each, 0, size[::-1]).astype(int) for each in around)
    u, v = ((np.arange(_FINE * a, _FINE * b) + 0.5) / _FINE - 0.5 for a, b in ((left, right), (top, bottom)))
    nearest = np.full((len(v), len(u)), np.inf)
    for a, b in pairwise(path_px):
        along, reach = b - a, (np.minimum(a, b) - width_px, np.maximum(a, b) + width_px)
        across, down = (slice(*np.searchsorted(at, [each[i] for each in reach])) for i, at in enumerate((u, v)))
        du, dv = u[across] - a[0], v[down, None] - a[1]
        share = np.clip((du * along[0] + dv * along[1]) / (along @ along), 0.0, 1.0)
        away = np.hypot(du - share * along[0], dv - share * along[1])
        nearest[down, across] = np.minimum(nearest[down, across], away)
    if cut:
        along = path_px[-1] - path_px[-2]
        nearest[(v[:, None] - b[1]) * along[1] + (u - b[0]) * along[0] > 0.0] = np.inf
    inside, shade = nearest < 0.5 * width_px, np.zeros(nearest.shape)
    shade[inside] = 0.4 + 0.6 * np.sqrt(1.0 - (nearest[inside] / (0.5 * width_px)) ** 2)
    blurred = cv2.GaussianBlur(shade, (0, 0), blur_px * _FINE)
    picture[top:bottom, left:right] = height * blurred.reshape(len(v) // _FINE, _FINE, -1, _FINE).mean(axis=(1, 3))
    return picture


def exposed(brightness: np.ndarray, rng: np.random.Generator, noise: float = 1.5) -> np.ndarray:
    """(H, W) float32: noise and whole grey levels."""
    noisy = brightness + rng.normal(0.0, noise, brightness.shape)
    return np.clip(np.rint(noisy), 0, 255).astype(np.float32)


def straight(angle_deg: float, length_px: float = 180.0, middle: tuple[float, float] = (158.3, 119.6)) -> np.ndarray:
    """(2, 2) ends of a straight line through the picture's middle."""
    half = 0.5 * length_px * np.array([np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))])
    return np.array([np.array(middle) - half, np.array(middle) + half])


def bent(start: tuple[float, float], angle_deg: float, turn_deg: float, length_px: float = 220.0) -> np.ndarray:
    """(K, 2) a line whose direction turns evenly by so much from clamp to tip."""
    share = np.linspace(0.0, 1.0, 80)
    heading = np.radians(angle_deg + turn_deg * share)
    step = length_px / 79 * np.stack([np.cos(heading), np.sin(heading)], axis=1)
    return np.array(start) + np.concatenate([np.zeros((1, 2)), np.cumsum(step[:-1], axis=0)])


def aside(path_px: np.ndarray, points_px: np.ndarray) -> np.ndarray:
    """(N,) signed distance of points from a polyline, positive to the right of its direction in the picture."""
    best, signed = np.full(len(points_px), np.inf), np.zeros(len(points_px))
    for a, b in pairwise(path_px):
        along = (b - a) / np.linalg.norm(b - a)
        offset = points_px - a
        share = np.clip(offset @ along, 0.0, np.linalg.norm(b - a))
        distance = np.linalg.norm(offset - share[:, None] * along, axis=1)
        nearer = distance < best
        best[nearer] = distance[nearer]
        signed[nearer] = (along[0] * offset[:, 1] - along[1] * offset[:, 0])[nearer]
    return signed


def trace(image: np.ndarray, corridor: Corridor, bright: bool | None = True) -> np.ndarray:
    """(K, 2) the finder's best path from clamp to tip in a picture (H, W)."""
    finder = AntennaFinder.prepare(corridor, (image.shape[1], image.shape[0]))
    if bright is None:
        return finder.shapes(image)[0][0]
    return finder.path(image, finder.candidates(image, bright)[0], bright)
