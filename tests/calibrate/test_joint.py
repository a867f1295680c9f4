"""The joint solve on stills of the static rod: it recovers what is true, and says how well."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from vbaa_calib.calibrate.antenna.bundle_adjustment import BundleAdjustment, adjust_bundle, noise_scale
from vbaa_calib.calibrate.antenna.inputs import EXACT, Observation, Prior
from vbaa_calib.calibrate.antenna.session_rig import prior, solve_antenna
from vbaa_calib.calibrate.doubts import _row_doubts as row_doubts
from vbaa_calib.calibrate.doubts import prior_doubts
from vbaa_calib.calibrate.pose.fusion import PoseEstimate
from vbaa_calib.camera import Camera
from vbaa_calib.core.robust import chi_square
from vbaa_calib.diagnose.session import static_frame_diagnoses
from vbaa_calib.geometry import Kinematics, Pose
from vbaa_calib.rig import RIG_PARAMETERS
from vbaa_calib.session import DRIFTS, Drift, Load, LoadReadings, Still

from ..rod_scenes import BROWN, LENGTH_M, MATRIX, World, camera_pose
from . import still_faults
from .clean_sessions import clean_session
from .still_faults import NOMINAL, POSE_COVARIANCE, Faults

CAMERA = Camera("opencv", (960, 720), MATRIX, BROWN)
TRUE = World(camera_pose(0.6, 1.0))
SESSION = still_faults.session()
RULER = LoadReadings(5e-4, 5e-3)
TILTS = (0.0, 0.5, -0.4, 0.9)
LOADS = [(0.12, 0.08), (0.18, -0.04), (0.22, 0.03), (0.15, 0.05)]


def stills() -> list[Still]:
    """Four free frames, and each load along ±y and z."""
    free = [Still(None, 0.0, tilt, 0.0) for tilt in TILTS]
    hung = [
        Load(None, 0.0, TILTS[index % 4], 0.0, distance, size * cos, size * sin)
        for index, (distance, size) in enumerate(LOADS)
        for cos, sin in ((1.0, 0.0), (0.6, 0.8))
    ]
    return [*free, *hung]


def observed(world: World, rng: np.random.Generator, **faults: Any) -> list[Observation]:
    """What the camera sees of the stills, and what the sensor reads, with these `Faults`."""
    exact = {"ruler_std_m": 0.0, "balance_std": 0.0, "points": 200, "sigma_px": 0.04}
    return still_faults.observed(world, stills(), rng, Faults(**exact | faults))


def jig_prior(pose: Pose, camera: Camera = CAMERA, covariance: np.ndarray = POSE_COVARIANCE, **more: Any) -> Prior:
    """What is known before the antenna is looked at, the camera's pose from a jig."""
    return prior(NOMINAL, camera, [PoseEstimate("jig", pose, covariance, np.zeros((6, 8)))], **more)


def start_pose(rng: np.random.Generator) -> Pose:
    """Off the true one as `POSE_COVARIANCE` says."""
    return TRUE.T_antenna_camera.retract(np.sqrt(np.diag(POSE_COVARIANCE)) * rng.normal(size=6))


def adjusted(observations: list[Observation], before: Prior) -> BundleAdjustment:
    return adjust_bundle(observations, before, LENGTH_M, TRUE.sensor.std_Nm)


def solved(observations: list[Observation], rng: np.random.Generator) -> BundleAdjustment:
    """Solved from a prior pose that is off as its covariance says."""
    return adjusted(observations, jig_prior(start_pose(rng)))


def statistic(off: np.ndarray, covariance: np.ndarray) -> float:
    """χ² of errors `off` (n,) over n."""
    return chi_square(off, covariance) / len(off)


