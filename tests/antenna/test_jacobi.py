"""Jacobi's functions against SciPy and, where SciPy gives up digits, against mpmath."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest
from scipy.special import ellipeinc, ellipj, ellipk

from vbaa_calib.native import core


def jacobi(u: np.ndarray, m: float) -> np.ndarray:
    """(4, N) sn, cn, dn, and E(am)."""
    return np.transpose([core.antenna.jacobi(each, m) for each in u])


@pytest.mark.parametrize("m", [0.0, 1e-12, 1e-3, 0.1, 0.5, 0.9, 0.999, 1 - 1e-5])
def test_against_scipy_over_several_quarter_periods(m: float) -> None:
    u = np.linspace(-3.3, 5.2, 997) * ellipk(m)
    sn, cn, dn, amplitude = ellipj(u, m)
    found = jacobi(u, m)
    for values, expected in zip(found, (sn, cn, dn, ellipeinc(amplitude, m)), strict=True):
        np.testing.assert_allclose(values, expected, rtol=0, atol=1e-13)


@pytest.mark.parametrize("m", [0.3, 1 - 1e-9, 1 - 1e-12])
def test_against_mpmath(m: float) -> None:
    u = np.linspace(-2.9, 3.7, 23) * ellipk(m)
    found = jacobi(u, m)
    with mpmath.workdps(30):
        for name, values in zip(("sn", "cn", "dn"), found, strict=False):
            expected = [float(mpmath.ellipfun(name, mpmath.mpf(x), m=mpmath.mpf(m))) for x in u]
            np.testing.assert_allclose(values, expected, rtol=0, atol=1e-13)
        inside = np.abs(u) < ellipk(m)
        expected = [
            float(mpmath.ellipe(mpmath.asin(mpmath.ellipfun("sn", mpmath.mpf(x), m=mpmath.mpf(m))), mpmath.mpf(m)))
            for x in u[inside]
        ]
    np.testing.assert_allclose(found[3][inside], expected, rtol=0, atol=1e-13)
