"""Vectors in kernels: tuples of three numbers, which stay in registers."""

from __future__ import annotations

import numpy as np

from vbaa_calib.core.compiled import kernel

Vector = tuple[float, float, float]


@kernel
def vector(values: np.ndarray) -> Vector:
    """Of (3,)."""
    return values[0], values[1], values[2]


@kernel
def scaled(factor: float, a: Vector) -> Vector:
    """factor · a."""
    return factor * a[0], factor * a[1], factor * a[2]


@kernel
def moved(a: Vector, factor: float, b: Vector) -> Vector:
    """a + factor · b."""
    return a[0] + factor * b[0], a[1] + factor * b[1], a[2] + factor * b[2]


@kernel
def dot(a: Vector, b: Vector) -> float:
    """a · b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel
def cross(a: Vector, b: Vector) -> Vector:
    """a × b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@kernel
def turned(rotation: np.ndarray, a: Vector) -> Vector:
    """rotation (3, 3) · a."""
    return dot(vector(rotation[0]), a), dot(vector(rotation[1]), a), dot(vector(rotation[2]), a)


@kernel
def turned_back(rotation: np.ndarray, a: Vector) -> Vector:
    """Its transpose · a."""
    first, second = scaled(a[0], vector(rotation[0])), scaled(a[1], vector(rotation[1]))
    return moved(moved(first, 1.0, second), a[2], vector(rotation[2]))


@kernel
def unit(a: Vector) -> Vector:
    """a of length 1."""
    return scaled(1.0 / np.sqrt(dot(a, a)), a)
