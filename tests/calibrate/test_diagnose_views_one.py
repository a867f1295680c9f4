"""One more picture against those before it: its size, and where it shows the board."""

from __future__ import annotations

import numpy as np
import pytest

from vbaa_calib.calibrate.faults.variety import resolution_changed, same_pose
from vbaa_calib.calibrate.lens.models import LENS_MODELS
from vbaa_calib.geometry import Pose

from .synthetic_views import CENTRE, SPEC, pose_towards, views_of

SIZE = (1280, 720)
INTRINSICS = np.array([1100.0, 1102.0, 640.0, 362.0, -0.18, 0.06, 7e-4, -5e-4])


@pytest.mark.parametrize(("turn_rad", "move_m", "same"), [(0.0, 0.003, True), (0.25, 0.0, False), (0.0, 0.03, False)])
def test_small_moves_are_the_same_pose_and_tilts_are_not(turn_rad: float, move_m: float, same: bool) -> None:
    for seed in range(5):
        pose = pose_towards(np.random.default_rng(seed), 0.2, 0.3, 0.1)
        turn = Pose.from_rotvec(np.array([0.0, turn_rad, 0.0]), np.zeros(3)).rotation
        middle = pose.translation_m + pose.rotation @ CENTRE
        moved = Pose(turn @ pose.rotation, middle + np.array([move_m, 0.0, 0.0]) - turn @ pose.rotation @ CENTRE)
        first, second = views_of(
            LENS_MODELS["opencv4"], INTRINSICS, SIZE, [pose, moved], np.random.default_rng(seed), 0.05
        )
        assert (same_pose(second, [first], SPEC) is not None) == same


@pytest.mark.parametrize(
    ("size", "name"),
    [
        ((1280, 720), None),
        ((720, 1280), "picture_turned"),
        ((640, 360), "picture_scaled"),
        ((1920, 1080), "picture_scaled"),
        ((1280, 640), "picture_cropped"),
        ((1280, 960), "picture_cropped"),
    ],
)
def test_a_change_of_resolution_has_its_cause(size: tuple[int, int], name: str | None) -> None:
    found = resolution_changed(size, (1280, 720))
    assert (None if found is None else found.name) == name
    assert found is None or found.grave
