"""What a jig's entries could have been meant as: every usual mistake is among them, and each can be taken back."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from vbaa_calib.geometry import Pose
from vbaa_calib.session.jig import jig_alternatives, jig_doubts

SIZE_M = (0.108, 0.072)
FACING = np.diag([1.0, -1.0, -1.0])


def jigs(count: int) -> list[Pose]:
    """Boards that face a camera on the +z side, in any of four turns, nearly square, 20 to 150 mm from the clamp."""
    rng = np.random.default_rng(11)
    found = []
    for _ in range(count):
        turn = Rotation.from_euler("z", 90 * rng.integers(4), degrees=True).as_matrix() @ FACING
        shake = Rotation.from_rotvec(rng.normal(0.0, 0.02, 3)).as_matrix()
        found.append(Pose(shake @ turn, rng.choice([-1, 1], 3) * rng.uniform(0.02, 0.09, 3)))
    return found


def same(a: Pose, b: Pose) -> bool:
    return bool(np.abs(a.matrix - b.matrix).max() < 1e-9)


SLIPS: dict[str, Callable[[Pose], Pose]] = {
    "sign of x": lambda jig: Pose(jig.rotation, jig.translation_m * [-1, 1, 1]),
    "sign of y": lambda jig: Pose(jig.rotation, jig.translation_m * [1, -1, 1]),
    "sign of z": lambda jig: Pose(jig.rotation, jig.translation_m * [1, 1, -1]),
    "x and y": lambda jig: Pose(jig.rotation, jig.translation_m[[1, 0, 2]]),
    "y and z": lambda jig: Pose(jig.rotation, jig.translation_m[[0, 2, 1]]),
    "cm as mm": lambda jig: Pose(jig.rotation, 0.1 * jig.translation_m),
    "inches as mm": lambda jig: Pose(jig.rotation, jig.translation_m / 25.4),
    "cm as m": lambda jig: Pose(jig.rotation, 100.0 * jig.translation_m),
    "mm as m": lambda jig: Pose(jig.rotation, 1000.0 * jig.translation_m),
    "half a turn": lambda jig: jig @ Pose(np.diag([-1.0, -1.0, 1.0]), np.zeros(3)),
    "other corner": lambda jig: jig @ Pose(np.diag([-1.0, -1.0, 1.0]), np.array([*SIZE_M, 0.0])),
    "a quarter turn": lambda jig: jig @ Pose(Rotation.from_euler("z", 90, degrees=True).as_matrix(), np.zeros(3)),
    "board's y": lambda jig: jig @ Pose(FACING, np.zeros(3)),
    "inverse": Pose.inverse,
    "all signs": lambda jig: Pose(jig.rotation, -jig.translation_m),
}


@pytest.mark.parametrize("slip", SLIPS)
@pytest.mark.parametrize("thickness_m", [0.0, 0.003])
def test_every_slip_is_taken_back_by_an_alternative(slip: str, thickness_m: float) -> None:
    """The jig describes the board's back; what is wrong with that is found with the thickness on the right side."""
    face = Pose(np.eye(3), np.array([0.0, 0.0, -thickness_m]))
    for right in jigs(20):
        entered = SLIPS[slip](right) @ face
        alternatives = jig_alternatives(entered, SIZE_M, thickness_m)
        assert sum(same(pose, right @ face) for _, pose in alternatives) == 1


def test_alternatives_differ_and_are_poses() -> None:
    for jig in jigs(20):
        poses = [jig, *(pose for _, pose in jig_alternatives(jig, SIZE_M, 0.003))]
        assert len({words for words, _ in jig_alternatives(jig, SIZE_M, 0.003)}) == len(poses) - 1
        assert not any(same(a, b) for i, a in enumerate(poses) for b in poses[:i])
        for pose in poses:
            np.testing.assert_allclose(pose.rotation @ pose.rotation.T, np.eye(3), atol=1e-9)
            assert np.linalg.det(pose.rotation) == pytest.approx(1.0)


@pytest.mark.parametrize("factor", [1e-3, 1e3])
def test_a_jig_in_metres_or_millimetres_is_doubted_with_its_size(factor: float) -> None:
    for jig in jigs(20):
        assert jig_doubts(jig, 0.24) == []
        (doubt,) = jig_doubts(Pose(jig.rotation, factor * jig.translation_m), 0.24)
        assert f"{1e3 * np.linalg.norm(jig.translation_m):.3g} mm" in doubt.remedy
