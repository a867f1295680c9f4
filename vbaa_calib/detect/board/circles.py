"""Centres of circles: centroids of their areas in a picture, corrected to the projections of the true centres.

The two differ because perspective and distortion are not affine. The map from board to picture is fitted to the grid as
a homography followed by a cubic, and the difference is integrated over each circle, with the radius from its area.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np

from targets.board import CircleGrid, corner_points

from .settings import DetectionSettings

_Map = Callable[[np.ndarray], np.ndarray]


def circle_centres(image: np.ndarray, found_px: np.ndarray, spec: CircleGrid) -> tuple[np.ndarray, ...]:
    """Refine the circles of a grid in a picture (H, W) uint8, from rough centres (corner_count, 2) px.

    Returns ids (N,) of the circles that are large and free enough, the pictures of their centres (N, 2) px, covariances
    (N, 2, 2) px² from the picture's noise, and the corrections (N, 2) px, subtracted from the centroids.
    """
    points = corner_points(spec)[:, :2]
    centres, bias = found_px.copy(), np.zeros_like(found_px)
    ids, radius_m, blur_px = np.arange(len(points)), _first_radius_m(image, found_px, points, spec.pitch_m), np.inf
    areas: list[_Area] = []
    for _ in range(DetectionSettings.circle_rounds):
        project = _board_to_picture(points[ids], centres[ids])
        slopes, circle = _slopes(project, points, spec.pitch_m), (radius_m, spec.pitch_m)
        seen = {
            int(index): area
            for index in ids
            if (area := _area(image, centres[index] + bias[index], slopes[index], circle, blur_px)) is not None
        }
        ids, areas = np.array(list(seen), int), list(seen.values())
        if len(ids) < 4:
            return np.zeros(0, int), np.zeros((0, 2)), np.zeros((0, 2, 2)), np.zeros((0, 2))
        sizes = np.array([area.px2 for area in areas]) / np.abs(np.linalg.det(slopes[ids])) / np.pi
        radius_m = min(float(np.sqrt(np.median(sizes))), 0.49 * spec.pitch_m)
        blur_px = float(np.median([area.blur_px for area in areas]))
        bias[ids] = _bias(project, points[ids], radius_m)
        centres[ids] = np.array([area.centre for area in areas]) - bias[ids]
    noise = np.maximum(np.median([area.variances for area in areas], axis=0), DetectionSettings.least_variance)
    return ids, centres[ids], np.array([area.covariance(*noise) for area in areas]), bias[ids]


def _board_to_picture(points: np.ndarray, pixels: np.ndarray) -> _Map:
    """The smooth map from the board's plane to the picture through points (N, 2) m and their pixels (N, 2)."""
    homography = cv2.findHomography(points, pixels)[0]
    if homography is None:
        homography = np.eye(3)

    def flat(places: np.ndarray) -> np.ndarray:
        return cv2.perspectiveTransform(places.reshape(1, -1, 2), homography)[0]

    middle = pixels.mean(axis=0)
    size = max(float(np.abs(pixels - middle).max()), 1.0)

    def monomials(places_px: np.ndarray) -> np.ndarray:
        u, v = ((places_px - middle) / size).T
        return np.stack([u**i * v**j for i in range(4) for j in range(4 - i)], axis=1)

    straight = flat(points)
    cubic = np.zeros((10, 2))
    if len(points) >= DetectionSettings.cubic_needs:
        cubic = np.linalg.lstsq(monomials(straight), pixels - straight, rcond=None)[0]

    def project(places: np.ndarray) -> np.ndarray:
        through = flat(places)
        return (through + monomials(through) @ cubic).reshape(places.shape)

    return project


def _slopes(project: _Map, places: np.ndarray, pitch_m: float) -> np.ndarray:
    """(..., 2, 2) px per metre along the board's x and y (columns) at places (..., 2)."""
    step = 1e-3 * pitch_m
    moved = [project(places + one) - project(places - one) for one in step * np.eye(2)]
    return np.stack(moved, axis=-1) / (2.0 * 1e-3 * pitch_m)


def _bias(project: _Map, centres: np.ndarray, radius_m: float) -> np.ndarray:
    """(N, 2) px from the projection of each circle's centre (N, 2) m to the centroid of its area."""
    rings, around = 4, 12
    nodes, weights = np.polynomial.legendre.leggauss(rings)
    # quadrature over rings of equal area
    radii, angles = np.sqrt((nodes + 1.0) / 2.0), 2.0 * np.pi * np.arange(around) / around
    offsets = radius_m * radii[:, None, None] * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    places = centres[:, None] + offsets.reshape(1, -1, 2)
    covered = np.repeat(weights, around) * np.abs(np.linalg.det(_slopes(project, places, radius_m)))
    middle = (covered[..., None] * project(places)).sum(axis=1) / covered.sum(axis=1)[:, None]
    return np.asarray(middle - project(centres))


