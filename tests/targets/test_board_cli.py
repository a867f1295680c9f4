"""What is printed: boards by their verb, jigs in 3-D, and the scale of a print from two readings."""

from __future__ import annotations

import argparse
import math
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pypdfium2
import pytest
import yaml

from targets.board import BoardSpec
from targets.jig import _write_jig
from targets.print_scale import print_scale
from targets.sheet import lay_out, paper_named
from vbaa_calib.cli import board as board_cli
from vbaa_calib.core.errors import InputError
from vbaa_calib.detect.board.board_file import load_board, load_lens_board
from vbaa_calib.detect.board.corners import detect_corners
from vbaa_calib.session.settings import read_pose


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


SIZES = {"margin_mm": 5.0, "thickness_mm": 3.0, "wire_mm": 0.8}


def triangles(path: Path) -> np.ndarray:
    """(T, 3, 3) of a binary STL."""
    data = path.read_bytes()
    count = int.from_bytes(data[80:84], "little")
    assert len(data) == 84 + 50 * count
    facets = np.frombuffer(data, np.dtype([("numbers", "<f4", 12), ("more", "<u2")]), count, 84)["numbers"]
    normals, corners = facets[:, :3].astype(float), facets[:, 3:].reshape(-1, 3, 3).astype(float)
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    np.testing.assert_allclose(normals, across / np.linalg.norm(across, axis=1, keepdims=True), atol=1e-6)
    return corners


def volume_mm3(corners: np.ndarray) -> float:
    return float(np.einsum("ti,ti->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6.0)


@pytest.mark.parametrize("squares", [(9, 7), (3, 2)])
def test_solids_are_closed_and_of_the_sizes_asked_for(squares: tuple[int, int], tmp_path: Path) -> None:
    outline = 12.0 * squares[0], 12.0 * squares[1]
    _write_jig(tmp_path, outline, **SIZES)
    parts = {name: triangles(tmp_path / f"{name}.stl") for name in ("jig", "clamp", "cap")}
    for corners in parts.values():
        points = np.round(corners, 4)
        edges = Counter((tuple(face[i]), tuple(face[(i + 1) % 3])) for face in points.tolist() for i in range(3))
        # each edge is passed once in each direction
        assert set(edges.values()) == {1}
        assert all(edges[end, begin] == 1 for begin, end in edges)
        assert volume_mm3(corners) > 0.0
    clamp = parts["clamp"].reshape(-1, 3)
    np.testing.assert_allclose(clamp.min(axis=0), [-16.0, -12.0, -14.0])
    np.testing.assert_allclose(clamp.max(axis=0), [0.0, 12.0, 0.0])
    groove = 16.0 * 0.9 * 0.4
    holes = 2 * 2.5**2 * 14.0
    assert volume_mm3(parts["clamp"]) == pytest.approx(16.0 * 24.0 * 14.0 - groove - holes, rel=1e-5)
    assert volume_mm3(parts["cap"]) == pytest.approx(16.0 * 24.0 * 6.0 - 16.0 * 0.9 * 0.28 - 2 * 2.5**2 * 6.0, rel=1e-5)
    # plate and walls
    assert np.ptp(parts["jig"][..., 0]) == pytest.approx(16.0 + 8.0 + outline[0] + 10.0, abs=1e-4)


def test_the_boards_pose_is_that_of_the_tray(tmp_path: Path) -> None:
    """Its back lies on the floor, its plate against both walls, its face looks to the camera and below the antenna."""
    jig = yaml.safe_load(_write_jig(tmp_path, (108.0, 84.0), **SIZES))["jig"]
    pose = read_pose(jig["T_antenna_board"], "jig.yaml", "jig")
    corners = pose @ (1e-3 * np.array([[0.0, 0.0, 0.0], [108.0, 84.0, 0.0], [0.0, 0.0, -3.0]]))
    points = 1e-3 * triangles(tmp_path / "jig.stl").reshape(-1, 3)
    floor, top = np.unique(np.round(points[:, 2], 7))[[1, 2]]
    assert corners[0, 2] == pytest.approx(floor)
    assert floor < corners[2, 2] < -0.4e-3 < 0.0
    assert top - floor == pytest.approx(3e-3, abs=1e-6)
    assert corners[0, 0] - 5e-3 == pytest.approx(8e-3)
    assert corners[0, 1] + 5e-3 == pytest.approx(np.unique(np.round(points[:, 1], 7))[-2])
    assert corners[0, 1] == pytest.approx(-corners[1, 1])


def test_deviations_against_sampling() -> None:
    """Scatter of scale and aspect over readings with noise, against what is predicted for one of them."""
    rng = np.random.default_rng(3)
    true = 0.997
    drawn = [
        print_scale(260, true * 260 + noise_x, 150, true * 150 + noise_y)
        for noise_x, noise_y in rng.normal(0, 0.25, (4000, 2))
    ]
    one = print_scale(260, true * 260, 150, true * 150)
    together = [each for each in drawn if not each.differs]
    assert np.std([each.scale for each in together]) == pytest.approx(one.std, rel=0.05)
    assert np.mean([each.scale for each in together]) == pytest.approx(true, abs=4 * one.std / math.sqrt(4000))
    assert np.std([each.aspect for each in drawn]) == pytest.approx(one.aspect_std, rel=0.05)
    # square prints are called different as seldom as three deviations say: 0.27 %, ± 3 deviations of the count
    assert sum(each.differs for each in drawn) == pytest.approx(4000 * 0.0027, abs=10)
