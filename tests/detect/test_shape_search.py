"""The shapes along which a picture shows two edges: laws on drawn pictures."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from vbaa_calib.native import core

from .drawn_lines import SIZE, aside, background, exposed, tube

WIDTH_PX, SPACING_PX, LENGTH_PX = 5.0, 6.0, 200.0
CONTACTS = np.array([0.25, 0.5, 0.75, 1.0])
NO_LOOKS = np.empty((0, 4))
ODDS = SimpleNamespace(
    surface_spread=50.0,
    colour_spread=15.0,
    edge_rate=0.1,
    hidden_odds=-1.5,
    hidden_root_odds=-3.0,
    correlation_px=6.0,
    strain_std=0.01,
    look_odds=2.0,
)


def shape(turn_rad: float, contact: float = 0.6, heading_rad: float = 0.0) -> np.ndarray:
    """(73, 2) the axis, turned at its tip as a force at a part of its length does."""
    reach = np.linspace(0.0, 1.0, 73) / contact
    bend = np.where(reach < 1.0, reach * (2.0 - reach), 1.0)
    angle = heading_rad + turn_rad * bend / bend[-1]
    along = LENGTH_PX / 72 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    start = np.array([[159.5, 119.5]]) - 100.0 * np.array([[np.cos(heading_rad), np.sin(heading_rad)]])
    return start + np.concatenate([np.zeros((1, 2)), np.cumsum(0.5 * (along[1:] + along[:-1]), axis=0)])


def found(picture: np.ndarray, heading_rad: float = 0.0, looks: np.ndarray = NO_LOOKS, most: int = 2) -> list:
    """The shapes about a straight axis."""
    turns = np.arange(-0.6, 0.61, 0.05)
    paths = np.array([shape(turn, contact, heading_rad) for contact in CONTACTS for turn in turns])
    axis = shape(0.0, 1.0, heading_rad)
    taken = np.ascontiguousarray(picture)
    return core.search.likely_shapes(
        taken, axis, paths, SPACING_PX, WIDTH_PX, CONTACTS, (1.5, 0.015), looks, ODDS, most
    )


def drawn(path: np.ndarray, height: float = 60.0, seed: int = 3) -> np.ndarray:
    """(H, W) float32: a tube before blots."""
    rng = np.random.default_rng(seed)
    return exposed(background(rng) + 40.0 + tube(path, WIDTH_PX, height), rng)


def off(path: np.ndarray, true: np.ndarray) -> float:
    """How far the points of a path are from the true line on average, px: at clear edges odds do not tell a pixel."""
    return float(np.abs(aside(true, path)).mean())


TRUE = shape(0.37)
PICTURE = drawn(TRUE)


@pytest.mark.parametrize("height", [60.0, -50.0, 25.0])
def test_a_tube_is_found_whatever_its_polarity(height: float) -> None:
    """Brighter or darker than what it is before: the middle of its edges."""
    assert off(found(drawn(TRUE, height))[0][2], TRUE) < 1.0


@pytest.mark.parametrize("colour", [(30.0, 30.0, -30.0), (-25.0, 25.0, 0.0), (40.0, 0.0, 0.0)])
def test_a_tube_is_found_whatever_its_colour(colour: tuple[float, float, float]) -> None:
    """Also one that is hardly brighter or darker than its background."""
    picture = np.stack([drawn(TRUE, height, seed=4 + k) for k, height in enumerate(colour)], axis=-1)
    assert off(found(picture.astype(np.uint8))[0][2], TRUE) < 1.0


def test_its_background_may_change_along_it() -> None:
    """Brighter than one half of what is behind it and darker than the other."""
    changing = np.where(np.arange(SIZE[1]) < 150, 60.0, 160.0)
    tubes = tube(TRUE, WIDTH_PX, 1.0)
    picture = exposed(changing + (110.0 - changing) * np.clip(2.0 * tubes, 0.0, 1.0), np.random.default_rng(5))
    assert off(found(picture)[0][2], TRUE) < 1.0


def test_a_mirrored_picture_shows_the_mirrored_shape() -> None:
    """Up and down exchanged about the axis."""
    (_, bend, path, _), *_ = found(PICTURE)
    (_, other, mirrored, _), *_ = found(PICTURE[::-1])
    assert_allclose(mirrored, path * [1.0, -1.0] + [0.0, SIZE[0] - 1.0], atol=2.0)
    assert abs(bend[1] + other[1]) < 0.03


def test_a_turned_picture_shows_the_turned_shape() -> None:
    """By half a turn about its middle, as the axis is."""
    path, turned = found(PICTURE)[0][2], found(PICTURE[::-1, ::-1], np.pi)[0][2]
    assert_allclose(turned, np.array(SIZE[::-1]) - 1.0 - path, atol=2.0)


@pytest.mark.parametrize("exposure", [lambda level: 0.6 * level, lambda level: 255.0 - level, lambda level: level + 40])
def test_light_does_not_matter(exposure: Callable[[np.ndarray], np.ndarray]) -> None:
    """Scaled, inverted or raised levels show the same shape."""
    assert_allclose(found(exposure(PICTURE))[0][2], found(PICTURE)[0][2], atol=2.0)


def test_what_hides_its_middle_does_not_matter() -> None:
    """A bar across it, with edges of its own."""
    picture = PICTURE.copy()
    picture[:, 130:165] = 200.0
    evidence, _, path, odds = found(picture)[0]
    hidden = (path[:, 0] > 132) & (path[:, 0] < 162)
    assert off(path, TRUE) < 1.0
    assert odds[hidden].mean() < 0.5 * odds[~hidden].mean()
    assert evidence < found(PICTURE)[0][0]


def test_an_empty_picture_shows_little() -> None:
    """Its best shape has far less evidence, and a flat picture's has less than none."""
    empty = exposed(background(np.random.default_rng(3)) + 40.0, np.random.default_rng(3))
    assert found(empty)[0][0] < 0.25 * found(PICTURE)[0][0]
    assert found(np.full(SIZE, 90, np.uint8))[0][0] < 0.0


