"""What a picture's centreline is worth, by the truth that it was drawn from; and the bound that no method beats."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..detect.centreline import Centreline
from ..detect.corridor import Corridor
from .vision_paths import aside_px, normals
from .vision_scenes import Shot, Truth, light, variance

FALSE_PX, FALSE_SIGMA = 0.5, 5.0
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

    Attributes
    ----------
    errors_px, sigma_px : (N,) signed distance of the points across the antenna, their deviations.
    false : (N,) whether a point is false.
    kept : share of the visible antenna that has a point within 2 px along it.
    """

    errors_px: np.ndarray
    sigma_px: np.ndarray
    false: np.ndarray
    kept: float


def score(line: Centreline, truth: Truth) -> Score:
    """Judge points by the nearest place of the true path; where the antenna is hidden any point is false."""
    errors, nearest = aside_px(truth.path_px, line.points_px)
    false = (np.abs(errors) > FALSE_PX) & (np.abs(errors) > FALSE_SIGMA * line.sigma_px)
    place = np.arange(len(truth.path_px))
    if len(nearest) and truth.visible.any():
        # points a hair inside what hides the antenna still show it: the picture is blurred
        shown = np.convolve(truth.visible, np.ones(9), mode="same") > 0
        false |= ~shown[nearest]
        gap = np.abs(place[truth.visible][:, None] - np.sort(nearest)[None]).min(axis=1)
        kept = float((gap <= 5).mean())
    else:
        kept = 0.0
    return Score(errors, line.sigma_px, false, kept)


def bound_px(shot: Shot, points_px: np.ndarray, step_px: float = 0.05) -> np.ndarray:
    """(N,) Cramér–Rao bound of the place across the antenna, for one column (or row) of pixels each.

    Unknown besides the place: level and slope of the background, the line's height. Noise of known variance.
    """
    assert shot.bend is not None
    from .vision_scenes import truth

    path = truth(shot).path_px
    _, nearest = aside_px(path, points_px)
    normal = normals(path)[nearest]
    whole = light(shot)
    by_place = (light(shot, step_px) - light(shot, -step_px)) / (2.0 * step_px)
    by_height = whole - light(shot, antenna=False)
    weight = 1.0 / np.sqrt(variance(shot, whole))
    reach = int(np.ceil(0.8 * shot.width_px + 5.0))
    bounds = np.empty(len(points_px))
    for index, (point, across) in enumerate(zip(points_px, normal, strict=True)):
        sideways = abs(across[1]) >= abs(across[0])
        line, middle = (round(point[0]), round(point[1])) if sideways else (round(point[1]), round(point[0]))
        cut = slice(max(middle - reach, 0), middle + reach + 1)
        here = (cut, line) if sideways else (line, cut)
        t = np.arange(len(whole[here])) / reach
        nuisance = np.stack([np.ones_like(t), t, by_height[here]], axis=1) * weight[here][:, None]
        signal = by_place[here] * weight[here]
        rest = signal - nuisance @ np.linalg.lstsq(nuisance, signal, rcond=None)[0]
        bounds[index] = 1.0 / np.sqrt(max(float(rest @ rest), 1e-12))
    return bounds
