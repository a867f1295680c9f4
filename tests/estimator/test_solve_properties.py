"""Whatever is given to it, the estimator answers: a status from the table, numbers where there are any to give."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from estimator import Contact, ContactEstimator
from estimator.table.contacts import LOCATED, STATUSES
from vbaa_calib.antenna.rungs import RUNGS
from vbaa_calib.rig import Rig

from ..rod_scenes import LENGTH_M, RIG_STD, World, camera_pose
from .contact_scenes import STRAIGHT, frame


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