def _first_radius_m(image: np.ndarray, centres: np.ndarray, points: np.ndarray, pitch_m: float) -> float:
    """The circles' radius from the fraction of pixels, within half the pitch, that are nearer to their grey level."""
    slopes = _slopes(_board_to_picture(points, centres), points, pitch_m)
    shares, half_m = [], 0.5 * pitch_m
    for centre, slope in zip(centres, slopes, strict=True):
        _, places, pixels = _around(image, centre, slope, half_m)
        distance_m = np.linalg.norm(places, axis=1)
        inside = pixels[distance_m < half_m]
        if len(inside) >= DetectionSettings.core_pixels:
            core = pixels[np.argmin(distance_m)]
            low, high = np.percentile(inside, (5.0, 95.0))
            shares.append(np.mean(np.abs(inside - core) < (high - low) / 2.0))
    return half_m * float(np.sqrt(np.median(shares))) if shares else 0.25 * pitch_m


def _around(image: np.ndarray, centre: np.ndarray, slope: np.ndarray, reach_m: float) -> tuple[np.ndarray, ...]:
    """Pixels around a centre, at least those within `reach_m`: offsets (P, 2) in px and in m, grey levels (P,)."""
    half = reach_m * np.linalg.norm(slope, axis=1)
    low = np.maximum(np.floor(centre - half).astype(int), 0)
    high = np.maximum(np.minimum(np.ceil(centre + half).astype(int) + 1, image.shape[::-1]), low)
    v, u = np.mgrid[low[1] : high[1], low[0] : high[0]]
    offsets = np.stack([u.ravel(), v.ravel()], axis=1) - centre
    return offsets, offsets @ np.linalg.pinv(slope).T, image[low[1] : high[1], low[0] : high[0]].ravel().astype(float)


@dataclass(frozen=True, eq=False)
class _Area:
    """Area of a circle in the picture, with its centroid and blur.

    centre : (2,) px. px2 : size. blur_px : standard deviation of its edge.
    variances : (2,) of the noise within and around it, grey levels squared.
    by_grey : (2, P) derivatives of the centre by the grey levels. share : (P,) each level between the circle's (0) and
        that around it (1).
    """

    centre: np.ndarray
    px2: float
    blur_px: float
    variances: tuple[float, float]
    by_grey: np.ndarray
    share: np.ndarray

    def covariance(self, within: float, around: float) -> np.ndarray:
        return np.asarray((self.by_grey * (within + self.share * (around - within))) @ self.by_grey.T)


def _area(
    image: np.ndarray, centre: np.ndarray, slope: np.ndarray, circle: tuple[float, float], blur_px: float
) -> _Area | None:
    """The area of the circle near `centre`; None if it is too small, or cut by the picture's border.

    circle : its radius and the circles' pitch, m. blur_px : standard deviation of its edge's blur.
    Grey levels are used only near the edge: pixels further inside count as covered, those further outside as not.
    """
    radius_m, pitch_m = circle
    gap_m = pitch_m - 2.0 * radius_m
    inner_m, outer_m = radius_m + DetectionSettings.area_reach * gap_m, radius_m + DetectionSettings.ring_reach * gap_m
    offsets, places, grey = _around(image, centre, slope, outer_m)
    distance_m = np.linalg.norm(places, axis=1)
    half = outer_m * np.linalg.norm(slope, axis=1)
    if ((centre - half < -0.5) | (centre + half > np.array(image.shape[::-1]) - 0.5)).any():
        return None
    inside, core = distance_m < inner_m, distance_m < DetectionSettings.core * radius_m
    ring = ~inside & (distance_m < outer_m)
    if min(core.sum(), ring.sum()) < DetectionSettings.core_pixels:
        return None
    per_px = np.linalg.norm(places @ np.linalg.pinv(slope), axis=1) / np.maximum(distance_m, 1e-12)
    beyond_px = (distance_m - radius_m) / np.maximum(per_px, 1e-12)
    reach_px = DetectionSettings.edge_blurs * blur_px + 1.0
    covered, edge = beyond_px < -reach_px, inside & (np.abs(beyond_px) <= reach_px)
    design = np.column_stack([np.ones(len(offsets)), offsets])
    by_ring = np.linalg.pinv(design[ring])
    depth = design @ (by_ring @ grey[ring]) - grey
    contrast = float(depth[core].mean())
    weight = np.where(covered, contrast, np.where(edge, depth, 0.0))
    total = float(weight.sum())
    if not total * contrast > 0.0 or abs(contrast) < 1.0:
        return None
    moment = weight @ offsets / total
    # derivative of Σ weight · (offset − moment) / total = 0
    arm = (offsets[edge] - moment).T / total
    by_grey = np.zeros((2, len(offsets)))
    by_grey[:, edge] = -arm
    by_grey[:, ring] += (arm @ design[edge]) @ by_ring
    variances = float(grey[core].var()), float((depth[ring] ** 2).sum() / (ring.sum() - 3))
    share = 1.0 - depth / contrast
    # over an edge with a Gaussian blur share · (1 − share) sums up to σ/√π
    between = float((share[inside] * (1.0 - share[inside])).sum() + inside.sum() * np.mean(variances) / contrast**2)
    around_px = 2.0 * np.pi * radius_m * np.linalg.norm(slope) / np.sqrt(2.0)
    blur_px = np.sqrt(np.pi) * max(between, 0.0) / around_px
    return _Area(centre + moment, total / contrast, blur_px, variances, by_grey, np.clip(share, 0.0, 1.0))
