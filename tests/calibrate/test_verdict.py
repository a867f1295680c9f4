"""One verdict: terminal, camera.json and exit code say the same."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

import vbaa_calib.calibrate.report  # noqa: F401, its modules must not first be loaded while detect_folder is another
from vbaa_calib.calibrate.lens.intrinsics import solve_intrinsics
from vbaa_calib.cli.main import main

from .synthetic_views import SPEC
from .test_diagnose_views import SIZE, pictures


@pytest.mark.parametrize(("later_focal", "grade"), [(1.0, "trusted"), (1.008, "do not use")])
def test_file_terminal_and_exit_code_agree(
    later_focal: float, grade: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A lens that was touched midway must not be used, whatever its residuals."""
    views = pictures(3, np.repeat([1.0, later_focal], 10))
    monkeypatch.setattr("vbaa_calib.detect.board.corners.detect_folder", lambda *_: views)
    board, out, photos = tmp_path / "board.yaml", tmp_path / "camera.json", tmp_path / "photos"
    board.write_text(yaml.safe_dump({"board": SPEC.to_dict()}))
    photos.mkdir()
    (photos / "00.png").touch()
    call = ["intrinsics", str(photos), "--board", str(board), "-o", str(out), "--lens-model", "opencv5", "--json"]
    code = main(call)
    said, file = capsys.readouterr(), json.loads(out.read_text())
    result = json.loads(said.out)
    assert tuple(file["image_size"]) == SIZE
    assert (file["grade"], file["trusted"], code) == (grade, grade == "trusted", int(grade == "do not use"))
    assert f"verdict    {file['verdict']}\n" in said.err
    assert len(file["warnings"]) == len(file["diagnoses"]) == said.err.count("look at ") + said.err.count("wrong ")
    assert any(one["grave"] for one in file["diagnoses"]) == (grade == "do not use")
    assert {key: result[key] for key in file} == file


def test_a_lens_that_misses_by_pixels_must_not_be_used() -> None:
    rng = np.random.default_rng(0)
    views = [
        replace(view, corners_px=view.corners_px + rng.normal(0.0, 4.0, view.corners_px.shape))
        for view in pictures(3, np.ones(12))
    ]
    verdict = solve_intrinsics(views, SPEC, "opencv5").verdict
    assert verdict.grade == "do not use"
    assert "lens_misses" in {one.name for one in verdict.diagnoses}
