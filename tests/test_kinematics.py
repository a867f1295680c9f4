"""The two joints: the paper's at right angles, and real axes that lean and pass each other."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from vbaa_calib.core.errors import InputError
from vbaa_calib.geometry import Kinematics, Pose, rotation_world_antenna

MOUNT = Pose.from_rotvec(np.array([0.2, -0.4, 0.9]), np.array([0.012, -0.003, 0.006]))
FOOT = np.array([0.1, -0.2, 0.15])
ANGLES = [(0.0, 0.0), (0.4, -0.7), (-2.9, 1.3), (6.1, -3.0)]


def matrix(rotvec: list[float], shift: list[float]) -> np.ndarray:
    """(4, 4), by SciPy alone."""
    whole = np.eye(4)
    whole[:3, :3], whole[:3, 3] = Rotation.from_rotvec(rotvec).as_matrix(), shift
    return whole


@pytest.mark.parametrize(("pan", "tilt"), ANGLES)
def test_perfect_axes_are_the_papers_to_the_last_bit(pan: float, tilt: float) -> None:
    pose = Kinematics(MOUNT, FOOT).T_world_antenna(pan, tilt)
    paper = Pose(rotation_world_antenna(pan, tilt), FOOT) @ MOUNT
    np.testing.assert_array_equal(pose.matrix, paper.matrix)
    expected = (Rotation.from_euler("z", pan) * Rotation.from_euler("y", -tilt)).as_matrix()
    np.testing.assert_allclose(rotation_world_antenna(pan, tilt), expected, atol=1e-15)


@pytest.mark.parametrize(("pan", "tilt"), ANGLES)
def test_the_chain_is_the_one_in_the_docstring(pan: float, tilt: float) -> None:
    kinematics = Kinematics(MOUNT, FOOT, axis_skew_rad=0.3, axis_offset_m=-0.02, tilt_zero_rad=0.1)
    chain = [
        matrix([0, 0, 0], FOOT.tolist()),
        matrix([0, 0, pan], [0, 0, 0]),
        matrix([0.3, 0, 0], [-0.02, 0, 0]),
        matrix([0, -(tilt + 0.1), 0], [0, 0, 0]),
        MOUNT.matrix,
    ]
    np.testing.assert_allclose(
        kinematics.T_world_antenna(pan, tilt).matrix, np.linalg.multi_dot(chain), rtol=0, atol=1e-15
    )


def test_skew_and_offset_are_the_angle_and_the_distance_of_the_axes() -> None:
    skew, offset = 0.25, 0.03
    kinematics = Kinematics(Pose.identity(), FOOT, axis_skew_rad=skew, axis_offset_m=offset)
    here, tilted = kinematics.T_world_antenna(0.7, 0.0), kinematics.T_world_antenna(0.7, 0.5)
    # the tilt axis: y of the attachment through its origin, which tilting leaves alone
    np.testing.assert_allclose(tilted.translation_m, here.translation_m, atol=1e-16)
    np.testing.assert_allclose(tilted.rotation[:, 1], here.rotation[:, 1], atol=1e-15)
    axis, up = here.rotation[:, 1], np.array([0.0, 0.0, 1.0])
    assert np.arcsin(axis @ up) == pytest.approx(skew)
    common = np.cross(axis, up) / np.linalg.norm(np.cross(axis, up))
    assert (here.translation_m - FOOT) @ common == pytest.approx(offset)
    assert here.translation_m[2] == FOOT[2]


@pytest.mark.parametrize("size", [0.0, 1e-300, 1e-12, 1e-5, 0.5, 3.0, np.pi - 1e-9, np.pi, 4.0, 7.0])
def test_rotations_are_scipys(size: float) -> None:
    """Matrix, rotation vector and quaternion, each into the other, from no turn at all to more than a whole one."""
    rng = np.random.default_rng(1)
    axes = [*np.eye(3), *-np.eye(3), *rng.normal(size=(40, 3))]
    for axis in axes:
        vector = size * axis / np.linalg.norm(axis)
        ours, other = Pose.from_rotvec(vector, FOOT), Rotation.from_rotvec(vector)
        np.testing.assert_allclose(ours.rotation, other.as_matrix(), rtol=0, atol=1e-15)
        # half a turn has two vectors
        again = ours.rotvec_rad
        np.testing.assert_allclose(Rotation.from_rotvec(again).as_matrix(), ours.rotation, rtol=0, atol=2e-15)
        if size < 3.1:
            np.testing.assert_allclose(again, vector, rtol=1e-14, atol=0)
        xyzw = np.array(ours.to_dict()["rotation_xyzw"])
        assert xyzw[3] >= 0.0
        np.testing.assert_allclose(abs(xyzw @ other.as_quat()), 1.0, rtol=1e-15)
        np.testing.assert_allclose(Pose.from_quaternion(3.0 * xyzw, FOOT).rotation, ours.rotation, rtol=0, atol=1e-15)


def test_what_is_no_rotation() -> None:
    assert np.isnan(Pose.identity().retract(np.array([np.inf, 0.0, 0.0, 0.0, 0.0, 0.0])).rotation).all()
    with pytest.raises(InputError, match="mirrored"):
        _ = Pose(np.diag([1.0, 1.0, -1.0]), FOOT).rotvec_rad
