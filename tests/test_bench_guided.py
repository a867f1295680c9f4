"""The benchmark of suggested poses: its cameras, its judge and its counting."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.guided.guided import Row, as_text, pictures_needed, sequence
from benchmarks.guided.rigs import Photographer, rigs, true_error_mm, wanted_pose
from benchmarks.guided.strategies import PEOPLE, STRATEGIES, SUGGESTED
from targets.board import corner_points
from vbaa_calib.calibrate.guide.next_view import lens_progress
from vbaa_calib.geometry import Pose


def row(way: str, pictures: int, true_mm: float, predicted_mm: float | None = None) -> Row:
    return Row("rig", way, pictures, 2, true_mm, true_mm, None, predicted_mm, None, None, 0.0, "")


def test_needed_is_where_the_error_stays_small():
    rows = [row(PEOPLE, count, error) for count, error in ((3, 0.09), (4, 0.2), (6, 0.1), (8, 0.05))]
    assert pictures_needed(rows, "true_rms_mm") == 6
    assert pictures_needed(rows[:2], "true_rms_mm") is None
    assert pictures_needed(rows, "predicted_mm") is None


def test_verdict_weighs_suggested_against_random():
    ours = [row(SUGGESTED, 4, 0.05), row(SUGGESTED, 6, 0.05)]
    assert "met: 0.67" in as_text([*ours, row(PEOPLE, 6, 0.05)], 2)
    assert "missed: 1.00" in as_text([*ours, row(PEOPLE, 4, 0.05)], 2)
    assert "missed: suggested poses" in as_text([row(SUGGESTED, 6, 0.5), row(PEOPLE, 6, 0.05)], 2)


def test_the_judge_knows_the_truth_and_takes_up_what_a_pose_can():
    rig = rigs()[0]
    assert true_error_mm(rig.camera, rig) < 1e-6
    moved = replace(rig.camera, matrix=rig.camera.matrix + np.array([[0, 0, 4.0], [0, 0, 0], [0, 0, 0]]))
    found_again = true_error_mm(moved, rig)
    told = true_error_mm(moved, rig, rig.plane.board_pose(rig.board))
    assert found_again < 0.3 * told


def test_rendered_corners_are_where_the_board_is():
    rig = rigs()[1]
    photographer = Photographer(rig, 0)
    pose = rig.plane.board_pose(rig.board)
    nearer = Pose(pose.rotation, 0.7 * pose.translation_m)
    view = photographer.picture(nearer)
    true, _ = rig.camera.project(nearer @ corner_points(rig.board)[view.ids])
    assert len(view.ids) > 10
    assert np.sqrt(np.mean((view.corners_px - true) ** 2)) < 0.5


def test_an_outline_is_obeyed_before_there_is_a_lens():
    rig = rigs()[0]
    suggestion = lens_progress([], rig.board, rig.plane, image_size=rig.image_size).suggestion
    pose = wanted_pose(suggestion, rig, None)
    width, height = rig.board.square_m * rig.board.squares_x, rig.board.square_m * rig.board.squares_y
    corners = np.array([[0.0, 0.0, 0.0], [width, 0.0, 0.0], [width, height, 0.0], [0.0, height, 0.0]])
    pixels, _ = rig.camera.project(pose @ corners)
    assert np.linalg.norm(pixels - suggestion.outline_px, axis=1).max() < 15.0


@pytest.mark.parametrize("way", list(STRATEGIES))
def test_every_strategy_takes_pictures(way):
    photographer = Photographer(rigs()[0], 1)
    views = []
    for _ in range(3):
        views.append(STRATEGIES[way](photographer, views, None))
    assert all(len(view.ids) >= 7 for view in views)


def test_three_suggested_pictures_go_a_long_way(monkeypatch):
    monkeypatch.setattr("benchmarks.guided.guided.ENOUGH_SUGGESTED", 3)
    judged = sequence(rigs()[0], SUGGESTED, 0)
    assert judged[3].true < 0.15
    assert judged[3].predicted < 0.15
