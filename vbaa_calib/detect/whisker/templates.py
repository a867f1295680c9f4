"""The shapes that the antenna can take in the picture: cantilevers bent out of the free axis, sampled and tabled."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from vbaa_calib.core.polyline import arc_lengths, normals, resample

from .corridor import Corridor

SAMPLES = 72
"""Samples along a template."""
CONTACTS = (0.12, 0.3, 0.5, 0.7, 0.85, 1.0, 1.8)
"""Where the bending force acts, as fractions of the length; beyond one the bend is nearly an arc."""
LARGEST_TURN_RAD = 1.75
"""Most that the antenna's direction changes from clamp to tip."""
STEPS = np.array([[0, 1], [1, 1], [1, 0], [1, -1]])
"""(4, 2) steps (u, v) along the normals that ridges are looked for in."""


@dataclass(frozen=True, eq=False)
class Templates:
    """Paths that an antenna may take.

    Attributes
    ----------
    paths_px : (P, S, 2) pixels, from clamp to tip.
    direction : (P, S) which of `STEPS` is nearest to the path's normal.
    spacing_px : how far neighbouring paths' tips are apart.
    """

    paths_px: np.ndarray
    direction: np.ndarray
    spacing_px: float


def templates(corridor: Corridor) -> Templates:
    """Every path in a corridor, close enough together that the antenna is within `spacing_px` of one of them."""
    axis, _ = resample(corridor.axis_px, max(arc_lengths(corridor.axis_px)[-1] / SAMPLES, 1e-3))
    length = arc_lengths(axis)[-1]
    step = length / (len(axis) - 1)
    tangent = np.gradient(axis, axis=0)
    heading = np.unwrap(np.arctan2(tangent[:, 1], tangent[:, 0]))
    share = np.linspace(0.0, 1.0, len(axis))
    spacing = max(0.9 * step, 3.0)
    bent = []
    for contact in CONTACTS:
        reach = share / contact
        shape = np.where(reach < 1.0, reach * (2.0 - reach), 1.0)
        shape /= shape[-1]
        turn = np.arange(0.0, LARGEST_TURN_RAD, spacing / (length * shape.mean()))
        turns = np.concatenate([-turn[:0:-1], turn])
        angle = heading[None] + turns[:, None] * shape[None]
        steps = step * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        steps = 0.5 * (steps[:, :-1] + steps[:, 1:])
        bent.append(axis[0] + np.concatenate([np.zeros((len(turns), 1, 2)), np.cumsum(steps, axis=1)], axis=1))
    paths = np.concatenate(bent)
    paths = paths[_within(paths, corridor)]
    return Templates(paths, _directions(paths), spacing)


def _within(paths: np.ndarray, corridor: Corridor) -> np.ndarray:
    """(P,) whether a path's tip is no farther from the axis' tip than the corridor reaches there."""
    tip = corridor.axis_px[-1]
    across = normals(corridor.axis_px)[-1]
    along = np.array([across[1], -across[0]])
    offset = paths[:, -1] - tip
    return np.abs(offset @ across) <= corridor.reach_px[-1] + np.maximum(0.0, offset @ along)


def _directions(paths: np.ndarray) -> np.ndarray:
    along = np.gradient(paths, axis=1)
    unit = STEPS / np.linalg.norm(STEPS, axis=1, keepdims=True)
    across = np.stack([-along[..., 1], along[..., 0]], axis=-1)
    return np.abs(across @ unit.T).argmax(axis=-1).astype(np.uint8)


TEXTURE_QUANTILE = 0.8
"""Quantile of the response that counts as the surroundings' own texture."""


def downsampled(image: np.ndarray, factor: int) -> np.ndarray:
    """(h, w) uint8: blocks of `factor` pixels averaged; other depths than 8 bits are stretched to the full range."""
    height, width = image.shape
    size = (max(width // factor, 1), max(height // factor, 1))
    cropped = image[: size[1] * factor, : size[0] * factor] if min(size) > 1 else image
    small = cv2.resize(cropped, size, interpolation=cv2.INTER_AREA)
    if small.dtype == np.uint8:
        return small
    values = np.nan_to_num(np.asarray(small, np.float32), nan=0.0, posinf=0.0, neginf=0.0)
    low, high = float(values.min()), float(values.max())
    return cv2.convertScaleAbs(values - low, alpha=255.0 / max(high - low, 1e-6))


def ridge_responses(small: np.ndarray, reach: int, pool: int, bright: bool | None = True) -> np.ndarray:
    """(4 · h · w + 1,) uint8 ridge response for the four normals, pooled over `pool` pixels, flat; the last is zero.

    small (H, W) uint8; the line is `bright`er than both flanks, `reach` pixels away, or darker, or, with None, either.
    The answer saturates where a ridge is clear, so that a brighter one buys no detour.
    """
    small = 255 - small if bright is False else small
    height, width = small.shape
    framed = cv2.copyMakeBorder(small, reach, reach, reach, reach, cv2.BORDER_REPLICATE)
    diagonal = int(np.ceil(reach / np.sqrt(2.0)))
    square = np.ones((2 * pool - 1, 2 * pool - 1), np.uint8)
    shape = (-(-height // pool), -(-width // pool))
    flat = np.zeros(len(STEPS) * shape[0] * shape[1] + 1, np.uint8)
    layers = flat[:-1].reshape(len(STEPS), *shape)
    for step, layer in zip(STEPS.tolist(), layers, strict=True):
        far = diagonal if step[0] and step[1] else reach
        u, v = far * step[0], far * step[1]
        flanks = [
            framed[reach + s * v : reach + s * v + height, reach + s * u : reach + s * u + width] for s in (-1, 1)
        ]
        ridge = cv2.subtract(small, cv2.max(*flanks))
        if bright is None:
            ridge = cv2.max(ridge, cv2.subtract(cv2.min(*flanks), small))
        layer[:] = (cv2.dilate(ridge, square) if pool > 1 else ridge)[::pool, ::pool]
    return cv2.LUT(flat, _saturation(flat)).ravel()


def _saturation(flat: np.ndarray) -> np.ndarray:
    """(256,) lookup table of responses: none for the texture that is everywhere, level at a few times that."""
    counts = np.bincount(flat[:: 1 + len(flat) // 20_000], minlength=256).cumsum()
    ordinary = float(np.searchsorted(counts, TEXTURE_QUANTILE * counts[-1])) + 1.0
    over = np.maximum(np.arange(256.0) - ordinary, 0.0)
    return np.rint(250.0 * over / (over + 3.0 * ordinary)).astype(np.uint8)
