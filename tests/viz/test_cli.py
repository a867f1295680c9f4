"""`vbaa reconstruct`, `view`, `report`, `compare`, and the report that `vbaa estimate` ends with."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from estimator.table.contacts import ContactRow, ContactTable
from estimator.table.files import read_contacts, write_contacts
from vbaa_calib.camera import Camera
from vbaa_calib.cli.main import main
from vbaa_calib.rig import Rig
from viz.report.compare import compare_contacts, compare_rigs

from ..lazy import Lazy

pv = Lazy("pyvista")


def outcome(capsys: pytest.CaptureFixture[str], *argv: object) -> tuple[int, Any, str]:
    """Exit code, JSON on stdout if any, and stderr."""
    code = main([str(part) for part in argv])
    said = capsys.readouterr()
    return code, json.loads(said.out) if said.out else None, said.err


def test_reconstruct_writes_the_object(files: SimpleNamespace, capsys: pytest.CaptureFixture[str]) -> None:
    out = files.folder / "object.vtp"
    code, result, said = outcome(capsys, "reconstruct", files.contacts, "--rig", files.rig, "-o", out, "--json")
    assert (code, result["contacts"], result["patches"]) == (0, 90, 1)
    mesh = pv.read(out)
    assert mesh.n_cells == result["triangles"] > 100
    assert mesh.n_points == result["points"]
    off = np.linalg.norm((mesh.points - [0.16, 0.05, 0.0])[:, :2], axis=1) - 0.015
    assert np.sqrt(np.mean(off**2)) < 3e-4
    assert 0 < result["median_std_m"] < 3e-4
    assert result["stiffness_in_words"] in said
    assert result["stiffness_told"] == (result["stiffness_N_m"] is not None)


def test_view_writes_page_and_gltf(files: SimpleNamespace, capsys: pytest.CaptureFixture[str]) -> None:
    page, gltf, picture = (files.folder / name for name in ("scene.html", "scene.glb", "seen.png"))
    cv2.imwrite(str(picture), np.full((720, 960), 90, np.uint8))
    argv = ["view", files.contacts, "--rig", files.rig, "--truth", files.truth, "--plain", "--picture", picture]
    code, result, said = outcome(capsys, *argv, "--html", page, "--gltf", gltf, "--color", "time", "--json")
    assert (code, result["contacts"], result["frames"], result["moments"]) == (0, 90, 92, 92)
    assert result["facts"] == []
    assert "opens offline" in said
    assert gltf.read_bytes()[:4] == b"glTF"
    text = page.read_text()
    assert '"mode": "time"' in text
    assert f'"pictures": {[0] * 92}' in text
    code, _, said = outcome(capsys, *argv, "--html", page)
    assert (code, "exists already" in said) == (2, True)
    cv2.imwrite(str(picture), np.full((72, 96), 90, np.uint8))
    code, _, said = outcome(capsys, *argv, "--html", page, "--force")
    assert (code, "96 x 72 pixels, the rig's camera 960 x 720" in said) == (2, True)
    assert page.read_text() == text


COVARIANCE = np.diag([1e-6, 4e-6, 9e-6])


def row(frame: int, rng: np.random.Generator, status: str = "ok", off: float = 0.0) -> ContactRow:
    """A contact, `off` deviations from where it is usually, scattered by `rng` in its own deviations."""
    own = rng.normal(size=3)
    return ContactRow(
        frame=frame,
        time_s=float(frame),
        status=status,
        in_contact=status != "no_contact",
        model="rod",
        distance_m=0.1 + 1e-3 * (own[0] + off),
        distance_std_m=1e-3,
        force_y_N=0.02 + 1e-4 * own[1],
        force_y_std_N=1e-4,
        force_z_N=0.01,
        force_z_std_N=1e-4,
        deflection_y_m=0.0,
        deflection_z_m=0.0,
        point_antenna_m=np.array([0.1, 0.0, 0.0]),
        point_world_m=np.array([0.1, 0.0, 0.0]) + np.sqrt(np.diag(COVARIANCE)) * rng.normal(size=3),
        covariance_world_m2=COVARIANCE,
    )


def table(seed: int, count: int = 400) -> ContactTable:
    rng = np.random.default_rng(seed)
    return ContactTable.from_rows([row(frame, rng) for frame in range(count)])


def test_independent_results_differ_by_the_deviations_that_they_state() -> None:
    """√2 of one's own deviation, √6 for a point in space."""
    found = compare_contacts(table(1), table(2))
    for name, expected in (("distance", 2.0), ("force_y", 2.0), ("force_z", 0.0), ("point", 6.0)):
        assert np.mean(found.deviations[name] ** 2) == pytest.approx(expected, rel=0.2)


def test_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str], rig: Rig) -> None:
    rng = np.random.default_rng(0)
    a, b, c = (tmp_path / f"{name}.csv" for name in "abc")
    write_contacts(a, [row(frame, rng) for frame in range(20)])
    rows = list(read_contacts(a).rows())
    write_contacts(b, [replace(one, distance_m=one.distance_m + 5e-3) if one.frame == 7 else one for one in rows])
    write_contacts(c, rows)
    assert main(["compare", str(a), str(c), "--tolerance", "1e-6"]) == 0
    page = tmp_path / "page.html"
    capsys.readouterr()
    assert main(["compare", str(a), str(b), "--html", str(page), "--json"]) == 1
    said = json.loads(capsys.readouterr().out)
    assert said["off"] == 1
    distance = said["recordings"]["contacts"]["deviations"]["distance"]
    assert (distance["largest_frame"], distance["largest"]) == (7, pytest.approx(5.0))
    assert "They differ" in page.read_text()
    assert main(["compare", str(a), str(b), "--allow", "0.05"]) == 0
    assert main(["compare", str(a), str(b), "--tolerance", "6"]) == 0
    own = tmp_path / "rig.json"
    own.write_text(json.dumps(rig.to_dict()))
    assert main(["compare", str(own), str(own), "--html", str(tmp_path / "rigs.html")]) == 0
    for wrong in ([str(a), str(own)], [str(tmp_path), str(tmp_path)], [str(a), str(b), "--tolerance", "nan"]):
        assert main(["compare", *wrong]) == 2


def test_lenses_of_two_models_are_compared_where_they_show_a_ray(rig: Rig) -> None:
    """The same lens with one coefficient more, which is zero, is the same; one that moved by so many deviations is
    off by as many, along the direction in which its own covariance says so."""
    four = rig.camera
    own = np.diag((1e-3 * np.array([*four.parameters[:4], 1.0, 1.0, 0.1, 0.1])) ** 2)
    four = Camera("opencv", four.image_size, four.matrix, np.resize(four.distortion, 4), own)
    wide = np.zeros((9, 9))
    wide[:8, :8] = own
    one = replace(rig, camera=four, covariance=rig.covariance[:17, :17])

    def other(step: np.ndarray) -> Rig:
        moved = four.moved(step)
        five = Camera("opencv", four.image_size, moved.matrix, np.append(moved.distortion, 0.0), wide)
        return replace(one, camera=five)

    same = compare_rigs(one, other(np.zeros(8)))
    assert same.names[-1] == "projection_px"
    assert same.difference[-1] == pytest.approx(0.0, abs=1e-9)
    assert not same.beyond(1e-3)
    middle = np.zeros(8)
    middle[2] = 6.0 * np.sqrt(own[2, 2])
    off = compare_rigs(one, other(middle))
    assert off.beyond(3.0) == ["projection_px"]
    assert off.difference[-1] == pytest.approx(middle[2], rel=1e-6)
    assert 3.0 < abs(off.deviations[-1]) <= 6.0
