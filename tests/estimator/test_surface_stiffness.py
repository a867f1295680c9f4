"""The object's stiffness from force against displacement: told where the data tell it, and not where they do not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from estimator.object.surface import reconstruct
from estimator.object.surface.build import MODEL_SHARE

from .touched import CYLINDER, RADIUS_M, SPHERE, drawn, spread_touches


@pytest.mark.parametrize("stiffness_N_m", [20.0, 100.0])
def test_a_soft_ball_s_stiffness_and_its_unpressed_shape(stiffness_N_m: float) -> None:
    true = spread_touches(SPHERE, 60, np.random.default_rng(0), compliance_m_N=1 / stiffness_N_m, common=False)
    surface = reconstruct(drawn(true, np.random.default_rng(1)), RADIUS_M)
    soft = surface.compliance
    assert soft.determined
    assert soft.stiffness_N_m == pytest.approx(stiffness_N_m, rel=0.1)
    assert soft.interval_N_m[0] < stiffness_N_m < soft.interval_N_m[1]
    # nothing is common, but the model is not exact
    assert MODEL_SHARE / stiffness_N_m < soft.std_m_N < 1e-3
    # pressed in by up to 3 mm, drawn where it is when nobody touches it
    assert np.sqrt(np.mean(SPHERE.signed_distance(surface.touched_m)[0] ** 2)) < 1e-4


def test_common_errors_widen_the_interval() -> None:
    """An error of the antenna's stiffness moves points with the forces: that looks like yielding."""
    true = spread_touches(SPHERE, 60, np.random.default_rng(0), compliance_m_N=0.01)
    true.modes_m[:, :, 6] = 1.5e-3 * true.force_N
    soft = reconstruct(drawn(true, np.random.default_rng(1)), RADIUS_M).compliance
    assert soft.std_m_N > 1.5e-3


def test_a_rigid_object_is_stiffer_than_so_much() -> None:
    true = spread_touches(CYLINDER, 60, np.random.default_rng(0), common=False)
    soft = reconstruct(drawn(true, np.random.default_rng(2)), RADIUS_M).compliance
    assert not soft.determined
    assert np.isnan(soft.stiffness_N_m)
    assert soft.interval_N_m[0] > 300
    assert soft.interval_N_m[1] == np.inf
    assert soft.reason.startswith("the object is stiffer than")


def test_forces_that_are_all_alike_tell_nothing() -> None:
    true = spread_touches(SPHERE, 40, np.random.default_rng(0), common=False)
    force = 0.03 * true.force_N / np.linalg.norm(true.force_N, axis=1, keepdims=True)
    surface = reconstruct(drawn(replace(true, force_N=force), np.random.default_rng(1)), RADIUS_M)
    assert not surface.compliance.determined
    assert "cannot be told" in surface.compliance.reason
    assert np.isnan(surface.compliance.interval_N_m).all()


def test_what_comes_out_under_pressure_points_at_the_calibration() -> None:
    true = spread_touches(SPHERE, 60, np.random.default_rng(0), compliance_m_N=-0.02, common=False)
    soft = reconstruct(drawn(true, np.random.default_rng(1)), RADIUS_M).compliance
    assert not soft.determined
    assert "check the rig's calibration" in soft.reason
