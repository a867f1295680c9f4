"""`vbaa reconstruct` and `vbaa view` as a user calls them."""

from __future__ import annotations

import json
import subprocess
import sys
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
import pyvista as pv

from vbaa_calib.cli import main
from viz.files.object_file import read_object
from viz.render import render


def outcome(capsys: pytest.CaptureFixture[str], *argv: object) -> tuple[int, Any, str]:
    """Exit code, JSON on stdout if any, and stderr."""
    code = main([str(part) for part in argv])
    said = capsys.readouterr()
    return code, json.loads(said.out) if said.out else None, said.err


def test_reconstruct_writes_the_object(files: SimpleNamespace, capsys: pytest.CaptureFixture[str]) -> None:
    out = files.folder / "object.vtp"
    code, result, said = outcome(capsys, "reconstruct", files.contacts, "--rig", files.rig, "-o", out, "--json")
    assert code == 0
    assert result["contacts"] == 90
    assert result["patches"] == 1
    mesh = pv.read(out)
    assert mesh.n_cells == result["triangles"] > 100
    assert mesh.n_points == result["points"]
    off = np.linalg.norm((mesh.points - [0.16, 0.05, 0.0])[:, :2], axis=1) - 0.015
    assert np.sqrt(np.mean(off**2)) < 3e-4
    assert 0 < result["median_std_m"] < 3e-4
    assert result["stiffness_in_words"] in said
    assert result["stiffness_told"] == (result["stiffness_N_m"] is not None)


@pytest.mark.parametrize("suffix", ["ply", "glb"])
def test_without_rig_it_says_that_the_radius_is_missing(
    files: SimpleNamespace, capsys: pytest.CaptureFixture[str], suffix: str
) -> None:
    code, _, said = outcome(capsys, "reconstruct", files.contacts, "-o", files.folder / f"object.{suffix}")
    assert code == 0
    assert "radius is not known" in said
    assert len(read_object(files.folder / f"object.{suffix}").triangles) > 100


RIGGED = ("view", "{contacts}", "--rig", "{rig}", "--plain", "--html", "{folder}/a.html")


@pytest.mark.parametrize(
    ("argv", "complaint"),
    [
        (["reconstruct", "{contacts}", "-o", "{folder}/object.stl"], "is not a .vtp, .ply or .glb"),
        (["reconstruct", "{folder}/none.csv", "-o", "{folder}/object.vtp"], "no such file"),
        (["reconstruct", "{truth}", "-o", "{folder}/object.vtp"], "truth.json"),
        (["reconstruct", "{contacts}", "--rig", "{truth}", "-o", "{folder}/object.vtp"], "truth.json"),
        (["reconstruct", "{contacts}", "-o", "{folder}/none/object.vtp"], "its folder does not exist"),
        (["reconstruct", "{contacts}", "-o", "{contacts}"], "is not a .vtp, .ply or .glb"),
        (["view", "{contacts}", "--html", "{rig}"], "is not a .html or .htm"),
        (["view", "{contacts}", "--gltf", "{folder}/scene.obj"], "is not a .glb or .gltf"),
        (["view", "{contacts}", "--gltf", "{folder}/none/scene.glb", "--plain"], "its folder does not exist"),
        (["view", "{contacts}", "--session", "{folder}", "--html", "{folder}/a.html"], "give --rig, too"),
        (["view", "{contacts}", "--picture", "{rig}", "--html", "{folder}/a.html"], "give --rig, too"),
        ([*RIGGED, "--picture", "{rig}"], "rig.json: is not a picture"),
        ([*RIGGED, "--session", "{folder}"], "session.yaml"),
        (["view", "{contacts}", "--screenshot", "{folder}/scene.jpg"], "is not a .png"),
        (["view", "{contacts}", "--object", "{contacts}", "--html", "{folder}/a.html"], "is not a .vtp, .ply or .glb"),
        (["view", "{contacts}", "--object", "{folder}/a.vtp", "--html", "{folder}/a.html"], "no such file"),
        (["view", "{contacts}", "--truth", "{rig}", "--html", "{folder}/a.html"], "rig.json: has no object"),
        (["view", "{free}", "--html", "{folder}/a.html"], "free.csv: no frame has a located contact"),
        (["reconstruct", "{free}", "-o", "{folder}/object.vtp"], "free.csv: no frame has a located contact"),
        (["view", "{rig}", "--html", "{folder}/a.html"], "rig.json"),
    ],
)
def test_wrong_calls_end_in_one_line_and_leave_nothing(
    files: SimpleNamespace, capsys: pytest.CaptureFixture[str], argv: list[str], complaint: str
) -> None:
    before = sorted(files.folder.iterdir())
    code, _, said = outcome(capsys, *(part.format(**vars(files)) for part in argv))
    assert code == 2
    assert complaint in said
    assert len(said.strip().splitlines()) <= 2
    assert sorted(files.folder.iterdir()) == before


