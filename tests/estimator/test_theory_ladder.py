"""docs/ladder.md: where small deflections stop being good enough, by the cube of the slope."""

from __future__ import annotations

import numpy as np
import pytest

from estimator import ContactEstimator

from .test_theory_bounds import SIGMA_PX, STEEPNESS, camera_at, factors, touched

AWAY_M, POINTS, LENGTH_M, ALLOWED = 0.6, 200, 0.24, 1 / 3
STEPS = [(0.25, 0.139, 6.1), (0.5, 0.184, 4.9), (0.75, 0.276, 4.4), (0.95, 0.458, 4.2)]
"""l/L, the factor k of Δl/l = k·θ_c², and the slope in degrees at which the beam is a third of a deviation off."""


@pytest.fixture
def as_fitted(monkeypatch: pytest.MonkeyPatch) -> None:
    """Deviations of noise and rig alone, whatever the rung makes wrong."""
    monkeypatch.setattr("estimator.solver.ladder.LARGE_BIAS", np.inf)
    monkeypatch.setattr("estimator.contact.status.HIGHEST_BIAS", np.inf)


@pytest.mark.usefixtures("as_fitted")
@pytest.mark.parametrize(("reach", "factor", "degrees"), STEPS)
def test_a_third_of_a_deviation(reach: float, factor: float, degrees: float) -> None:
    """The distance that the rung `linear` finds in a picture of the elastica without noise, beside the closed form."""
    rig = camera_at(AWAY_M)
    sigma_m = SIGMA_PX * AWAY_M / rig.camera.matrix[0, 0]
    least = STEEPNESS * factors(reach)[0] * sigma_m / np.sqrt(POINTS)
    slope = (ALLOWED * least / (factor * reach * LENGTH_M)) ** (1 / 3)
    assert np.degrees(slope) == pytest.approx(degrees, abs=0.06)
    for times in (0.7, 1.0, 1.5):
        given = touched(rig, 0.0, times * slope, reach)
        contact = ContactEstimator(rig, "linear", friction=0.0).estimate(
            given.points_px[0], moment=float(given.moment_Nm[0]), pan=0.0, tilt=0.0, sigma_px=SIGMA_PX
        )
        off = (contact.distance_m - given.distance_m[0]) / contact.distance_std_m
        assert off == pytest.approx(ALLOWED * times**3, rel=0.06)
        assert contact.bias["linear"] >= 0.95 * off
