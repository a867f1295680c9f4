"""A sensor's zero that walks is followed, and noise is not taken for a touch."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from estimator import ContactEstimator
from estimator.table.contacts import LOCATED, Measured
from vbaa_calib.rig import Rig
from vbaa_calib.session import DRIFTS

from ..rod_scenes import RIG_STD, SIGMA_PX, frames
from .pressing import WORLD, Motion

RATE_HZ = 30.0
NOISE_NM = WORLD.sensor.std_Nm


def rig() -> Rig:
    return replace(WORLD.rig(0.25 * RIG_STD), drift=DRIFTS["lab"])


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
        rows = [n for n, each in enumerate(contacts) if each.status in LOCATED]
        # along the line of the moment's arm, in deviations
        found[name] = np.array([(contacts[n].force_N[2] - force[n, 1]) / contacts[n].force_std_N[2] for n in rows])
        zero_Nm = estimator.drift.now.moment_sensor.offset_Nm - rig().moment_sensor.offset_Nm
        if name == "followed":
            assert zero_Nm == pytest.approx(walk[-1], abs=6.0 * NOISE_NM)
    assert np.sqrt(np.mean(found["followed"] ** 2)) < 1.5
    assert np.sqrt(np.mean(found["left"] ** 2)) > 2.0 or len(found["left"]) < 0.7 * len(found["followed"])


def test_a_free_antenna_is_not_touched() -> None:
    """In many frames with nothing but noise no contact is imagined."""
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
