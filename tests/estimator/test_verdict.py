"""What is said of a frame, and what is not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ..rod_scenes import LENGTH_M, RIG_STD, Frame, World, blunt, camera_pose, frames
from . import contact_scenes
from .contact_scenes import estimated as judged
from .contact_scenes import estimated_together, withheld

STD = 0.25 * RIG_STD
INCLINED, UPRIGHT = World(camera_pose(0.9, 0.4)), World(camera_pose(0.0))


def frame(contact: float, roll: float, tip_m: float, world: World = INCLINED, seed: int = 0) -> Frame:
    """One frame, touched at this part of its length."""
    return contact_scenes.frame(contact, roll, tip_m, world, seed)


@pytest.mark.parametrize("world", [INCLINED, UPRIGHT])
def test_the_free_antenna_touches_nothing(world: World) -> None:
    rng = np.random.default_rng(1)
    for contact in estimated_together(
        frames(world, [0.1] * 6, np.zeros((6, 2)), rng.uniform(0, 1, 6), rng), world.rig()
    ):
        assert contact.status == "no_contact"
        assert not contact.in_contact
        assert withheld(contact)
        assert abs(contact.moment_residual_Nm) < 2e-4


@pytest.mark.parametrize("moment_std_Nm", [2e-5, 5e-4])
def test_edge_on_is_unobservable(moment_std_Nm: float) -> None:
    """The camera's centre lies in the deformation plane; the moment tells of a contact, nothing tells where."""
    world = blunt(UPRIGHT, std_Nm=moment_std_Nm)
    contact = judged(frame(0.6, np.pi / 2, 0.02, world), world.rig(STD))
    assert contact.status == "unobservable"
    assert "edge-on" in contact.reason
    assert contact.in_contact
    assert withheld(contact)


def test_tiny_deflections_never_give_a_confident_number() -> None:
    tips = enumerate(np.repeat([2e-5, 1e-4, 2e-4, 4e-4], 2))
    several = [frame(0.6, 0.4 + seed, tip_m, seed=seed) for seed, tip_m in tips]
    found = estimated_together(several, INCLINED.rig(STD))
    statuses = found.status.tolist()
    for seen, contact in zip(several, found, strict=True):
        if contact.status in ("ok", "tip_contact"):
            assert abs(contact.distance_m - seen.distance_m) < 4 * contact.distance_std_m
        else:
            assert withheld(contact)
    assert set(statuses[:2]) <= {"no_contact", "low_signal"}
    assert "low_signal" in statuses
    light = frame(0.2, 4.4, 4e-4, UPRIGHT, seed=4)  # a badly known distance is no contact at the clamp
    assert judged(light, UPRIGHT.rig(STD)).status == "low_signal"


@pytest.mark.parametrize("seed", range(2))
def test_the_tip(seed: int) -> None:
    seen = frame(1.0, 0.4 + seed, 0.025, seed=seed)
    contact = judged(seen, INCLINED.rig(STD))
    assert contact.status == "tip_contact"
    assert contact.distance_m == LENGTH_M
    assert "tip" in contact.reason
    # the data allow it a little inside, and that is said
    assert 1e-4 < contact.distance_std_m < 3e-3
    assert (np.abs(contact.force_N - seen.force_N)[1:] < 4 * contact.force_std_N[1:]).all()


def test_a_moment_that_contradicts_the_picture_is_said() -> None:
    """Mentioned at four of its deviations, beyond six nothing is trusted."""
    seen = frame(0.6, 0.8, 0.03)
    rig = INCLINED.rig(0.2 * STD)
    assert "disagree" not in judged(seen, rig).reason
    said = list(
        estimated_together([replace(seen, moment_Nm=seen.moment_Nm - off) for off in np.linspace(0.0, 5e-3, 11)], rig)
    )
    assert {contact.status for contact in said} == {"ok", "failed"}
    words = ["contradict" if "contradict" in c.reason else "disagree" if "disagree" in c.reason else "" for c in said]
    assert words == sorted(words, key=["", "disagree", "contradict"].index)
    assert set(words) == {"", "disagree", "contradict"}
    for contact, word in zip(said, words, strict=True):
        assert (contact.status == "failed") == (word == "contradict")
    assert withheld(said[-1])
    assert "check the sensor" in said[-1].reason


@pytest.mark.parametrize(
    ("reading", "azimuth", "roll", "seed"),
    [
        ("reversed", 0.4, 0.7, 0),
        pytest.param("reversed", np.pi, -0.9, 1, marks=pytest.mark.slow),
        ("disconnected", 0.4, 2.4, 2),
    ],
)
def test_a_wrong_sensor_under_an_inclined_camera_gives_no_numbers(
    reading: str, azimuth: float, roll: float, seed: int
) -> None:
    """A sensor whose sign is wrong or which is not connected; the reason names it."""
    world = World(camera_pose(0.9, azimuth))
    seen = frame(0.6, roll, 0.03, world, seed)
    contact = judged(replace(seen, moment_Nm=-seen.moment_Nm if reading == "reversed" else 0.0), world.rig(STD))
    assert contact.status == "failed"
    assert withheld(contact)
    assert "picture and moment contradict each other" in contact.reason
