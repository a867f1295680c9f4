"""The finder on path-traced pictures: bare metal, nylon, paint; clutter, shadows, highlights."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

from vbaa_calib.calibrate.antenna.learnt_paint import learn
from vbaa_calib.detect.whisker.antenna import CLAMP_REACH_PX, REACH_PER_LENGTH
from vbaa_calib.detect.whisker.corridor import Corridor
from vbaa_calib.detect.whisker.finder import AntennaFinder
from vbaa_calib.detect.whisker.paint import Paint
from vbaa_calib.detect.whisker.profile import measure_in_colour

from ..traced_pictures import TracedPicture, traced_pictures

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


def test_before_other_colours_the_line_is_where_the_antenna_is() -> None:
    patchworks = [one for one in PICTURES if "_patchwork_" in one.name and len(one.line_px)]
    for one in patchworks:
        line = measure_in_colour(one.color(), one.line_px, one.width_px)
        assert line.found
        assert np.median(_off(one, line.points_px)) < 0.06 * one.width_px
    assert len(patchworks) >= 8


@pytest.mark.parametrize("name", ["paint_patchwork_noload_001", "nitinol_patchwork_noload_001"])
def test_light_from_one_side_does_not_pull_the_line(name: str) -> None:
    picture = next(one for one in PICTURES if one.name == name)
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(picture.free_px, axis=0), axis=1))])
    where = Corridor(picture.free_px, CLAMP_REACH_PX + REACH_PER_LENGTH * along, picture.width_px)
    color = picture.color()
    finder = AntennaFinder.prepare(where, (color.shape[1], color.shape[0]))
    assert learn([finder], [color]) == Paint(None)
    line = Paint(None).find(finder, color)
    assert line.found
    off = _off(picture, line.points_px)
    assert np.sqrt(np.mean(off**2)) < 0.04 * picture.width_px
    assert np.sqrt(np.mean((off / line.sigma_px) ** 2)) < 2.0


def test_the_set_has_every_kind() -> None:
    kinds = {(picture.material, picture.bench) for picture in PICTURES}
    assert {material for material, _ in kinds} >= {"steel", "nitinol", "nylon", "paint"}
    assert {bench for _, bench in kinds} >= {"plain", "cluttered", "patchwork"}
