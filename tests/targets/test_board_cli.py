"""`vbaa board` as its user sees it: files, numbers, refusals."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pypdfium2
import pytest
import yaml

from targets.board import AprilGrid, BoardSpec, corner_points
from targets.sheet import lay_out, paper_named
from vbaa_calib.cli import board as board_cli
from vbaa_calib.core.errors import InputError
from vbaa_calib.detect.board.board_file import load_board, load_lens_board
from vbaa_calib.detect.board.corners import detect_corners


def board(*argv: object, force: bool = False) -> dict[str, Any]:
    """Parse and run, without the front door."""
    parser = argparse.ArgumentParser(exit_on_error=False)
    board_cli.configure(parser)
    args = parser.parse_args([str(part) for part in argv])
    args.force = force
    return board_cli._run(args)


def test_one_command_gives_sheet_and_description(tmp_path: Path) -> None:
    """Nothing said but the name: A4, and a board.yaml that describes what a detector finds on the sheet."""
    out = tmp_path / "board.pdf"
    result = board("-o", out)
    spec = load_board(tmp_path / "board.yaml")
    assert spec == BoardSpec(11, 7, 0.02, 0.015)
    assert result["spec_file"] == str(tmp_path / "board.yaml")
    assert (result["paper"], result["orientation"], result["page_mm"]) == ("A4", "landscape", [297.0, 210.0])
    assert (result["id"], result["size_mm"], result["rulers_mm"]) == (
        "cc20e81f",
        [220.0, 140.0],
        {"x": 260.0, "y": 150.0},
    )
    picture = pypdfium2.PdfDocument(out)[0].render(scale=150 / 72, grayscale=True).to_numpy().squeeze()
    assert len(detect_corners(picture, spec).ids) == spec.corner_count == result["corners"]


def test_an_april_grid_is_drawn_as_it_is_found(tmp_path: Path) -> None:
    """As large as the paper lets it; printed again from its board.yaml, or from Kalibr's target.yaml."""
    result = board("--type", "aprilgrid", "--tags", "5x4", "--first-id", 3, "-o", tmp_path / "grid.pdf")
    spec = load_lens_board(tmp_path / "grid.yaml")
    assert result["board"] == spec.to_dict()
    assert (result["corners"], result["markers"], result["paper"]) == (80, 20, "A4")
    with pytest.raises(ValueError, match="does not fit"):
        lay_out(replace(spec, tag_m=spec.tag_m + 1e-3), paper_named("A4"))
    picture = (
        pypdfium2.PdfDocument(tmp_path / "grid.pdf")[0].render(scale=150 / 72, grayscale=True).to_numpy().squeeze()
    )
    found = detect_corners(picture, spec)
    assert len(found.ids) == spec.corner_count
    mm = found.corners_px / (150 / 25.4)
    steps = np.linalg.norm(np.diff(mm.reshape(-1, spec.corner_columns, 2), axis=1), axis=-1)[:, ::2]
    np.testing.assert_allclose(steps, 1e3 * spec.tag_m, atol=0.05)
    target = tmp_path / "target.yaml"
    target.write_text("{target_type: aprilgrid, tagCols: 4, tagRows: 3, tagSize: 0.03, tagSpacing: 0.3}")
    assert board("--spec", target, "-o", tmp_path / "k.svg")["board"]["tag_m"] == 0.03
    for wrong in (("--tags", "5x4"), ("--type", "aprilgrid", "--squares", "5x4")):
        with pytest.raises(InputError):
            board(*wrong, "-o", tmp_path / "x.png", "--screen-ppi", 96)


def test_an_april_grid_is_drawn_for_a_screen(tmp_path: Path) -> None:
    """In whole pixels, and described as it is there."""
    call = ("--type", "aprilgrid", "--tags", "4x3", "--thickness-mm", 2, "-o", tmp_path / "x.png", "--screen-ppi", 96)
    result = board(*call)
    spec = load_board(tmp_path / "x.yaml")
    assert isinstance(spec, AprilGrid)
    assert result["board"] == spec.to_dict()
    found = detect_corners(cv2.imread(str(tmp_path / "x.png"), cv2.IMREAD_GRAYSCALE), spec)
    assert len(found.ids) == spec.corner_count
    shift = found.corners_px - corner_points(spec)[found.ids, :2] * 1e3 * result["px_per_mm"]
    np.testing.assert_allclose(shift, np.broadcast_to(shift.mean(axis=0), shift.shape), atol=0.1)
    assert spec.thickness_m == 0.002


def test_a_described_board_is_printed_as_it_is(tmp_path: Path) -> None:
    """From a board.yaml or a session.yaml; no second description appears."""
    spec = BoardSpec(9, 6, 0.012, 0.009, legacy_pattern=True, thickness_m=0.002)
    given = tmp_path / "session.yaml"
    given.write_text(yaml.safe_dump({"board": spec.to_dict()}))
    result = board("--spec", given, "-o", tmp_path / "b.svg", "--paper", "Letter")
    assert result["board"] == spec.to_dict()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["b.svg", "session.yaml"]
    board("--spec", given, "-o", tmp_path / "c.pdf", "--write-spec", tmp_path / "board.yaml")
    assert load_board(tmp_path / "board.yaml") == spec


def test_a_screen_has_its_own_description(tmp_path: Path) -> None:
    """The size in whole pixels is not the wanted one: what is written is what the screen shows."""
    given = tmp_path / "board.yaml"
    given.write_text(yaml.safe_dump(BoardSpec(9, 6, 0.02, 0.015).to_dict()))
    result = board("--spec", given, "-o", tmp_path / "screen.png", "--screen-ppi", 96)
    shown = load_board(tmp_path / "screen.yaml")
    assert shown.square_m == pytest.approx(1e-3 * result["square_px"] / result["px_per_mm"], abs=1e-11)
    assert shown.square_m != 0.02
    picture = cv2.imread(str(tmp_path / "screen.png"), cv2.IMREAD_UNCHANGED)
    assert list(picture.shape[::-1]) == result["image_size"]
    assert len(detect_corners(picture, shown).ids) == shown.corner_count
    with pytest.raises(InputError, match="is an input of this command"):
        board("--spec", given, "-o", tmp_path / "board.png", "--screen-ppi", 96)
