"""Polylines in a plane: arc lengths, even spacing, normals, and how points lie relative to them; in any unit."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vbaa_calib.native import core


def arc_lengths(polyline: np.ndarray) -> np.ndarray:
    """(K,) arc lengths of the points of a polyline (K, D), from its start."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(polyline, axis=0), axis=1))])


def resample(polyline: np.ndarray, spacing: float) -> tuple[np.ndarray, np.ndarray]:
    """Points (K, 2) at equal spacing along a polyline, short of its end, and the arc length (K,) of each."""
    return core.search.resample(polyline, spacing)


def normals(polyline: np.ndarray) -> np.ndarray:
    """(K, 2) unit normals of a polyline, K ≥ 2, with smooth directions."""
    return core.search.normals(polyline)


def offsets_from(polyline: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Index (N,) of the nearest point of a finely spaced polyline (K, 2) to points (N, 2), and the distance from it
    along the normal."""
    return core.search.nearest_on(polyline, points)


def followed(path_px: np.ndarray, image_size: Sequence[int]) -> np.ndarray:
    """The part (M, 2) of a path (K, 2) that an antenna can take in or near a picture (width, height).

    Whatever proposes a path — a fit, a contact, a rig — may be wrong, and arrays are as long as the path: it begins
    where it is first no farther from the picture than width and height together, and ends where it is again, where it
    is not finite, and where it has become longer than once around all that, for no antenna winds up.
    """
    half = 0.5 * np.asarray(image_size, float)
    room = 2.0 * half.sum()
    near = (np.abs(path_px - half) <= half + room).all(axis=1)
    if not near.all():
        path_px, near = path_px[int(near.argmax()) :], near[int(near.argmax()) :]
        path_px = path_px if near.all() else path_px[: int(near.argmin())]
    if len(path_px) < 2:
        return path_px
    short = np.hypot(*np.diff(path_px, axis=0).T).cumsum() <= 10.0 * room
    return path_px if short[-1] else path_px[: 1 + int(short.argmin())]
