"""The finder on path-traced pictures: bare metal, nylon, paint; clutter, shadows, highlights."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

from tests.traced_pictures import TracedPicture, traced_pictures
from vbaa_calib.calibrate.antenna.learnt_paint import learn
from vbaa_calib.detect.whisker.antenna import CLAMP_REACH_PX, REACH_PER_LENGTH
from vbaa_calib.detect.whisker.contrast import contrast_plane
from vbaa_calib.detect.whisker.corridor import Corridor
from vbaa_calib.detect.whisker.finder import AntennaFinder
from vbaa_calib.detect.whisker.paint import Paint
from vbaa_calib.detect.whisker.profile import measure_on

PICTURES = traced_pictures()


@pytest.mark.parametrize("picture", PICTURES, ids=lambda picture: picture.name)
def test_no_other_line_is_taken_for_the_antenna(picture: TracedPicture) -> None:
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(picture.free_px, axis=0), axis=1))])
    # the rig is known to a pixel, not better
    guess, reach = picture.free_px + np.array([0.5, 1.0]), CLAMP_REACH_PX + REACH_PER_LENGTH * along
    color, where = picture.color(), Corridor(guess, reach, picture.width_px)
    finder = AntennaFinder.prepare(where, (color.shape[1], color.shape[0]))
    found = Paint(None).find(finder, color)
    if found.verdict != "ok":
        return
    assert len(picture.line_px), "there is no antenna"
    assert (_off(picture, found.points_px) < picture.width_px).mean() > 0.95


def _off(picture: TracedPicture, points_px: np.ndarray) -> np.ndarray:
    """(N,) distances of points from the true line."""
    share, fine = np.linspace(0.0, 1.0, len(picture.line_px)), np.linspace(0.0, 1.0, 4000)
    line = np.stack([np.interp(fine, share, axis) for axis in picture.line_px.T], axis=1)
    return cKDTree(line).query(points_px)[0]


def test_before_other_colours_the_line_is_measured_better_in_colour() -> None:
    patchworks = [one for one in PICTURES if "_patchwork_" in one.name and len(one.line_px)]
    squares = np.zeros(2)
    for one in patchworks:
        planes = Paint(None).plane(one.color()), contrast_plane(one.color(), one.line_px, one.width_px)
        for k, plane in enumerate(planes):
            line = measure_on(plane, one.line_px, one.width_px, None, stands_out=True)
            assert line.found
            squares[k] += np.mean(_off(one, line.points_px) ** 2)
    assert len(patchworks) >= 8
    assert squares[1] < 0.9**2 * squares[0]


@pytest.mark.parametrize("name", ["paint_patchwork_noload_001", "nitinol_patchwork_noload_001"])
def test_light_from_one_side_pulls_no_line_that_is_measured_by_both_edges(name: str) -> None:
    picture = next(one for one in PICTURES if one.name == name)
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(picture.free_px, axis=0), axis=1))])
    where = Corridor(picture.free_px, CLAMP_REACH_PX + REACH_PER_LENGTH * along, picture.width_px)
    color = picture.color()
    finder = AntennaFinder.prepare(where, (color.shape[1], color.shape[0]))
    assert learn([finder], [color]) == Paint(None)
    pulled, line = (paint.find(finder, color) for paint in (Paint(True), Paint(None)))
    assert line.found
    assert line.seen > pulled.seen - 0.05
    off = [np.sqrt(np.mean(_off(picture, one.points_px) ** 2)) for one in (pulled, line)]
    assert not pulled.found or off[1] < 0.9 * off[0]


def test_the_set_has_every_kind() -> None:
    kinds = {(picture.material, picture.bench) for picture in PICTURES}
    assert {material for material, _ in kinds} >= {"steel", "nitinol", "nylon", "paint"}
    assert {bench for _, bench in kinds} >= {"plain", "cluttered", "patchwork"}
