"""The two actuators: joint angles to the pose of the antenna in the world."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import ArrayLike

from vbaa_calib.core.arrays import PLAUSIBLE, check_angle, fixed, validate_arguments
from vbaa_calib.core.errors import InputError

from .pose import Pose

_MOST_KEPT = 64  # readings of which the pose is kept for the next who asks
_STEP = 1e-5  # finite-difference step of skew, offset and zero, rad or m


@validate_arguments
def rotation_world_antenna(pan_rad: ArrayLike, tilt_rad: ArrayLike, axis_skew_rad: float = 0.0) -> np.ndarray:
    """R_world_antenna = Rz(pan)·Rx(skew)·Ry(−tilt), (..., 3, 3) for angles (...). Without skew it is Eq. (22) with
    the misprint in its third column corrected.

    As printed that column is (−sinθ, 0, cosθ), which is a rotation only for pan = 0.
    """
    pan, tilt = np.asarray(pan_rad, float), np.asarray(tilt_rad, float)
    if pan.shape != tilt.shape:
        try:
            pan, tilt = np.broadcast_arrays(pan, tilt)
        except ValueError:
            what = f"pan_rad has shape {pan.shape}, tilt_rad {tilt.shape}"
            raise InputError(what, remedy="give one of each for every frame") from None
    return _turn(pan, tilt, axis_skew_rad)


def _turn(pan: np.ndarray, tilt: np.ndarray, axis_skew_rad: float) -> np.ndarray:
    angles = np.array((pan, tilt))
    (sin_p, sin_t), (cos_p, cos_t) = np.sin(angles), np.cos(angles)
    rows = [cos_t * cos_p, -sin_p, -sin_t * cos_p], [cos_t * sin_p, cos_p, -sin_t * sin_p], [sin_t, 0.0 * pan, cos_t]
    turn = np.ascontiguousarray(np.moveaxis(np.array(rows), (0, 1), (-2, -1)) if pan.ndim else rows)
    if axis_skew_rad == 0.0:
        return turn
    sin_s, cos_s = np.sin(axis_skew_rad), np.cos(axis_skew_rad)
    side = sin_s * np.stack([sin_t, cos_t], axis=-1)
    turn[..., 0, ::2] += sin_p[..., None] * side
    turn[..., 1, ::2] -= cos_p[..., None] * side
    turn[..., :2, 1] *= cos_s
    turn[..., 2, ::2] *= cos_s
    turn[..., 2, 1] = sin_s
    return turn


def _panned_x(pan_rad: np.ndarray) -> np.ndarray:
    return np.stack([np.cos(pan_rad), np.sin(pan_rad), np.zeros_like(pan_rad)], axis=-1)


def _central_differences(ends: Iterable[Iterable[tuple[np.ndarray, np.ndarray]]]) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives of rotations (K, B, 3, 3) and translations (K, B, 3) from their values at one `_STEP` below and
    above."""
    moved = [[(up - down) / (2 * _STEP) for down, up in zip(*each, strict=True)] for each in ends]
    rotations, translations = zip(*moved, strict=True)
    return np.stack(rotations), np.stack(translations)


