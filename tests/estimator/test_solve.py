"""The solver of a frame: its laws, its ladder, what else would explain a frame, friction, and second contacts."""

from __future__ import annotations

import re
from functools import cache

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from benchmarks.estimator.scenes import Scenes
from estimator import Contact, ContactEstimator
from estimator.contact.contacts import Contacts
from estimator.contact.settings import ContactSettings
from estimator.table.contacts import LOCATED, STATUSES
from vbaa_calib.antenna.linear import deflection
from vbaa_calib.antenna.rungs import RUNGS
from vbaa_calib.native import core
from vbaa_calib.rig import Rig

from ..rod_scenes import LENGTH_M, RIG_STD, STIFFNESS_NM2, World, camera_pose
from ..rod_scenes import seen as pictured
from .contact_scenes import STRAIGHT, WORLD, answered, fitted_std, frame, rubbed, scene_deviations, withheld


def quietly(examples: int) -> settings:
    """The same so many examples every time, however long they take."""
    slow = [HealthCheck.too_slow]
    return settings(deadline=None, max_examples=examples, derandomize=True, suppress_health_check=slow, database=None)


FEW, MANY = quietly(3), quietly(60)


@cache
def rig_of(camera: int, std: float, straight: bool) -> Rig:
    """A few rigs: upright, inclined towards the clamp, across, nearly along the antenna."""
    pose = camera_pose(*((0.0, 0.0), (0.8, np.pi), (0.8, 1.57), (1.3, 0.1))[camera])
    if straight:
        return World(pose, STRAIGHT).rig(std * RIG_STD, np.zeros(3))
    return World(pose).rig(std * RIG_STD)


RIGS = st.builds(rig_of, st.integers(0, 3), st.sampled_from([0.0, 0.25, 1.0]), st.booleans())
MODELS = st.sampled_from(["auto", *RUNGS])
SEEDS = st.integers(0, 2**31)


def well_formed(contact: Contact, felt: bool) -> None:
    """What holds of every result."""
    assert contact.status in STATUSES
    assert contact.model in RUNGS
    assert contact.reason
    assert contact.in_contact == (contact.status not in ("no_antenna", "no_contact"))
    located = contact.status in LOCATED
    vectors = (contact.force_N, contact.force_std_N, contact.deflection_m, contact.force_world_N)
    points = (contact.point_antenna_m, contact.point_world_m, contact.covariance_world_m2)
    numbers = (contact.distance_m, contact.distance_std_m, contact.friction_angle_rad, contact.friction_angle_std_rad)
    for values in (*points, *numbers):
        assert np.isfinite(values).all() if located else np.isnan(values).all()
    # without a reading the force may be known in part, which the reason says
    parts = np.isfinite(np.stack(vectors[:3]))
    partly = located and not felt and "not determined" in contact.reason
    assert (parts == parts[0]).all()
    assert parts.all() == (located and not partly)
    assert np.isfinite(contact.force_world_N).all() == parts.all()
    if not felt or contact.status == "no_antenna":
        assert np.isnan(contact.moment_residual_Nm)
    if not located:
        return
    assert 0.0 < contact.distance_m <= LENGTH_M
    assert (contact.distance_m == LENGTH_M) == (contact.status == "tip_contact")
    assert contact.distance_std_m > 0.0
    assert (contact.force_std_N[1:][parts[0, 1:]] > 0.0).all()
    assert contact.condition >= 1.0
    covariance = contact.covariance_world_m2
    np.testing.assert_allclose(covariance, covariance.T, atol=1e-9 * np.abs(covariance).max())
    assert np.linalg.eigvalsh(covariance).min() > -1e-9 * np.abs(covariance).max()


