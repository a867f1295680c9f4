"""The whole way: an antenna strokes an object, the estimator sees it, the surface is held against the truth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from benchmarks.estimator.setup import ACROSS, Setup, drawn_truth
from benchmarks.object.scenes import Recorded, contacts, record
from estimator.contact.common_errors import shared_errors
from estimator.object.surface import Surface, reconstruct, touches_of
from vbaa_calib.simulate.scene.objects import TouchObject
from vbaa_calib.simulate.scene.scene import Sweep

from .touched import angles_rad

STIFFNESS_N_M = 50.0


@dataclass(frozen=True, eq=False)
class Stroked:
    """What was recorded and what was made of it."""

    recorded: Recorded
    surface: Surface


@pytest.fixture(scope="module")
def stroked() -> Stroked:
    """A soft cylinder, stroked twice along its axis by an antenna whose rig is known as after a calibration."""
    rig = Setup("brown", 0.5, ACROSS, swing_m=0.06, real=True, exact=False).rig()
    obj = TouchObject("cylinder", np.array([0.16, 0.05, 0.0]), np.array([0.0, 0.0, 1.0]), 0.015, 0.06, STIFFNESS_N_M)
    push = np.radians([[2.0, 7.0], [3.0, 9.0]])
    reach = np.radians([[-7.0, 7.0], [7.0, -7.0]])
    strokes = [
        Sweep("pan", 1, 14, 1, float(np.radians(2)), (low, high), 1.5, (first, last))
        for (low, high), (first, last) in zip(push.tolist(), reach.tolist(), strict=True)
    ]
    rng = np.random.default_rng(4)
    recorded = record(drawn_truth(rig, rng), obj, strokes, rng, given=rig, points=80)
    table = contacts(recorded)
    return Stroked(recorded, reconstruct(touches_of(table, shared_errors(rig, table)), rig.antenna.diameter_m / 2))


def test_the_line_lies_on_the_cylinder_within_its_deviation(stroked: Stroked) -> None:
    surface = stroked.surface
    distance, _ = stroked.recorded.object.signed_distance(surface.points_m)
    assert np.sqrt(np.mean(distance**2)) < 2.5e-4
    # the rig's error hits all of the line alike: this is one sample
    assert np.sqrt(np.mean((distance / surface.std_m) ** 2)) < 3.5
    assert len(surface.lines) > 20
    assert np.ptp(surface.points_m[:, 2]) > 0.03


def test_the_normals_are_the_cylinder_s(stroked: Stroked) -> None:
    true = stroked.recorded.truth.normal_world[stroked.surface.touched_row]
    miss = np.degrees(angles_rad(stroked.surface.touched_normal, true))
    assert np.median(miss) < 0.5
    assert np.percentile(miss, 95) < 3


def test_its_stiffness_is_told(stroked: Stroked) -> None:
    soft = stroked.surface.compliance
    assert soft.determined
    assert soft.stiffness_N_m == pytest.approx(STIFFNESS_N_M, rel=0.1)
    assert abs(soft.compliance_m_N - 1 / STIFFNESS_N_M) < 3 * soft.std_m_N
