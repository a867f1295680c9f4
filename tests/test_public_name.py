"""`vbaa`: the public calls under one name, whatever else is called `estimator`."""

from __future__ import annotations

import dataclasses
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

import vbaa
from vbaa_calib.geometry import Pose
from vbaa_calib.session import read_recording

from .small_scene import small_rig

ROOT = Path(__file__).parents[1]


def test_every_public_name_is_there_and_importing_it_loads_nothing_heavy() -> None:
    assert all(getattr(vbaa, name) is not None for name in vbaa.__all__)
    code = "import sys, vbaa; print([name for name in ('numpy', 'torch', 'cv2') if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    assert done.stdout == "[]\n"


def test_a_picture_to_a_contact_in_one_call() -> None:
    """From a file and from its pixels the same as in the session; and while frames come. Arrays cannot be changed."""
    estimator = vbaa.ContactEstimator(vbaa.Rig.load(small_rig() / "rig.json"))
    table = estimator.estimate_session(small_rig() / "session")
    frames = read_recording(vbaa.load_session(small_rig() / "session"))
    several = [
        {"image": each.image, "moment": each.moment_Nm, "pan": each.pan_rad, "tilt": each.tilt_rad} for each in frames
    ]
    for number, each in enumerate(several):
        contact = estimator.estimate(**each)
        again = estimator.estimate(**each | {"image": cv2.imread(str(each["image"]), cv2.IMREAD_UNCHANGED)})
        assert contact.status == table.status[number]
        np.testing.assert_allclose(again.distance_m, contact.distance_m)
        assert not abs(contact.distance_m - table.distance_m[number]) > 3.0 * contact.distance_std_m
        assert len(repr(contact)) < 400
    assert [contact.status for contact in estimator.live(several)] == table.status.tolist()


def test_a_rig_is_saved_and_described_and_stays_as_it_is(tmp_path: Path) -> None:
    rig = vbaa.Rig.load(small_rig() / "rig.json")
    rig.save(tmp_path / "again.json")
    rig.camera.save(tmp_path / "camera.json")
    with pytest.raises(vbaa.InputError, match="exists already"):
        rig.save(tmp_path / "again.json")
    again = vbaa.Rig.load(tmp_path / "again.json")
    # a rotation comes back from its quaternion to the last digit but one
    np.testing.assert_allclose(again.T_antenna_camera.matrix, rig.T_antenna_camera.matrix, rtol=0, atol=1e-15)
    assert dataclasses.replace(again, T_antenna_camera=rig.T_antenna_camera).to_dict() == rig.to_dict()
    assert vbaa.Camera.load(tmp_path / "camera.json").to_dict() == rig.camera.to_dict()
    assert len(repr(rig)) < 200
    assert len(rig.summary().splitlines()) >= 4
    pose = rig.T_antenna_camera
    arrays = (rig.camera.matrix, rig.covariance, rig.gravity_world_m_s2, pose.rotation, rig.antenna.parameters)
    for array in (*arrays, rig.kinematics.position_world_m):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0


WRONG: dict[str, Any] = {
    "a covariance of NaN": lambda rig: replace(rig, covariance=np.full_like(rig.covariance, np.nan)),
    "a negative covariance": lambda rig: replace(rig, covariance=-rig.covariance),
    "a covariance of another size": lambda rig: replace(rig, covariance=np.eye(3)),
    "gravity in a plane": lambda rig: replace(rig, gravity_world_m_s2=np.zeros(2)),
    "gravity in g": lambda rig: replace(rig, gravity_world_m_s2=np.array([0.0, 0.0, -1.0])),
    "a pose of NaN": lambda rig: replace(rig, T_antenna_camera=Pose(np.full((3, 3), np.nan), np.zeros(3))),
    "a gain of 0": lambda rig: replace(rig.moment_sensor, gain=0.0),
    "an antenna of no length": lambda rig: replace(rig.antenna, length_m=0.0),
    "a negative covariance of the lens": lambda rig: replace(rig.camera, covariance=-np.eye(8)),
    "pictures of negative noise": lambda rig: replace(rig.image, noise_px=-1.0),
    "a picture of another size": lambda rig: seen(rig, image=np.zeros((3, 3), np.uint8)),
    "a picture of floats": lambda rig: seen(rig, image=np.zeros(rig.camera.image_size[::-1])),
    "a picture and pixels": lambda rig: seen(rig, image="a.png", centreline_px=np.zeros((9, 2))),
    "no picture": lambda rig: seen(rig, image="none.png"),
    "nothing": lambda rig: seen(rig),
}


def seen(rig: vbaa.Rig, **what: Any) -> Any:
    return vbaa.ContactEstimator(rig).estimate(**what, moment=0.0, pan=0.0, tilt=0.0)


@pytest.mark.parametrize("name", WRONG)
def test_what_is_wrong_is_refused_at_once(name: str) -> None:
    with pytest.raises(vbaa.InputError):
        WRONG[name](vbaa.Rig.load(small_rig() / "rig.json"))
