"""A sensor that is not square to the axis: OpenCV's two tilt angles, inverted in closed form.

With R = Ry(τ_y) Rx(τ_x) and (a, b, w) = R (x, y, 1), the tilted point is (R22 a/w − R02, R22 b/w − R12).
"""

from __future__ import annotations

import math
from types import ModuleType

import numpy as np
import torch

from ..arrays import Array, matrix, namespace

Angles = tuple[Array, Array]


def _sin_cos(angle: Array) -> tuple[Array, Array]:
    if isinstance(angle, torch.Tensor):
        return torch.sin(angle), torch.cos(angle)
    return math.sin(angle), math.cos(angle)


def apply_tilt(x: Array, y: Array, angles: Angles) -> tuple[Array, Array, Array]:
    """Onto the tilted sensor: (x, y) → (x, y, whether the point is in front of it)."""
    (sx, cx), (sy, cy) = map(_sin_cos, angles)
    a, b, w = cy * x + sy * sx * y - sy * cx, cx * y + sx, sy * x - cy * sx * y + cy * cx
    front = w > 0
    w = namespace(w).where(front, w, 1.0)
    return cy * cx * (a / w) + sy * cx, cy * cx * (b / w) - sx, front


def remove_tilt(x: Array, y: Array, angles: Angles) -> tuple[Array, Array, Array]:
    """From the tilted sensor back: the inverse of apply_tilt."""
    (sx, cx), (sy, cy) = map(_sin_cos, angles)
    a, b = (x - sy * cx) / (cy * cx), (y + sx) / (cy * cx)
    m0, m1, m2 = cy * a + sy, sy * sx * a + cx * b - cy * sx, -sy * cx * a + sx * b + cy * cx
    front = m2 > 0
    m2 = namespace(m2).where(front, m2, 1.0)
    return m0 / m2, m1 / m2, front


def _rotation(angles: Angles) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """R and its derivatives by τ_x and by τ_y, each (3, 3)."""
    (sx, cx), (sy, cy) = map(_sin_cos, angles)
    rotation = np.array([[cy, sy * sx, -sy * cx], [0.0, cx, sx], [sy, -cy * sx, cy * cx]])
    by_x = np.array([[0.0, sy * cx, sy * sx], [0.0, -sx, cx], [0.0, -cy * cx, -cy * sx]])
    by_y = np.array([[-sy, cy * sx, -cy * cx], [0.0, 0.0, 0.0], [cy, sy * sx, -sy * cx]])
    return rotation, by_x, by_y


def remove_tilt_jacobians(xp: ModuleType, x: Array, y: Array, angles: tuple[float, float]) -> tuple[Array, Array]:
    """d(remove_tilt)/d(x, y) and d(remove_tilt)/d(τ_x, τ_y), each (..., 2, 2), at tilted points (x, y)."""
    rotation, *by_angle = _rotation(angles)
    R = rotation.tolist()
    a, b = (x + R[0][2]) / R[2][2], (y + R[1][2]) / R[2][2]
    m = [R[0][i] * a + R[1][i] * b + R[2][i] for i in range(3)]
    ideal = m[0] / m[2], m[1] / m[2]

    def column(dm: list[Array]) -> tuple[Array, Array]:
        return (dm[0] - ideal[0] * dm[2]) / m[2], (dm[1] - ideal[1] * dm[2]) / m[2]

    def by_tilt(D: list[list[float]]) -> tuple[Array, Array]:
        da, db = (D[0][2] - a * D[2][2]) / R[2][2], (D[1][2] - b * D[2][2]) / R[2][2]
        moved = [R[0][i] * da + R[1][i] * db + D[0][i] * a + D[1][i] * b + D[2][i] for i in range(3)]
        return column(moved)

    by_point = [column([R[row][i] / R[2][2] for i in range(3)]) for row in range(2)]
    by_angles = [by_tilt(derivative.tolist()) for derivative in by_angle]
    return tuple(matrix(xp, [[c[k] for c in columns] for k in range(2)]) for columns in (by_point, by_angles))
