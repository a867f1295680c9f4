"""The benchmark of suggested poses: its cameras, its judge and its counting."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from benchmarks.guided.guided import sequence
from benchmarks.guided.rigs import SUGGESTED, rigs, true_error_mm


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
