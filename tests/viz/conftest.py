"""One touched cylinder and the rig that touched it, for all tests of the pictures."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from estimator.table.contacts import ContactRow, ContactTable
from estimator.table.files import write_contacts
from vbaa_calib.camera import Camera
from vbaa_calib.geometry import Kinematics, Pose
from vbaa_calib.rig import RIG_PARAMETERS, Antenna, AntennaImage, MomentSensor, Rig
from viz.scene.scene import Scene

from .scenes import full_scene
from .touching import cylinder, touch


@pytest.fixture(scope="session")
def kinematics() -> Kinematics:
    return Kinematics(
        Pose.from_rotvec(np.array([0.0, 0.02, 0.01]), np.array([0.01, 0.0, 0.005])), np.array([0, 0, 0.02])
    )


@pytest.fixture(scope="session")
def rig(kinematics: Kinematics) -> Rig:
    camera = Camera("opencv", (960, 720), np.array([[900.0, 0, 480], [0, 900, 360], [0, 0, 1]]), np.zeros(0))
    # beside the antenna's middle, looking down at it from 0.35 m
    turn = Rotation.from_matrix(np.array([[1.0, 0, 0], [0, -1, 0], [0, 0, -1]]))
    return Rig(
        camera=camera,
        T_antenna_camera=Pose(turn.as_matrix(), np.array([0.12, 0.0, 0.35])),
        antenna=Antenna(0.24, 0.0008, np.array([0, 0, 0.01, 0, 0.05, 0.0, np.log(3.9e-3), np.log(3.97e-3), 0.0])),
        moment_sensor=MomentSensor(1.0, 0.0, 2e-5),
        kinematics=kinematics,
        gravity_world_m_s2=np.array([0.0, 0.0, -9.80665]),
        image=AntennaImage(0.1, 1.0, True),
        covariance=1e-8 * np.eye(len(RIG_PARAMETERS)),
    )


@pytest.fixture(scope="session")
def rows(kinematics: Kinematics) -> list[ContactRow]:
    """Ninety contacts on a patch, then a frame without contact and one that failed."""
    angle, height = np.meshgrid(np.linspace(1.0, 2.1, 9), np.linspace(-0.03, 0.03, 10))
    found = touch(
        *cylinder(angle.ravel(), height.ravel()), np.random.default_rng(0), std_along_m=4e-4, kinematics=kinematics
    )
    return [
        *found,
        ContactRow(frame=90, time_s=3.0, status="no_contact", reason="the antenna has its free shape"),
        ContactRow(frame=91, time_s=3.1, status="failed", in_contact=True, reason="<the fit> did not converge"),
    ]


@pytest.fixture(scope="session")
def table(rows: list[ContactRow]) -> ContactTable:
    return ContactTable.from_rows(rows)


@pytest.fixture(scope="session")
def truth(table: ContactTable) -> dict[str, Any]:
    """As in truth.json: the object, and the frames as they were estimated."""
    return {
        "object": {
            "shape": "cylinder",
            "center_world_m": [0.16, 0.05, 0.0],
            "axis_world": [0.0, 0.0, 1.0],
            "wedge_world": [0.0, 0.0, 0.0],
            "radius_m": 0.015,
            "half_length_m": 0.05,
        },
        "frames": [
            {
                "frame": int(frame),
                "in_contact": bool(touched),
                "distance_m": float(distance) if touched else None,
                "force_N": [0.0, float(y), float(z)] if touched else [0.0, 0.0, 0.0],
            }
            for frame, touched, distance, y, z in zip(
                table.frame, table.located, table.distance_m, table.force_y_N, table.force_z_N, strict=True
            )
        ],
    }


@pytest.fixture(scope="session")
def scene(table: ContactTable, rig: Rig, truth: dict[str, Any]) -> Scene:
    return full_scene(table, rig, truth)


@pytest.fixture
def files(tmp_path: Path, rows: list[ContactRow], rig: Rig, truth: dict[str, Any]) -> SimpleNamespace:
    """The same as files: contacts, some without any contact, rig, truth, and the folder they are in."""
    write_contacts(tmp_path / "contacts.csv", rows)
    write_contacts(tmp_path / "free.csv", [row for row in rows if row.status == "no_contact"])
    (tmp_path / "rig.json").write_text(json.dumps(rig.to_dict()))
    (tmp_path / "truth.json").write_text(json.dumps(truth))
    return SimpleNamespace(
        folder=tmp_path,
        contacts=tmp_path / "contacts.csv",
        free=tmp_path / "free.csv",
        rig=tmp_path / "rig.json",
        truth=tmp_path / "truth.json",
    )
