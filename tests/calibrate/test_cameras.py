"""Several cameras in one solve: what they share counts once, and the common covariance says how wrong it is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from vbaa_calib.calibrate.antenna.bundle_adjustment import BundleAdjustment, adjust_bundle
from vbaa_calib.calibrate.antenna.inputs import Observation
from vbaa_calib.calibrate.antenna.session_rig import prior
from vbaa_calib.calibrate.pose.fusion import PoseEstimate
from vbaa_calib.camera import Camera
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.robust import chi_square
from vbaa_calib.rig import RIG_PARAMETERS
from vbaa_calib.session import Load, LoadReadings, Still

from ..rod_scenes import BROWN, LENGTH_M, MATRIX, World, camera_pose
from . import still_faults
from .still_faults import NOMINAL, POSE_COVARIANCE, Faults

WORLDS = (World(camera_pose(0.6, 1.0)), World(camera_pose(0.7, -1.2)))
READINGS = LoadReadings(5e-4, 5e-3)
LENS_STD = np.array([0.5, 0.5, 0.3, 0.3, 1e-3, 3e-3, 5e-5, 5e-5])
JIG_STD = np.array([5e-4] * 3 + [2e-4] * 3)
OWN = 0.1 * POSE_COVARIANCE
TIP_STD_M = 2e-4
NOTED = [
    *(Still(None, 0.0, tilt, 0.0) for tilt in (0.0, 0.5, -0.4)),
    *(
        Load(None, 0.0, 0.0, 0.0, distance, size * cos, size * sin)
        for distance, size in ((0.12, 0.08), (0.18, -0.04), (0.22, 0.03))
        for cos, sin in ((1.0, 0.0), (0.6, 0.8))
    ),
]
EI = RIG_PARAMETERS.index("log_stiffness_Nm2")


def seen_by_both(rng: np.random.Generator, tip_m: float | None) -> list[list[Observation]]:
    """What each camera sees of the same loads, which are not quite what was noted, with the same readings."""
    off = rng.normal(size=(2, len(NOTED)))
    hung = [
        replace(
            one,
            distance_m=min(one.distance_m + READINGS.distance_std_m * off[0, index // 2], LENGTH_M),
            force_y_N=one.force_y_N * np.exp(READINGS.force_std_relative * off[1, index // 2]),
            force_z_N=one.force_z_N * np.exp(READINGS.force_std_relative * off[1, index // 2]),
        )
        if isinstance(one, Load)
        else one
        for index, one in enumerate(NOTED, 1)
    ]
    faults = Faults(ruler_std_m=0.0, balance_std=0.0, tip_m=tip_m)
    both = [still_faults.observed(world, hung, rng, faults) for world in WORLDS]
    read = [replace(row, moment_Nm=one.still.moment_Nm) for row, one in zip(NOTED, both[0], strict=True)]
    return [[replace(one, still=still) for one, still in zip(seen, read, strict=True)] for seen in both]


def calibrated(seed: int) -> tuple[list[BundleAdjustment], np.ndarray]:
    """Each camera by itself, of lenses and a jig that are off as they say; and true lenses and tip."""
    rng = np.random.default_rng((7, seed))
    slip, tip_m = JIG_STD * rng.normal(size=6), float(TIP_STD_M * rng.normal())
    alone, lenses = [], []
    for world, observations in zip(WORLDS, seen_by_both(rng, tip_m), strict=True):
        at = world.T_antenna_camera
        lever = np.cross(at.translation_m, np.eye(3)).T
        by_jig = np.block([[np.eye(3), np.zeros((3, 3))], [lever, np.eye(3)]]) * JIG_STD
        own = np.sqrt(np.diag(OWN)) * rng.normal(size=6)
        start = at.retract(by_jig @ (slip / JIG_STD) + own)
        off = LENS_STD * rng.normal(size=8)
        matrix = MATRIX.copy()
        matrix[[0, 1, 0, 1], [0, 1, 2, 2]] += off[:4]
        camera = Camera("opencv", (960, 720), matrix, BROWN + off[4:], np.diag(LENS_STD**2))
        covariance = OWN + by_jig @ by_jig.T
        estimate = PoseEstimate("jig", start, covariance, np.zeros((6, 8)), by_jig)
        before = replace(prior(NOMINAL, camera, [estimate], readings=READINGS), tip_std_m=TIP_STD_M)
        alone.append(adjust_bundle(observations, before, LENGTH_M, world.sensor.std_Nm))
        lenses.append(np.concatenate([MATRIX[[0, 1, 0, 1], [0, 1, 2, 2]], BROWN]))
    return alone, np.array([*lenses, np.full(8, tip_m)])


def by_name(alone: list[BundleAdjustment]) -> list[BundleAdjustment]:
    """All of them in one solve."""
    return list(BundleAdjustment.together(dict(zip(("left", "right"), alone, strict=False))).values())


def errors(solved: BundleAdjustment, world: World, lens: np.ndarray, tip_m: float) -> np.ndarray:
    """(26,) of rig, lens and tip."""
    truth = np.concatenate([world.parameters, [world.sensor.gain, world.sensor.offset_Nm]])
    pose = solved.T_antenna_camera.tangent_from(world.T_antenna_camera)
    off = np.concatenate([pose, solved.parameters[6:] - truth, solved.camera.parameters - lens])
    return np.append(off, 0.0 if solved.tip is None else solved.tip.offset_m - tip_m)


def whole(solved: BundleAdjustment) -> np.ndarray:
    """(26, 26) covariance with the tip."""
    assert solved.tip is not None
    return solved.tip.joint_with(solved.covariance)


@pytest.mark.parametrize("draws", [4, pytest.param(40, marks=pytest.mark.slow)])
def test_the_common_covariance_is_that_of_the_errors(draws: int) -> None:
    """χ² over its degrees of freedom is 1, of each camera's errors; EI is known better than by either alone."""
    squares, gains = [], []
    for seed in range(draws):
        alone, (*lenses, tip) = calibrated(seed)
        together = by_name(alone)
        for one, world, lens in zip(together, WORLDS, lenses, strict=True):
            off = errors(one, world, lens, float(tip[0]))
            squares.append(chi_square(off, whole(one)) / len(off))
        gains.append(together[0].covariance[EI, EI] / min(one.covariance[EI, EI] for one in alone))
        shared = slice(6, 17)
        np.testing.assert_allclose(together[0].covariance[shared, shared], together[1].covariance[shared, shared])
    assert 1.0 - 3.0 / np.sqrt(13.0 * draws) < np.mean(squares) < 1.0 + 3.0 / np.sqrt(13.0 * draws)
    assert np.mean(gains) < 0.95


def test_what_both_share_counts_once() -> None:
    """One camera alone is what it was; a second one that repeats its pictures, readings and jig adds no reading: the
    sensor's gain, which these determine, is no better known."""
    alone, _ = calibrated(0)
    (same,) = by_name(alone[:1])
    std = np.sqrt(np.diag(whole(alone[0])))
    assert (np.abs(same.parameters - alone[0].parameters) < 1e-3 * std[:17]).all()
    np.testing.assert_allclose(whole(same) / np.outer(std, std), whole(alone[0]) / np.outer(std, std), atol=1e-3)
    twice, gain = by_name([alone[0], alone[0]])[0], RIG_PARAMETERS.index("moment_gain")
    assert twice.covariance[gain, gain] > 0.9 * alone[0].covariance[gain, gain]


def test_another_antenna_is_no_further_camera() -> None:
    alone, _ = calibrated(1)
    assert by_name([replace(one, tip=None) for one in alone])[1].tip is None
    step = np.zeros(17)
    step[EI] = 0.2
    other = replace(alone[1], parameters=alone[1].parameters + step)
    with pytest.raises(InputError, match="right finds another antenna than left, most of all log_stiffness"):
        by_name([alone[0], other])
