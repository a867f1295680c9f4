"""The shapes that the antenna can take in the picture: cantilevers bent out of the free axis, sampled and tabled."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .corridor import Corridor, length_px, normals, resample

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
    axis, _ = resample(corridor.axis_px, max(length_px(corridor.axis_px) / SAMPLES, 1e-3))
    length = length_px(axis)
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