def test_view_writes_page_and_gltf(files: SimpleNamespace, capsys: pytest.CaptureFixture[str]) -> None:
    page, gltf = files.folder / "scene.html", files.folder / "scene.glb"
    argv = ["view", files.contacts, "--rig", files.rig, "--truth", files.truth, "--plain", "--html", page]
    code, result, said = outcome(capsys, *argv, "--gltf", gltf, "--color", "time", "--json")
    assert (code, result["contacts"], result["frames"], result["moments"]) == (0, 90, 92, 92)
    assert result["facts"] == []
    assert "opens offline" in said
    assert gltf.read_bytes()[:4] == b"glTF"
    assert '"mode": "time"' in page.read_text()
    code, _, said = outcome(capsys, *argv)
    assert code == 2
    assert "exists already" in said
    assert outcome(capsys, *argv, "--force")[0] == 0


def test_view_finds_the_object_itself(files: SimpleNamespace, capsys: pytest.CaptureFixture[str]) -> None:
    page = files.folder / "scene.html"
    code, result, said = outcome(capsys, "view", files.contacts, "--rig", files.rig, "--html", page, "--json")
    assert code == 0
    assert any("riction" in fact for fact in result["facts"])
    assert any("stiff" in fact for fact in result["facts"])
    assert all(fact in said for fact in result["facts"])
    assert "reconstructed surface" in page.read_text()


def test_a_picture_hangs_before_the_camera(files: SimpleNamespace, capsys: pytest.CaptureFixture[str]) -> None:
    picture, page = files.folder / "seen.png", files.folder / "scene.html"
    cv2.imwrite(str(picture), np.full((720, 960), 90, np.uint8))
    argv = ["view", files.contacts, "--rig", files.rig, "--plain", "--picture", picture, "--html", page]
    assert outcome(capsys, *argv)[0] == 0
    assert f'"pictures": {[0] * 92}' in page.read_text()
    cv2.imwrite(str(picture), np.full((72, 96), 90, np.uint8))
    code, _, said = outcome(capsys, *argv, "--force")
    assert code == 2
    assert "96 x 72 pixels, the rig's camera 960 x 720" in said


def test_view_without_a_display_says_what_to_do(
    files: SimpleNamespace, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(sys, "platform", "linux")
    code, _, said = outcome(capsys, "view", files.contacts)
    assert code == 2
    assert "--screenshot" in said


def test_view_on_a_display_that_is_not_there_says_what_to_do(
    files: SimpleNamespace, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    if not sys.platform.startswith("linux") or not render.can_render():
        pytest.skip("no X11, or no OpenGL here")
    monkeypatch.setenv("DISPLAY", ":7777")
    code, _, said = outcome(capsys, "view", files.contacts, "--plain")
    assert code == 2
    assert "no display" in said


def test_view_without_opengl_writes_the_page_and_says_what_to_install(
    files: SimpleNamespace, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(render, "PROBE", (sys.executable, "-c", "raise SystemExit(139)"))
    render.can_render.cache_clear()
    page, picture = files.folder / "scene.html", files.folder / "scene.png"
    argv = ["view", files.contacts, "--plain", "--html", page, "--screenshot", picture]
    code, _, said = outcome(capsys, *argv)
    render.can_render.cache_clear()
    assert code == 1
    assert "libegl1" in said
    assert page.exists()
    assert not picture.exists()


@pytest.mark.parametrize("verb", ["reconstruct", "view"])
def test_help_needs_no_heavy_library(verb: str) -> None:
    code = (
        f"import sys; from vbaa_calib.cli import main; main(['{verb}', '--help']); "
        "sys.exit(bool({'pyvista', 'torch', 'cv2', 'scipy'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "contacts.csv" in done.stdout
