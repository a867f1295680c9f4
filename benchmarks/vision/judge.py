"""What others use to find a thin line in a picture: thinning, Steger's ridges, the centroid of every column."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from vbaa_calib.detect.whisker.centreline import Centreline
from vbaa_calib.detect.whisker.corridor import Corridor

from .scenes import Shot, Truth, aside_px, light, normals, truth, variance

FALSE_PX, _FALSE_SIGMA = 0.5, 5.0
"""A point is false when it is off by more than both of these: pixels, and its own standard deviations."""


def corridor(shot: Shot, rng: np.random.Generator) -> Corridor:
    """What a rig would know about where the antenna is: its free axis, a pixel or two and a degree off."""
    width, height = shot.size
    bend = shot.bend
    clamp = np.array(bend.clamp_px if bend else (0.07 * width, 0.5 * height)) + rng.normal(0.0, 0.7, 2)
    length = (bend.length_px if bend else 0.78 * width) * rng.uniform(0.985, 1.015)
    angle = (bend.heading_rad if bend else rng.uniform(-0.1, 0.1)) + rng.normal(0.0, 0.008)
    along = np.linspace(0.0, length, 60)
    axis = clamp + along[:, None] * np.array([np.cos(angle), np.sin(angle)])
    return Corridor(axis, 8.0 + 0.9 * along, shot.width_px * rng.uniform(0.95, 1.05))


def usual_height(shot: Shot, rng: np.random.Generator) -> float:
    """What a rig would know from its no-load pictures of the line's height, grey levels: right to a sixth."""
    seen = shot.width_px / np.hypot(shot.width_px, 2.4 * shot.spec.blur_px)
    return float(255.0 * seen * (0.88 * shot.spec.antenna - shot.spec.background) * rng.uniform(0.85, 1.15))


@dataclass(frozen=True)
class Score:
    """One picture's centreline against the truth.

    errors_px, sigma_px : (N,) signed distance of the points across the antenna, their deviations.
    false : (N,) whether a point is false.
    kept : share of the visible antenna that has a point within 2 px along it.
    """

    errors_px: np.ndarray
    sigma_px: np.ndarray
    false: np.ndarray
    kept: float


def score(line: Centreline, true: Truth) -> Score:
    """Judge points by the nearest place of the true path; where the antenna is hidden any point is false."""
    errors, nearest = aside_px(true.path_px, line.points_px)
    false = (np.abs(errors) > FALSE_PX) & (np.abs(errors) > _FALSE_SIGMA * line.sigma_px)
    place = np.arange(len(true.path_px))
    if len(nearest) and true.visible.any():
        # points a hair inside what hides the antenna still show it: the picture is blurred
        shown = np.convolve(true.visible, np.ones(9), mode="same") > 0
        false |= ~shown[nearest]
        gap = np.abs(place[true.visible][:, None] - np.sort(nearest)[None]).min(axis=1)
        kept = float((gap <= 5).mean())
    else:
        kept = 0.0
    return Score(errors, line.sigma_px, false, kept)


def bound_px(shot: Shot, points_px: np.ndarray, step_px: float = 0.05) -> np.ndarray:
    """(N,) Cramér–Rao bound of the place across the antenna, for one column (or row) of pixels each.

    Unknown besides the place: level and slope of the background, the line's height. Noise of known variance.
    """
    path = truth(shot).path_px
    normal = normals(path)[aside_px(path, points_px)[1]]
    whole = light(shot)
    images = (
        (light(shot, step_px) - light(shot, -step_px)) / (2.0 * step_px),
        whole - light(shot, antenna=False),
        variance(shot.spec, whole),
    )
    reach, bounds = int(np.ceil(0.8 * shot.width_px + 5.0)), np.empty(len(points_px))
    upright = np.abs(normal[:, 1]) >= np.abs(normal[:, 0])
    for own, axes, along in ((upright, images, points_px), (~upright, [i.T for i in images], points_px[:, ::-1])):
        known = information(axes, np.rint(along[own, 0]).astype(int), along[own, 1], reach)
        bounds[own] = 1.0 / np.sqrt(np.maximum(known, 1e-12))
    return bounds


