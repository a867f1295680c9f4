"""The joint solve on stills of the static rod: it recovers what is true, and says how well."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from targets.board import BoardSpec
from vbaa_calib.antenna.rod import solve_rod
from vbaa_calib.calibrate.joint import JointSolution, Observation, Prior, noise_scale, solve_joint
from vbaa_calib.calibrate.plane import BoardPose
from vbaa_calib.calibrate.session_rig import doubts, make_rig, nominal_parameters
from vbaa_calib.camera import Camera
from vbaa_calib.geometry import Kinematics, Pose
from vbaa_calib.reprojection import see
from vbaa_calib.rig import RIG_PARAMETERS, MomentSensor
from vbaa_calib.session import Load, NominalAntenna, Session, Still

from ..rod_scenes import BROWN, GRAVITY_WORLD, LENGTH_M, MATRIX, World, along, camera_pose, gravity_antenna, seen

CAMERA = Camera("opencv", (960, 720), MATRIX, BROWN)
NOMINAL = NominalAntenna(LENGTH_M, 0.8e-3, 193e9, 7900.0)
POSE_COVARIANCE = np.diag([3e-4**2] * 3 + [1e-4**2] * 3)
TRUE = World(camera_pose(0.6, 1.0))
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


def observed(
    world: World, rng: np.random.Generator, sigma_px: float = 0.04, claimed: float = 1.0, points: int = 200
) -> list[Observation]:
    """What the camera sees of the stills, and what the sensor reads; deviations `claimed` times the true ones."""
    s = np.linspace(0.01, 1.0, points) * LENGTH_M
    result = []
    for still in stills():
        gravity = gravity_antenna(still.tilt_rad)
        loaded = isinstance(still, Load)
        force = np.array([0.0, still.force_y_N, still.force_z_N]) if loaded else np.zeros(3)
        contact = still.distance_m if loaded else 0.1
        shape = solve_rod(world.rod, gravity[None], np.array([contact]), force[None])
        pixels = seen(world.T_antenna_camera, along(shape, s)) + rng.normal(0.0, sigma_px, (points, 2))
        sensor = world.sensor
        reading = -sensor.gain * shape.clamp_moment_Nm[0, 1] + sensor.offset_Nm + rng.normal(0.0, sensor.std_Nm)
        points_seen = see(CAMERA, pixels, np.full(points, claimed * sigma_px))
        result.append(Observation(replace(still, moment_Nm=float(reading)), points_seen, gravity))
    return result


def solved(observations: list[Observation], rng: np.random.Generator) -> JointSolution:
    """Solved from a prior pose that is off as its covariance says."""
    start = TRUE.T_antenna_camera.retract(np.sqrt(np.diag(POSE_COVARIANCE)) * rng.normal(size=6))
    prior = Prior(
        start,
        POSE_COVARIANCE,
        mean=np.concatenate([nominal_parameters(NOMINAL), [1.0, 0.0]]),
        std=np.array([1.5e-3] * 2 + [0.035] * 2 + [0.3] * 2 + [0.5, 0.03, 0.5, 0.02]),
    )
    return solve_joint(observations, CAMERA, prior, LENGTH_M, MomentSensor(1.0, 0.0, TRUE.sensor.std_Nm))


def errors(joint: JointSolution) -> np.ndarray:
    """(16,) solved less true; the pose as a step from the true one."""
    turn = joint.T_antenna_camera.rotation @ TRUE.T_antenna_camera.rotation.T
    pose = np.concatenate([Pose(turn, np.zeros(3)).rotvec_rad, np.zeros(3)])
    pose[3:] = joint.T_antenna_camera.translation_m - TRUE.T_antenna_camera.translation_m
    truth = np.concatenate([TRUE.parameters, [TRUE.sensor.gain, TRUE.sensor.offset_Nm]])
    return np.concatenate([pose, joint.parameters[6:] - truth])


@pytest.fixture(scope="module")
def good() -> tuple[JointSolution, list[Observation]]:
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
    correlation = joint.covariance / np.outer(std, std)
    assert np.linalg.eigvalsh(correlation).min() > 0
    whole = errors(joint) @ np.linalg.solve(joint.covariance, errors(joint)) / 16
    assert 0.3 < whole < 2.2
    assert joint.noise_scale == pytest.approx(1.0, abs=0.12)
    np.testing.assert_allclose(joint.point_rms, 1.0, atol=0.25)
    assert np.abs(joint.moment_residuals_Nm).max() < 4 * TRUE.sensor.std_Nm


def test_the_rig_says_what_was_solved(good) -> None:
    joint, observations = good
    rig = make_rig(session(), CAMERA, joint, observations)
    assert rig.antenna.stiffness_Nm2 == pytest.approx(np.exp(joint.parameters[12]))
    assert (rig.moment_sensor.gain, rig.moment_sensor.offset_Nm) == joint.sensor_gain_offset
    # the points' own deviation comes back in pixels, whatever the lens does to it
    assert rig.image.noise_px == pytest.approx(0.04 * joint.noise_scale, rel=0.05)
    assert rig.image.bright
    dark = [replace(observation, bright=False) for observation in observations]
    assert not make_rig(session(), CAMERA, joint, dark).image.bright


def test_deviations_that_claim_too_little_are_found_out() -> None:
    """Pictures that claim half their noise: the scale makes up for it, and the deviations stay what they are."""
    rng = np.random.default_rng(1)
    joint = solved(observed(TRUE, rng, claimed=0.5), rng)
    assert joint.noise_scale == pytest.approx(2.0, rel=0.12)
    np.testing.assert_allclose(joint.point_rms, 1.0, atol=0.25)


def test_noise_that_neighbours_share_counts_when_averaged() -> None:
    rng = np.random.default_rng(2)
    white = [rng.normal(size=500) for _ in range(12)]
    shared = [np.convolve(rng.normal(size=504), np.ones(5) / np.sqrt(5), mode="valid") for _ in range(12)]
    assert noise_scale(white) == pytest.approx(1.0, abs=0.12)
    # means of long runs scatter √5 times as much as independent points would make them
    assert 1.7 < noise_scale(shared) < 2.4
    assert noise_scale([3.0 * values for values in white]) == pytest.approx(3 * noise_scale(white))


def session() -> Session:
    """A session with nothing on disk."""
    board = BoardSpec.from_dict(
        {"type": "charuco", "squares_x": 9, "squares_y": 6, "square_m": 0.012, "marker_m": 0.009}
        | {"dictionary": "DICT_4X4_100", "legacy_pattern": False, "thickness_m": 0.0}
    )
    return Session(Path("."), board, NOMINAL, None, Kinematics(), GRAVITY_WORLD, TRUE.sensor.std_Nm)


def board_pose() -> BoardPose:
    """A board that was seen well."""
    fields = BoardPose.__dataclass_fields__
    known = {"T_camera_board": Pose.identity(), "rms_px": 0.05, "covariance": 1e-10 * np.eye(6)}
    known |= {"second_ratio": 50.0, "lens_sensitivity": np.zeros((6, 8))}
    return BoardPose(**{name: known.get(name) for name in fields})


def named(observations: list[Observation]) -> list[Observation]:
    """The same with pictures that have names."""
    return [
        replace(observation, still=replace(observation.still, image=Path(f"{index:03d}.png")))
        for index, observation in enumerate(observations)
    ]


def found_doubts(observations: list[Observation], rng: np.random.Generator) -> list[str]:
    joint = solved(observations, rng)
    rig = make_rig(session(), CAMERA, joint, observations)
    return doubts(session(), rig, board_pose(), joint, [observation.still for observation in observations])


def test_a_good_calibration_raises_no_doubt(good) -> None:
    _, observations = good
    assert found_doubts(named(observations), np.random.default_rng(3)) == []


def test_a_wrong_row_is_named_and_hardly_moves_the_stiffness(good) -> None:
    """A load's distance noted 6 mm off: the robust solve names it."""
    joint, observations = good
    wrong = named(observations)
    load = wrong[6].still
    assert isinstance(load, Load)
    wrong[6] = replace(wrong[6], still=replace(load, distance_m=load.distance_m + 6e-3))
    lines = found_doubts(wrong, np.random.default_rng(4))
    assert "006.png: left out" in lines[0]
    assert len(lines) == 1
    again = solved(wrong, np.random.default_rng(4))
    assert again.kept.tolist() == [index != 6 for index in range(12)]
    assert again.parameters[12] == pytest.approx(joint.parameters[12], abs=3e-3)
    assert again.noise_scale == pytest.approx(1.0, abs=0.12)


