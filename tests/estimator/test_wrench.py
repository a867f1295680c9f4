"""A sensor of several axes at the clamp: contacts by any of its components, against SciPy's fit of the static rod."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from estimator.solver.frames import frames_from_pixels
from estimator.solver.ladder import solve
from estimator.solver.numbers import FitNumbers
from estimator.solver.rig_arrays import RigArrays
from vbaa_calib.antenna.rod import RodShape
from vbaa_calib.geometry import Pose
from vbaa_calib.rig import MomentSensor, Rig, WrenchSensor
from vbaa_calib.session import READINGS

from ..rod_scenes import (
    LENGTH_M,
    RIG_STD,
    SIGMA_PX,
    UNIT_N,
    Frame,
    Guess,
    World,
    camera_pose,
    fitted,
    frames,
    gravity_antenna,
    press,
    pushing,
)

WORLD, FORCE_N, MOMENT_NM = World(camera_pose(0.7, 0.8)), 1e-3, 2e-5
MOUNTED = Pose(Rotation.from_rotvec([0.4, -1.2, 0.3]).as_matrix(), np.array([-0.012, 0.004, 0.003]))
ALL = tuple(READINGS)


@dataclass(frozen=True, eq=False)
class Sensor:
    """The truth, written down again: right-handed components (C,) in its own axes, about its own origin."""

    components: tuple[str, ...]
    pose: Pose
    gain: np.ndarray
    offset: np.ndarray

    @staticmethod
    def of(components: tuple[str, ...], pose: Pose = MOUNTED) -> Sensor:
        count = len(components)
        return Sensor(components, pose, np.linspace(0.97, 1.05, count), 1e-4 * np.arange(count))

    @property
    def std(self) -> np.ndarray:
        return np.array([FORCE_N if name[0] == "f" else MOMENT_NM for name in self.components])

    @property
    def parameter_std(self) -> np.ndarray:
        """Of turn, gains and offsets after a calibration."""
        return np.concatenate([np.full(3, 3e-3), np.full(len(self.gain), 2e-3), 0.2 * self.std])

    def moved(self, step: np.ndarray) -> Sensor:
        count = len(self.gain)
        turn = Rotation.from_rotvec(step[:3]).as_matrix() @ self.pose.rotation
        pose = Pose(turn, self.pose.translation_m)
        return replace(self, pose=pose, gain=self.gain + step[3 : 3 + count], offset=self.offset + step[3 + count :])

    def read(self, force_N: np.ndarray, moment_Nm: np.ndarray) -> np.ndarray:
        """(C,) of a load's force and moment about the antenna's origin."""
        about = moment_Nm - np.cross(self.pose.translation_m, force_N)
        force, moment = self.pose.rotation.T @ force_N, self.pose.rotation.T @ about
        own = {f"f{axis}": value for axis, value in zip("xyz", force, strict=True)}
        own |= {f"m{axis}": value for axis, value in zip("xyz", moment, strict=True)}
        return self.gain * [own[name] for name in self.components] + self.offset

    def rig(self, std: np.ndarray) -> Rig:
        """What a calibration free of error would have found."""
        rig, other = WORLD.rig(std), [name != "my" for name in self.components]
        count, own, size = sum(other), self.parameter_std, len(rig.covariance)
        kept = np.concatenate([np.ones(3, bool), other, other])
        covariance = np.hstack([np.zeros((3 + 2 * count, size)), np.diag(own[kept] ** 2)])
        names = tuple(np.array(self.components)[other])
        more = WrenchSensor(names, self.gain[other], self.offset[other], self.std[other], self.pose, covariance)
        joint, moment = rig.covariance.copy(), MomentSensor.none()
        if "my" in self.components:
            my = self.components.index("my")
            moment = MomentSensor(-self.gain[my], self.offset[my], MOMENT_NM)
            joint[-2, -2], joint[-1, -1] = own[3 + my] ** 2, own[3 + len(other) + my] ** 2
        else:
            joint[-2:] = joint[:, -2:] = 0.0
        return replace(rig, moment_sensor=moment, wrench_sensor=more, covariance=joint)


def pressed(world: World, one: Frame, distance: float, push_N: np.ndarray) -> tuple[RodShape, np.ndarray, np.ndarray]:
    """The rod, the contact's force, and force and moment of that and the weight (6,)."""
    gravity = gravity_antenna(one.tilt_rad)
    shape, force = press(world.rod, gravity[None], np.array([distance]) * LENGTH_M, push_N[None])
    weight = np.exp(world.parameters[7]) * LENGTH_M * gravity
    return shape, force[0], np.concatenate([force[0] + weight, shape.clamp_moment_Nm[0]])


def solved(several: list[Frame], readings: np.ndarray, rig: Rig, sensor: Sensor) -> FitNumbers:
    """What the core says; readings (B, C) of the sensor's components."""
    every = np.full((len(several), len(READINGS)), np.nan)
    every[:, [ALL.index(name) for name in sensor.components]] = readings
    points = np.stack([one.points_px for one in several])
    gravity = np.stack([gravity_antenna(one.tilt_rad) for one in several])
    tips, sigma = np.full((len(several), 3), np.nan), np.full(points.shape[:2], SIGMA_PX)
    return solve(frames_from_pixels(RigArrays.from_rig(rig, 0.0), points, sigma, every, tips, gravity), "rod")


