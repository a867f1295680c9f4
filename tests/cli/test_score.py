"""The table of error against truth counts what it says."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from estimator.table.contacts import ContactRow, ContactTable
from vbaa_calib.geometry import Pose
from viz.cli.demo import _score

POSE = Pose.from_rotvec(np.array([3.0, 0.1, 0.0]), np.array([0.1, 0.0, 0.4]))


def test_errors_of_known_size_come_out_at_that_size() -> None:
    """Of six frames two are off, one fits, one failed, one missed a contact, and one shows a contact that is none."""
    matrix, point_m, free = np.diag([1000.0, 1000.0, 1.0]), np.array([0.14, 0.02, 0.01]), {"in_contact": False}
    touched = {"in_contact": True, "distance_m": 0.15, "contact_world_m": point_m.tolist(), "force_N": [0, 0.05, 0]}
    cells: list[dict[str, Any]] = [{"status": "no_contact"}] * 4 + [{"status": "failed"}]
    for place, off_m, turn_rad in ((0, 3e-3, 0.1), (1, -4e-3, -0.1), (5, 0.0, 0.0)):
        force = {"force_y_N": 0.05 * np.cos(turn_rad), "force_z_N": 0.05 * np.sin(turn_rad)}
        where = {"point_world_m": point_m + np.array([0.0, off_m, 0.0]), "covariance_world_m2": 1e-6 * np.eye(3)}
        own = {"status": "ok", "in_contact": True, "distance_m": 0.15 + off_m, **force, **where}
        cells[place : place + 1] = [own]
    table = ContactTable.from_rows([ContactRow(frame=at, time_s=0.1 * at, **each) for at, each in enumerate(cells)])
    truth = {
        "frames": [each | {"frame": frame} for frame, each in enumerate([touched] * 3 + [free] * 3)][::-1],
        "camera": {"matrix": (matrix @ np.diag([1.01, 1.0, 1.0])).tolist()},
        "T_antenna_camera": POSE.to_dict(),
        "stiffness_Nm2": 4e-3,
    }
    rig: Any = SimpleNamespace(
        camera=SimpleNamespace(matrix=matrix),
        antenna=SimpleNamespace(stiffness_Nm2=4.1e-3),
        T_antenna_camera=POSE.retract(np.array([0.0, 0.002, 0.0, 0.0, 3e-4, 4e-4])),
    )
    found = _score(rig, table, truth)
    rms_m = np.sqrt((3e-3**2 + 4e-3**2) / 2)
    assert found == pytest.approx(
        {"frames": 6, "frames_ok": 3}
        | {"contact_point_rmse_m": rms_m, "distance_rmse_m": rms_m, "nees": rms_m**2 / 1e-6 / 3}
        | {"direction_rmse_rad": 0.1, "force_rmse_relative": 2 * np.sin(0.05)}
        | {"stiffness_relative_error": 0.025, "focal_relative_error": 0.01 / 1.01}
        | {"camera_position_error_m": 5e-4, "camera_rotation_error_rad": 0.002}
    )
