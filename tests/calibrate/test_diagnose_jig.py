"""Slips in the jig's pose are named by where the free antenna lies, of rigs drawn widely; clean sessions pass."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from vbaa_calib.calibrate.given_lens import focus_changed
from vbaa_calib.calibrate.lens.intrinsics import solve_intrinsics
from vbaa_calib.calibrate.lens.models import LENS_MODELS
from vbaa_calib.calibrate.pose.fusion import PoseEstimate
from vbaa_calib.core.errors import Diagnosis
from vbaa_calib.diagnose.jig import jig_diagnoses
from vbaa_calib.geometry import Pose

from .jig_slips import SLIPS, drawn_rig, mistaken, reported
from .synthetic_views import SPEC, pose_towards, views_of

SHIFT_M = np.array([0.0, 8e-3, 0.0])
SHOWN_BY_LOADS = ("sign of z", "x and z")
"""A clamp's angle makes up for a shift along the line of sight, until loads bend the antenna."""


@pytest.mark.parametrize("seed", [3, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(4, 14))])
@pytest.mark.parametrize("slip", ["in cm", "sign of y"])
def test_a_slip_is_named(slip: str, seed: int) -> None:
    _named(slip, seed)


@pytest.mark.slow
@pytest.mark.parametrize("slip", SLIPS)
def test_every_slip_is_named(slip: str) -> None:
    for seed in range(14, 18):
        _named(slip, seed)


def _named(slip: str, seed: int) -> None:
    rng = np.random.default_rng((7, seed))
    evidence = reported(drawn_rig(rng), rng)
    name, change = SLIPS[slip]
    found = jig_diagnoses(mistaken(evidence, change))
    assert [one.name for one in found] == [name] or (not found and slip in SHOWN_BY_LOADS), found
    assert all(one.grave for one in found)


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, 40))])
def test_a_jig_that_is_right_is_not_blamed(seed: int) -> None:
    rng = np.random.default_rng((8, seed))
    assert jig_diagnoses(reported(drawn_rig(rng), rng)) == []


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, 8))])
def test_mirrored_pictures_of_the_antenna_are_named(seed: int) -> None:
    rng = np.random.default_rng((9, seed))
    evidence = reported(drawn_rig(rng), rng)
    width = evidence.camera.image_size[0]
    turn, shift = np.array([-1.0, 1.0]), np.array([width - 1.0, 0.0])
    lines = [
        replace(one, points_px=shift + turn * one.points_px, tip_px=shift + turn * one.tip_px) for one in evidence.lines
    ]
    (found,) = jig_diagnoses(replace(evidence, lines=lines))
    # where the antenna lies along the picture's middle, upside down looks the same
    assert found.name in ("pictures_mirrored", "pictures_turned")
    assert "mirrored left to right" in found.words


def test_a_second_way_shows_by_how_much_the_jig_is_off() -> None:
    """Without the antenna either may be off; its line says which."""
    rng = np.random.default_rng((10, 0))
    rig = drawn_rig(rng)
    evidence, std = reported(rig, rng), np.array([2e-4] * 3 + [1e-4] * 3)
    seen = rig.T_antenna_camera.retract(std * rng.normal(size=6))
    other = PoseEstimate("sweep", seen, np.diag(std**2), np.zeros((6, 8)))
    off = mistaken(replace(evidence, others=[other]), lambda at: Pose(at.rotation, at.translation_m + SHIFT_M))
    (found,) = jig_diagnoses(off)
    assert found.name == "jig_off"
    assert float(found.words.split(", ")[2].split()[0]) == pytest.approx(-8.0, abs=1.0)
    (found,) = jig_diagnoses(replace(off, lines=[]))
    assert "jig.T_antenna_board has it, by" in found.words
    assert "the sweep puts the camera off" in found.words


@pytest.mark.parametrize("factor", [1.0, 0.97, 1.03])
def test_a_refocus_between_the_lens_pictures_and_the_jigs_is_named(factor: float) -> None:
    rng, lens = np.random.default_rng(5), LENS_MODELS["opencv4"]
    intrinsics = np.array([1100.0, 1102.0, 640.0, 362.0, -0.18, 0.06, 7e-4, -5e-4])
    views = views_of(lens, intrinsics, (1280, 720), [pose_towards(rng, 0.16, 0.8) for _ in range(12)], rng, 0.06)
    solution = solve_intrinsics(views, SPEC, "opencv4")
    intrinsics[:2] *= factor
    jig = views_of(lens, intrinsics, (1280, 720), [pose_towards(rng, 0.2, 0.9, 0.1)], rng, 0.06)
    what = Diagnosis("refocused", "the lens is not that of", "take them anew")
    found = focus_changed(solution.camera, [("plane", one) for one in jig], solution.board_shape, what)
    assert [one.grave for one in found] == [True] * (factor != 1.0)
