"""The Gaussian process under the surface: its derivatives against differences, its solve against the textbook's."""

from __future__ import annotations

import numpy as np
import pytest

from estimator.object.surface.solution import (
    Equations,
    Functionals,
    PatchModel,
    Prior,
    covariance,
    pairs,
    solve,
    values_at,
)

PRIOR = Prior(length_m=0.02, amplitude_m=0.004, offset_m=0.1, incline=1.5)


def views(rng: np.random.Generator, count: int) -> Functionals:
    """Values, slopes and mixtures of two functions of two coordinates."""
    return Functionals(
        0.02 * rng.standard_normal((count, 2)), rng.standard_normal((count, 2)), rng.standard_normal((count, 2, 2))
    )


def test_the_solve_is_the_textbook_s_with_compliance_as_a_vague_number() -> None:
    """Posterior of shape and compliance against conditioning one joint Gaussian, the compliance's prior nearly flat."""
    rng = np.random.default_rng(3)
    rows, count, flat = views(rng, 25), 25, 1e3
    modes, force = 1e-3 * rng.standard_normal((count, 2)), 0.03 * rng.standard_normal(count)
    equations = Equations(rows, 0.01 * rng.standard_normal(count), 1e-6 * np.eye(count), modes, force, np.zeros(count))
    solution = solve((PatchModel(equations, PRIOR, 0.0),), True)
    at = values_at(0.01 * rng.standard_normal((3, 2)), np.array([1.0, 0.0]))
    seen = np.vstack([covariance(pairs(at, rows), PRIOR), flat**2 * force])
    own = (
        covariance(pairs(rows, rows), PRIOR) + 1e-6 * np.eye(count) + modes @ modes.T + flat**2 * np.outer(force, force)
    )
    prior = np.zeros((4, 4))
    prior[:3, :3], prior[3, 3] = covariance(pairs(at, at), PRIOR), flat**2
    gain = np.linalg.solve(own, seen.T).T
    mean, left = gain @ equations.y, np.diag(prior - gain @ seen.T)
    np.testing.assert_allclose(solution.mean(0, at), mean[:3], rtol=1e-4, atol=1e-7)
    np.testing.assert_allclose(solution.spread(0, at), np.sqrt(left[:3]), rtol=1e-3)
    np.testing.assert_allclose(np.diag(solution.joint([(0, at)])), left[:3], rtol=2e-3)
    assert solution.compliance_m_N == pytest.approx(mean[3], rel=1e-4)


def test_left_out_residuals_are_those_of_leaving_out() -> None:
    rng = np.random.default_rng(4)
    rows = values_at(0.02 * rng.standard_normal((12, 2)), np.ones(1))
    noise = np.diag(rng.uniform(1e-8, 1e-6, 12))
    equations = Equations(rows, 0.003 * rng.standard_normal(12), noise, np.zeros((12, 0)), np.zeros(12), np.zeros(12))
    residual = solve((PatchModel(equations, PRIOR, 0.0),), False).leave_one_out_residuals
    whole = covariance(pairs(rows, rows), PRIOR) + noise
    for index in (0, 5, 11):
        others = np.arange(12) != index
        gain = np.linalg.solve(whole[np.ix_(others, others)], whole[others, index])
        spread = np.sqrt(whole[index, index] - gain @ whole[others, index])
        expected = (equations.y[index] - gain @ equations.y[others]) / spread
        assert residual[index] == pytest.approx(expected, rel=1e-5)
