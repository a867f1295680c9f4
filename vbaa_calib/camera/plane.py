"""Intersection of rays with planes."""

from __future__ import annotations

import math

import numpy as np

from vbaa_calib.core.arrays import Array, ArrayT, like, masked, namespace, validate_arguments
from vbaa_calib.core.errors import InputError
from vbaa_calib.geometry import Plane


def cross(origins: Array, directions: Array, normals: Array, offsets_m: Array) -> tuple[Array, Array]:
    """Intersections (..., 3) of rays with planes, always finite, and whether there is one (...).

    Rays origins + t·directions, t > 0 (unit directions), planes normals·x = offsets_m; all broadcast. Not valid:
    grazing, behind the origin, a plane through the origin, not finite.
    """
    xp = namespace(directions)
    slant = (normals * directions).sum(-1)
    height = offsets_m - (normals * origins).sum(-1)
    # rays at less than 1e-3 rad to the plane, and planes through their origin, have no intersection
    valid = (xp.abs(slant) > math.sin(1e-3)) & (xp.abs(height) > 1e-9) & (height * slant > 0)
    slant = xp.where(valid, slant, 1.0)
    range_m = xp.where(valid, height, 0.0) / slant
    return origins + range_m[..., None] * directions, valid


@validate_arguments
def intersect_plane(origins: ArrayT, directions: ArrayT, plane: Plane) -> tuple[ArrayT, ArrayT]:
    """Intersections (..., 3) of rays with a plane, and validity (...). All in the plane's frame.

    Origins (..., 3) m and unit directions (..., 3) broadcast. Invalid rays (NaN) stay invalid.
    """
    return _finished(origins, directions, like(directions, plane.normal), plane.offset_m)


@validate_arguments
def intersect_hinge_plane(origins: ArrayT, directions: ArrayT, roll_rad: ArrayT) -> tuple[ArrayT, ArrayT]:
    """Intersections (..., 3) of rays with the deformation plane 𝒟 at each roll (...), and validity (...). Antenna
    frame.

    Their x and y are the picture on plane C under the upright camera, Eqs. (3)–(5).

    Differentiable in the roll. Not valid where the camera's centre lies in 𝒟: then the picture says nothing of depth.
    """
    xp = namespace(directions)
    roll_rad = like(directions, roll_rad)
    normals = xp.stack([0.0 * roll_rad, -xp.sin(roll_rad), xp.cos(roll_rad)], -1)
    return _finished(origins, directions, normals, 0.0)


@validate_arguments
def in_plane_axes(plane: Plane) -> np.ndarray:
    """(2, 3) orthonormal axes of the coordinates on a plane.

    The first is the frame's x axis laid onto the plane (y where x is normal to it); the second completes a
    right-handed frame with the normal. On plane C they are x and y, on the hinge plane x and the way along the roll.
    """
    normal = np.asarray(plane.normal, float)
    seed = np.eye(3)[0 if abs(normal[0]) < 0.999 else 1]
    first = seed - normal * (normal @ seed)
    first = first / np.linalg.norm(first)
    return np.stack([first, np.cross(normal, first)])


def _finished(origins: Array, directions: Array, normals: Array, offset_m: float) -> tuple[Array, Array]:
    if origins.shape[-1:] != (3,) or directions.shape[-1:] != (3,):
        what = f"origins and directions have the shapes {tuple(origins.shape)} and {tuple(directions.shape)}"
        raise InputError(what, remedy="give both as (..., 3)")
    xp = namespace(directions)
    finite = xp.isfinite(directions).all(-1) & xp.isfinite(origins).all(-1)
    safe = xp.where(finite[..., None], directions, 0.0)
    points, valid = cross(xp.where(finite[..., None], origins, 0.0), safe, normals, offset_m)
    return masked(points, valid), valid