def any_points(rig: Rig, model: str, seed: int, friction: float, felt: bool) -> None:
    """Noise, straight lines, one spot, pixels far outside the picture: finite, but no antenna's."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(0, 60))
    spread = 10.0 ** rng.uniform(-3.0, 5.0)
    points = rng.uniform(-200.0, 1200.0, 2) + spread * rng.normal(size=(count, 2))
    if rng.uniform() < 0.5 and count:
        points = rng.uniform(0.0, 900.0, 2) + np.linspace(-1.0, 1.0, count)[:, None] * spread * rng.normal(size=2)
    moment = float(10.0 ** rng.uniform(-8.0, 2.0) * rng.choice([-1.0, 1.0])) if felt else None
    sigma = float(10.0 ** rng.uniform(-4.0, 2.0))
    contact = ContactEstimator(rig, model, friction=friction).estimate(
        points, moment=moment, pan=float(rng.normal()), tilt=float(rng.normal()), sigma_px=sigma
    )
    well_formed(contact, felt)


def any_contact(rig: Rig, model: str, seed: int, contact: float, roll: float, tip_m: float, felt: bool) -> None:
    """Antennas that may not be those of the rig, with holes and outliers."""
    rng = np.random.default_rng(seed)
    world = World(rig.T_antenna_camera)
    seen = frame(contact, roll, tip_m, world, seed=seed, points=int(rng.integers(5, 120)))
    points = seen.points_px.copy()
    points[rng.uniform(size=len(points)) < rng.uniform(0.0, 0.5)] = np.nan
    points[rng.uniform(size=len(points)) < 0.1] += rng.normal(0.0, 30.0, 2)
    moment = seen.moment_Nm if felt else None
    answer = ContactEstimator(rig, model).estimate(points, moment=moment, pan=0.0, tilt=seen.tilt_rad)
    well_formed(answer, felt)


ANY = {"rig": RIGS, "model": MODELS, "seed": SEEDS, "felt": st.booleans()}
POINTS = given(**ANY, friction=st.sampled_from([0.0, 0.2, 1.0]))
CONTACT = given(**ANY, contact=st.floats(0.05, 1.0), roll=st.floats(-np.pi, np.pi), tip_m=st.floats(1e-6, 0.05))
test_a_few_points_get_an_answer = FEW(POINTS(any_points))
test_a_few_contacts_get_an_answer = FEW(CONTACT(any_contact))
test_any_points_get_an_answer = pytest.mark.slow(MANY(POINTS(any_points)))
test_any_contact_gets_an_answer = pytest.mark.slow(MANY(CONTACT(any_contact)))


HEAVY = WORLD.rig(np.zeros(17))


def made_and_said(rung: str, std: float, straight: bool) -> tuple[np.ndarray, np.ndarray]:
    """(K,) biases really made without noise on a rung, and those that it predicts; in deviations of noise and rig."""
    rng, high = np.random.default_rng(3), rung == "elastica"
    world = World(camera_pose(0.6, 1.0), STRAIGHT) if straight else WORLD
    rig = world.rig(std * RIG_STD, np.zeros(3)) if straight else world.rig(std * RIG_STD)
    count, low, most = (20, 18.0, 34.0) if high else (60, 0.7, 25.0)
    slope = np.exp(rng.uniform(np.log(low), np.log(most), count))
    contact, roll = rng.uniform(0.3, 0.9, count), rng.uniform(-1.0, 1.0, count) * (1.0 if high else 3.0)
    # else the elastica has no bias worth the name
    scenes = rubbed(rig, contact, slope, 0.0, roll, sigma_px=0.01 if high else 0.1)
    found = answered(scenes, rung, friction=0.0)
    off = np.column_stack(
        [LENGTH_M * found.numbers.unknowns[:, 0] - scenes.distance_m, (found.numbers.force_N - scenes.force_N)[:, 1:]]
    )
    made = np.abs(off / fitted_std(found, scenes, rung, 0.0)).max(axis=1)
    said = found.numbers.bias[:, RUNGS.index(rung)]
    fits = found.numbers.converged & (found.numbers.scatter <= core.solver.WRONG_SHAPE)
    counted = fits & (made > 0.3) & (made < 10.0)
    return made[counted], said[counted]


@pytest.mark.parametrize(
    ("rung", "straight", "std"),
    [("paper", True, 0.25), ("linear", True, 0.25), ("linear", False, 0.0), ("elastica", False, 0.0)],
)
def test_bias_is_what_was_predicted(rung: str, straight: bool, std: float) -> None:
    """Frictionless rods without noise: within a factor of two where it is 0.3 to 10 deviations."""
    made, said = made_and_said(rung, std, straight)
    assert len(made) >= 8
    assert (said / made < 2.0).all(), said / made
    assert (said / made > 0.5).all(), said / made


@pytest.mark.parametrize(
    ("rung", "std", "friction", "count"),
    [("linear", 0.0, 0.0, 100), ("linear", 0.0, 0.2, 100), ("linear", 0.25, 0.2, 100), ("paper", 0.25, 0.2, 25)],
)
def test_a_demanded_rung_is_never_wrong_and_confident(rung: str, std: float, friction: float, count: int) -> None:
    """What a rung makes wrong is in its deviations, or the frame fails and says so."""
    rng = np.random.default_rng(4)
    rig = WORLD.rig(std * RIG_STD) if std else HEAVY
    contact, slope = rng.uniform(0.2, 0.95, count), np.exp(rng.uniform(0.0, np.log(34.0), count))
    scenes = rubbed(rig, contact, slope, friction * rng.normal(size=count), rng.uniform(-3.0, 3.0, count))
    found = answered(scenes, rung, friction)
    assert not (np.abs(scene_deviations(found, scenes)) > 4.0).any()
    said = np.array([one.predicted_bias_std for one in found])
    assert not (np.isfinite(found.distance_m) & (said > ContactSettings.highest_bias)).any()
    assert (rung == "linear") == bool((found.status == "ok").any())
    assert any(one.reason.startswith(f"{rung} is too low for this frame") for one in found)


UPRIGHT = World(camera_pose(0.0)).rig(np.zeros(17))
TOWARDS_CLAMP = World(camera_pose(0.785, np.pi)).rig(np.zeros(17))
ACROSS = World(camera_pose(0.785, np.pi / 2)).rig(np.zeros(17))


def touched(rig: Rig, slope: float, count: int = 40, sigma_px: float = 0.1, seed: int = 0) -> Scenes:
    """Frames with noise at rolls of a third to two thirds of a right angle, to all four sides."""
    rng = np.random.default_rng(seed)
    roll = rng.uniform(0.5, 1.05, count)
    roll = np.where(np.arange(count) % 2 == 0, roll, -roll) + np.where(np.arange(count) % 4 < 2, 0.0, np.pi)
    return rubbed(rig, rng.uniform(0.35, 0.85, count), [slope] * count, 0.0, roll, sigma_px=sigma_px).noisy(rng)


@pytest.mark.parametrize("slope", [3.0, 6.0])
def test_an_upright_camera_alone_does_not_know_the_side_at_small_slopes(slope: float) -> None:
    """The mirror image in the picture's plane looks the same: whatever is said must allow for both."""
    given = touched(UPRIGHT, slope)
    found = answered(given, blind=True)
    known = np.abs(found.force_N[:, 2]) > 3.0 * found.force_std_N[:, 2]
    assert (np.sign(found.force_N[known, 2]) == np.sign(given.force_N[known, 2])).all()
    off = scene_deviations(found, given)
    assert np.nanmax(np.abs(off), initial=0.0) < 4.5
    # the place is given, and what is given of f_z says little of it
    assert np.isfinite(off[:, 0]).mean() > 0.8
    sure = (found.status == "ok") & (np.abs(found.force_N[:, 2]) > 5.0 * found.force_std_N[:, 2])
    assert sure.mean() < 0.2


