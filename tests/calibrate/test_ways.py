"""Several ways to plane C: agreement, contradiction, and what they say together."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from vbaa_calib.calibrate.pose.board_pose import BoardPose, jig_estimate
from vbaa_calib.calibrate.pose.fusion import PoseEstimate, differences, fused, require_agreement
from vbaa_calib.core.errors import InputError
from vbaa_calib.geometry import Pose

TRUE = Pose.from_rotvec(np.array([2.9, 0.2, -0.4]), np.array([0.1, 0.02, 0.35]))
LENS = np.diag([0.5, 0.5, 0.8, 0.8]) ** 2


def spread(rng: np.random.Generator) -> np.ndarray:
    """A covariance of a tenth of a millimetre and of a milliradian, with correlations."""
    root = np.diag([1e-3] * 3 + [1e-4] * 3) @ (np.eye(6) + 0.3 * rng.normal(size=(6, 6)))
    return root @ root.T


def drawn(way: str, rng: np.random.Generator, lens_step: np.ndarray) -> PoseEstimate:
    """An estimate that is off as it says, by its own noise and by the lens."""
    covariance, sensitivity = spread(rng), 1e-4 * rng.normal(size=(6, 4))
    off = np.linalg.cholesky(covariance) @ rng.normal(size=6) + sensitivity @ lens_step
    return PoseEstimate(way, TRUE.retract(off), covariance, sensitivity)


def test_honest_ways_differ_as_predicted() -> None:
    rng = np.random.default_rng(0)
    found = []
    for _ in range(400):
        step = np.sqrt(np.diag(LENS)) * rng.normal(size=4)
        one, other = (drawn(way, rng, step) for way in ("jig", "sweep"))
        found.append(differences([one, other], LENS)[0].statistic)
    # χ² of 6 degrees of freedom: its mean over 400 draws has a deviation of 0.17
    assert np.mean(found) == pytest.approx(6.0, abs=0.6)


def test_the_way_that_stands_alone_is_named() -> None:
    rng = np.random.default_rng(2)
    ways = [drawn(way, rng, np.zeros(4)) for way in ("jig", "sweep", "over board")]
    require_agreement(differences(ways, LENS), "session")
    moved = replace(ways[1], T_antenna_camera=ways[1].T_antenna_camera.retract(np.array([0, 0, 0, 0, 5e-3, 0])))
    with pytest.raises(InputError, match="sweep stands alone") as caught:
        require_agreement(differences([ways[0], moved, ways[2]], LENS), "session")
    assert "jig and sweep differ by" in str(caught.value)
    with pytest.raises(InputError, match="one of them is wrong"):
        require_agreement(differences([ways[0], moved], LENS), "session")


def test_fusing_weighs_each_way_by_what_it_is_worth() -> None:
    rng = np.random.default_rng(3)
    scores = []
    for _ in range(300):
        ways = [drawn(way, rng, np.zeros(4)) for way in ("jig", "sweep", "over board")]
        covariance = np.linalg.inv(np.sum([np.linalg.inv(way.covariance) for way in ways], axis=0))
        off = fused(ways).tangent_from(TRUE)
        scores.append(off @ np.linalg.solve(covariance, off))
    assert np.mean(scores) == pytest.approx(6.0, abs=0.7)


def test_the_jig_carries_board_lens_and_its_own_doubt_to_the_camera() -> None:
    rng = np.random.default_rng(5)
    T_antenna_board = Pose.from_rotvec(rng.normal(size=3), 0.1 * rng.normal(size=3))
    T_camera_board = Pose.from_rotvec(rng.normal(size=3), np.array([0.02, -0.01, 0.4]))
    covariance, sensitivity = spread(rng), 1e-4 * rng.normal(size=(6, 4))
    board = BoardPose(T_camera_board, covariance, sensitivity, 0.1, 40, 0, None)
    found = jig_estimate(board, T_antenna_board, translation_std_m=2e-4, rotation_std_rad=1e-3)
    off, by_lens = [], []
    for _ in range(4000):
        moved = T_camera_board.retract(np.linalg.cholesky(covariance) @ rng.normal(size=6))
        held = T_antenna_board.retract(np.repeat([1e-3, 2e-4], 3) * rng.normal(size=6))
        off.append((held @ moved.inverse()).tangent_from(found.T_antenna_camera))
    for column in sensitivity.T:
        step = T_camera_board.retract(1e-3 * column)
        by_lens.append((T_antenna_board @ step.inverse()).tangent_from(found.T_antenna_camera) / 1e-3)
    sampled = np.cov(np.array(off).T)
    scale = np.sqrt(np.outer(np.diag(sampled), np.diag(sampled)))
    np.testing.assert_allclose(found.covariance / scale, sampled / scale, atol=0.08)
    np.testing.assert_allclose(found.lens_sensitivity, np.array(by_lens).T, atol=1e-6)
