"""What is said of a frame, and what is not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.waiting.frames import ALIKE, fitting_nothing
from estimator import ContactEstimator

from ..rod_scenes import LENGTH_M, RIG_STD, Frame, World, blunt, camera_pose, frames
from . import contact_scenes
from .contact_scenes import STRAIGHT as PLAIN
from .contact_scenes import estimated as judged
from .contact_scenes import estimated_together, withheld

STD = 0.25 * RIG_STD
INCLINED, UPRIGHT = World(camera_pose(0.9, 0.4)), World(camera_pose(0.0))
STRAIGHT = World(camera_pose(0.6, 1.0), PLAIN)


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


@pytest.mark.parametrize("reading", [-1.0, 0.0])
def test_an_upright_camera_believes_a_wrong_sensor(reading: float) -> None:
    """Stated as a limit: distance and f_y are right all the same, f_z is what the sensor says."""
    seen = frame(0.6, 0.4, 0.015, UPRIGHT)
    contact = judged(replace(seen, moment_Nm=reading * seen.moment_Nm), UPRIGHT.rig(STD))
    assert contact.status == "ok"
    assert contact.distance_m == pytest.approx(seen.distance_m, rel=0.02)
    assert contact.force_N[1] == pytest.approx(seen.force_N[1], rel=0.05)
    assert abs(contact.force_N[2] - seen.force_N[2]) > 20 * contact.force_std_N[2]


def test_an_upright_camera_cannot_contradict_the_moment() -> None:
    """Stated as a limit: f_z comes from the moment alone, and goes wrong with it."""
    seen = frame(0.6, 0.4, 0.02, UPRIGHT)
    contact = judged(replace(seen, moment_Nm=seen.moment_Nm + 5e-4), UPRIGHT.rig(STD))
    assert contact.status == "ok"
    assert contact.distance_m == pytest.approx(seen.distance_m, abs=1e-3)
    # 5e-4 N·m at 144 mm are 3.3 mN, over the sensor's gain
    assert contact.force_N[2] - seen.force_N[2] == pytest.approx(5e-4 / 1.04 / seen.distance_m, rel=0.1)


def test_a_camera_that_was_knocked_is_said() -> None:
    seen = frame(0.6, 0.4, 0.02)
    knocked = np.zeros(17)
    knocked[3:6] = 1e-3
    contact = judged(seen, INCLINED.moved(knocked).rig(STD))
    assert contact.status == "failed" or "check the rig" in contact.reason
    knocked[3:6] = 3e-3
    assert judged(seen, INCLINED.moved(knocked).rig(STD)).status == "failed"


def test_a_wrong_stiffness_scales_the_force_and_shows_without_contact() -> None:
    """Stated as a limit: in one touched frame EI off by 2 hides behind the force. The free antenna gives it away."""
    wrong = INCLINED.parameters + np.log(2.0) * np.eye(9)[6]
    stiff = replace(INCLINED, parameters=wrong).rig(STD)
    seen = frame(0.6, 0.4, 0.02)
    contact = judged(seen, stiff)
    assert contact.distance_m == pytest.approx(seen.distance_m, rel=0.05)
    assert contact.force_N[1] / seen.force_N[1] == pytest.approx(2.0, rel=0.2)
    free = frame(0.6, 0.4, 1e-9)
    assert judged(free, INCLINED.rig(STD)).status == "no_contact"
    assert judged(free, stiff).status != "no_contact"


def test_what_fits_nothing_is_given_up_soon() -> None:
    """Nearly always in no more evaluations of the whole model than a sound frame takes; and that is said."""
    several = [frame(0.4 + 0.1 * seed, 0.4 + seed, 0.03, seed=seed) for seed in range(4)]
    rig, moments, still = INCLINED.rig(STD), np.array([seen.moment_Nm for seen in several]), np.zeros(4)
    given = {"points_px": np.stack([seen.points_px for seen in several])}
    joints = still, np.array([seen.tilt_rad for seen in several])
    estimator = ContactEstimator(rig)
    sound = estimator.estimate_batch(given["points_px"], moments, *joints)
    assert set(sound.status) == {"ok"}
    for kind, those in fitting_nothing(rig, given, 0).items():
        found = estimator.estimate_batch(those["points_px"], moments, *joints)
        assert set(found.status) <= {"failed", "unobservable"}, kind
        soon = found.numbers.evaluations <= sound.numbers.evaluations.min()
        # a line may lie along an antenna that is bent far
        assert soon.sum() >= 3 or kind == ALIKE, kind
        for contact, early in zip(found, soon, strict=True):
            assert ("not on this antenna" in contact.reason) == early, kind