def information(images: Sequence[np.ndarray], column: np.ndarray, row: np.ndarray, reach: int) -> np.ndarray:
    """(C,) inverse variance, px⁻², of a line's place across it, by the pixels up to `reach` from (column, row), (C,).

    images : (H, W) change of the light with the place, the line alone, and the noise's variance. Free in every column
    are level and slope of the background and the line's height.
    """
    by_place, line, noise = images
    beside = np.arange(-reach, reach + 1)
    rows = np.rint(row).astype(int)[:, None] + beside
    there = (rows >= 0) & (rows < len(line))
    at = np.clip(rows, 0, len(line) - 1), column[:, None]
    weight = there / np.sqrt(noise[at])
    aside = np.broadcast_to(beside / reach, weight.shape)
    unknown = np.stack([np.ones_like(weight), aside, line[at]], axis=-1) * weight[..., None]
    signal = by_place[at] * weight
    normal = np.linalg.pinv(np.einsum("ctk,ctl->ckl", unknown, unknown), hermitian=True)
    taken_up = np.einsum("ckl,ctl,ct->ck", normal, unknown, signal)
    return ((signal - np.einsum("ctk,ck->ct", unknown, taken_up)) ** 2).sum(axis=1)


Peer = Callable[[np.ndarray], np.ndarray]
"""(H, W) uint8 picture of a bright antenna → points (N, 2), px."""


def within(corridor: Corridor, size: tuple[int, int]) -> np.ndarray:
    """(H, W) uint8 mask of a corridor: peers get the same knowledge of where to look; it is no part of their time."""
    across = np.gradient(corridor.axis_px, axis=0)[:, ::-1] * [-1.0, 1.0]
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    sides = [corridor.axis_px + sign * corridor.reach_px[:, None] * across for sign in (1, -1)]
    outline = np.concatenate([sides[0], sides[1][::-1]])
    mask = np.zeros(size[::-1], np.uint8)
    cv2.fillPoly(mask, [np.round(outline).astype(np.int32)], 255)
    return mask


def peers(corridor: Corridor, size: tuple[int, int]) -> dict[str, Peer]:
    """Name → method, prepared for one corridor."""
    mask = within(corridor, size)
    return {
        "cv2.ximgproc.thinning": lambda image: thinned(image, mask),
        "Steger, scikit-image": lambda image: steger(image, mask > 0, corridor.width_px, bright=True),
        "centroid per column": lambda image: _centroids(image, mask),
    }


def _centroids(image: np.ndarray, mask: np.ndarray) -> np.ndarray:
    ground = cv2.mean(image, mask)[0]
    lit = np.where(_otsu(image, mask) > 0, image.astype(np.float32) - np.float32(ground), np.float32(0.0))
    total = lit.sum(axis=0)
    columns = np.flatnonzero(total > 0)
    rows = (np.arange(len(lit), dtype=np.float32) @ lit)[columns] / total[columns]
    return np.stack([columns, rows], axis=1).astype(float)


def _otsu(image: np.ndarray, mask: np.ndarray) -> np.ndarray:
    return cv2.bitwise_and(cv2.threshold(image, 0, 255, cv2.THRESH_BINARY | cv2.THRESH_OTSU)[1], mask)


def thinned(image: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Points (N, 2) px of the skeleton of what is bright, by Otsu's threshold."""
    rows, columns = np.nonzero(cv2.ximgproc.thinning(_otsu(image, mask)))
    return np.stack([columns, rows], axis=1).astype(float)


def steger(image: np.ndarray, mask: np.ndarray, width_px: float, bright: bool | None) -> np.ndarray:
    """Points (N, 2) px on ridges (`bright` None: and valleys) of an (H, W) picture by Steger (1998), by scikit-image.

    Where the second derivative across the line is largest, the picture's parabola has its top or bottom within the
    pixel: scale w / (2 √3) for a line of width w, the response cut by Otsu's threshold within the mask.
    """
    from skimage.feature import hessian_matrix
    from skimage.filters import gaussian, threshold_otsu

    sigma = max(width_px / (2.0 * np.sqrt(3.0)), 0.8)
    grey = image.astype(float)
    rr, rc, cc = hessian_matrix(grey, sigma, use_gaussian_derivatives=True)
    slope_r, slope_c = np.gradient(gaussian(grey, sigma, preserve_range=True))
    half, mean = np.hypot(0.5 * (cc - rr), rc), 0.5 * (cc + rr)
    curvature = np.where(mean < 0, mean - half, mean + half)
    # eigenvector of the curvature that is larger by amount
    angle = 0.5 * np.arctan2(2.0 * rc, cc - rr) + np.where(mean < 0, 0.5 * np.pi, 0.0)
    across_c, across_r = np.cos(angle), np.sin(angle)
    step = -(slope_c * across_c + slope_r * across_r) / np.where(np.abs(curvature) > 1e-9, curvature, np.inf)
    strength = np.abs(curvature) if bright is None else np.maximum(-curvature, 0.0)
    on = mask & (np.abs(step * across_c) <= 0.5) & (np.abs(step * across_r) <= 0.5)
    on &= strength > (threshold_otsu(strength[mask]) if mask.any() else np.inf)
    rows, columns = np.nonzero(on)
    return np.stack([columns + (step * across_c)[on], rows + (step * across_r)[on]], axis=1)