def with_tips(tip_m: float, seed: int) -> tuple[BundleAdjustment, BundleAdjustment]:
    """One rig from stills whose camera is known to a millimetre, without and with the antenna's end in them."""
    rng = np.random.default_rng(seed)
    start = TRUE.T_antenna_camera.retract(1e-3 * rng.normal(size=6))
    before = replace(jig_prior(start, covariance=1e-3**2 * np.eye(6), readings=RULER), tip_std_m=5e-5)
    observations = observed(TRUE, rng, tip_m=tip_m)
    blind = [replace(one, tip_std_px=np.nan) for one in observations]
    return adjusted(blind, before), adjusted(observations, before)


def end_variance(joint: BundleAdjustment) -> float:
    """Variance (m²) along the antenna of where the camera's pose puts the end that it sees."""
    pose = joint.T_antenna_camera
    end = pose.inverse() @ np.array([LENGTH_M, 0.0, 0.0])
    moved = [(pose.retract(step) @ end)[0] for step in 1e-6 * np.eye(6)]
    slope = (np.array(moved) - LENGTH_M) / 1e-6
    return float(slope @ joint.covariance[:6, :6] @ slope)


def test_the_antennas_end_tells_where_the_camera_is_along_it() -> None:
    rng = np.random.default_rng(11)
    z, offsets = [], []
    for seed in range(3):
        tip_m = float(5e-5 * rng.normal())
        alone, both = with_tips(tip_m, seed)
        assert alone.tip is None
        z.append(errors(both)[:6] / np.sqrt(np.diag(both.covariance))[:6])
        offsets.append((both.tip.offset_m - tip_m) / both.tip.std_m)
        # of the end in plane C, by the camera's turn and place
        blind, told = (end_variance(each) for each in (alone, both))
        assert told < 0.5 * blind
        whole = np.block(
            [
                [both.covariance, both.tip.covariance[:, None]],
                [both.tip.covariance[None], np.array([[both.tip.std_m**2]])],
            ]
        )
        std = np.sqrt(np.diag(whole))
        assert np.linalg.eigvalsh(whole / np.outer(std, std)).min() > 0
    assert 0.3 < np.mean(np.square(z)) < 2.5
    assert np.sqrt(np.mean(np.square(offsets))) < 2.2


@pytest.mark.parametrize("shared", ["line_px", "light_px"])
def test_errors_that_lines_share_are_in_the_covariance(shared: str) -> None:
    """Lines off by a hundredth of a pixel all along, each of them or all alike: white noise alone claims too much."""
    whole: dict[float, list[float]] = {0.0: [], 0.01: []}
    for seed in range(3):
        rng = np.random.default_rng((12, seed))
        observations = observed(TRUE, rng, **{shared: 0.01})
        for std_px, found in whole.items():
            joint = adjusted(observations, jig_prior(start_pose(rng), drift=Drift(**{shared: std_px})))
            found.append(statistic(errors(joint), joint.covariance))
    assert np.mean(whole[0.0]) > 1.2 * np.mean(whole[0.01])
    assert 0.4 < np.mean(whole[0.01]) < 2.0


def errors(joint: BundleAdjustment) -> np.ndarray:
    """(17,) solved less true; the pose as a step from the true one."""
    pose = joint.T_antenna_camera.tangent_from(TRUE.T_antenna_camera)
    truth = np.concatenate([TRUE.parameters, [TRUE.sensor.gain, TRUE.sensor.offset_Nm]])
    return np.concatenate([pose, joint.parameters[6:] - truth])


@pytest.fixture(scope="module")
def good() -> tuple[BundleAdjustment, list[Observation]]:
    """One good calibration."""
    rng = np.random.default_rng(0)
    observations = observed(TRUE, rng)
    return solved(observations, rng), observations


