"""The paper's beam against beam theory integrated numerically, and the laws that linear elasticity obeys."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.beam import (
    deflection_by_contact,
    superposed_deflection,
    weight_clamp_moment,
    weight_deflection,
    weight_slope,
)
from vbaa_calib.antenna import linear

EI, LENGTH = 3.9e-3, 0.24


def integrated(moment_of_x, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Deflection and slope at x from y″ = M/EI, clamped at 0: no closed form in it."""
    solution = solve_ivp(
        lambda s, state: [state[1], moment_of_x(s) / EI],
        (0.0, x[-1]),
        [0.0, 0.0],
        t_eval=x,
        rtol=1e-12,
        atol=1e-15,
        max_step=1e-3,
    )
    return solution.y[0], solution.y[1]


@pytest.mark.parametrize("contact", [0.04, 0.16, 0.24])
def test_point_load_against_integration(contact: float) -> None:
    x = np.linspace(0.0, LENGTH, 49)
    y, slope = integrated(lambda s: 0.3 * max(contact - s, 0.0), x)
    np.testing.assert_allclose(linear.deflection(x, contact, 0.3, EI), y, atol=1e-11)
    np.testing.assert_allclose(linear.slope(x, contact, 0.3, EI), slope, atol=1e-9)


def test_weight_against_integration() -> None:
    x = np.linspace(0.0, LENGTH, 49)
    y, slope = integrated(lambda s: 0.5 * 0.04 * (LENGTH - s) ** 2, x)
    np.testing.assert_allclose(weight_deflection(x, LENGTH, 0.04, EI), y, atol=1e-11)
    np.testing.assert_allclose(weight_slope(x, LENGTH, 0.04, EI), slope, atol=1e-9)


def test_weight_is_the_sum_of_many_small_loads() -> None:
    x = np.linspace(0.0, LENGTH, 13)
    middles = (np.arange(4000) + 0.5) * LENGTH / 4000
    many = superposed_deflection(x, middles, np.full(4000, 0.04 * LENGTH / 4000), EI)
    np.testing.assert_allclose(weight_deflection(x, LENGTH, 0.04, EI), many, rtol=1e-6)
    assert weight_clamp_moment(LENGTH, 0.04) == pytest.approx(LENGTH / 2 * 0.04 * LENGTH)


def test_weight_of_the_papers_antenna() -> None:
    """0.8 mm steel, 240 mm: about 4 mm of sag and 1.1 mN·m at the clamp."""
    load = 7900.0 * np.pi * 0.0004**2 * 9.80665
    assert 4.0e-3 < weight_deflection(LENGTH, LENGTH, load, EI) < 4.2e-3
    assert 1.1e-3 < weight_clamp_moment(LENGTH, load) < 1.15e-3


def test_slope_and_contact_derivative_are_derivatives() -> None:
    rng = np.random.default_rng(0)
    x, contact = rng.uniform(0.01, LENGTH, (2, 500))
    step = 1e-6
    by_x = (linear.deflection(x + step, contact, 1.0, EI) - linear.deflection(x - step, contact, 1.0, EI)) / (2 * step)
    by_l = (linear.deflection(x, contact + step, 1.0, EI) - linear.deflection(x, contact - step, 1.0, EI)) / (2 * step)
    np.testing.assert_allclose(linear.slope(x, contact, 1.0, EI), by_x, rtol=1e-6)
    np.testing.assert_allclose(deflection_by_contact(x, contact, 1.0, EI), by_l, rtol=1e-6)


def test_reciprocity_and_contact_deflection() -> None:
    """Maxwell: a load at a seen at b is a load at b seen at a; at the contact both parts meet in Eqs. (17), (18)."""
    rng = np.random.default_rng(1)
    a, b = rng.uniform(0.0, LENGTH, (2, 200))
    np.testing.assert_allclose(linear.deflection(a, b, 1.0, EI), linear.deflection(b, a, 1.0, EI), rtol=1e-14)
    np.testing.assert_allclose(linear.deflection_at_contact(a, 0.2, EI), linear.deflection(a, a, 0.2, EI), rtol=1e-14)


def test_both_parts_as_the_paper_prints_them() -> None:
    x = np.linspace(0.0, LENGTH, 101)
    contact, force = 0.13, -0.4
    curved, straight = force / (6 * EI) * (3 * contact - x) * x**2, force / (6 * EI) * (3 * x - contact) * contact**2
    expected = np.where(x <= contact, curved, straight)
    np.testing.assert_allclose(linear.deflection(x, contact, force, EI), expected, rtol=1e-13)


def test_outside_is_nan() -> None:
    assert np.isnan(linear.deflection([-0.01, 0.1], [0.1, -0.1], 1.0, EI)).all()
    assert np.isnan(linear.slope(-0.01, 0.1, 1.0, EI))
    assert np.isnan(linear.deflection_at_contact(-0.1, 1.0, EI))
