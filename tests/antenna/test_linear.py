"""The paper's beam against beam theory integrated numerically, and the laws that linear elasticity obeys."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from vbaa_calib.antenna import linear

from ..beam import deflection_by_contact

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
    np.testing.assert_allclose(linear.deflection(a, a, 0.2, EI), 0.2 * a**3 / (3.0 * EI), rtol=1e-14)


def test_outside_is_nan() -> None:
    assert np.isnan(linear.deflection([-0.01, 0.1], [0.1, -0.1], 1.0, EI)).all()
    assert np.isnan(linear.slope(-0.01, 0.1, 1.0, EI))
    assert np.isnan(linear.deflection(-0.1, -0.1, 1.0, EI))
