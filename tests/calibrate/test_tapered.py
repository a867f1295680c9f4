"""A cone: its EI and its taper out of known loads, within the stated diameters' accuracy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from vbaa_calib.calibrate.antenna.bundle_adjustment import adjust_bundle

from .reported_sessions import coned, drawn_truth, reported


@pytest.mark.parametrize("stated", [1.0, 1.02])
def test_a_cones_stiffness_and_taper_are_solved(stated: float) -> None:
    """Also where the tip is stated two per cent too thick, by a caliper that is no better."""
    rng = np.random.default_rng(4)
    truth = coned(drawn_truth(rng), 0.5)
    length, thick = truth.antenna.length_m, truth.antenna.diameter_m
    profile = ((0.0, thick), (length, 0.5 * stated * thick))
    known = replace(truth.antenna, profile=profile, diameter_std_m=0.01 * thick)
    drawn = reported(replace(truth, antenna=known), rng)
    joint = adjust_bundle(drawn.observations, drawn.before, length, drawn.session.moment_std_Nm)
    before, at = joint.problem.prior, joint.problem.taper
    std = before.log_tip_std * float(np.sqrt(joint.solution.covariance()[at, at][0, 0]))
    assert std < 0.3 * before.log_tip_std
    assert abs(joint.log_tip + np.log(stated)) < 3.0 * std
    assert abs(joint.parameters[12] - truth.parameters[6]) < 3.0 * np.sqrt(joint.covariance[12, 12])
