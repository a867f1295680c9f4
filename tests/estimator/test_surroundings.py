"""What stands still behind the antenna is learnt from pictures with the antenna in them, and taken off; drawn here."""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np
import pytest

from estimator.contact.recording import subtracted
from estimator.contact.surroundings import _background_of as background_of
from vbaa_calib.detect.whisker.background import Background
from vbaa_calib.detect.whisker.centreline import Centreline
from vbaa_calib.detect.whisker.corridor import Corridor
from vbaa_calib.detect.whisker.finder import AntennaFinder
from vbaa_calib.detect.whisker.profile import measure

from ..detect.drawn_lines import SIZE, aside, background, bent, exposed, tube

WIDTH_PX, ANTENNA = 4.0, 130.0
CLAMP = (40.0, 120.4)
AXIS = np.stack([np.linspace(40.0, 260.0, 50), np.full(50, 120.4)], axis=1)
COUNT = 12


@cache
def finder() -> AntennaFinder:
    """For the drawn pictures."""
    return AntennaFinder.prepare(Corridor(AXIS, 8.0 + 0.9 * (AXIS[:, 0] - 40.0), WIDTH_PX), SIZE[::-1])


def scene(rng: np.random.Generator) -> np.ndarray:
    """Clutter with bars and edges, some of them as bright as the antenna."""
    light = background(rng, 8.0)
    for _ in range(9):
        ends = rng.uniform(0, [SIZE[1], SIZE[0]], (2, 2)).round().astype(int)
        cv2.line(light, ends[0].tolist(), ends[1].tolist(), float(rng.uniform(30, 170)), int(rng.integers(2, 9)))
    return cv2.GaussianBlur(light, (0, 0), 0.8)


def recording(
    rng: np.random.Generator, shake_px: float = 0.0, lamp: float = 0.0, still: bool = False, drift_px: float = 0.0
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Pictures of an antenna that bends in front of a scene, and its paths."""
    light, images, paths = scene(rng), [], []
    for k in range(COUNT):
        path = bent(CLAMP, 0.0, 3.0 if still else float(rng.uniform(-30.0, 30.0)))
        share = tube(path, WIDTH_PX, 1.0)
        shift = rng.normal(0.0, shake_px, 2) + k * drift_px
        move = np.array([[1.0, 0.0, shift[0]], [0.0, 1.0, shift[1]]])
        behind = cv2.warpAffine(light, move, SIZE[::-1], flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
        bright = 1.0 + lamp * (-1) ** k
        images.append(exposed(bright * (behind * (1.0 - share) + ANTENNA * share), rng))
        paths.append(path)
    return images, paths


def lines_with(empty: Background, images: list[np.ndarray]) -> list[Centreline]:
    """As a recording's are found: less the background, then along the first guide."""
    lines = []
    for image in images:
        less = subtracted(finder(), image, empty)
        lines.append(measure(less[0], less[1].guide_px, WIDTH_PX, None) if less[1].found else less[1])
    return lines


def seen(lines: list[Centreline]) -> float:
    """Mean fraction of the antenna that is seen where it is found."""
    return float(np.mean([line.found * line.seen for line in lines]))


@pytest.mark.parametrize(
    ("shake_px", "lamp"),
    [pytest.param(0.0, 0.0, marks=pytest.mark.slow), pytest.param(1.0, 0.0, marks=pytest.mark.slow), (1.0, 0.2)],
)
def test_more_is_seen_in_its_place_however_the_camera_shakes_and_the_lamp_changes(shake_px: float, lamp: float) -> None:
    images, paths = recording(np.random.default_rng(1), shake_px, lamp)
    empty, why = background_of(images, finder(), True)
    assert empty is not None, why
    without, lines = [finder().find(image, True) for image in images], lines_with(empty, images)
    assert seen(lines) > max(0.65, seen(without) + 0.1)
    assert sum(line.found for line in lines) >= COUNT - 1
    off = [aside(path, line.points_px) / line.sigma_px for path, line in zip(paths, lines, strict=True)]
    assert np.median(np.abs(np.concatenate(off))) < 1.2


@pytest.mark.parametrize("change", [{"still": True}, pytest.param({"drift_px": 9.0}, marks=pytest.mark.slow)])
def test_an_antenna_at_rest_and_a_scene_that_moves_are_left_as_they_are(change: dict[str, float]) -> None:
    images, _ = recording(np.random.default_rng(2), **change)
    empty, why = background_of(images, finder(), True)
    assert empty is None
    assert ("hardly moves" in why) == ("still" in change)
