"""The whole way: an antenna strokes an object, the estimator sees it, the surface is held against the truth."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.estimator.setup import ACROSS, Setup, drawn_truth
from benchmarks.object.scenes import contacts, record
from estimator.contact.common_errors import shared_errors
from estimator.object.surface import reconstruct, touches_of
from vbaa_calib.simulate.scene.objects import TouchObject
from vbaa_calib.simulate.scene.scene import Sweep

from .touched import angles_rad

STIFFNESS_N_M = 50.0


def test_a_soft_cylinder_stroked_twice() -> None:
    """By an antenna whose rig is known as after a calibration: line, normals and stiffness."""
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
    surface = reconstruct(touches_of(table, shared_errors(rig, table)), rig.antenna.diameter_m / 2)
    distance, _ = obj.signed_distance(surface.points_m)
    assert np.sqrt(np.mean(distance**2)) < 2.5e-4
    # the rig's error hits all of the line alike: this is one sample
    assert np.sqrt(np.mean((distance / surface.std_m) ** 2)) < 3.5
    assert len(surface.lines) > 20
    assert np.ptp(surface.points_m[:, 2]) > 0.03
    miss = np.degrees(angles_rad(surface.touched_normal, recorded.truth.normal_world[surface.touched_row]))
    assert np.median(miss) < 0.5
    assert np.percentile(miss, 95) < 3
    soft = surface.compliance
    assert soft.determined
    assert soft.stiffness_N_m == pytest.approx(STIFFNESS_N_M, rel=0.1)
    assert abs(soft.compliance_m_N - 1 / STIFFNESS_N_M) < 3 * soft.std_m_N
