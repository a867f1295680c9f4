"""`vbaa reconstruct`, `view`, `report`, and the report that `vbaa estimate` ends with, as a user calls them."""

from __future__ import annotations

import json
import sys
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
import pyvista as pv

from vbaa_calib.cli.main import main
from viz.render import probe


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


def test_view_without_opengl_writes_the_page_and_says_what_to_install(
    files: SimpleNamespace, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(probe, "PROBE", (sys.executable, "-c", "raise SystemExit(139)"))
    probe.can_render.cache_clear()
    page, picture = files.folder / "scene.html", files.folder / "scene.png"
    argv = ["view", files.contacts, "--plain", "--html", page, "--screenshot", picture]
    code, _, said = outcome(capsys, *argv)
    probe.can_render.cache_clear()
    assert code == 1
    assert "libegl1" in said
    assert page.exists()
    assert not picture.exists()


def test_a_report_of_files(files: SimpleNamespace, capsys: pytest.CaptureFixture[str]) -> None:
    argv = ["report", files.contacts, "--rig", files.rig, "--truth", files.truth, "--title", "<mine>", "--json"]
    code, said, _ = outcome(capsys, *argv)
    assert (code, said) == (0, {"report": str(files.folder / "report.html")})
    html = (files.folder / "report.html").read_text()
    for words in ("&lt;mine&gt;", "Contact located in 90 of 92 frames", "sha256", ">truth<"):
        assert words in html
    assert outcome(capsys, *argv)[0] == 2
    outcome(capsys, "report", files.free, "-o", files.folder / "free.html")
    html = (files.folder / "free.html").read_text()
    assert "Nothing was touched" in html
    assert "Nothing can be said of it: no frame has a located contact" in html
    elsewhere = json.loads(files.rig.read_text())
    elsewhere["kinematics"]["position_world_m"] = [0.3, 0.0, 0.0]
    files.rig.write_text(json.dumps(elsewhere))
    code, _, words = outcome(capsys, *argv, "-o", files.folder / "foreign.html")
    assert (code, "do not fit the rig's kinematics" in words) == (2, True)
    assert not (files.folder / "foreign.html").exists()