def test_recovers_the_rig_within_its_deviations(good) -> None:
    joint, _ = good
    std = np.sqrt(np.diag(joint.covariance))
    z = dict(zip(RIG_PARAMETERS, errors(joint) / std, strict=True))
    assert max(map(abs, z.values())) < 3.5, z
    assert std[RIG_PARAMETERS.index("log_stiffness_Nm2")] < 2e-3
    assert np.linalg.eigvalsh(joint.covariance / np.outer(std, std)).min() > 0
    assert 0.3 < statistic(errors(joint), joint.covariance) < 2.2
    assert joint.noise_scale == pytest.approx(1.0, abs=0.12)
    np.testing.assert_allclose(joint.point_rms, 1.0, atol=0.25)
    assert np.abs(joint.moment_residuals_Nm).max() < 4 * TRUE.sensor.std_Nm


def test_deviations_that_claim_too_little_are_found_out() -> None:
    """Pictures that claim half their noise: the scale makes up for it, and the deviations stay what they are."""
    rng = np.random.default_rng(1)
    joint = solved(observed(TRUE, rng, claimed=0.5), rng)
    assert joint.noise_scale == pytest.approx(2.0, rel=0.12)
    np.testing.assert_allclose(joint.point_rms, 1.0, atol=0.25)


def named(observations: list[Observation]) -> list[Observation]:
    """The same with pictures that have names."""
    return [
        replace(observation, still=replace(observation.still, image=Path(f"{index:03d}.png")))
        for index, observation in enumerate(observations)
    ]


def test_a_good_calibration_raises_no_doubt(good) -> None:
    _, observations = good
    joint = solved(named(observations), np.random.default_rng(3))
    found = static_frame_diagnoses(SESSION, Kinematics(), joint)
    found += prior_doubts(joint, found) + row_doubts(joint, found)
    assert [str(one) for one in found if one.severity != "note"] == []


def test_a_lens_that_is_off_is_put_right_by_what_the_antenna_shows() -> None:
    """The lens' doubt takes part: a focal length 2 std off leaves the errors within what is predicted."""
    std = np.array([0.5, 0.5, 0.3, 0.3, 1e-3, 3e-3, 5e-5, 5e-5])
    rng = np.random.default_rng(8)
    step = std * [2.0, 2.0, 0.5, -0.5, 0.3, -0.2, 0.4, 0.1]
    matrix = MATRIX.copy()
    matrix[[0, 1, 0, 1], [0, 1, 2, 2]] += step[:4]
    wrong = Camera("opencv", (960, 720), matrix, BROWN + step[4:], np.diag(std**2))
    observations = observed(TRUE, rng)
    start = start_pose(rng)
    joint = adjusted(observations, jig_prior(start, wrong))
    truth = np.concatenate([MATRIX[[0, 1, 0, 1], [0, 1, 2, 2]], BROWN])
    away = np.concatenate([errors(joint), joint.camera.parameters - truth])
    assert len(joint.covariance) == 25
    assert np.abs(away / np.sqrt(np.diag(joint.covariance))).max() < 3.5
    assert 0.3 < statistic(away, joint.covariance) < 2.0
    # as if it were exact, the same lens throws the stiffness and the pose far off
    stubborn = adjusted(observations, jig_prior(start, replace(wrong, covariance=None)))
    assert statistic(errors(stubborn), stubborn.covariance) > 2.0


@pytest.mark.parametrize("seed", [1, 15, pytest.param(4, marks=pytest.mark.slow)])
def test_a_load_that_contradicts_the_others_is_left_out_though_its_points_fit(seed: int) -> None:
    """Points stated ten times less well than they are do not show it, nor does one load's shape: the stiffness does."""
    drawn = clean_session(seed)
    before = replace(drawn.before, readings=EXACT)
    observations = [replace(one, sigma_px=np.full_like(one.sigma_px, 1.0)) for one in drawn.observations]
    bending = [
        one.still.distance_m**2 * np.hypot(*one.load_N) if isinstance(one.still, Load) else 0.0 for one in observations
    ]
    wrong = int(np.argmax(bending))
    still = observations[wrong].still
    assert isinstance(still, Load)
    noted = replace(still, force_y_N=1.2 * still.force_y_N, force_z_N=1.2 * still.force_z_N)
    observations[wrong] = replace(observations[wrong], still=noted)
    found = solve_antenna(drawn.session, observations, before)
    assert np.flatnonzero(~found.kept).tolist() == [wrong]
    off = found.parameters[RIG_PARAMETERS.index("log_stiffness_Nm2")] - drawn.world.parameters[6]
    assert abs(off) < 3.0 * np.hypot(np.sqrt(found.covariance[12, 12]), 0.005)  # and the weights' own error


