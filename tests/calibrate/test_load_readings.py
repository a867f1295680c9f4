"""Loads whose places and weights are read off: the joint solve finds what they are off by, and EI says so."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from vbaa_calib.calibrate.antenna.inputs import EXACT, Observation, reading_keys
from vbaa_calib.session import Load, LoadReadings

from .test_joint import TRUE, adjusted, errors, jig_prior, observed

RULER = LoadReadings(5e-4, 5e-3)
LOG_STIFFNESS = 12


def misread(observations: Sequence[Observation], rng: np.random.Generator) -> list[Observation]:
    """The observations with places and weights noted wrong, the same one always by the same."""
    off: dict[object, float] = {}
    noted = []
    for one in observations:
        still = one.still
        if isinstance(still, Load):
            place, weight = reading_keys(still)
            heavier = np.exp(off.setdefault(weight, rng.normal(0.0, RULER.force_std_relative)))
            still = replace(
                still,
                distance_m=still.distance_m + off.setdefault(place, rng.normal(0.0, RULER.distance_std_m)),
                force_y_N=heavier * still.force_y_N,
                force_z_N=heavier * still.force_z_N,
            )
        noted.append(replace(one, still=still))
    return noted


def draw(seed: int) -> tuple[tuple[float, float], tuple[float, float]]:
    """Error and deviation of log EI, by a solve that weighs the readings and by one that takes them as exact."""
    rng = np.random.default_rng(seed)
    seen = misread(observed(TRUE, rng), rng)
    found = []
    for known in (RULER, EXACT):
        joint = adjusted(seen, jig_prior(TRUE.T_antenna_camera, readings=known))
        found.append((errors(joint)[LOG_STIFFNESS], float(np.sqrt(joint.covariance[LOG_STIFFNESS, LOG_STIFFNESS]))))
    return found[0], found[1]


def judged(draws: Sequence[tuple[tuple[float, float], tuple[float, float]]]) -> tuple[float, float, float]:
    """rms error over rms deviation, the share of 95 % intervals that hold, and rms error over that of exact loads."""
    weighed, exact = np.array([one[0] for one in draws]), np.array([one[1] for one in draws])
    rms, std, naive = (float(np.sqrt((column**2).mean())) for column in (*weighed.T, exact[:, 0]))
    return rms / std, float((np.abs(weighed[:, 0]) < 1.96 * weighed[:, 1]).mean()), rms / naive


@pytest.mark.slow
def test_the_deviation_of_stiffness_holds_when_loads_are_misread() -> None:
    off, held, better = judged([draw(seed) for seed in range(40)])
    assert 0.75 < off < 1.25
    assert held >= 0.88
    assert better < 0.4