def test_kinds_of_pictures_agree() -> None:
    """Bytes, sixteen bits and floats, grey and three equal channels."""
    level = np.rint(PICTURE).astype(np.uint8)
    evidence, _, path, _ = found(level)[0]
    for same in (level.astype(np.uint16) * 257, level.astype(np.float32), level.astype(float), level[..., None]):
        other, _, others, _ = found(same)[0]
        assert_allclose(others, path, atol=1e-6)
        assert_allclose(other, evidence, rtol=1e-6)
    assert off(found(np.repeat(level[..., None], 3, axis=2))[0][2], TRUE) < 1.0


@pytest.mark.parametrize("coloured", [False, True])
def test_the_line_that_looks_as_the_antenna_does_wins(coloured: bool) -> None:
    """Of two tubes, by their luma alone where the picture is grey."""
    other, rng = shape(-0.37), np.random.default_rng(6)
    light = 90.0 + tube(TRUE, WIDTH_PX, 50.0) - tube(other, WIDTH_PX, 60.0)
    picture = np.clip(exposed(light, rng, 1.0), 0, 255).astype(np.uint8)
    taken = np.repeat(picture[..., None], 3, axis=2) if coloured else picture
    for level, path in ((135.0, TRUE), (36.0, other)):
        looks = np.repeat([[level, level, level, 10.0]], 8, axis=0)
        assert off(found(taken, looks=looks)[0][2], path) < 1.0


def test_shapes_come_with_what_they_are_made_of() -> None:
    """The best one first; each another one; evidence is what its places' odds add up to, less what bending costs."""
    shapes = found(PICTURE, most=4)
    assert 1 <= len(shapes) <= 4
    assert [one[0] for one in shapes] == sorted((one[0] for one in shapes), reverse=True)
    for evidence, (contact, turn, _, _), path, odds in shapes:
        strain = turn * WIDTH_PX / (min(contact, 1.0) * LENGTH_PX) / ODDS.strain_std
        assert_allclose(evidence, LENGTH_PX / ODDS.correlation_px * odds.mean() - 0.5 * strain**2, rtol=1e-3)
        assert path.shape == (73, 2)