@pytest.mark.parametrize("seed", [25, 26, 31])
def test_a_thread_over_the_antenna_is_left_out_and_its_load_stays(seed: int) -> None:
    """The load's row is right, its picture disturbed where the thread crosses the line."""
    rng = np.random.default_rng(seed)
    observations = observed(TRUE, rng)
    before = jig_prior(start_pose(rng), drift=DRIFTS["lab"])
    clean = adjusted(observations, before)
    assert not any(clean.disturbed)
    for index in (5, 9):
        points = observations[index].points_px.copy()
        points += 0.6 * np.exp(-(((np.arange(len(points)) - 120) / 10.0) ** 2))[:, None] * [0.3, 1.0]
        observations[index] = replace(observations[index], points_px=points)
    joint = adjusted(observations, before)
    assert joint.kept.all()
    assert [index for index, count in enumerate(joint.disturbed) if count] == [5, 9]
    named = [one for one in row_doubts(joint, ()) if one.name == "line_disturbed"]
    assert [one.severity for one in named] == ["note", "note"]
    moved = (joint.parameters - clean.parameters) / np.sqrt(np.diag(clean.covariance)[:17])
    assert np.abs(moved).max() < 1.0


def test_lines_that_state_too_much_do_not_make_the_others_surer() -> None:
    """Two thin lines along rows of seven lines: their errors are shared, and stated four times too large."""
    rng = np.random.default_rng(3)
    lines = [rng.normal(0.0, size, 300) for size in (1.0, 0.25, 1.0, 1.0, 0.25, 1.0, 1.0)]
    assert noise_scale(lines) == pytest.approx(1.0, abs=0.1)
    assert noise_scale([3.0 * one for one in lines]) == pytest.approx(3.0 * noise_scale(lines))


def test_what_no_parameter_explains_widens_the_covariance() -> None:
    """Lines that are off by ten times what is allowed for; a clean session's covariance stays."""
    found = []
    for seed in range(2, 5):
        rng = np.random.default_rng((22, seed))
        observations = observed(TRUE, rng, line_px=0.03)
        joint = adjusted(observations, jig_prior(start_pose(rng), drift=Drift(line_px=0.003)))
        assert joint.scatter > 1.5
        found.append(statistic(errors(joint), joint.covariance))
        clean = adjusted(observed(TRUE, rng, line_px=0.003), jig_prior(start_pose(rng), drift=Drift(line_px=0.003)))
        assert clean.scatter < 1.15
        assert np.all(np.diag(joint.covariance)[:17] > np.diag(clean.covariance)[:17])
    assert 0.3 < np.mean(found) < 2.5


@pytest.mark.parametrize(("modulus", "density"), [(3.0, 1140.0), (60.0, 6450.0), (400.0, 9000.0)])
def test_a_wrongly_stated_material_changes_neither_ei_nor_weight(modulus: float, density: float) -> None:
    """A prior of 3 % on the weight would hold it: the noise is scaled by what the pictures miss the model by."""
    rng = np.random.default_rng(3)
    stated = replace(NOMINAL, youngs_modulus_Pa=1e9 * modulus, density_kg_m3=density)
    joint = solve_antenna(SESSION, observed(TRUE, rng), prior(stated, CAMERA, jig_prior(start_pose(rng)).poses))
    assert joint.kept.all()
    assert (np.abs(errors(joint)) < 4.0 * np.sqrt(np.diag(joint.covariance)))[12:14].all()
