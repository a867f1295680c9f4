"""The benchmark of suggested poses: its cameras, its judge and its counting."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from benchmarks.guided.guided import Row, as_text, pictures_needed, sequence
from benchmarks.guided.rigs import PEOPLE, SUGGESTED, rigs, true_error_mm


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


def test_three_suggested_pictures_go_a_long_way(monkeypatch):
    monkeypatch.setattr("benchmarks.guided.guided.ENOUGH_SUGGESTED", 3)
    judged = sequence(rigs()[0], SUGGESTED, 0)
    assert judged[3].predicted < 0.15
    assert judged[3].true < 2.0 * judged[3].predicted