@pytest.mark.parametrize(
    "components", [ALL, ("my", "mz"), ("fy", "fz"), ("mx", "fz"), ("my", "mz", "fx")], ids=lambda names: "-".join(names)
)
@pytest.mark.parametrize(
    ("contact", "roll", "tip_m"), [(0.55, 0.6, 0.02), pytest.param(0.8, -1.2, 0.05, marks=pytest.mark.slow)]
)
def test_scipy_ends_at_the_same_minimum(components: tuple[str, ...], contact: float, roll: float, tip_m: float) -> None:
    """The same distance, force and standard deviations, which are Cramér and Rao's."""
    rng, lateral, sensor = np.random.default_rng(4), pushing(roll, tip_m, contact * LENGTH_M), Sensor.of(components)
    std = 0.3 * RIG_STD
    steps = rng.normal(size=15 + len(sensor.parameter_std))
    world = WORLD.moved(np.append(std[:15] * steps[:15], np.zeros(2)))
    one = frames(world, [contact * LENGTH_M], [lateral.tolist()], [0.3], rng, points=100)[0]
    load = pressed(world, one, contact, lateral)[2]
    reads = sensor.moved(sensor.parameter_std * steps[15:])
    readings = reads.read(load[:3], load[3:]) + sensor.std * rng.normal(size=len(components))
    numbers = solved([one], readings[None], sensor.rig(std), sensor)
    whole = np.concatenate([std[:15], sensor.parameter_std])

    def at(x: np.ndarray) -> Guess:
        step = whole * x[3:]
        moved = WORLD.moved(np.append(step[:15], np.zeros(2)))
        shape, force, load = pressed(moved, one, x[0], UNIT_N * x[1:3])
        read = sensor.moved(step[15:]).read(load[:3], load[3:])
        return moved.T_antenna_camera, shape, force, (readings - read) / sensor.std

    touch, deviations, _ = fitted(one, np.array([contact, *lateral / UNIT_N, *steps]), at)
    answer = np.append(numbers.unknowns[0, 0], numbers.force_N[0, 1:])
    said = np.append(numbers.std[0, 0], np.sqrt(np.diag(numbers.covariance[0])[4:]))
    assert (np.abs(answer - touch) < 0.02 * deviations).all()
    np.testing.assert_allclose(said, deviations, rtol=0.02)


@pytest.mark.parametrize("components", [ALL, ("my", "mz"), ("fx", "fy", "fz")], ids=lambda names: "-".join(names))
def test_errors_are_as_large_as_stated(components: tuple[str, ...]) -> None:
    """Distance and force of drawn frames of drawn rigs: their errors in the stated standard deviations are normal."""
    rng, sensor, std, count = np.random.default_rng(9), Sensor.of(components), 0.3 * RIG_STD, 160
    drawn = []
    for _ in range(count):
        steps = rng.normal(size=15 + len(sensor.parameter_std))
        world = WORLD.moved(np.append(std[:15] * steps[:15], np.zeros(2)))
        contact, tip_m = rng.uniform(0.4, 0.9), rng.uniform(0.01, 0.05)
        lateral = pushing(rng.uniform(-np.pi, np.pi), tip_m, contact * LENGTH_M)
        one = frames(world, [contact * LENGTH_M], [lateral.tolist()], [0.3], rng, points=100)[0]
        _, force, load = pressed(world, one, contact, lateral)
        reads = sensor.moved(sensor.parameter_std * steps[15:])
        readings = reads.read(load[:3], load[3:]) + sensor.std * rng.normal(size=len(components))
        drawn.append((one, readings, contact, force))
    several, readings, contacts, forces = zip(*drawn, strict=True)
    found = solved(list(several), np.array(readings), sensor.rig(std), sensor)
    errors = (found.force_N - np.array(forces))[:, 1:]
    squares = np.einsum("fi,fij,fj->f", errors, np.linalg.inv(found.covariance[:, 4:, 4:]), errors) / 2.0
    off = np.column_stack([(found.unknowns[:, 0] - contacts) / found.std[:, 0], np.sqrt(squares)])
    rms = np.sqrt(np.mean(np.square(off), axis=0))
    assert (np.abs(rms - 1.0) < 0.15).all(), rms
    assert np.abs(off).max() < 4.5


def test_a_rig_with_a_wrench_sensor_is_written_and_read_again(tmp_path) -> None:
    rig = Sensor.of(ALL).rig(RIG_STD)
    rig.save(tmp_path / "rig.json")
    again = Rig.load(tmp_path / "rig.json")
    np.testing.assert_allclose(again.covariance_with_tip, rig.covariance_with_tip)
    assert again.columns == rig.columns == tuple(READINGS.values())
    step = np.sqrt(np.diag(rig.covariance_with_tip))
    more = again.moved(step).wrench_sensor
    assert more is not None
    np.testing.assert_allclose(more.gain, rig.wrench_sensor.gain + step[-10:-5])
    assert np.linalg.eigvalsh(again.drifted().covariance_with_tip)[0] > -1e-12
