"""No moment sensor, and one of several axes: what the pictures determine without, its turn, gains, zeros and faults."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import inf, nan

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from vbaa_calib.antenna.rod import solve_rod
from vbaa_calib.calibrate.antenna.bundle_adjustment import BundleAdjustment
from vbaa_calib.calibrate.antenna.inputs import Observation
from vbaa_calib.calibrate.antenna.residual_checks import check
from vbaa_calib.calibrate.antenna.session_rig import make_rig, prior, read_by, solve_antenna
from vbaa_calib.calibrate.check.antenna import check_stills
from vbaa_calib.calibrate.pose.fusion import PoseEstimate
from vbaa_calib.diagnose.session import static_frame_diagnoses
from vbaa_calib.geometry import Kinematics, Pose
from vbaa_calib.rig import Rig
from vbaa_calib.session import READINGS, Load, NominalWrenchSensor, Session, Still
from vbaa_calib.simulate.scene.scene import WrenchSpec

from ..rod_scenes import LENGTH_M
from .clean_sessions import CleanSession, clean_session
from .still_faults import NOMINAL, POSE_COVARIANCE
from .test_joint import CAMERA, SESSION, TRUE, observed, start_pose


def without_sensor(drawn: CleanSession) -> CleanSession:
    """The same pictures, nothing read with them."""
    unread = [replace(one, still=replace(one.still, moment_Nm=nan)) for one in drawn.observations]
    return replace(drawn, session=replace(drawn.session, moment_std_Nm=inf), observations=unread)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_no_sensor_is_one_that_tells_nothing(seed: int) -> None:
    """As the sensor's noise grows without bound, pose, antenna and covariance go to those without a sensor."""
    drawn = clean_session(seed)
    silent = without_sensor(drawn)
    alone = solve_antenna(silent.session, silent.observations, silent.before)
    noisy = solve_antenna(replace(drawn.session, moment_std_Nm=1e6), drawn.observations, drawn.before)
    rig = slice(0, 15)
    std = np.sqrt(np.diag(noisy.covariance))[rig]
    np.testing.assert_allclose(alone.parameters[rig] / std, noisy.parameters[rig] / std, atol=1e-3)
    np.testing.assert_allclose(np.sqrt(np.diag(alone.covariance))[rig], std, rtol=1e-4)


@pytest.mark.parametrize(("first", "count"), [(0, 2), pytest.param(2, 10, marks=pytest.mark.slow)])
def test_the_rig_is_honest_and_can_be_stored(first: int, count: int) -> None:
    """EI within its deviation over drawn rigs; the stored rig says null and comes back the same; nothing is doubted."""
    off = []
    for seed in range(first, first + count):
        drawn = clean_session(seed)
        silent = without_sensor(drawn)
        joint = solve_antenna(silent.session, silent.observations, silent.before)
        rig = make_rig(silent.session, Kinematics(), joint, silent.observations)
        log_stiffness = np.log(rig.antenna.stiffness_Nm2)
        off.append((log_stiffness - drawn.world.parameters[6]) / rig.std("log_stiffness_Nm2"))
        assert not any(one.grave for one in static_frame_diagnoses(silent.session, Kinematics(), joint))
        assert check(joint)["noise_Nm"] is None
        data = rig.to_dict()
        again = Rig.from_dict(data)
        assert data["moment_sensor"] is None
        assert not again.moment_sensor.exists
        assert not rig.covariance[15:17].any()
        assert not rig.drifted().covariance[15:17].any()
        assert again.to_dict()["moment_sensor"] is None
        np.testing.assert_array_equal(again.covariance, rig.covariance)
    assert np.abs(off).max() < 3.5


STATED = Pose(Rotation.from_rotvec([0.0, -np.pi / 2, 0.0]).as_matrix(), np.array([-0.01, 0.002, 0.0]))
TURN_RAD = np.array([0.02, -0.024, 0.016])
ALL = ("fx", "fy", "fz", "mx", "my", "mz")


def session_of(components: tuple[str, ...]) -> Session:
    nominal = NominalWrenchSensor(list(components), 1e-3, 2e-5, STATED)
    std_Nm = 2e-5 if {"my", "-my"} & {*components} else np.inf
    return replace(SESSION, wrench_sensor=nominal, moment_std_Nm=std_Nm)


