"""The detector's self-test: it must find the installed OpenCV sound, and an unsound one out."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

from targets.board import BoardSpec
from vbaa_calib.cli.main import main
from vbaa_calib.detect.board.corners import BoardView, detect_corners
from vbaa_calib.doctor.detector_test import (
    OPENCV,
    OURS,
    Row,
    as_text,
    is_sound,
    mean_bias_px,
    opencv_corners,
    try_detectors,
    verdict,
)

SPEC = BoardSpec(6, 5, 0.02, 0.014)
QUICK = {"square_px": (40.0,), "blur_px": (0.7,)}


def shifted(by_px: tuple[float, float]) -> dict:
    """Detectors of which OpenCV's is off by a constant."""

    def detect(image: np.ndarray, spec: BoardSpec) -> BoardView:
        found = opencv_corners(image, spec)
        return BoardView(found.name, found.ids, found.corners_px + by_px, found.image_size)

    return {OPENCV: detect, OURS: detect_corners}


def test_the_installed_opencv_is_sound() -> None:
    rows = try_detectors(SPEC, 2, 0, **QUICK)
    assert [row.detector for row in rows] == [OPENCV, OURS]
    assert is_sound(rows)
    for row in rows:
        assert row.found > 0.9
        assert row.median_px <= row.rms_px <= row.worst_px < 0.3
        assert np.abs(row.bias_px).max() < 0.02
    assert rows[1].rms_px < 0.06
    assert 0.5 < rows[1].error_per_std < 2.5
    assert f"OpenCV {cv2.__version__} finds this board's corners without bias" in verdict(rows)[0]


@pytest.mark.parametrize("by_px", [(0.5, 0.5), (-0.5, 0.0), (0.0, 0.45)])
def test_half_a_pixel_is_found_out(by_px: tuple[float, float]) -> None:
    rows = try_detectors(SPEC, 1, 0, shifted(by_px), **QUICK)
    assert mean_bias_px(rows, OPENCV) == pytest.approx(by_px, abs=0.03)
    assert not is_sound(rows)
    assert "half a pixel off" in verdict(rows)[0]
    assert "Update it" in verdict(rows)[0]


def test_a_detector_that_finds_nothing_is_not_sound() -> None:
    def blind(image: np.ndarray, spec: BoardSpec) -> BoardView:
        return BoardView("", np.zeros(0, int), np.zeros((0, 2)), image.shape[::-1])

    rows = try_detectors(SPEC, 1, 0, {OPENCV: blind, OURS: blind}, **QUICK)
    assert not is_sound(rows)
    assert "under none of the conditions" in verdict(rows)[0]
    assert "too few to measure" in as_text(rows)
    assert rows[0].to_dict()["rms_px"] is None


def test_the_verb_reports_in_words_and_json(
    tmp_path: Path, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    board = tmp_path / "board.yaml"
    board.write_text(yaml.safe_dump(SPEC.to_dict()))

    def quick(spec: BoardSpec, pictures: int, seed: int) -> list[Row]:
        return try_detectors(spec, pictures, seed, **QUICK)

    monkeypatch.setattr("vbaa_calib.doctor.detector_test.try_detectors", quick)
    assert main(["selftest", "--board", str(board), "--repeats", "1", "--json"]) == 0
    captured = capsys.readouterr()
    result = json.loads(captured.out)
    assert result["sound"] is True
    assert result["opencv"] == cv2.__version__
    assert set(result["rows"][0]) >= {"detector", "square_px", "blur_px", "found", "bias_px", "rms_px", "worst_px"}
    assert "without bias" in captured.err
