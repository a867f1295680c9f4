"""The antenna in the ideal picture, the plane one unit before the camera."""

from __future__ import annotations

from vbaa_calib.arrays import Array, namespace

from .known import Known

NEAREST_DEPTH_M = 1e-4
"""Nodes nearer to the camera's plane than this, or behind it, are taken to lie there: their picture is far off."""


def project(known: Known, points_m: Array, pose: int = 0) -> tuple[Array, Array, Array]:
    """Ideal image u, v and depth, (..., M) each, of antenna points (..., M, 3), by one of the known poses."""
    x, y, z = (points_m[..., axis] for axis in range(3))
    rotation, shift = known.rotations[pose], known.translations[pose]
    across, down, ahead = (
        row[0] * x + row[1] * y + (row[2] * z + move) for row, move in zip(rotation, shift, strict=True)
    )
    depth = namespace(ahead).clip(ahead, NEAREST_DEPTH_M, None)
    return across / depth, down / depth, depth


def image_slopes(known: Known, tangents: Array, u: Array, v: Array, depth: Array) -> tuple[Array, Array]:
    """Slopes (..., M) of the image by arc length, of tangents (..., M, 3) at image points and depths (..., M)."""
    x, y, z = (tangents[..., axis] for axis in range(3))
    across, down, ahead = (row[0] * x + row[1] * y + row[2] * z for row in known.rotations[0])
    return (across - u * ahead) / depth, (down - v * ahead) / depth


def dot(first: Array, second: Array) -> Array:
    """Inner products (...) of plane vectors (..., 2): far quicker than a sum over so short an axis."""
    return first[..., 0] * second[..., 0] + first[..., 1] * second[..., 1]
