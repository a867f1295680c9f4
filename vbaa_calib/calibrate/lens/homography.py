"""Homographies of a flat board to its picture, of which less than half of the corners may be wrong, compiled."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.spatial.transform import Rotation

from vbaa_calib.core.compiled import kernel

_SEED, _SAMPLES, _LEAST_SIZE = 0, 64, 1e-300
_BELOW_MEDIAN, _RAYLEIGH_MEDIAN = 5.0 / 1.1774, 1.1774
_LEAST_CORNERS = 4
"""They fix a homography."""
_AWAY = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1.0])


@lru_cache(maxsize=256)
def _picks(count: int) -> np.ndarray:
    """(S, 4) samples of four out of so many."""
    return np.ascontiguousarray(
        np.random.default_rng(_SEED).random((_SAMPLES, count)).argsort(axis=1)[:, :_LEAST_CORNERS]
    )


def homography(points: np.ndarray, image: np.ndarray, division: float = 0.0) -> tuple[np.ndarray, float] | None:
    """(3, 3) of points (N, 2) to their image (N, 2), and the noise per axis as the median corner has it; or None.

    Least median of squares (Rousseeuw 1984), then least squares of the points that it fits. OpenCV's finds none on
    small boards: most of its samples have three points on a line, and it gives up.

    division : λ of the undistortion x / (1 + λr²) of the image, about its origin; the noise is the distorted image's.
    """
    known = np.isfinite(image).all(axis=1)
    if known.sum() < _LEAST_CORNERS:
        return None
    if not known.all():
        points, image = points[known], image[known]
    found, noise = _fitted(np.ascontiguousarray(points), image, _picks(len(points)), division)
    return (found, noise) if np.isfinite(noise) else None


def board_poses(homographies: list[np.ndarray | None]) -> np.ndarray:
    """(V, 6) rotation vectors and translations of a board's plane, from its homographies (3, 3) to ideal image
    coordinates; ahead of the camera where there is none."""
    poses = np.tile(_AWAY, (len(homographies), 1))
    known = [view for view, found in enumerate(homographies) if found is not None]
    if known:
        every = np.array([homographies[view] for view in known])
        lengths = np.linalg.norm(every[:, :, :2], axis=1).sum(axis=1)
        every *= np.copysign(2.0 / np.maximum(lengths, _LEAST_SIZE), every[:, 2, 2])[:, None, None]
        axes = np.stack([every[:, :, 0], every[:, :, 1], np.cross(every[:, :, 0], every[:, :, 1])], axis=2)
        vectors, _, others = np.linalg.svd(axes)
        vectors[:, :, 2] *= np.linalg.det(vectors @ others)[:, None]
        poses[known] = np.hstack([Rotation.from_matrix(vectors @ others).as_rotvec(), every[:, :, 2]])
    return poses


@kernel
def _fitted(points: np.ndarray, image: np.ndarray, picks: np.ndarray, division: float) -> tuple[np.ndarray, float]:
    """As `homography`; noise NaN where there is none."""
    count, stretch, ideal = len(points), np.empty(len(points)), np.empty_like(image)
    for n in range(count):
        stretch[n] = 1.0 + division * (image[n, 0] ** 2 + image[n, 1] ** 2)
        ideal[n, 0], ideal[n, 1] = image[n, 0] / stretch[n], image[n, 1] / stretch[n]
    (board, by_board), (ideal, by_ideal) = _normalised(points), _normalised(ideal)
    best, distances = _least_median(board, ideal, picks), np.empty(count)
    for _ in range(2):
        for n in range(count):
            distances[n] = _distance(best, board[n], ideal[n])
        if not np.isfinite(distances.sum()):
            return best, np.nan
        limit = -1.0
        for _ in range(_LEAST_CORNERS):
            nearest = np.inf
            for distance in distances:
                if limit < distance < nearest:
                    nearest = distance
            limit = nearest
        best = _least_squares(board, ideal, distances, max(_BELOW_MEDIAN * np.median(distances), limit))
    for n in range(count):
        distances[n] = _distance(best, board[n], ideal[n]) * abs(stretch[n])
    scale = by_ideal[0, 0]
    # its adjugate is the inverse times the square of the scale
    whole = _product(_product(_adjugate(by_ideal), best), by_board) / scale**2
    return whole, np.median(distances) / (_RAYLEIGH_MEDIAN * scale)


@kernel
def _normalised(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points (N, 2) about their mean, by their size (Hartley); and (3, 3) what makes them that."""
    x, y, square, count = 0.0, 0.0, 0.0, len(points)
    for n in range(count):
        x, y = x + points[n, 0] / count, y + points[n, 1] / count
    for n in range(count):
        square += (points[n, 0] - x) ** 2 + (points[n, 1] - y) ** 2
    scale, moved = 1.0 / max(np.sqrt(0.5 * square / count), _LEAST_SIZE), np.empty((count, 2))
    for n in range(count):
        moved[n, 0], moved[n, 1] = scale * (points[n, 0] - x), scale * (points[n, 1] - y)
    return moved, np.array([[scale, 0.0, -scale * x], [0.0, scale, -scale * y], [0.0, 0.0, 1.0]])


