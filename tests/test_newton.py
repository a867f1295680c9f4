"""Newton's method and the small linear systems of the kernels, against NumPy."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest

from vbaa_calib.core.compiled import kernel
from vbaa_calib.core.newton import newton_for, solve


class Circle(NamedTuple):
    """x² + y² = square, y = slope·x."""

    square: float
    slope: float


@kernel
def _residual(circle: Circle, x: np.ndarray, values: np.ndarray) -> None:
    values[0] = x[0] ** 2 + x[1] ** 2 - circle.square
    values[1] = x[1] - circle.slope * x[0]


_newton = newton_for(_residual)


@pytest.mark.parametrize("slope", [0.0, -0.7, 3.0])
def test_newton_finds_the_root_or_its_limit(slope: float) -> None:
    x, wide, narrow = np.ones(2), np.full(2, 9.0), np.full(2, 0.1)
    assert _newton(Circle(4.0, slope), x, -wide, wide, 1e-12) <= 1e-12
    np.testing.assert_allclose(x, np.array([1.0, slope]) * 2.0 / np.hypot(1.0, slope), atol=1e-12)
    assert _newton(Circle(4.0, slope), x, -narrow, narrow, 1e-12) > 1.0
    assert (np.abs(x) <= narrow).all()


def test_small_systems_are_numpys() -> None:
    rng = np.random.default_rng(3)
    for n in (1, 3, 8):
        matrix, right = rng.normal(size=(n, n)), rng.normal(size=(n, 3))
        x = right.copy()
        assert solve(matrix, x)
        np.testing.assert_allclose(x, np.linalg.solve(matrix, right), rtol=1e-9)


def test_a_singular_system_has_the_pseudo_inverses_answer() -> None:
    rng = np.random.default_rng(4)
    matrix, right = rng.normal(size=(6, 6)), rng.normal(size=(6, 2))
    matrix[:, 4] = 0.0
    x = right.copy()
    assert solve(matrix, x)
    np.testing.assert_allclose(x, np.linalg.pinv(matrix) @ right, rtol=1e-5, atol=1e-8)
    matrix[2, 2] = np.nan
    assert not solve(matrix, x)
