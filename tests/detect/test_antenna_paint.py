"""Dark, coloured, deep and cluttered pictures, and what the finder refuses: drawn here, judged by the drawn path."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
import pytest

from vbaa_calib.calibrate.antenna.learnt_paint import learn
from vbaa_calib.detect.whisker.antenna import find
from vbaa_calib.detect.whisker.centreline import Centreline, Visibility
from vbaa_calib.detect.whisker.corridor import Corridor
from vbaa_calib.detect.whisker.finder import AntennaFinder
from vbaa_calib.detect.whisker.paint import Paint, look_of, usual_looks, without_other_things
from vbaa_calib.detect.whisker.profile import measure

from .drawn_lines import SIZE, aside, background, bent, exposed, straight, tube

WIDTH_PX = 3.0


@pytest.fixture(scope="module")
def finder() -> AntennaFinder:
    along = np.linspace(0.0, 225.0, 60)
    axis = np.array([40.0, 120.0]) + along[:, None] * np.array([1.0, 0.0])
    return AntennaFinder.prepare(Corridor(axis, 8.0 + 0.9 * along, WIDTH_PX), (SIZE[1], SIZE[0]))


def picture(rng: np.random.Generator, turn_deg: float, height: float = 90.0) -> tuple[np.ndarray, np.ndarray]:
    """(H, W) float grey levels and the drawn path."""
    path = bent((40.0, 120.4), 0.0, turn_deg)
    return background(rng, 2.0) + tube(path, WIDTH_PX, height), path


def test_bright_and_dark_are_told_by_themselves(finder: AntennaFinder) -> None:
    rng = np.random.default_rng(0)
    bright, _ = picture(rng, 3.0)
    assert learn([finder], [exposed(bright, rng).astype(np.uint8)]) == Paint(True)
    assert learn([finder], [exposed(230.0 - bright, rng).astype(np.uint8)]) == Paint(False)


def test_a_colour_is_found_where_the_grey_level_shows_nothing(finder: AntennaFinder) -> None:
    """The antenna is redder and less green than the ground, and exactly as grey."""
    rng = np.random.default_rng(1)
    path = bent((40.0, 120.4), 0.0, 20.0)
    line, ground = tube(path, WIDTH_PX, 60.0), background(rng, 2.0)
    planes = [exposed(ground + share * line, rng) for share in (0.0, -0.299 / 0.587, 1.0)]
    colour = np.stack(planes, axis=-1).astype(np.uint8)
    assert not Paint().find(finder, colour).found
    paint = learn([finder], [colour])
    assert paint is not None
    found = paint.find(finder, colour)
    assert found.found
    error = aside(path, found.points_px)
    assert abs(error.mean()) < 0.02
    # measured by both edges: what these share is in the deviations
    assert 0.5 < error.std() / np.sqrt((found.sigma_px**2).mean()) < 1.2


def test_what_is_hidden_and_where_the_visible_end_is(finder: AntennaFinder) -> None:
    rng = np.random.default_rng(4)
    light, path = picture(rng, 25.0)
    light[:, 120:150] = 30.0
    light[:, 215:] = 30.0
    line = finder.find(exposed(light, rng))
    assert line.found
    assert line.end == "hidden"
    assert 208.0 < line.end_px[0] <= 216.0
    gap = np.concatenate(line.stretches(Visibility.HIDDEN))
    assert 110.0 < gap[:, 0].min() < 122.0
    assert 148.0 < gap[:, 0].max() < 160.0
    assert np.abs(aside(path, gap)).max() < 1.5, "the bridge over what is hidden"
    assert np.concatenate(line.stretches(Visibility.BEYOND))[:, 0].min() > 205.0
    whole = finder.find(exposed(picture(rng, 25.0)[0], rng))
    assert whole.end == "tip"


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("seed", range(20))
def test_any_corridor_in_any_picture(seed: int) -> None:
    """Short, outside, ragged, end on, in tiny pictures: an answer with a reason, nothing that is not a number."""
    rng = np.random.default_rng([99, seed])
    height, width = rng.integers(4, 200, 2)
    noise = rng.integers(0, 256, (height, width)).astype(np.uint8)
    image = [noise, np.full_like(noise, 77), rng.normal(size=noise.shape), noise.astype(np.uint16) * 257][seed % 4]
    ends = rng.uniform(-1, 2, (2, 2)) * [width, height]
    ends[1] = ends[0] + rng.normal(0, 3, 2) if seed % 5 == 0 else ends[1]
    count = int(rng.integers(0, 40))
    axis = ends[0] + np.linspace(0, 1, count)[:, None] * (ends[1] - ends[0])
    axis += rng.normal(0, 1, axis.shape) * (seed % 3 == 0)
    along = np.linspace(0.0, float(np.linalg.norm(ends[1] - ends[0])), count)
    where = Corridor(axis, 8.0 + 0.9 * along, float(rng.uniform(0.3, 40.0)))
    for bright in (True, False):
        for line in (find(image, where, bright), measure(image, axis, where.width_px, bright)):
            assert np.isfinite(line.points_px).all()
            assert np.isfinite(line.sigma_px).all()
            assert not line.found
            assert line.reason
            assert len(line.visibility) == len(line.guide_px)


def test_polarity_that_changes_along_the_antenna_is_learnt_and_found(finder: AntennaFinder) -> None:
    """Glaring at the clamp, darker than its background at the tip; a thick bright cable runs beside it."""
    rng = np.random.default_rng(6)
    ground, path = background(rng, 2.0), bent((40.0, 120.4), 0.0, 10.0)
    reflectance = np.interp(np.arange(ground.shape[1]), [40, 120, 170, 265], [1.0, 0.6, -0.6, -1.0])
    cable = tube(straight(8.0, 260.0, (150.0, 165.0)), 3.0 * WIDTH_PX, 90.0)
    image = exposed(60.0 + ground + cable + 70.0 * reflectance * tube(path, WIDTH_PX, 1.0), rng)
    paint = learn([finder], [image])
    assert paint.bright is None
    line = paint.find(finder, image)
    assert line.found
    assert line.seen > 0.8
    assert np.abs(aside(path, line.points_px)).max() < 1.0
    assert max(Paint(bright).find(finder, image).seen for bright in (True, False)) < 0.7


def test_a_line_keeps_to_the_middle_of_an_antenna_with_a_bright_and_a_dark_side(finder: AntennaFinder) -> None:
    """As of bare steel between a lamp and the dark: either side alone would draw it by half a width."""
    rng = np.random.default_rng(7)
    path = bent((40.0, 120.4), 0.0, 10.0)
    down = np.array([0.0, 0.25 * WIDTH_PX])
    sides = [tube(path + side * down, 0.5 * WIDTH_PX, 60.0) for side in (-1.0, 1.0)]
    image = exposed(background(rng, 2.0) + 80.0 + sides[0] - sides[1], rng)
    line = finder.find(image, None)
    assert line.found
    assert np.abs(aside(path, line.points_px)).max() < 0.25 * WIDTH_PX


def taken(drawn: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(H, W, 3) uint8 of drawn colours, with noise."""
    return np.clip(drawn + rng.normal(0.0, 2.0, drawn.shape), 0, 255).astype(np.uint8)


