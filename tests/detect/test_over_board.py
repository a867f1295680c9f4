"""The antenna over a board: the predicted print, the profile fit, and the line in drawn pictures."""

from __future__ import annotations

import functools
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree

from vbaa_calib.detect.over_board.line import BoardLine, PlaneAbove, find_over_board
from vbaa_calib.detect.over_board.line import _board_picture as board_picture

from ..over_scenes import View, shown

PLAIN = View()


@functools.cache
def found(view: View = PLAIN, *, wires: bool = True) -> BoardLine | None:
    scene = shown(view) if wires else shown(view, wires=0)
    plane = PlaneAbove(scene.camera, scene.T_camera_board, scene.over.height_m)
    return find_over_board(scene.picture, plane, scene.scene.board, scene.scene.antenna.diameter_m)


def aside(line: BoardLine, truth: np.ndarray) -> np.ndarray:
    """(N,) distance of each point from the true centreline (M, 2), signed."""
    _, nearest = cKDTree(truth).query(line.points_px)
    along = np.gradient(truth, axis=0)[nearest]
    normal = np.stack([-along[:, 1], along[:, 0]], axis=1) / np.linalg.norm(along, axis=1, keepdims=True)
    return ((line.points_px - truth[nearest]) * normal).sum(axis=1)


def test_the_bare_board_is_predicted_to_its_noise() -> None:
    scene = shown(PLAIN, wires=0)
    picture = board_picture(scene.picture, scene.camera, scene.T_camera_board, scene.scene.board)
    assert picture.blur_px == pytest.approx(0.7, abs=0.1)
    inside = np.isfinite(picture.pattern)
    ratio = ((picture.seen - picture.pattern) / picture.noise)[inside]
    assert np.sqrt((ratio**2).mean()) == pytest.approx(1.0, abs=0.25)
    assert np.abs((picture.seen - picture.pattern)[inside]).mean() < 0.03


@pytest.mark.parametrize(
    ("view", "most_rms_px"),
    [
        (PLAIN, 0.09),
        pytest.param(View(paint=0.05), 0.25, marks=pytest.mark.slow),
        pytest.param(View(diameter=0.0022), 0.25, marks=pytest.mark.slow),
        pytest.param(View(diameter=0.00055, noise=3.0), 0.12, marks=pytest.mark.slow),
        pytest.param(
            View(inclination=50.0, azimuth=100.0, over=replace(PLAIN.over, turn_rad=1.4)), 0.12, marks=pytest.mark.slow
        ),
    ],
)
def test_points_lie_on_the_centreline(view: View, most_rms_px: float) -> None:
    line, truth = found(view), shown(view).centreline_px()
    assert line.bright == (view.paint > 0.5)
    off = aside(line, truth)
    assert len(off) > 150
    assert np.sqrt((off**2).mean()) < most_rms_px
    assert np.abs(off / line.sigma_px).mean() < 3.0
    tip = min((end for end in line.ends if end), key=lambda end: np.linalg.norm(end.point_px - truth[-1]))
    assert np.linalg.norm(tip.point_px - truth[-1]) < 4.0 * tip.std_px < 6.0


def test_without_an_antenna_there_is_no_line() -> None:
    assert found(wires=False) is None