@kernel
def _least_median(points: np.ndarray, image: np.ndarray, picks: np.ndarray) -> np.ndarray:
    """(3, 3) that fits half of the points (N, 2) best, of those through four of them, picks (S, 4)."""
    count = len(points)
    best, least, distances = np.full((3, 3), np.nan), np.inf, np.empty(count)
    for pick in picks:
        # adjugates: a sample with three points on a line gives a singular matrix, which fits nothing
        trial = _product(_basis(image, pick), _adjugate(_basis(points, pick)))
        worse = 0
        for n in range(count):
            distances[n] = _distance(trial, points[n], image[n])
            if not distances[n] < least:
                worse += 1
                if 2 * worse > count + 1:
                    break
        if 2 * worse <= count + 1:
            median = np.median(distances)
            if median < least:
                best, least = trial, median
    return best


@kernel
def _basis(points: np.ndarray, pick: np.ndarray) -> np.ndarray:
    """(3, 3) the homography that takes a projective basis to four points (N, 2)."""
    found = np.empty((3, 3))
    u, v = points[pick[3]]
    for i in range(3):
        (x, y), (a, b), (c, d) = points[pick[i]], points[pick[(i + 1) % 3]], points[pick[(i + 2) % 3]]
        weight = u * (b - d) + v * (c - a) + (a * d - b * c)
        found[0, i], found[1, i], found[2, i] = weight * x, weight * y, weight
    return found


@kernel
def _adjugate(m: np.ndarray) -> np.ndarray:
    found = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            a, b, c, d = (i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3
            found[j, i] = m[a, c] * m[b, d] - m[a, d] * m[b, c]
    return found


@kernel
def _product(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Of two (3, 3)."""
    found = np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            for k in range(3):
                found[i, k] += first[i, j] * second[j, k]
    return found


@kernel
def _distance(h: np.ndarray, point: np.ndarray, image: np.ndarray) -> float:
    """Of the image of a point under a homography from where it is."""
    x, y = point
    w = h[2, 0] * x + h[2, 1] * y + h[2, 2]
    off_x, off_y = (h[0, 0] * x + h[0, 1] * y + h[0, 2]) / w, (h[1, 0] * x + h[1, 1] * y + h[1, 2]) / w
    return float(np.sqrt((off_x - image[0]) ** 2 + (off_y - image[1]) ** 2))


@kernel
def _least_squares(points: np.ndarray, image: np.ndarray, distances: np.ndarray, limit: float) -> np.ndarray:
    """(3, 3) of least algebraic error over the points (N, 2) within the limit."""
    scatter, row = np.zeros((9, 9)), np.empty(9)
    for n in range(len(points)):
        if distances[n] <= limit:
            x, y = points[n]
            for axis in range(2):
                row[:] = 0.0
                row[3 * axis], row[3 * axis + 1], row[3 * axis + 2] = x, y, 1.0
                row[6], row[7], row[8] = -image[n, axis] * x, -image[n, axis] * y, -image[n, axis]
                for i in range(9):
                    for j in range(9):
                        scatter[i, j] += row[i] * row[j]
    return np.linalg.eigh(scatter)[1][:, 0].copy().reshape(3, 3)
