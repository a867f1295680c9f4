"""Errors of a rig and its contacts against the truth of a synthetic session."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from estimator.table.contacts import ContactTable
from vbaa_calib.geometry import Pose
from vbaa_calib.rig import Rig
from viz.scene.truth import true_contacts


def score(rig: Rig, contacts: ContactTable, truth: Mapping[str, Any]) -> dict[str, Any]:
    """Root mean square errors over the frames that were located, and the calibration's errors. SI units.

    `frames_ok` counts the frames whose status is right: located where there is contact, free where not. Force and
    direction are those across the antenna (y, z), the force's error over its true size. `nees` is the mean squared
    error of the contact point over its own covariance, per degree of freedom; 1 is honest.

    truth : truth.json's mapping.
    """
    true = true_contacts(contacts, truth)
    touching = np.isfinite(true.distance_m)
    right = np.where(touching, contacts.located, contacts.status == "no_contact")
    both = touching & contacts.located
    force = np.stack([true.force_y_N[both], true.force_z_N[both]], axis=1)
    found = np.stack([contacts.force_y_N[both], contacts.force_z_N[both]], axis=1)
    off = (contacts.point_world_m - true.point_world_m)[both]
    weighted = np.linalg.solve(contacts.covariance_world_m2[both], off[..., None])[..., 0]
    across = force[:, 0] * found[:, 1] - force[:, 1] * found[:, 0]
    matrix, true_matrix = rig.camera.matrix, np.array(truth["camera"]["matrix"])
    T_true = Pose.from_dict(truth["T_antenna_camera"])
    rotation = Rotation.from_matrix(rig.T_antenna_camera.rotation @ T_true.rotation.T).magnitude()
    return {
        "frames": len(contacts),
        "frames_ok": int(right.sum()),
        "contact_point_rmse_m": _rms(np.linalg.norm(off, axis=1)),
        "distance_rmse_m": _rms((contacts.distance_m - true.distance_m)[both]),
        "force_rmse_relative": _rms(np.linalg.norm(found - force, axis=1) / np.linalg.norm(force, axis=1)),
        "direction_rmse_rad": _rms(np.arctan2(across, (force * found).sum(axis=1))),
        "stiffness_relative_error": abs(rig.antenna.stiffness_Nm2 / truth["stiffness_Nm2"] - 1),
        "focal_relative_error": float(np.abs(np.diag(matrix)[:2] / np.diag(true_matrix)[:2] - 1).max()),
        "camera_position_error_m": float(np.linalg.norm(rig.T_antenna_camera.translation_m - T_true.translation_m)),
        "camera_rotation_error_rad": float(rotation),
        "nees": float((off * weighted).sum(axis=1).mean() / 3),
    }


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt((values**2).mean()))
