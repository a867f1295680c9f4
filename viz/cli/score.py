"""Errors of a rig and its contacts against the truth of a synthetic session."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from estimator.table.contacts import ContactTable
from vbaa_calib.geometry import Pose
from vbaa_calib.rig import Rig


@dataclass(frozen=True)
class Score:
    """Root mean square errors over the frames that were located, and the calibration's errors. SI units.

    Attributes
    ----------
    frames, frames_ok : all frames, and those whose status is right: located where there is contact, free where not.
    force_rmse_relative : of the force across the antenna (y, z), over its true size.
    direction_rmse_rad : of that force's direction in the yz plane.
    nees : mean squared contact point error over its own covariance, per degree of freedom; 1 is honest.
    """

    frames: int
    frames_ok: int
    contact_point_rmse_m: float
    distance_rmse_m: float
    force_rmse_relative: float
    direction_rmse_rad: float
    stiffness_relative_error: float
    focal_relative_error: float
    camera_position_error_m: float
    camera_rotation_error_rad: float
    nees: float

    def to_dict(self) -> dict[str, Any]:
        """JSON-able."""
        return asdict(self)


def score(rig: Rig, contacts: ContactTable, truth: Mapping[str, Any]) -> Score:
    """Compare with truth.json's mapping."""
    true = {entry["frame"]: entry for entry in truth["frames"]}
    entries = [true[int(frame)] for frame in contacts.frame]
    touching = np.array([entry["in_contact"] for entry in entries])
    right = np.where(touching, contacts.located, contacts.status == "no_contact")
    both = np.flatnonzero(touching & contacts.located)
    distance = np.array([entries[i]["distance_m"] for i in both])
    point = np.array([entries[i]["contact_world_m"] for i in both])
    force = np.array([entries[i]["force_N"] for i in both])[:, 1:]
    found = np.stack([contacts.force_y_N[both], contacts.force_z_N[both]], axis=1)
    off = contacts.point_world_m[both] - point
    weighted = np.linalg.solve(contacts.covariance_world_m2[both], off[..., None])[..., 0]
    turn = np.arctan2(_cross(force, found), (force * found).sum(axis=1))
    matrix, true_matrix = rig.camera.matrix, np.array(truth["camera"]["matrix"])
    T_true = Pose.from_dict(truth["T_antenna_camera"])
    rotation = Rotation.from_matrix(rig.T_antenna_camera.rotation @ T_true.rotation.T).magnitude()
    return Score(
        frames=len(contacts),
        frames_ok=int(right.sum()),
        contact_point_rmse_m=_rms(np.linalg.norm(off, axis=1)),
        distance_rmse_m=_rms(contacts.distance_m[both] - distance),
        force_rmse_relative=_rms(np.linalg.norm(found - force, axis=1) / np.linalg.norm(force, axis=1)),
        direction_rmse_rad=_rms(turn),
        stiffness_relative_error=abs(rig.antenna.stiffness_Nm2 / truth["stiffness_Nm2"] - 1),
        focal_relative_error=float(np.abs(np.diag(matrix)[:2] / np.diag(true_matrix)[:2] - 1).max()),
        camera_position_error_m=float(np.linalg.norm(rig.T_antenna_camera.translation_m - T_true.translation_m)),
        camera_rotation_error_rad=float(rotation),
        nees=float((off * weighted).sum(axis=1).mean() / 3),
    )


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt((np.asarray(values) ** 2).mean()))


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
