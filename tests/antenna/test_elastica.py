"""The planar elastica against elliptic integrals, an initial-value solver, a boundary-value solver, and its laws."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest
from scipy.integrate import solve_bvp, solve_ivp
from scipy.optimize import brentq

from vbaa_calib.antenna import elastica, linear

EI, LENGTH = 3.9e-3, 0.24


def integrated(s: np.ndarray, load: float, angle_of_force: float, curvature: float) -> np.ndarray:
    """x, w, θ (3, N) of a unit antenna, from the clamp on: a force normal to a tangent at `angle_of_force` at its end.

    Shoots for the curvature at the clamp that leaves none at the end, starting near the one given.
    """

    def shot(start: float):
        return solve_ivp(
            lambda _, state: [np.cos(state[2]), np.sin(state[2]), state[3], -load * np.cos(angle_of_force - state[2])],
            (0.0, 1.0),
            [0.0, 0.0, 0.0, start],
            method="DOP853",
            rtol=1e-13,
            atol=1e-14,
            dense_output=True,
        )

    start = brentq(lambda value: shot(value).y[3, -1], 0.99 * curvature, 1.01 * curvature, xtol=1e-15)
    return shot(start).sol(s)[:3]


@pytest.mark.parametrize("load", [1e-6, 0.7, 2.51, 60.0])
def test_dead_tip_load_against_elliptic_integrals(load: float) -> None:
    """Bisshopp and Drucker's closed form at 30 digits, a route that shares nothing with the pendulum's."""
    with mpmath.workdps(30):
        root = mpmath.sqrt(mpmath.mpf(load))

        def squared_and_amplitude(theta):
            squared = (1 + mpmath.sin(theta)) / 2
            return squared, mpmath.asin(1 / mpmath.sqrt(2 * squared))

        def excess(theta):
            m, amplitude = squared_and_amplitude(theta)
            return mpmath.ellipk(m) - mpmath.ellipf(amplitude, m) - root

        bracket = (mpmath.mpf(load) / 4 if load < 1 else mpmath.mpf("0.2"), mpmath.pi / 2 - mpmath.mpf("1e-12"))
        theta = mpmath.findroot(excess, bracket, solver="anderson", tol=1e-40, maxsteps=500)
        m, amplitude = squared_and_amplitude(theta)
        w = 1 - 2 / root * (mpmath.ellipe(m) - mpmath.ellipe(amplitude, m))
        expected = [float(mpmath.sqrt(2 * mpmath.sin(theta) / load)), float(w), float(theta)]
    shape = elastica.planar_elastica_dead([1.0], 1.0, [load], 1.0)
    np.testing.assert_allclose([shape.x_m[0, 0], shape.w_m[0, 0], shape.theta_rad[0, 0]], expected, rtol=0, atol=1e-11)


@pytest.mark.parametrize("load", [0.05, 0.6, 2.4, 2.6, 4.5, 9.0])
@pytest.mark.parametrize("lean", [0.0, 0.3, -0.5])
def test_contact_force_against_shooting_from_the_clamp(load: float, lean: float) -> None:
    s = np.linspace(0.0, 1.0, 21)
    shape = elastica.normal_load(s, [load], lean)
    near_clamp = elastica.normal_load([1e-4], [load], lean).theta_rad[0, 0] / 1e-4
    x, w, theta = integrated(s, load, shape.theta_rad[0, -1] + lean, near_clamp)
    np.testing.assert_allclose(shape.x_m[0], x, atol=1e-10)
    np.testing.assert_allclose(shape.w_m[0], w, atol=1e-10)
    np.testing.assert_allclose(shape.theta_rad[0], theta, atol=1e-10)


@pytest.mark.parametrize("lean", [0.0, 0.6, -0.8])
def test_dead_force_against_a_boundary_value_solver(lean: float) -> None:
    """Clamped at one end, moment-free at the other, force of fixed direction: θ″ = −a·cos(θ − β)."""
    s = np.linspace(0.0, 1.0, 41)
    solution = solve_bvp(
        lambda _, state: [state[1], -3.0 * np.cos(lean - state[0])],
        lambda clamp, tip: [clamp[0], tip[1]],
        s,
        np.stack([s, 1.0 - s]),
        tol=1e-11,
        max_nodes=50000,
    )
    assert solution.success
    np.testing.assert_allclose(
        elastica.planar_elastica_dead(s, 1.0, [3.0], 1.0, lean).theta_rad[0], solution.sol(s)[0], atol=1e-9
    )


def test_small_loads_meet_the_linear_beam() -> None:
    """To first order the beam; the next term is of relative order a², and there is no floor of rounding under it."""
    s = np.linspace(0.02, LENGTH, 40)
    for load in (1e-2, 1e-4, 1e-7, 1e-12):
        force = load * EI / 0.15**2
        exact = elastica._planar_elastica(s, [0.15], [force], EI)
        beam = linear.deflection(s, 0.15, force, EI)
        np.testing.assert_allclose(exact.w_m[0], beam, rtol=load**2 + 1e-12)
        np.testing.assert_allclose(exact.theta_rad[0], linear.slope(s, 0.15, force, EI), rtol=load**2 + 1e-12)


@pytest.mark.parametrize("force", [0.05, -0.4, 1.2])
@pytest.mark.parametrize("friction", [0.0, 0.25, -0.25])
def test_clamp_moment_balances_the_contact_force(force: float, friction: float) -> None:
    """EI·θ′ at the clamp is the moment of the contact force there; unit speed and tangents hold along the antenna."""
    step = 1e-6
    shape = elastica._planar_elastica([0.0, step, 2 * step, 0.15], [0.15], [force], EI, friction)
    curvature = (4 * shape.theta_rad[0, 1] - shape.theta_rad[0, 2]) / (2 * step)
    # inclined by friction towards the clamp
    angle = shape.theta_rad[0, 3] + np.copysign(friction, force * friction)
    f_x, f_w = -force * np.sin(angle), force * np.cos(angle)
    assert np.hypot(f_x, f_w) == pytest.approx(abs(force))
    assert EI * curvature == pytest.approx(shape.x_m[0, 3] * f_w - shape.w_m[0, 3] * f_x, rel=1e-7)
