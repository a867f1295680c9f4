"""The search for the antenna: its compiled functions against SciPy, rough paths, shapes along which two edges show."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from vbaa_calib.detect.whisker.corridor import Corridor
from vbaa_calib.detect.whisker.finder import AntennaFinder
from vbaa_calib.detect.whisker.profile import refine_path
from vbaa_calib.detect.whisker.settings import SearchSettings
from vbaa_calib.native import core

from .drawn_lines import SIZE, aside, background, bent, exposed, trace, tube


@pytest.mark.parametrize("bright", [True, False])
def test_a_path_moves_onto_a_curved_line(bright: bool) -> None:
    truth = bent((40.0, 120.0), 0.0, 12.0)
    line = tube(truth, 3.0, 80.0)
    picture = 100.0 + (line if bright else -line)
    rough = truth + np.outer(np.linspace(0.0, 5.0, len(truth)), [0.0, 1.0])
    found = refine_path(picture.astype(np.float32), rough, 3.0, 12.0, bright)[2:-6]
    assert np.abs(aside(truth, found)).max() < 0.15


WIDTH_PX = 2.3


def corridor(axis_px: np.ndarray) -> Corridor:
    """What detection allows around a free antenna."""
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(axis_px, axis=0), axis=1))])
    return Corridor(axis_px, 8.0 + 0.6 * along, WIDTH_PX)


def free(length_px: float = 225.0) -> np.ndarray:
    """(K, 2) the free antenna: straight to the right from (40, 120)."""
    share = np.linspace(0.0, 1.0, 60)[:, None]
    return np.array([40.0, 120.0]) + share * np.array([length_px, 0.0])


@pytest.mark.parametrize("turn_deg", [-45.0, -20.0, 0.0, 30.0, 45.0])
@pytest.mark.parametrize("bright", [True, False, None])
def test_finds_bent_lines(turn_deg: float, bright: bool | None) -> None:
    rng = np.random.default_rng(abs(int(turn_deg)))
    path = bent((40.0, 122.0), 0.0, turn_deg)
    line = tube(path, WIDTH_PX, 80.0)
    # with None glaring at the clamp, darker than its surroundings at the tip
    sign = np.interp(np.arange(line.shape[1]), [40, 130, 150, 265], [1.0, 0.4, -0.4, -1.0]) if bright is None else 1.0
    picture = exposed(background(rng) + 80.0 + (-line if bright is False else sign * line), rng)
    found = trace(picture, corridor(free()), bright)
    inside = found[:, 0] < path[:, 0].max() - 4
    assert inside.sum() > 60
    assert np.abs(aside(path, found[inside])).max() < (3.0 if bright is None else 2.5)


WIDTH_PX_SEARCH, SPACING_PX, LENGTH_PX = 5.0, 6.0, 200.0
CONTACTS = np.array([0.25, 0.5, 0.75, 1.0])
NO_LOOKS = np.empty((0, 4))
ODDS = SimpleNamespace(
    surface_spread=50.0,
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
    axis, taken = shape(0.0, 1.0, heading_rad), np.ascontiguousarray(picture)
    where = Corridor(axis, 8.0 + 0.9 * LENGTH_PX * np.linspace(0.0, 1.0, len(axis)), WIDTH_PX_SEARCH)
    finder = AntennaFinder.prepare(where, (SIZE[1], SIZE[0]))
    rough = replace(finder, settings=SearchSettings(shapes=most)).rough(taken)
    return core.search.likely_shapes(
        taken, axis, rough, SPACING_PX, WIDTH_PX_SEARCH, CONTACTS, (1.5, 0.015), looks, ODDS
    )


def drawn(path: np.ndarray, height: float = 60.0, seed: int = 3) -> np.ndarray:
    """(H, W) float32: a tube before blots."""
    rng = np.random.default_rng(seed)
    return exposed(background(rng) + 40.0 + tube(path, WIDTH_PX_SEARCH, height), rng)


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
    tubes = tube(TRUE, WIDTH_PX_SEARCH, 1.0)
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


@pytest.mark.parametrize("coloured", [False, True])
def test_the_line_that_looks_as_the_antenna_does_wins(coloured: bool) -> None:
    """Of two tubes, by their luma alone where the picture is grey."""
    other, rng = shape(-0.37), np.random.default_rng(6)
    light = 90.0 + tube(TRUE, WIDTH_PX_SEARCH, 50.0) - tube(other, WIDTH_PX_SEARCH, 60.0)
    picture = np.clip(exposed(light, rng, 1.0), 0, 255).astype(np.uint8)
    taken = np.repeat(picture[..., None], 3, axis=2) if coloured else picture
    for level, path in ((135.0, TRUE), (36.0, other)):
        looks = np.repeat([[level, level, level, 10.0]], 8, axis=0)
        assert off(found(taken, looks=looks)[0][2], path) < 1.0
