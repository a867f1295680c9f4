"""The antenna in colours: its shades, and lines that are drawn here, measured before plain and patched backgrounds."""

from __future__ import annotations

import numpy as np
import pytest

from vbaa_calib.detect.whisker.profile import measure_in_colour
from vbaa_calib.native import core

from .drawn_lines import SIZE, aside, bent, exposed, straight, tube
from .test_profile import dense
from .test_reflectance import at_its_side, bright_to_dark, metal


def test_shades_are_what_convolution_gives() -> None:
    """The backgrounds, and the series in the angle of a round surface, blurred; and their derivatives."""
    width, blur, fine = 4.3, 0.7, 7 * 32
    at = np.arange(-12 * fine, 12 * fine + 1) / fine
    inside, angle = np.abs(at) < 0.5 * width, np.arcsin(np.clip(2.0 * at / width, -1.0, 1.0))
    sharp = [at < -0.5 * width, at > 0.5 * width]
    for k in (1, 2, 3):
        sharp += [np.where(inside, wave(k * angle), 0.0) for wave in (np.sin, np.cos)]
    bell = np.exp(-0.5 * at**2 / (blur**2 + 0.29**2))
    tabled, wider, softer = (core.profile.shades(width * a, blur * b, 12) for a, b in ((1, 1), (1.001, 1), (1, 1.001)))
    for k, shape in enumerate(sharp):
        shade = np.asarray(shape, float)
        if k > 1:
            shade[inside] -= shade[inside].mean()
            shade[inside] /= np.sqrt((shade[inside] ** 2).mean())
        meant = np.convolve(shade, bell / bell.sum(), mode="same")[::7]
        middle = slice(7 * 32, -7 * 32)  # beyond, the convolution ends
        assert np.allclose(tabled[middle, k], meant[middle], atol=5e-3)
        assert np.allclose(tabled[:, 8 + k], np.gradient(tabled[:, k], 1.0 / 32.0), atol=4e-3)
        assert np.allclose(tabled[:, 16 + k], (wider - tabled)[:, k] / 0.001, atol=4e-3)
        assert np.allclose(tabled[:, 24 + k], (softer - tabled)[:, k] / 0.001, atol=4e-3)


def in_colour(cover: np.ndarray, ground: np.ndarray, rng: np.random.Generator, noise: float = 1.5) -> np.ndarray:
    """(H, W, 3) of an antenna of one colour that covers so much (H, W) of a ground (H, W, 3)."""
    light = ground + cover[..., None] * (np.array([150.0, 120.0, 90.0]) - ground)
    return np.stack([exposed(channel, rng, noise) for channel in np.moveaxis(light, -1, 0)], axis=-1)


@pytest.mark.parametrize("width_px", [2.5, 4.0, 9.0])
@pytest.mark.parametrize("patched", [False, True])
def test_lines_are_where_and_as_sure_as_they_say(width_px: float, patched: bool) -> None:
    """Before one background, and before patches here darker, there brighter, on either side their own."""
    rng, errors, claims = np.random.default_rng(int(10 * width_px)), [], []
    for _ in range(4):
        path = bent((40.0, 100.0 + rng.uniform(0, 1)), rng.uniform(-5, 10), rng.uniform(0, 30))
        ground = np.full((*SIZE, 3), 60.0)
        if patched:
            for begin in range(0, SIZE[1], 45):
                ground[:, begin : begin + 45] = rng.uniform(20.0, 230.0, 3)
        picture = in_colour(tube(path, width_px, 1.0), ground, rng)
        line = measure_in_colour(picture, dense(path) + 0.4, width_px)
        assert line.found
        assert line.seen > 0.9
        errors.append(aside(path, line.points_px))
        claims.append(line.sigma_px)
    error, claim = np.concatenate(errors), np.concatenate(claims)
    assert np.sqrt((error**2).mean()) < 0.05
    assert 0.4 < np.sqrt((error**2).mean() / (claim**2).mean()) < 1.4


@pytest.mark.parametrize("brightness", [bright_to_dark, at_its_side])
def test_a_highlight_at_its_side_does_not_pull_the_line(brightness) -> None:
    rng, path, width_px = np.random.default_rng(2), straight(12.0, 220.0), 5.0
    light = metal(path, width_px, brightness)
    picture = np.stack([exposed(light, rng) for _ in range(3)], axis=-1)
    line = measure_in_colour(picture, dense(path) + np.array([0.0, 0.15 * width_px]), width_px)
    assert line.found
    assert abs(aside(path, line.points_px).mean()) < 0.04 * width_px


def test_what_hides_it_leaves_a_gap() -> None:
    rng, path = np.random.default_rng(4), straight(10.0)
    picture = in_colour(tube(path, 4.0, 1.0), np.full((*SIZE, 3), 60.0), rng)
    picture[:, 140:175] = np.rint(90.0 + rng.normal(0.0, 1.5, (SIZE[0], 35, 3)))
    u = measure_in_colour(picture, dense(path) + 0.5, 4.0).points_px[:, 0]
    assert not ((u > 142) & (u < 173)).any()
    assert ((u < 135).sum() > 50) & ((u > 180).sum() > 50)