@validate_arguments
@dataclass(frozen=True, eq=False)
class Kinematics:
    """Pose of the antenna frame by the joint angles: Eqs. (19) and (21), with skew and offset of the two axes.

    T_world_actuator = Trans(position)·Rz(pan)·Trans(offset along x)·Rx(skew)·Ry(−(tilt + tilt zero)). The pan axis is
    the world's z through `position_world_m`. The panned x axis is the common perpendicular of the two axes; its foot
    on the tilt axis is the actuator frame's origin; its y runs along that axis. In the paper the axes cross at right
    angles.

    Attributes
    ----------
    T_actuator_antenna : pose of the antenna frame on the moving attachment.
    position_world_m : (3,) crossing point of the two joint axes in the world, Eq. (21). Where they pass each other, the
        foot of their common perpendicular on the pan axis.
    axis_skew_rad : inclination of the tilt axis from the right angle with the pan axis; positive where its y tilts to
        +z.
    axis_offset_m : from the pan axis to the tilt axis along the panned x.
    tilt_zero_rad : true tilt where the encoder reads zero; true tilt = reading + tilt_zero_rad.
    axes_std : (3,) standard deviations of skew (rad), offset (m) and tilt zero (rad) for a camera pose that is exact.
    axes_by_pose : (3, 6) derivatives of the three by the camera pose's error (`Pose.retract`'s tangent): results of one
        sweep share its errors. Without a sweep the axes count as exact.
    """

    T_actuator_antenna: Pose = field(default_factory=Pose.identity)
    position_world_m: np.ndarray = field(default_factory=lambda: np.zeros(3))
    axis_skew_rad: float = 0.0
    axis_offset_m: float = 0.0
    tilt_zero_rad: float = 0.0
    axes_std: np.ndarray = field(default_factory=lambda: np.zeros(3))
    axes_by_pose: np.ndarray = field(default_factory=lambda: np.zeros((3, 6)))

    def __post_init__(self) -> None:
        for name, shape in (("position_world_m", (3,)), ("axes_std", (3,)), ("axes_by_pose", (3, 6))):
            object.__setattr__(self, name, fixed(getattr(self, name), shape, name, finite=False))

    @validate_arguments
    def T_world_antenna(self, pan_rad: float, tilt_rad: float) -> Pose:
        """Pose of the antenna frame in the world at the readings; `T_world_antenna @ p_antenna` is Eq. (19).

        Raises InputError for angles beyond a turn: they are degrees.
        """
        for name, angle in (("pan_rad", pan_rad), ("tilt_rad", tilt_rad)):
            if abs(angle) > PLAUSIBLE.angle_rad:
                check_angle(angle, name)
        return Pose(*self.world_antenna(pan_rad, tilt_rad))

    @validate_arguments
    def world_antenna(self, pan_rad: ArrayLike, tilt_rad: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        """Rotations (B, 3, 3) and translations (B, 3) of `T_world_antenna` at many readings (B,)."""
        pan_rad, tilt_rad = np.asarray(pan_rad, float), np.asarray(tilt_rad, float)
        if 0 < pan_rad.size <= _MOST_KEPT and pan_rad.shape == tilt_rad.shape:
            return self._once(pan_rad.tobytes(), tilt_rad.tobytes(), pan_rad.shape)
        return self._carried(pan_rad, tilt_rad)

    @lru_cache(maxsize=64)  # noqa: B019 -- a stream asks several times for the same pictures'
    def _once(self, pan: bytes, tilt: bytes, shape: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
        """Rotations and translations at a few readings, in that shape; cached by their bytes, as −0 equals 0."""
        angles = (np.frombuffer(each) for each in (pan, tilt))
        found = self._carried(*(each[0] if len(each) == 1 else each for each in angles))
        rotation, translation = (
            each.reshape(*shape, *each.shape[-width:]) for each, width in zip(found, (2, 1), strict=True)
        )
        rotation.flags.writeable = translation.flags.writeable = False
        return rotation, translation

    def _carried(self, pan_rad: np.ndarray, tilt_rad: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        turned = _turn if pan_rad.shape == tilt_rad.shape else rotation_world_antenna
        turn = turned(pan_rad, tilt_rad + self.tilt_zero_rad, self.axis_skew_rad)
        origin = self.position_world_m
        if self.axis_offset_m != 0.0:
            origin = origin + self.axis_offset_m * _panned_x(pan_rad)
        mount = self.T_actuator_antenna
        return turn @ mount.rotation, turn @ mount.translation_m + origin

    def by_joints(self, pan_rad: np.ndarray, tilt_rad: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives of `world_antenna` by pan and tilt: rotations (2, B, 3, 3), translations (2, B, 3)."""
        panned = (self.world_antenna(pan_rad + step, tilt_rad) for step in (-_STEP, _STEP))
        tilted = (self.world_antenna(pan_rad, tilt_rad + step) for step in (-_STEP, _STEP))
        return _central_differences([panned, tilted])

    @cached_property
    def axes_known(self) -> bool:
        """Whether skew, offset and tilt zero count as exact."""
        return not (self.axes_std.any() or self.axes_by_pose.any())

    def by_axes(self, pan_rad: np.ndarray, tilt_rad: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives of `world_antenna` by skew, offset and tilt zero: rotations (3, B, 3, 3), translations (3, B,
        3)."""
        return _central_differences([one.world_antenna(pan_rad, tilt_rad) for one in pair] for pair in self._stepped)

    @cached_property
    def _stepped(self) -> list[list[Kinematics]]:
        """The kinematics with skew, offset and tilt zero one difference step below and above."""
        names = ("axis_skew_rad", "axis_offset_m", "tilt_zero_rad")
        return [[replace(self, **{name: getattr(self, name) + step}) for step in (-_STEP, _STEP)] for name in names]
