"""Robust statistics against sampling and against the losses that their weights belong to."""

import numpy as np
import pytest
from scipy.stats import chi2

from vbaa_calib.core.robust import chi_limit, chi_square, chi_square_p, huber_losses, huber_weights, mad_std, radial_std

from .lazy import Lazy

torch = Lazy("torch")


def test_medians_give_the_standard_deviation_of_normal_numbers_and_forgive_outliers():
    noise = 0.3 * np.random.default_rng(1).standard_normal((200_000, 2))
    noise[:200] += 1e3
    assert mad_std(noise[:, 0]) == pytest.approx(0.3, rel=0.01)
    assert radial_std(np.linalg.norm(noise, axis=1)) == pytest.approx(0.3, rel=0.01)


@pytest.mark.parametrize("kind", [lambda each: np.asarray(each), lambda each: torch.as_tensor(each)])
def test_weights_are_the_slope_of_the_loss_over_the_residual(kind):
    residuals = np.array([-40.0, -3.0, -1.0, 0.5, 2.4, 2.6, 9.0])
    step = 1e-6
    ahead, behind = (np.asarray(huber_losses(kind(residuals + sign * step))) for sign in (1, -1))
    weights = np.asarray(huber_weights(kind(residuals)))
    np.testing.assert_allclose((ahead - behind) / (2 * step), weights * residuals, rtol=1e-6)


def test_chi_square_is_scipys_whatever_the_units():
    covariance = np.array([[4.0, 0.3], [0.3, 1.0]])
    units = np.diag([1e-6, 1e4])
    errors = np.array([1.0, -2.0])
    square = errors @ np.linalg.solve(covariance, errors)
    assert chi_square(units @ errors, units @ covariance @ units) == pytest.approx(square, rel=1e-12)
    for freedom in (1, 1.3, 2, 3, 8, 17, 300, 3e4):
        for number in (0.0, 1e-9, square, 30.0, 400.0, 3e4, np.inf):
            assert chi_square_p(number, freedom) == pytest.approx(chi2.sf(number, freedom), rel=1e-10, abs=1e-300)
        for chance in (1e-100, 0.025, 0.5, 1.0 - 1e-6):
            assert chi_limit(chance, freedom) ** 2 == pytest.approx(chi2.isf(chance, freedom), rel=1e-10)
