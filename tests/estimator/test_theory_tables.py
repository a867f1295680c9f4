"""What friction that is not known costs, and what a wrong stiffness hides, as limits.md and the pages say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.estimator.scenes import elastica_shapes
from benchmarks.estimator.setup import TOWARDS_CLAMP, Setup
from estimator import ContactEstimator
from vbaa_calib.rig import Rig

from .contact_scenes import answered, rubbed

LENGTH_M, SWING_M = 0.24, 0.1
SLOPES_DEG = (5.0, 15.0, 25.0, 35.0)


def rig_of(tilt_deg: float = 0.0, azimuth: float = TOWARDS_CLAMP, *, real: bool = False, exact: bool = True) -> Rig:
    """The bench's, its picture wide enough for antennas bent by 35°."""
    return Setup("brown", np.radians(tilt_deg), azimuth, swing_m=SWING_M, real=real, exact=exact).rig()


@pytest.mark.parametrize(("exact", "most"), [(True, 6.0), (False, 1.9)])
def test_the_price_of_friction(exact: bool, most: float) -> None:
    """What it costs in l not to know the angle: nothing at small slopes, less than this at large ones."""
    grown = []
    for reach in (0.25, 0.95):
        given = rubbed(rig_of(exact=exact), [reach] * 4, SLOPES_DEG, 0.0, 0.3, made_by=elastica_shapes)
        rough, slippery = (answered(given, "elastica", friction).numbers.std[:, 0] for friction in (0.2, 0.0))
        grown.append(rough / slippery)
    assert 0.99 < np.min(grown) < 1.1
    assert 0.9 * most < np.max(grown) < most


@pytest.mark.parametrize(("tilt_deg", "factor"), [(0.0, 0.5), (30.0, 2.0)])
@pytest.mark.parametrize("blind", [False, True])
def test_a_wrong_stiffness_hides(blind: bool, factor: float, tilt_deg: float) -> None:
    """benchmarks/limits.md: what is seen of the force follows EI, what is read does not; the distance hardly moves."""
    rig = rig_of(max(tilt_deg, 30.0 * blind))
    given = rubbed(rig, [0.4, 0.6, 0.8], [20.0 if blind else 8.0] * 3, 0.0, 0.6, made_by=elastica_shapes)
    parameters = rig.antenna.parameters + np.log(factor) * (np.arange(9) == 6)
    wrong = ContactEstimator(replace(rig, antenna=replace(rig.antenna, parameters=parameters)))
    moment = None if blind else given.moment_Nm
    found = wrong.estimate_batch(given.points_px, moment, given.pan_rad, given.tilt_rad, sigma_px=0.1)
    assert blind or (found.status == "ok").all()
    force = (found.force_N / given.force_N)[:, 1:]
    expected = np.full((3, 2), [factor, factor if blind else 1.0])
    known = np.isfinite(force)
    assert known[:, 0].all()
    assert known.sum() >= 5
    # over all forces along the line of sight the mean is not the likeliest
    std = (found.force_std_N / np.abs(given.force_N))[:, 1:]
    assert (
        np.abs(force - expected)[known] < (0.03 if blind else 0.08) * expected[known] + (0.5 * blind * std)[known]
    ).all()
    np.testing.assert_allclose(found.distance_m, given.distance_m, rtol=0.01)
