"""The table of error against truth counts what it says."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from estimator.table.contacts import ContactRow, ContactTable
from vbaa_calib.geometry import Pose
from viz.cli.demo import _score

MATRIX = np.array([[1000.0, 0.0, 480.0], [0.0, 1000.0, 360.0], [0.0, 0.0, 1.0]])
POSE = Pose.from_rotvec(np.array([3.0, 0.1, 0.0]), np.array([0.1, 0.0, 0.4]))
FORCE_N, POINT_M = np.array([-0.005, 0.03, 0.04]), np.array([0.14, 0.02, 0.01])


def _located(frame: int, off_m: float, turn_rad: float = 0.0) -> ContactRow:
    c, s = np.cos(turn_rad), np.sin(turn_rad)
    return ContactRow(
        frame=frame,
        time_s=0.1 * frame,
        status="ok",
        in_contact=True,
        distance_m=0.15 + off_m,
        force_y_N=float(c * FORCE_N[1] - s * FORCE_N[2]),
        force_z_N=float(s * FORCE_N[1] + c * FORCE_N[2]),
        point_world_m=POINT_M + np.array([0.0, off_m, 0.0]),
        covariance_world_m2=1e-6 * np.eye(3),
    )


def _truth(frame: int, in_contact: bool) -> dict[str, Any]:
    if not in_contact:
        return {"frame": frame, "in_contact": False, "distance_m": None, "contact_world_m": None, "force_N": [0, 0, 0]}
    at = {"distance_m": 0.15, "contact_world_m": POINT_M.tolist(), "force_N": FORCE_N.tolist()}
    return {"frame": frame, "in_contact": True} | at


def test_errors_of_known_size_come_out_at_that_size() -> None:
    rows = [
        _located(0, 3e-3, 0.1),
        _located(1, -4e-3, -0.1),
        ContactRow(frame=2, time_s=0.2, status="no_contact"),
        ContactRow(frame=3, time_s=0.3, status="no_contact"),
        ContactRow(frame=4, time_s=0.4, status="failed"),
        _located(5, 0.0),
    ]
    touching = (True, True, True, False, False, False)
    truth = {
        "frames": [_truth(frame, touches) for frame, touches in enumerate(touching)][::-1],
        "camera": {"matrix": (MATRIX @ np.diag([1.01, 1.0, 1.0])).tolist()},
        "T_antenna_camera": POSE.to_dict(),
        "stiffness_Nm2": 4e-3,
    }
    rig: Any = SimpleNamespace(
        camera=SimpleNamespace(matrix=MATRIX),
        antenna=SimpleNamespace(stiffness_Nm2=4.1e-3),
        T_antenna_camera=POSE.retract(np.array([0.0, 0.002, 0.0, 0.0, 3e-4, 4e-4])),
    )
    found = _score(rig, ContactTable.from_rows(rows), truth)
    rms_m = np.sqrt((3e-3**2 + 4e-3**2) / 2)
    assert found == pytest.approx(
        {
            "frames": 6,
            "frames_ok": 3,  # missed a contact, failed on a free frame, saw a contact that was none
            "contact_point_rmse_m": rms_m,
            "distance_rmse_m": rms_m,
            "direction_rmse_rad": 0.1,
            "force_rmse_relative": 2 * np.sin(0.05),
            "nees": rms_m**2 / 1e-6 / 3,
            "stiffness_relative_error": 0.025,
            "focal_relative_error": 0.01 / 1.01,
            "camera_position_error_m": 5e-4,
            "camera_rotation_error_rad": 0.002,
        }
    )
