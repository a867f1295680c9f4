"""Rigid poses, and planes. `T_a_b` maps coordinates in frame b to frame a: `p_a = T_a_b @ p_b`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, overload

import numpy as np
from scipy.spatial.transform import Rotation

from vbaa_calib.core.arrays import as_floats, gate, of_shape
from vbaa_calib.core.errors import InputError, shown


@dataclass(frozen=True, eq=False)
class Pose:
    """A rotation (3, 3), determinant +1, and a translation (3,): `(T_a_b @ T_b_c) @ p_c == T_a_b @ (T_b_c @ p_c)`.

    Raises InputError for other shapes, and for what is no number.
    """

    rotation: np.ndarray
    translation_m: np.ndarray

    def __post_init__(self) -> None:
        for name, shape in (("rotation", (3, 3)), ("translation_m", (3,))):
            values = getattr(self, name)
            if type(values) is not np.ndarray or values.shape != shape or values.dtype.kind != "f":
                object.__setattr__(self, name, of_shape(values, shape, name, finite=False))

    @staticmethod
    def identity() -> Pose:
        """The pose that changes nothing."""
        return Pose(np.eye(3), np.zeros(3))

    @staticmethod
    def from_rotvec(rotvec_rad: np.ndarray, translation_m: np.ndarray) -> Pose:
        """From a rotation vector (3,) rad and a translation (3,) m."""
        turn, shift = (np.ravel(as_floats(each, "a pose", "give (3,) of both")) for each in (rotvec_rad, translation_m))
        return Pose(Rotation.from_rotvec(of_shape(turn, (3,), "rotvec_rad")).as_matrix(), shift)

    @staticmethod
    @gate
    def from_dict(data: Mapping[str, Any]) -> Pose:
        """From {"translation_m": [x, y, z], "rotation_xyzw": [x, y, z, w]}, the layout of all our files."""
        for key in ("rotation_xyzw", "translation_m"):
            if key not in data:
                raise InputError(f"the pose has no {key}", remedy="give what to_dict makes")
        turn = of_shape(data["rotation_xyzw"], (4,), "rotation_xyzw")
        if not turn.any():
            raise InputError("rotation_xyzw is zero", remedy="give a unit quaternion, x, y, z, w")
        return Pose(Rotation.from_quat(turn).as_matrix(), of_shape(data["translation_m"], (3,), "translation_m"))

    def to_dict(self) -> dict[str, list[float]]:
        """{"translation_m": [x, y, z], "rotation_xyzw": [x, y, z, w]}, w >= 0."""
        quaternion = Rotation.from_matrix(self.rotation).as_quat(canonical=True)
        return {"translation_m": self.translation_m.tolist(), "rotation_xyzw": quaternion.tolist()}

    @property
    def rotvec_rad(self) -> np.ndarray:
        """(3,) rotation vector, rad. SciPy's log map: OpenCV's Rodrigues returns exactly 0 below about 1e-5 rad."""
        return Rotation.from_matrix(self.rotation).as_rotvec()

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
        """Moved by a small step given in frame a: tangent (6,) = rotation vector rad, then translation m.

        The rotation turns about the origin of frame b, so the two halves do not mix.
        """
        tangent = of_shape(tangent, (6,), "tangent", finite=False)
        turn = Rotation.from_rotvec(tangent[:3]).as_matrix()
        return Pose(turn @ self.rotation, self.translation_m + tangent[3:])

    @gate
    def tangent_from(self, other: Pose) -> np.ndarray:
        """(6,) the step of `retract` that leads here from another pose between the same frames."""
        turn = Rotation.from_matrix(self.rotation @ other.rotation.T).as_rotvec()
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
            raise InputError(f"points are {shown(other)}", remedy="give (..., 3) m, or a Pose")
        return points @ self.rotation.T + self.translation_m


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


@gate
def hinge_plane(roll_rad: float) -> Plane:
    """The deformation plane 𝒟 in the antenna frame: through the x axis, turned by the roll ξ from plane C."""
    return Plane(np.array([0.0, -np.sin(roll_rad), np.cos(roll_rad)]), 0.0)
