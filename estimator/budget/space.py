"""The calibration's errors as independent ones, and which of them belong to what cause."""

from __future__ import annotations

from dataclasses import dataclass
from math import factorial

import numpy as np

from estimator.solver.rig_arrays import RigArrays
from vbaa_calib.rig import POSE_PARAMETERS, RIG_PARAMETERS

LENS, JOINT_AXES = "lens", "joint_axes"
RIG_CAUSES = {
    "camera_rotation": POSE_PARAMETERS[:3],
    "camera_position": POSE_PARAMETERS[3:],
    "clamp_offset": ("clamp_y_m", "clamp_z_m"),
    "clamp_angle": ("clamp_about_y_rad", "clamp_about_z_rad"),
    "clamp_give": ("clamp_give_m",),
    "bow": ("bow_about_y_per_m", "bow_about_z_per_m"),
    "stiffness": ("log_stiffness_Nm2",),
    "mass": ("log_mass_per_length_kg_m",),
    "moment_gain": ("moment_gain",),
    "moment_offset": ("moment_offset_Nm",),
}
"""Causes and their rows of the joint covariance; the lens' rows follow them."""
_DEPENDENT = 1e-7  # a row of unit deviation that adds less than this to others is determined by them


@dataclass(frozen=True, eq=False)
class ErrorSpace:
    """S independent errors of unit deviation that make all errors of rig and joint axes.

    Attributes
    ----------
    causes : names of the G causes that have any error, of `RIG_CAUSES`, `LENS` and `JOINT_AXES`.
    determined : (G, S, S) projector onto the errors that are determined once a cause is known, by correlation, too;
        determined_by_others : the same of all the other causes together. shares : each cause's part, see `split`.
    rig : how many of the S are the estimator's own rig steps; they stand first.
    axes : (3, S) errors of the joint axes' skew, offset and tilt zero.
    """

    causes: tuple[str, ...]
    determined: np.ndarray
    determined_by_others: np.ndarray
    shares: np.ndarray
    rig: int
    axes: np.ndarray

    @property
    def size(self) -> int:
        """S."""
        return self.axes.shape[1]

    @staticmethod
    def of(rig_arrays: RigArrays) -> ErrorSpace:
        """Of a rig as the estimator knows it."""
        rig_axes, kinematics = np.asarray(rig_arrays.axes), rig_arrays.rig.kinematics
        own = np.diag(kinematics.axes_std)[:, kinematics.axes_std > 0.0]
        axes = np.hstack([kinematics.axes_by_pose @ rig_axes[: len(POSE_PARAMETERS)], own])
        rig_rows = np.hstack([rig_axes, np.zeros((len(rig_axes), own.shape[1]))])
        rows = {cause: rig_rows[[RIG_PARAMETERS.index(name) for name in names]] for cause, names in RIG_CAUSES.items()}
        rows |= {LENS: rig_rows[len(RIG_PARAMETERS) :], JOINT_AXES: axes}
        rows = {cause: part for cause, part in rows.items() if part.any()}
        determined = subsets(list(rows.values()), axes.shape[1])
        single = [1 << index for index in range(len(rows))]
        without = [len(determined) - 1 - one for one in single]
        return ErrorSpace(
            tuple(rows), determined[single], determined[without], split(determined), rig_axes.shape[1], axes
        )


def subsets(rows: list[np.ndarray], size: int) -> np.ndarray:
    """(2^G, S, S) projectors onto what any set of causes tells of the independent errors; bit g is cause g.

    `rows` are G arrays (P_g, S): a cause's parameters by the independent errors.
    """
    determined = np.zeros((1, size, size))
    for part in rows:
        scale = np.linalg.norm(part, axis=1, keepdims=True)
        unit = part / np.where(scale > 0.0, scale, 1.0)
        # what the cause adds to each of the sets without it
        _, lengths, new = np.linalg.svd(unit - unit @ determined, full_matrices=False)
        new = new * (lengths > _DEPENDENT)[..., None]
        determined = np.concatenate([determined, determined + np.swapaxes(new, 1, 2) @ new])
    return determined


def split(determined: np.ndarray) -> np.ndarray:
    """(G, S, S) Shapley's shares of G causes, none negative, that add up to what all of them tell.

    A cause's share is what it tells in addition to others that are known before it, averaged over all orders: causes
    that are correlated divide what they have in common.
    """
    count = len(determined).bit_length() - 1
    members = (np.arange(len(determined))[:, None] >> np.arange(count)) & 1
    sizes = members.sum(axis=1)
    weight = np.array([factorial(k) * factorial(count - k - 1) / factorial(count) for k in range(count)])
    if not count:
        return np.zeros((0, *determined.shape[1:]))
    joins, stays = weight[np.clip(sizes - 1, 0, None)][:, None], weight[np.clip(sizes, None, count - 1)][:, None]
    return np.asarray(np.einsum("ug,uij->gij", np.where(members == 1, joins, -stays), determined))
