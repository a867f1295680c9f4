"""`vbaa intrinsics` from its command line: what it writes, and what it refuses."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import yaml

from targets.board import BoardSpec
from vbaa_calib.calibrate.lens.models import LENS_MODELS
from vbaa_calib.camera import Camera
from vbaa_calib.cli.main import main
from vbaa_calib.core.errors import InputError
from vbaa_calib.detect.board.board_file import load_board

from .photo_sets import photo_set

SPEC = BoardSpec(7, 5, 0.03, 0.022, "DICT_4X4_50")


def write_board(path: Path, spec: BoardSpec = SPEC) -> Path:
    path.write_text(yaml.safe_dump(spec.to_dict()))
    return path


def test_camera_json_holds_the_lens_and_its_evidence(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    photos = photo_set("realsense")
    board, output = write_board(tmp_path / "board.yaml"), tmp_path / "camera.json"
    call = ["intrinsics", str(photos.folder), "--board", str(board), "-o", str(output), "--json"]
    assert main(call) == 0
    result = json.loads(capsys.readouterr().out)
    document = json.loads(output.read_text())
    assert result == {"output": str(output), **document}
    assert document["schema"] == "vbaa.camera/1"
    chosen = LENS_MODELS[document["lens_model"]]
    assert document["parameters"] == list(chosen.parameter_names)
    assert document["model"] == chosen.camera_model
    assert np.shape(document["covariance"]) == (len(chosen.parameter_names),) * 2
    assert len(document["views"]) == 28
    assert document["dropped"] == []
    assert {row["model"] for row in document["model_comparison"]} >= {"none", "radial", "opencv5", "fisheye"}
    camera = Camera.load(output)
    assert camera.matrix[0, 0] == pytest.approx(898.7, rel=0.005)
    assert main(call) == 2, "nothing is overwritten without --force"
    assert "--force" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("{squares_x: 7, squares_y: 5, square_m: 0.03, marker_m: 0.022, squares: 3}", "unknown key squares"),
        ("{squares_x: 7, squares_y: 5, square_m: .nan, marker_m: 0.022}", "square_m is not a finite number"),
        ("type: chessboard", "type: 'chessboard'"),
        ("a: [", "not valid YAML"),
    ],
)
def test_a_wrong_board_file_is_refused_by_name_and_key(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "board.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match=r"board\.yaml") as caught:
        load_board(path)
    assert words in str(caught.value)
