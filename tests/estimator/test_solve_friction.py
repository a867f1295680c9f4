"""Contacts that rub: the force leans, and the answer stays honest."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.estimator.scenes import Scenes
from estimator.contact.contacts import Contacts

from ..rod_scenes import RIG_STD, World, camera_pose
from .contact_scenes import WORLD, answered, rubbed, scene_deviations

EXACT = WORLD.rig(np.zeros(17))
USUAL = WORLD.rig(0.25 * RIG_STD)


def rubbing(rig, friction: float, slope: float, count: int = 12, seed: int = 0) -> Scenes:
    """Frames with noise whose force leans by one angle, over distances and rolls."""
    rng = np.random.default_rng(seed)
    contact, roll = rng.uniform(0.4, 0.9, count), rng.uniform(-0.8, 0.8, count)
    return rubbed(rig, contact, [slope] * count, friction, roll).noisy(rng)


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


@pytest.mark.parametrize("slope", [3.0, 10.0])
def test_the_angle_is_not_claimed_where_it_is_not_seen(slope: float) -> None:
    found = answered(rubbing(USUAL, 0.3, slope))
    assert (found.friction_angle_std_rad > 0.12).all()
    assert (found.friction_angle_std_rad <= 0.2 * (1 + 1e-9)).all()


@pytest.mark.parametrize(("friction", "slope"), [(-0.3, 25.0), (0.0, 30.0), (0.3, 30.0)])
def test_the_angle_is_seen_at_large_slopes(friction: float, slope: float) -> None:
    rng = np.random.default_rng(1)
    given = rubbed(EXACT, rng.uniform(0.6, 0.9, 12), [slope] * 12, friction, rng.uniform(-0.5, 0.5, 12)).noisy(rng)
    found = answered(given)
    assert (found.status == "ok").all()
    std = found.friction_angle_std_rad
    assert (std < 0.1).all()
    off = (found.friction_angle_rad - friction) / std
    assert np.abs(off).max() < 3.5
    assert (off**2).mean() < 2.2
    # the force's third component, along the antenna, is then known as well
    along = (found.force_N - given.force_N)[:, 0] / found.force_std_N[:, 0]
    assert np.abs(along).max() < 3.5
    assert np.median(found.force_std_N[:, 0] / np.linalg.norm(given.force_N, axis=1)) < 0.1


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
