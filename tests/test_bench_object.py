"""The benchmark of felt objects: its recordings keep the laws, its judge finds what it is to find."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.estimator.setup import drawn_truth
from benchmarks.harness import rms_known
from benchmarks.object.object import judge
from benchmarks.object.scenes import AXIS, CENTRE, SETUP, SOFT, Case, Recorded, contacts, play
from vbaa_calib.simulate.scene.objects import TouchObject
from vbaa_calib.simulate.scene.scene import Sweep


def _cylinder(stiffness_N_m: float, friction: float) -> TouchObject:
    return TouchObject("cylinder", CENTRE, AXIS, 0.02, 0.08, stiffness_N_m, friction)


def _stroke(way: int) -> Sweep:
    return Sweep("pan", 1, 12, 2, math.radians(1.5), (math.radians(2), math.radians(7)), 2.0, (-way * 0.15, way * 0.15))


SHORT = Case("cylinder", _cylinder, [_stroke(1), _stroke(-1)])


@pytest.fixture(scope="module")
def played() -> Recorded:
    return play(SETUP.rig(), _cylinder(SOFT, 0.0), SHORT.strokes)


def test_what_the_estimator_makes_of_it_is_near_the_truth(played: Recorded) -> None:
    table = contacts(played.noisy(np.random.default_rng(2)))
    both = table.located & played.truth.in_contact
    assert both.sum() > 0.8 * played.truth.in_contact.sum()
    assert not (table.located & ~played.truth.in_contact).any()
    miss = ((table.point_world_m - played.truth.point_world_m) * played.truth.normal_world).sum(axis=1)[both]
    assert rms_known(miss) < 1e-4
    np.testing.assert_array_equal(table.pan_rad, played.pan_rad)


def test_the_judge_sees_a_given_rig_that_is_off(played: Recorded) -> None:
    rng = np.random.default_rng(3)
    given = drawn_truth(replace(SETUP, exact=False).rig(), rng)
    off, exact = judge(played.noisy(rng, given)), judge(played.noisy(rng))
    assert rms_known(off.point_std_m) > 1.2 * rms_known(exact.point_std_m)
    assert off.contacts > 15
    assert rms_known(exact.normal_rad) < math.radians(3.0)
    assert rms_known(exact.surface_m) < 2e-4
