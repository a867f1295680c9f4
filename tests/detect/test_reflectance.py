"""Bare metal and filtered pictures: what changes along the antenna or sits at its side, and how far points can be
trusted then."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
import pytest
from numpy.polynomial.legendre import legval

from vbaa_calib.detect.whisker.profile import measure
from vbaa_calib.native import core

from .drawn_lines import SIZE, aside, exposed, straight, tube
from .test_profile import WIDTH_PX, dense

FINE = 5
Brightness = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Shares of the way (M,), places across from −1 to 1 (M,) → grey levels (M,)."""


def metal(path_px: np.ndarray, width_px: float, brightness: Brightness, ground: float = 80.0) -> np.ndarray:
    """(H, W) grey levels of a straight tube along path (2, 2) whose brightness is given, before an even ground."""
    v, u = (np.mgrid[: FINE * SIZE[0], : FINE * SIZE[1]] + 0.5) / FINE - 0.5
    along = (path_px[1] - path_px[0]) / np.linalg.norm(path_px[1] - path_px[0])
    offset = np.stack([u, v], axis=-1) - path_px[0]
    share = offset @ along / np.linalg.norm(path_px[1] - path_px[0])
    across = offset @ np.array([-along[1], along[0]]) / (0.5 * width_px)
    on = (np.abs(across) < 1.0) & (share > 0.0) & (share < 1.0)
    light = np.full(u.shape, ground)
    light[on] = brightness(share[on], across[on])
    blurred = cv2.GaussianBlur(light, (0, 0), 0.7 * FINE)
    return blurred.reshape(SIZE[0], FINE, SIZE[1], FINE).mean(axis=(1, 3))


def bright_to_dark(share: np.ndarray, across: np.ndarray) -> np.ndarray:
    """From a glare through the ground's grey to dark, and a highlight at its side that fades, too."""
    glint = np.exp(-0.5 * ((across - 0.45) / 0.25) ** 2)
    return 150.0 - 130.0 * share + 90.0 * (1.0 - share) * glint


def at_its_side(share: np.ndarray, across: np.ndarray) -> np.ndarray:
    """Grey, with a highlight at one side all along it."""
    return 30.0 + 0.0 * share + 150.0 * np.exp(-0.5 * ((across - 0.5) / 0.3) ** 2)


def test_blurred_polynomials_are_what_convolution_gives() -> None:
    width, blur, fine = 4.3, 0.7, 7 * 32
    at = np.arange(-12 * fine, 12 * fine + 1) / fine
    inside = np.where(np.abs(at) < 0.5 * width, 1.0, 0.0)
    bell = np.exp(-0.5 * at**2 / (blur**2 + 0.29**2))
    for k, column in enumerate(core.profile.blurred_polynomials(width, blur, 12).T):
        sharp = inside * legval(2.0 * at / width, np.eye(4)[k])
        assert np.allclose(column, np.convolve(sharp, bell / bell.sum(), mode="same")[::7], atol=3e-3)


@pytest.mark.parametrize(
    ("brightness", "width_px"), [(bright_to_dark, 3.5), (bright_to_dark, 6.0), (at_its_side, 2.5), (at_its_side, 3.5)]
)
def test_bare_metal_is_measured_between_its_edges(brightness: Brightness, width_px: float) -> None:
    """A symmetric shape that is bright everywhere would lie on the highlight."""
    rng, path = np.random.default_rng(2), straight(12.0, 220.0)
    guide = dense(path) + np.array([0.0, 0.15 * width_px])
    errors, claims, seen = [], [], []
    for _ in range(4):
        line = measure(exposed(metal(path, width_px, brightness), rng), guide, width_px, None)
        assert line.found
        errors.append(aside(path, line.points_px))
        claims.append(line.sigma_px)
        seen.append(line.seen)
    error, claim = np.concatenate(errors), np.concatenate(claims)
    assert np.mean(seen) > 0.8
    assert abs(error.mean()) < 0.06 * width_px
    assert np.sqrt((error**2).mean()) < 1.2 * np.sqrt((claim**2).mean())


@pytest.mark.parametrize("width_px", [2.3, 6.0])
def test_filters_of_a_camera_are_in_the_deviations(width_px: float) -> None:
    """Noise that a filter has made smooth moves neighbours alike, and by more than residuals seem to say."""
    rng, alone, together = np.random.default_rng(5), [], []
    for index in range(8):
        path = straight(4.0 + 7.0 * index, 200.0)
        light = 60.0 + tube(path, width_px, 110.0)
        noise = 4.0 * cv2.GaussianBlur(rng.normal(0.0, 1.0, SIZE), (0, 0), 1.0)
        line = measure(np.rint(light + noise), dense(path) + 0.5, width_px)
        error = aside(path, line.points_px)
        alone.append((error**2).mean() / (line.sigma_px**2).mean())
        runs = len(error) // 20 * 20
        of_runs = error[:runs].reshape(-1, 20).mean(axis=1)
        expected = (line.effective_px[:runs] ** 2).reshape(-1, 20).mean(axis=1) / 20.0
        together.append((of_runs**2).mean() / expected.mean())
        assert (line.effective_px >= line.sigma_px).all()
    assert np.sqrt(np.mean(alone)) == pytest.approx(1.0, abs=0.15)
    assert 0.5 < np.sqrt(np.mean(together)) < 1.25


def test_white_noise_is_not_taken_for_shared() -> None:
    rng, path = np.random.default_rng(6), straight(9.0, 200.0)
    shares = []
    for _ in range(8):
        line = measure(exposed(60.0 + tube(path, WIDTH_PX, 110.0), rng, 2.0), dense(path) + 0.5, WIDTH_PX)
        shares.append(np.mean(line.effective_px / line.sigma_px))
    assert np.mean(shares) < 1.15


def test_the_edge_of_what_hides_its_end_is_not_the_antenna() -> None:
    """An object whose edge lies along the antenna's further half, there in its stead."""
    rng, path = np.random.default_rng(7), straight(10.0, 220.0)
    middle, along = path.mean(axis=0), (path[1] - path[0]) / np.linalg.norm(path[1] - path[0])
    lit = metal(path, 5.0, lambda share, across: 130.0 - 70.0 * share + 30.0 * across)
    v, u = np.mgrid[: SIZE[0], : SIZE[1]]
    ahead = (u - middle[0]) * along[0] + (v - middle[1]) * along[1]
    beside = (v - middle[1]) * along[0] - (u - middle[0]) * along[1]
    object_ = 80.0 + 50.0 / (1.0 + np.exp(-2.0 * beside))
    hidden = 1.0 / (1.0 + np.exp(-2.0 * ahead))
    for _ in range(4):
        line = measure(exposed(lit + hidden * (object_ - lit), rng), dense(path) + 0.5, 5.0, None)
        reached = (line.points_px - middle) @ along
        assert np.quantile(np.diff(np.sort(reached[reached < -10.0])), 0.99) < 3.0
        assert reached.min() < -100.0
        assert reached.max() < 12.0