def own(finder: AntennaFinder, paint: Paint, image: np.ndarray, calibrated: Sequence[np.ndarray]) -> Centreline:
    """What is the antenna's own in a picture, by its looks in others."""
    looks = usual_looks([look_of(one, paint.find(finder, one)) for one in calibrated])
    return without_other_things(image, paint.find(finder, image), looks, finder.corridor.width_px, paint)


@pytest.mark.parametrize("light", [0.75, 1.0, 1.3])
def test_a_line_that_goes_on_along_another_thing_ends_where_that_begins(finder: AntennaFinder, light: float) -> None:
    """Beyond its middle the antenna is hidden behind an edge of another colour, as wide and as straight."""
    rng = np.random.default_rng(5)
    path = bent((40.0, 120.4), 0.0, 3.0)
    drawn, hidden = (np.full((*SIZE, 3), 40.0) for _ in range(2))
    line = tube(path, WIDTH_PX, 1.0)[..., None]
    drawn += line * (np.array([140.0, 140.0, 140.0]))
    middle = int(path[len(path) // 2, 0])
    hidden[:] = drawn
    hidden[:, middle:] = (40.0 + line * np.array([20.0, 160.0, 90.0]))[:, middle:]
    shown = [taken(light * one, rng) for one in (drawn, hidden)]
    calibrated = [taken(drawn, rng) for _ in range(3)]
    whole, cut = (own(finder, Paint(True), one, calibrated) for one in shown)
    assert whole.found
    assert whole.points_px[-1, 0] > path[-1, 0] - 5.0
    assert cut.points_px[-1, 0] < middle + 2.0
    assert len(cut.points_px) > 0.4 * len(whole.points_px)
    assert cut.end != "tip"


@pytest.mark.parametrize(("both_edges", "left_out"), [(False, True), (True, False)])
def test_in_a_shadow_both_edges_show_the_antenna_as_well(
    finder: AntennaFinder, both_edges: bool, left_out: bool
) -> None:
    """A third of it has two fifths of its light, and its hue; what lies behind it is lit as elsewhere."""
    rng = np.random.default_rng(6)
    path = bent((40.0, 120.4), 0.0, 3.0)
    begin, end = int(path[len(path) // 2, 0]), int(path[5 * len(path) // 6, 0])
    lit = 40.0 + tube(path, WIDTH_PX, 1.0)[..., None] * np.array([120.0, 150.0, 160.0])
    shaded = lit.copy()
    shaded[:, begin:end] = 40.0 + 0.2 * (lit - 40.0)[:, begin:end]
    calibrated = [taken(lit, rng) for _ in range(3)]
    line = own(finder, Paint(True, both_edges=both_edges), taken(shaded, rng), calibrated)
    assert line.found
    inside = (line.points_px[:, 0] > begin + 15.0) & (line.points_px[:, 0] < end - 15.0)
    assert (inside.sum() == 0) == left_out
    assert line.points_px[-1, 0] > path[-1, 0] - 5.0
    if inside.any():
        assert np.sqrt(np.mean((aside(path, line.points_px) / line.sigma_px)[inside] ** 2)) < 2.0
        assert line.sigma_px[inside].min() > 1.2 * np.median(line.sigma_px[~inside])
        assert np.abs(aside(path, line.points_px[inside])).max() < 1.0


@pytest.mark.parametrize("bright", [True, None])
def test_a_line_is_followed_into_a_shadow_that_does_not_end_by_its_hue(
    finder: AntennaFinder, bright: bool | None
) -> None:
    """From seven twelfths on it has two fifths of its light; beyond five sixths another thing goes on in its stead and
    farther, as bright and as wide, of a somewhat other hue."""
    rng = np.random.default_rng(7)
    path = bent((40.0, 120.4), 0.0, 3.0)
    begin, end = int(path[7 * len(path) // 12, 0]), int(path[5 * len(path) // 6, 0])
    cover = tube(path, WIDTH_PX, 1.0)[..., None]
    lit = 40.0 + cover * np.array([150.0, 150.0, 150.0])
    shaded = lit.copy()
    shaded[:, begin:] = (20.0 + cover * np.array([56.0, 56.0, 56.0]))[:, begin:]
    farther = tube(np.vstack([path, path[-1] + 30.0 * (path[-1] - path[-3])]), WIDTH_PX, 1.0)[..., None]
    shaded[:, end:] = (20.0 + farther * np.array([48.0, 56.0, 62.0]))[:, end:]
    calibrated, image = [taken(lit, rng) for _ in range(3)], taken(shaded, rng)
    paint = Paint(bright, both_edges=True)
    line = own(finder, paint, image, calibrated)
    assert line.found
    assert end - 35.0 < line.points_px[-1, 0] < end
    assert line.end == "hidden"
    # a grey picture does not show the hue
    grey = [cv2.cvtColor(one, cv2.COLOR_BGR2GRAY) for one in (*calibrated, image)]
    line = own(finder, paint, grey[-1], grey[:-1])
    assert line.points_px[-1, 0] < begin + 15.0
