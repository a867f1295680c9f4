"""Rigid poses, and planes. `T_a_b` maps coordinates in frame b to frame a: `p_a = T_a_b @ p_b`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, overload

import numpy as np

from vbaa_calib.core.arrays import as_floats, fixed, of_shape, validate_arguments
from vbaa_calib.core.errors import InputError, quoted


@dataclass(frozen=True, eq=False)
class Pose:
    """A rotation (3, 3), determinant +1, and a translation (3,): `(T_a_b @ T_b_c) @ p_c == T_a_b @ (T_b_c @ p_c)`.

    Raises InputError for other shapes, and for what is no number.
    """

    rotation: np.ndarray
    translation_m: np.ndarray

    def __post_init__(self) -> None:
        for name, shape in (("rotation", (3, 3)), ("translation_m", (3,))):
            object.__setattr__(self, name, fixed(getattr(self, name), shape, name, finite=False))

    @staticmethod
    def identity() -> Pose:
        """The identity pose."""
        return Pose(np.eye(3), np.zeros(3))

    @staticmethod
    def from_rotvec(rotvec_rad: np.ndarray, translation_m: np.ndarray) -> Pose:
        """The pose of a rotation vector (3,) rad and a translation (3,) m."""
        turn, shift = (np.ravel(as_floats(each, "a pose", "give (3,) of both")) for each in (rotvec_rad, translation_m))
        return Pose(_rotation_about(of_shape(turn, (3,), "rotvec_rad")), shift)

    @staticmethod
    def from_quaternion(xyzw: np.ndarray, translation_m: np.ndarray) -> Pose:
        """The pose of a quaternion (4,) x, y, z, w of any length but 0, and a translation (3,) m."""
        x, y, z, w = (of_shape(xyzw, (4,), "a quaternion") / math.hypot(*xyzw)).tolist()
        return Pose(_rotation_of(x, y, z, w), translation_m)

    @staticmethod
    @validate_arguments
    def from_dict(data: Mapping[str, Any]) -> Pose:
        """The pose in {"translation_m": [x, y, z], "rotation_xyzw": [x, y, z, w]}, the layout of all our files."""
        for key in ("rotation_xyzw", "translation_m"):
            if key not in data:
                raise InputError(f"the pose has no {key}", remedy="give what to_dict makes")
        turn = of_shape(data["rotation_xyzw"], (4,), "rotation_xyzw")
        if not turn.any():
            raise InputError("rotation_xyzw is zero", remedy="give a unit quaternion, x, y, z, w")
        return Pose.from_quaternion(turn, of_shape(data["translation_m"], (3,), "translation_m"))

    def to_dict(self) -> dict[str, list[float]]:
        """The mapping {"translation_m": [x, y, z], "rotation_xyzw": [x, y, z, w]}, w >= 0."""
        return {"translation_m": self.translation_m.tolist(), "rotation_xyzw": list(_quaternion_of(self.rotation))}

    @property
    def rotvec_rad(self) -> np.ndarray:
        """(3,) rotation vector, rad, exact also below 1e-5 rad, where OpenCV's Rodrigues returns 0."""
        return _rotvec_of(self.rotation)

    @property
    def vector(self) -> np.ndarray:
        """(6,) rotation vector rad, then translation m, as OpenCV's projection takes a pose."""
        return np.concatenate([self.rotvec_rad, self.translation_m])

    @property
    def matrix(self) -> np.ndarray:
        """(4, 4) homogeneous matrix."""
        return np.block([[self.rotation, self.translation_m[:, None]], [np.zeros((1, 3)), np.ones((1, 1))]])

    def inverse(self) -> Pose:
        """`T_b_a` from `T_a_b`."""
        return Pose(self.rotation.T, -self.rotation.T @ self.translation_m)

    def retract(self, tangent: np.ndarray) -> Pose:
        """The pose moved by a small step in frame a: tangent (6,) = rotation vector rad, then translation m.

        The rotation turns about the origin of frame b, so the two halves do not mix.
        """
        tangent = of_shape(tangent, (6,), "tangent", finite=False)
        return Pose(_rotation_about(tangent[:3]) @ self.rotation, self.translation_m + tangent[3:])

    @validate_arguments
    def tangent_from(self, other: Pose) -> np.ndarray:
        """(6,) tangent with which `other.retract` gives this pose."""
        turn = _rotvec_of(self.rotation @ other.rotation.T)
        return np.concatenate([turn, self.translation_m - other.translation_m])

    @overload
    def __matmul__(self, other: Pose) -> Pose: ...
    @overload
    def __matmul__(self, other: np.ndarray) -> np.ndarray: ...
    def __matmul__(self, other: Pose | np.ndarray) -> Pose | np.ndarray:
        if isinstance(other, Pose):
            return Pose(self.rotation @ other.rotation, self.rotation @ other.translation_m + self.translation_m)
        points = other if type(other) is np.ndarray else as_floats(other, "points", "give (..., 3) m")
        if points.shape[-1:] != (3,) or points.dtype.kind not in "fiu":
            raise InputError(f"points are {quoted(other)}", remedy="give (..., 3) m, or a Pose")
        return points @ self.rotation.T + self.translation_m