def test_a_wrong_moment_reading_is_named(good) -> None:
    _, observations = good
    wrong = named(observations)
    wrong[8] = replace(wrong[8], still=replace(wrong[8].still, moment_Nm=wrong[8].still.moment_Nm + 1e-3))
    lines = found_doubts(wrong, np.random.default_rng(5))
    assert any("008.png: the moment reading" in line for line in lines)


def test_a_sensor_wired_the_wrong_way_round_is_said() -> None:
    world = replace(TRUE, sensor=MomentSensor(-1.04, 1.5e-4, 2e-5))
    rng = np.random.default_rng(6)
    lines = found_doubts(observed(world, rng), rng)
    assert any("sign" in line for line in lines)


@pytest.mark.slow
def test_the_deviation_of_the_stiffness_is_what_sampling_shows() -> None:
    rng = np.random.default_rng(7)
    exact = observed(TRUE, rng, sigma_px=1e-12, points=60)
    z = []
    for _ in range(12):
        drawn = []
        for observation in exact:
            root = np.linalg.inv(CAMERA.matrix[:2, :2])
            noise = rng.normal(0.0, 0.04, observation.seen.points.shape) @ root.T
            covariance = np.tile(0.04**2 * root @ root.T, (len(noise), 1, 1))
            points = replace(observation.seen, points=observation.seen.points + noise, covariance=covariance)
            still = observation.still
            reading = still.moment_Nm + rng.normal(0.0, TRUE.sensor.std_Nm)
            drawn.append(replace(observation, seen=points, still=replace(still, moment_Nm=reading)))
        joint = solved(drawn, rng)
        mass = RIG_PARAMETERS.index("log_mass_per_length_kg_m")
        whole = errors(joint) @ np.linalg.solve(joint.covariance, errors(joint))
        z.append([errors(joint)[12] / np.sqrt(joint.covariance[12, 12]), whole / 16])
        assert joint.covariance[mass, mass] < 0.03**2
    stiffness, whole = np.array(z).T
    # χ² of 12 draws: 0.3 to 2.2 at 1 %; the whole covariance has 16 times as many
    assert 0.3 < (stiffness**2).mean() < 2.2
    assert 0.7 < whole.mean() < 1.35