@pytest.mark.parametrize("rig", [UPRIGHT, TOWARDS_CLAMP, ACROSS], ids=["upright", "clamp", "across"])
@pytest.mark.parametrize("slope", [4.0, pytest.param(10.0, marks=pytest.mark.slow), 20.0])
def test_vision_alone_is_never_confident_and_wrong(rig: Rig, slope: float) -> None:
    rng, count = np.random.default_rng(9), 40
    contact, roll = rng.uniform(0.2, 0.95, count), rng.uniform(-np.pi, np.pi, count)
    friction = rng.normal(0.0, 0.2, count)
    given = rubbed(rig, contact, [slope] * count, friction, roll).noisy(rng)
    found = answered(given, blind=True)
    off = np.abs(scene_deviations(found, given))[np.isfinite(found.distance_m)]
    # little bent, an antenna pushed towards the camera looks as if it were not
    assert len(off) > 0.6 * count
    assert np.nanmax(off) < 6.0
    assert (found.status == "failed").mean() <= 0.05
    assert np.isnan(found.moment_residual_Nm).all()


EXACT = WORLD.rig(np.zeros(17))
USUAL = WORLD.rig(0.25 * RIG_STD)


def rubbing(rig, friction: float, slope: float) -> Scenes:
    """Frames with noise whose force leans by one angle, over distances and rolls."""
    rng = np.random.default_rng(0)
    contact, roll = rng.uniform(0.4, 0.9, 12), rng.uniform(-0.8, 0.8, 12)
    return rubbed(rig, contact, [slope] * 12, friction, roll).noisy(rng)