def _rotation_about(rotvec_rad: np.ndarray) -> np.ndarray:
    """(3, 3) rotation of a rotation vector (3,); NaN where that is not finite."""
    x, y, z = rotvec_rad.tolist()
    angle = math.hypot(x, y, z)
    if not angle < math.inf:
        return np.full((3, 3), np.nan)
    factor = math.sin(0.5 * angle) / angle if angle > 0.0 else 0.5
    return _rotation_of(factor * x, factor * y, factor * z, math.cos(0.5 * angle))


def _rotation_of(x: float, y: float, z: float, w: float) -> np.ndarray:
    """(3, 3) rotation of a unit quaternion."""
    xx, yy, zz, ww, xy, xz, yz, xw, yw, zw = x * x, y * y, z * z, w * w, x * y, x * z, y * z, x * w, y * w, z * w
    return np.array(
        [
            [xx - yy - zz + ww, 2.0 * (xy - zw), 2.0 * (xz + yw)],
            [2.0 * (xy + zw), yy - xx - zz + ww, 2.0 * (yz - xw)],
            [2.0 * (xz - yw), 2.0 * (yz + xw), zz - xx - yy + ww],
        ]
    )


def _quaternion_of(rotation: np.ndarray) -> tuple[float, ...]:
    """Unit quaternion x, y, z, w >= 0 of a rotation (3, 3), by its largest component (Shepperd). Raises InputError."""
    (a, b, c), (d, e, f), (g, h, i) = rotation.tolist()
    if a * (e * i - f * h) + b * (f * g - d * i) + c * (d * h - e * g) <= 0.0:
        raise InputError("the rotation is mirrored or zero", remedy="give a matrix of determinant +1")
    trace = a + e + i
    largest = max(a, e, i, trace)
    if trace == largest:
        found = h - f, c - g, d - b, 1.0 + trace
    elif a == largest:
        found = 1.0 + 2.0 * a - trace, b + d, c + g, h - f
    elif e == largest:
        found = b + d, 1.0 + 2.0 * e - trace, f + h, c - g
    else:
        found = c + g, f + h, 1.0 + 2.0 * i - trace, d - b
    length = math.hypot(*found)
    length = -length if found[3] < 0.0 else length
    return tuple(each / length for each in found)


def _rotvec_of(rotation: np.ndarray) -> np.ndarray:
    """(3,) rotation vector of a rotation (3, 3), rad."""
    x, y, z, w = _quaternion_of(rotation)
    sine = math.hypot(x, y, z)
    return (2.0 * math.atan2(sine, w) / sine if sine > 0.0 else 2.0) * np.array([x, y, z])


@dataclass(frozen=True, eq=False)
class Plane:
    """The points x with normal·x = offset_m, in one frame; the normal (3,) is a unit vector. Raises InputError."""

    normal: np.ndarray
    offset_m: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "normal", of_shape(self.normal, (3,), "normal"))
        object.__setattr__(self, "offset_m", float(of_shape(self.offset_m, (), "offset_m")))


PLANE_C = Plane(np.array([0.0, 0.0, 1.0]), 0.0)
"""The calibration plane C in the antenna frame: z = 0."""


@validate_arguments
def hinge_plane(roll_rad: float) -> Plane:
    """The deformation plane 𝒟 in the antenna frame: through the x axis, turned by the roll ξ from plane C."""
    return Plane(np.array([0.0, -np.sin(roll_rad), np.cos(roll_rad)]), 0.0)
