"""Corners that others found: the public solve."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.boards import BOARD, draw, error_mm, rigs
from targets.board import corner_points
from vbaa_calib import calibrate_lens
from vbaa_calib.core.errors import InputError

RIG = rigs()[4]
POINTS = corner_points(BOARD)


def test_corners_of_others_give_the_lens_their_outliers_and_the_boards_shape() -> None:
    given = draw(RIG, 3)
    views = [(view.ids.tolist(), view.corners_px.tolist()) for view in given.views]
    # one view of nothing, one of another board
    views[4:4] = [([], []), (given.views[0].ids[::-1], given.views[0].corners_px)]
    solution = calibrate_lens(views, RIG.image_size, POINTS)
    assert error_mm(solution.camera, RIG.camera, from_jig=True) < 0.01
    own = [*solution.outliers[:4], *solution.outliers[6:]]
    for view, good, outliers in zip(given.views, given.good, own, strict=True):
        assert set(outliers) == set(view.ids[~good])
    assert len(solution.outliers[4]) == 0
    true_m = RIG.board_points_m
    assert np.abs(solution.board_points - true_m).max() < 0.3 * np.abs(POINTS - true_m).max()
    assert solution.camera.covariance is not None
    assert solution.trusted == (solution.verdict.grade == "trusted")


SEEN = ([0, 1, 2, 3, 10, 11, 12, 13], np.arange(16.0).reshape(8, 2) ** 1.5)


@pytest.mark.parametrize(
    ("views", "size", "points", "model"),
    [
        ([], (640, 480), POINTS, "auto"),
        ([SEEN] * 4, (640, 480), POINTS, "opencv6"),
        ([SEEN] * 4, (640, -480), POINTS, "auto"),
        ([SEEN] * 4, (640, 480), POINTS * np.nan, "auto"),
        ([SEEN] * 4, (640, 480), POINTS[:, [0, 2, 1]], "auto"),
        ([([0, 0], [[1, 2], [3, 4]])] * 4, (640, 480), POINTS, "auto"),
        ([([0, 999], [[1, 2], [3, 4]])] * 4, (640, 480), POINTS, "auto"),
        ([([0, 1], [[1, 2], [3, np.inf]])] * 4, (640, 480), POINTS, "auto"),
    ],
)
def test_senseless_corners_are_refused_in_a_line(views, size, points, model) -> None:
    with pytest.raises(InputError) as refused:
        calibrate_lens(views, size, points, model)
    assert "\n" not in str(refused.value)
