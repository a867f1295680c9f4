"""Rigid poses, and planes. `T_a_b` maps coordinates in frame b to frame a: `p_a = T_a_b @ p_b`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, overload

import numpy as np
from scipy.spatial.transform import Rotation


@dataclass(frozen=True, eq=False)
class Pose:
    """A rotation (3, 3), determinant +1, and a translation (3,): `(T_a_b @ T_b_c) @ p_c == T_a_b @ (T_b_c @ p_c)`."""

    rotation: np.ndarray
    translation_m: np.ndarray

    @staticmethod
    def identity() -> Pose:
        """The pose that changes nothing."""
        return Pose(np.eye(3), np.zeros(3))

    @staticmethod
    def from_rotvec(rotvec_rad: np.ndarray, translation_m: np.ndarray) -> Pose:
        """From a rotation vector (3,) rad and a translation (3,) m."""
        return Pose(Rotation.from_rotvec(rotvec_rad).as_matrix(), np.asarray(translation_m, float).reshape(3))

    @staticmethod
    def from_dict(data: Mapping[str, Any]) -> Pose:
        """From {"translation_m": [x, y, z], "rotation_xyzw": [x, y, z, w]}, the layout of all our files."""
        return Pose(
            Rotation.from_quat(np.asarray(data["rotation_xyzw"], float)).as_matrix(),
            np.asarray(data["translation_m"], float),
        )

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
        turn = Rotation.from_rotvec(tangent[:3]).as_matrix()
        return Pose(turn @ self.rotation, self.translation_m + tangent[3:])

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
        return np.asarray(other) @ self.rotation.T + self.translation_m


@dataclass(frozen=True, eq=False)
class Plane:
    """The points x with normal·x = offset_m, in one frame; the normal (3,) is a unit vector."""

    normal: np.ndarray
    offset_m: float


PLANE_C = Plane(np.array([0.0, 0.0, 1.0]), 0.0)
"""The calibration plane C in the antenna frame: z = 0."""


def hinge_plane(roll_rad: float) -> Plane:
    """The deformation plane 𝒟 in the antenna frame: through the x axis, turned by the roll ξ from plane C."""
    return Plane(np.array([0.0, -np.sin(roll_rad), np.cos(roll_rad)]), 0.0)