def squares(found: Contacts, given: Scenes) -> np.ndarray:
    """(K, 3) of the deviations of what is given out."""
    off = scene_deviations(found, given)
    return off[np.isfinite(off[:, 0])] ** 2


@pytest.mark.parametrize("friction", [-0.3, 0.3])
@pytest.mark.parametrize("rig", [EXACT, USUAL], ids=["exact", "usual"])
def test_friction_is_covered(friction: float, rig) -> None:
    """An angle of one and a half of its deviations at 20°, which one who thinks of none gets wrong."""
    given = rubbing(rig, friction, 20.0)
    found = answered(given)
    assert (found.status == "ok").all()
    off = squares(found, given)
    assert off.max() < 3.5**2
    assert off[:, 0].mean() < 2.25  # the angle itself lies 1.5 deviations off
    assert squares(answered(given, friction=0.0), given)[:, 0].mean() > 6.0 * off[:, 0].mean() + 6.0


@pytest.mark.slow
def test_friction_as_thought_possible_is_covered_by_all_numbers() -> None:
    """400 frames, upright and inclined cameras, slopes to 30°, friction from its prior: squares near 1."""
    rng = np.random.default_rng(8)
    for incline, azimuth in ((0.0, 0.0), (0.8, np.pi), (0.8, 1.57), (0.5, 0.6)):
        rig, count = World(camera_pose(incline, azimuth)).rig(np.zeros(17)), 100
        contact, slope = rng.uniform(0.2, 0.95, count), rng.uniform(3.0, 30.0, count)
        friction = np.clip(rng.normal(0.0, 0.2, count), -0.7, 0.7)
        given = rubbed(rig, contact, slope, friction, rng.uniform(-0.9, 0.9, count)).noisy(rng)
        found = answered(given)
        assert (found.status == "ok").mean() > 0.9
        assert ((squares(found, given).mean(axis=0) > 0.7) & (squares(found, given).mean(axis=0) < 1.4)).all()


SIGMA_PX = 0.1
POINTS_SECOND = 200
LIGHT_SECOND = World(camera_pose(0.6, 1.0), STRAIGHT)
RIGS_SECOND = {
    "exact": LIGHT_SECOND.rig(np.zeros(17), np.zeros(3)),
    "usual": LIGHT_SECOND.rig(0.25 * RIG_STD, np.zeros(3)),
}