def felt(sensor: WrenchSpec, observations: list[Observation], rng: np.random.Generator) -> list[Observation]:
    """The same with what a sensor reads under the true loads, which the session notes exactly."""
    gravity = np.array([one.gravity_m_s2 for one in observations])
    loads = np.array([[0.0, *one.load_N] for one in observations])
    hung = [one.still.distance_m if isinstance(one.still, Load) else 0.5 * LENGTH_M for one in observations]
    shape, rod = solve_rod(TRUE.rod, gravity, np.array(hung), loads), TRUE.rod
    force = loads + rod.mass_per_length_kg_m * rod.length_m * gravity
    read = sensor.read(sensor.true(force, shape.clamp_moment_Nm), rng)
    columns = [READINGS[name] for name in sensor.components]
    nothing = {"moment_Nm": np.nan}
    return [
        replace(one, still=replace(one.still, **nothing | dict(zip(columns, row, strict=True))))
        for one, row in zip(observations, read.tolist(), strict=True)
    ]


def adjusted(
    components: tuple[str, ...], seed: int, fault: Callable[[Still], Still] = lambda still: still
) -> tuple[Session, BundleAdjustment, WrenchSpec, Rig]:
    rng, session = np.random.default_rng(seed), session_of(components)
    sensor = WrenchSpec(components, std_N=1e-3, T_antenna_sensor=STATED, turn_rad=TURN_RAD)
    observations = felt(sensor, observed(TRUE, rng), rng)
    observations = [replace(one, still=fault(one.still)) for one in observations]
    estimate = PoseEstimate("jig", start_pose(rng), POSE_COVARIANCE, np.zeros((6, 8)))
    before = read_by(session.wrench_sensor, prior(NOMINAL, CAMERA, [estimate]))
    joint = solve_antenna(session, observations, before)
    return session, joint, sensor, make_rig(session, Kinematics(), joint, observations)


@pytest.mark.parametrize("components", [ALL, ("my", "mz"), ("fy", "fz")], ids=lambda names: "-".join(names))
def test_turn_gains_and_zeros_are_found_as_well_as_stated(components: tuple[str, ...]) -> None:
    square = []
    for seed in range(4):
        _, _, sensor, rig = adjusted(components, seed)
        found = rig.wrench_sensor
        assert found is not None
        turn = Rotation.from_matrix(found.T_antenna_sensor.rotation @ STATED.rotation.T).as_rotvec() - TURN_RAD
        forces = np.array([name.startswith("f") for name in found.components])
        zero = np.where(forces, sensor.offset_N, sensor.offset_Nm)
        off = np.concatenate([turn, found.gain - sensor.gain, found.offset - zero])
        std = np.sqrt(np.diag(found.own_covariance))
        assert (np.abs(off) < 3.5 * std).all(), off / std
        square.append((off / std) ** 2)
        whole = np.sqrt(np.diag(rig.covariance_with_tip))
        scaled = rig.covariance_with_tip / np.outer(whole, whole).clip(1e-300)
        assert np.linalg.eigvalsh(scaled)[0] > -1e-9
        if "my" in components:
            assert rig.moment_sensor.gain == pytest.approx(-sensor.gain, abs=4.0 * rig.std("moment_gain"))
        else:
            assert not rig.moment_sensor.exists
    assert 0.3 < np.mean(square) < 2.0


def test_a_rig_that_did_not_change_passes_the_check() -> None:
    _, joint, _, rig = adjusted(ALL, 6)
    checked = check_stills(rig, joint.noted)
    off = np.array([one.moment_residual_Nm for one in checked])
    assert np.abs(off).max() < 5.0 * 2e-5
    assert {one.jacobian.shape[1] for one in checked} == {17 + 8}


def exchanged(first: str, second: str) -> Callable[[Still], Still]:
    a, b = READINGS[first], READINGS[second]
    return lambda still: replace(still, **{a: getattr(still, b), b: getattr(still, a)})


def turned(name: str) -> Callable[[Still], Still]:
    return lambda still: replace(still, **{READINGS[name]: -getattr(still, READINGS[name])})


@pytest.mark.parametrize(
    ("fault", "name", "words"),
    [
        (lambda still: still, "", ()),
        (exchanged("fx", "fy"), "sensor_exchanged", ("sensor_force_x_N", "sensor_force_y_N")),
        (exchanged("my", "mz"), "sensor_exchanged", ("moment_Nm", "moment_z_Nm")),
        (turned("fy"), "sensor_sign", ("sensor_force_y_N",)),
        (turned("my"), "sensor_sign", ("moment_Nm",)),
    ],
    ids=["none", "fx for fy", "my for mz", "−fy", "−my"],
)
def test_exchanged_channels_and_signs_are_named(
    fault: Callable[[Still], Still], name: str, words: tuple[str, ...]
) -> None:
    session, joint, _, _ = adjusted(ALL, 7, fault)
    found = [one for one in static_frame_diagnoses(session, Kinematics(), joint) if one.name.startswith("sensor")]
    assert [one.name for one in found[:1]] == [name] * bool(name)
    for word in words:
        assert word in found[0].words
