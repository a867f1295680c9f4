"""What changes within a recording is named, soon; touches alone are not taken for a change; and a zero is followed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from estimator import Contact, ContactEstimator
from estimator.contact.watch import UNSEEN_FRAMES, WITHIN_FRAMES, Change, DriftWatch
from estimator.table.contacts import LOCATED, Measured
from tests.rod_scenes import RIG_STD, SIGMA_PX, World, frames
from vbaa_calib.rig import Rig
from vbaa_calib.session import DRIFTS

from .pressing import WORLD, Motion

RATE_HZ = 30.0
BEFORE = 80
NOISE_NM = WORLD.sensor.std_Nm


def rig() -> Rig:
    return replace(WORLD.rig(0.25 * RIG_STD), drift=DRIFTS["lab"])


def stream(world: World, seed: int, count: int, press: float = 1.0, zero_Nm: float = 0.0) -> list[Measured]:
    """Frames of presses, `press` times as hard, the sensor's zero walking by so much a frame."""
    rng = np.random.default_rng(seed)
    motion = Motion.drawn(rng, count / RATE_HZ + 3.0)
    contact, lateral = motion.at(np.arange(count) / RATE_HZ)
    several = frames(world, contact.tolist(), (press * lateral).tolist(), [0.3] * count, rng, points=80)
    return [
        Measured(
            each.points_px, np.full(80, SIGMA_PX), each.moment_Nm + n * zero_Nm, 0.0, 0.3, time_s=float(n / RATE_HZ)
        )
        for n, each in enumerate(several)
    ]


def watched(several: list[Measured]) -> list[Change]:
    watch = DriftWatch(rig())
    return [change for frame, each in enumerate(several) for change in watch.push(frame, each)]


def moved(index: int, step: float) -> World:
    return WORLD.moved(step * np.eye(17)[index])


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(
    ("what", "index", "step"),
    [
        ("camera", 0, 1.5e-3),
        ("camera", 2, 1e-3),
        ("camera", 4, 4e-4),
        ("clamp", 8, 1.5e-3),
        ("clamp", 9, -1e-3),
        ("zero", 16, 20 * NOISE_NM),
        ("zero", 16, -20 * NOISE_NM),
    ],
)
def test_what_changes_is_named_within_the_free_frames_that_are_stated(
    what: str, index: int, step: float, seed: int
) -> None:
    """A quiet antenna first, then one free that has changed."""
    quiet = stream(WORLD, 10 + seed, BEFORE, 0.0)
    (change,) = watched(quiet + stream(moved(index, step), 20 + seed, 2 * WITHIN_FRAMES, 0.0))
    assert change.what == what
    assert BEFORE <= change.frame < BEFORE + WITHIN_FRAMES


@pytest.mark.parametrize("what", ["camera", "clamp"])
def test_it_is_named_between_touches_too(what: str) -> None:
    world = moved(4, 4e-4) if what == "camera" else moved(9, 1e-3)
    changes = watched(stream(WORLD, 2, 150) + stream(world, 3, 240))
    assert [change.what for change in changes] == [what]


@pytest.mark.parametrize("press", [1.0, 0.1])
def test_touches_alone_are_no_change(press: float) -> None:
    assert watched(stream(WORLD, 1, 900, press)) == []


def test_a_zero_that_walks_is_named() -> None:
    (change,) = watched(stream(WORLD, 4, 900, 0.3, zero_Nm=0.05 * NOISE_NM))
    assert change.what == "zero"
    assert change.frame * 0.05 < 25


def test_an_antenna_that_is_gone_is_named_once() -> None:
    gone = replace(stream(WORLD, 0, 1)[0], points_px=np.empty((0, 2)), sigma_px=np.empty(0))
    (change,) = watched(stream(WORLD, 0, BEFORE, 0.0) + [gone] * (3 * UNSEEN_FRAMES))
    assert (change.what, change.frame) == ("antenna", BEFORE + UNSEEN_FRAMES - 1)


def off(contacts: list[Contact], several: list[Measured], force_N: np.ndarray) -> np.ndarray:
    """Errors of the force along the line of the moment's arm, in deviations."""
    rows = [n for n, each in enumerate(contacts) if each.status in LOCATED]
    return np.array([(contacts[n].force_N[2] - force_N[n, 1]) / contacts[n].force_std_N[2] for n in rows])


def test_a_zero_is_followed_when_asked() -> None:
    """Its walk of 30 deviations makes the forces wrong by many of theirs; followed, by no more than they say."""
    count = 600
    rng = np.random.default_rng(7)
    motion = Motion.drawn(rng, count / RATE_HZ + 3.0)
    contact, lateral = motion.at(np.arange(count) / RATE_HZ)
    seen = frames(WORLD, contact.tolist(), lateral.tolist(), [0.3] * count, rng, points=80)
    walk = 0.05 * NOISE_NM * np.arange(count)
    several = [
        Measured(each.points_px, np.full(80, SIGMA_PX), each.moment_Nm + by, 0.0, 0.3, time_s=n / RATE_HZ)
        for n, (each, by) in enumerate(zip(seen, walk, strict=True))
    ]
    force = np.array([each.force_N[1:] for each in seen])
    found = {}
    for name, drift in {"left": DRIFTS["lab"], "followed": DRIFTS["lab"].tracking_zero()}.items():
        estimator = ContactEstimator(replace(rig(), drift=drift), jobs=1)
        contacts = list(estimator.run(several))
        found[name] = off(contacts, several, force)
        zero_Nm = estimator.drift.now.moment_sensor.offset_Nm - rig().moment_sensor.offset_Nm
        if name == "followed":
            assert zero_Nm == pytest.approx(walk[-1], abs=6.0 * NOISE_NM)
    assert np.sqrt(np.mean(found["followed"] ** 2)) < 1.5
    assert np.sqrt(np.mean(found["left"] ** 2)) > 2.0 or len(found["left"]) < 0.7 * len(found["followed"])


def test_a_free_antenna_is_not_touched() -> None:
    """In many frames with nothing but noise no contact is imagined, and no change."""
    (base,) = frames(WORLD, [0.12], [[0.0, 0.0]], [0.3], np.random.default_rng(0), points=80, sigma_px=0.0)
    rng = np.random.default_rng(11)
    several = [
        Measured(
            base.points_px + rng.normal(0.0, SIGMA_PX, (80, 2)),
            np.full(80, SIGMA_PX),
            base.moment_Nm + rng.normal(0.0, NOISE_NM),
            0.0,
            0.3,
            time_s=n / RATE_HZ,
        )
        for n in range(1500)
    ]
    contacts = list(ContactEstimator(rig(), jobs=1).run(several))
    assert {each.status for each in contacts} == {"no_contact"}
    assert watched(several) == []
