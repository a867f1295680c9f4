"""The core's fit of profiles and its normal equations against plain NumPy: convolution and linear least squares."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from vbaa_calib.native import core

PER_PX = 32
HALF, WIDTH_PX, BLUR_PX = 9, 3.4, 0.9
AT = np.arange(-(HALF + 2) * PER_PX, (HALF + 2) * PER_PX + 1) / PER_PX
"""(R,) distances at which cross-sections are tabled."""


@pytest.fixture
def image() -> np.ndarray:
    rng = np.random.default_rng(3)
    v, u = np.mgrid[:90, :200]
    ridge = 90.0 * np.exp(-0.5 * ((v - 40.0 - 0.1 * u) / 1.6) ** 2)
    return rng.normal(0.0, 3.0, v.shape) + 40.0 + 0.2 * u - 0.3 * v + ridge


def section() -> np.ndarray:
    """(R,) of a round, evenly painted antenna, blurred by lens and pixel."""
    inside = np.abs(AT) < 0.5 * WIDTH_PX
    body = np.where(inside, 0.4 + 0.6 * np.sqrt(np.clip(1.0 - (2.0 * AT / WIDTH_PX) ** 2, 0.0, None)), 0.0)
    line = np.convolve(body, np.exp(-0.5 * AT**2 / (BLUR_PX**2 + 0.29**2)), mode="same")
    return line / line.max()


def across(image: np.ndarray, centre: np.ndarray) -> tuple[core.search.Crossings, np.ndarray]:
    """Profiles of a straight path, and the distances (N, T) of their pixels from a line at (N,)."""
    found = core.search.crossings(image, np.array([[12.3, 41.0], [180.0, 58.4]]), HALF, 1.0)
    return found, (found.across - centre[: len(found.along), None]) / found.stretch[:, None]


def at(table: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    return lambda distance: np.interp(distance, AT, table)


@pytest.mark.parametrize("kind", [np.float64, np.float32, np.uint16, np.uint8])
def test_a_line_is_fitted_by_least_squares(image: np.ndarray, kind: type) -> None:
    picture = np.clip(image, 0.0, 255.0).astype(kind)
    centre = np.random.default_rng(4).uniform(-1.0, 1.0, 200)
    found, distance = across(picture, centre)
    value, slope = at(section()), at(np.gradient(section(), 1.0 / PER_PX))
    centre = centre[: len(distance)]
    fits = core.profile.fit(core.profile.expected(WIDTH_PX, BLUR_PX, HALF + 2), found, centre)
    for n, grey in enumerate(found.profiles):
        shape, moved = value(distance[n]), -slope(distance[n]) / found.stretch[n]
        columns = np.stack([np.ones(grey.size), np.arange(grey.size), shape, moved], axis=1)
        solved, squares, *_ = np.linalg.lstsq(columns, grey, rcond=None)
        unit = np.sqrt(np.linalg.inv(columns.T @ columns)[2, 2])
        meant = np.clip(solved[3] / solved[2], -HALF, HALF), solved[2], unit, np.sqrt(squares[0] / (grey.size - 4))
        assert [each[n] for each in fits] == pytest.approx(meant, rel=1e-8)


def test_normal_equations_are_products_of_columns_without_background(image: np.ndarray) -> None:
    rng, reach = np.random.default_rng(5), HALF + 2
    centre = rng.uniform(-1.0, 1.0, 200)
    found, distance = across(image, centre)
    coefficients = rng.normal(0.0, 30.0, (len(distance), 4))
    made = core.profile.normal_equations(found, centre[: len(distance)], WIDTH_PX, BLUR_PX, coefficients, reach)
    plain, wider, softer = (
        core.profile.blurred_polynomials(WIDTH_PX * a, BLUR_PX * b, reach) for a, b in ((1, 1), (1.02, 1), (1, 1.02))
    )
    q, _ = np.linalg.qr(np.stack([np.ones(2 * HALF + 1), np.arange(2 * HALF + 1)], axis=1))
    for n, own in enumerate(coefficients):
        alone = np.stack([at(column)(distance[n]) for column in plain.T])
        width, blur = (at((changed - plain) @ own / 0.02)(distance[n]) for changed in (wider, softer))
        place = at(np.gradient(plain @ own, 1.0 / PER_PX))(distance[n]) / -found.stretch[n]
        share = found.along[n] / found.along[-1] - 0.5
        columns = np.stack([*alone, width, blur, share * width, place, found.profiles[n]])
        columns -= columns @ q @ q.T
        meant = columns @ columns.T
        assert np.allclose(made[n], meant, rtol=1e-8, atol=1e-8 * np.sqrt(np.outer(meant.diagonal(), meant.diagonal())))