def twice_touched(first: float, second: float, share: float, slope_deg: float, rig: str = "exact") -> Contact:
    """Two forces in one plane on the paper's beam, the second this part of the first; its slope at the second."""
    at = np.array([first, second]) * LENGTH_M
    forces = np.array([1.0, share])
    forces *= 2.0 * STIFFNESS_NM2 * np.tan(np.radians(slope_deg)) / (forces * at**2).sum()
    x = (np.arange(POINTS_SECOND) + 0.5) / POINTS_SECOND * LENGTH_M
    aside = deflection(x[:, None], at, forces, STIFFNESS_NM2).sum(axis=1)
    points = np.stack([x, aside * np.cos(0.4), aside * np.sin(0.4)], axis=1)
    rng, sensor = np.random.default_rng(0), LIGHT_SECOND.sensor
    pixels = pictured(LIGHT_SECOND.T_antenna_camera, points) + rng.normal(0.0, SIGMA_PX, (POINTS_SECOND, 2))
    moment = sensor.gain * float(at @ forces) * np.sin(0.4) + sensor.offset_Nm + rng.normal(0.0, sensor.std_Nm)
    return ContactEstimator(RIGS_SECOND[rig]).estimate(pixels, moment=moment, pan=0.0, tilt=0.0, sigma_px=SIGMA_PX)


@pytest.mark.parametrize("rig", ["usual", pytest.param("exact", marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    ("first", "second", "share"), [(0.5, 0.75, 0.5), (0.5, 0.75, 1.0), (0.3, 0.9, 0.2), (0.5, 0.95, 0.3)]
)
def test_two_contacts_are_named(first: float, second: float, share: float, rig: str) -> None:
    """At 15° and 0.1 px: no numbers, but two places, of which one lies between the two or near one of them."""
    contact = twice_touched(first, second, share, 15.0, rig)
    assert contact.status == "failed"
    assert contact.in_contact
    assert withheld(contact)
    (places,) = re.findall(r"two contacts explain it better, near (\d+) and (\d+) mm", contact.reason)
    near, far = map(float, places)
    assert 0.0 < near < far <= 1e3 * LENGTH_M
    assert near < 1e3 * LENGTH_M * second
    assert far > 1e3 * LENGTH_M * first


def once_touched(count: int, seed: int, incline: float, azimuth: float, std: float) -> Contacts:
    """Frames of one contact each, with friction: bent a little and much, near the clamp and far."""
    rng = np.random.default_rng(seed)
    contact, slope = rng.uniform(0.15, 0.95, count), rng.uniform(2.0, 28.0, count)
    friction = np.clip(rng.normal(0.0, 0.2, count), -0.7, 0.7)
    rig = World(camera_pose(incline, azimuth)).rig(std * RIG_STD)
    scenes = rubbed(rig, contact, slope, friction, rng.uniform(-3.1, 3.1, count), sigma_px=SIGMA_PX)
    return answered(scenes.noisy(rng))


@pytest.mark.parametrize("std", [0.0, 0.25])
@pytest.mark.parametrize(("incline", "azimuth"), [(0.0, 0.0), (0.8, np.pi)])
def test_one_contact_is_never_two(incline: float, azimuth: float, std: float) -> None:
    found = once_touched(150, 0, incline, azimuth, std)
    assert not [one.reason for one in found if "two contacts" in one.reason]
    assert (found.status == "ok").mean() > 0.9


def test_a_knocked_rig_is_not_called_two_contacts() -> None:
    """The rig's own uncertainty takes up what it can: camera and antenna drawn from their covariance."""
    rng = np.random.default_rng(5)
    for _ in range(4):
        true = WORLD.moved(RIG_STD * rng.normal(size=17)).rig(np.zeros(17))
        contact, slope = rng.uniform(0.3, 0.9, 10), rng.uniform(5.0, 25.0, 10)
        scenes = rubbed(true, contact, slope, 0.0, rng.uniform(-1, 1, 10), given=WORLD.rig(RIG_STD)).noisy(rng)
        assert not [one.reason for one in answered(scenes) if "two contacts" in one.reason]
