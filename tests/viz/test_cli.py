"""`vbaa reconstruct` and `vbaa view` as a user calls them."""

from __future__ import annotations

import json
import subprocess
import sys
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import pyvista as pv

from vbaa_calib.cli import main
from viz import render


def outcome(capsys: pytest.CaptureFixture[str], *argv: object) -> tuple[int, Any, str]:
    """Exit code, JSON on stdout if any, and stderr."""
    code = main([str(part) for part in argv])
    said = capsys.readouterr()
    return code, json.loads(said.out) if said.out else None, said.err


def test_reconstruct_writes_the_object(files: SimpleNamespace, capsys: pytest.CaptureFixture[str]) -> None:
    out = files.folder / "object.vtp"
    code, result, _ = outcome(capsys, "reconstruct", files.contacts, "--rig", files.rig, "-o", out, "--json")
    assert code == 0
    assert result["points"] == 90
    assert result["patches"] == 1
    mesh = pv.read(out)
    assert mesh.n_cells == result["triangles"] > 100
    off = np.linalg.norm((mesh.points - [0.16, 0.05, 0.0])[:, :2], axis=1) - 0.015
    assert np.sqrt(np.mean(off**2)) < 3e-4


def test_without_rig_it_says_that_the_radius_is_missing(
    files: SimpleNamespace, capsys: pytest.CaptureFixture[str]
) -> None:
    code, _, said = outcome(capsys, "reconstruct", files.contacts, "-o", files.folder / "object.ply")
    assert code == 0
    assert "radius is not known" in said


@pytest.mark.parametrize(
    ("argv", "complaint"),
    [
        (["reconstruct", "{contacts}", "-o", "{folder}/object.stl"], "is not a .vtp or .ply"),
        (["reconstruct", "{folder}/none.csv", "-o", "{folder}/object.vtp"], "no such file"),
        (["reconstruct", "{truth}", "-o", "{folder}/object.vtp"], "truth.json"),
        (["reconstruct", "{contacts}", "--rig", "{truth}", "-o", "{folder}/object.vtp"], "truth.json"),
        (["reconstruct", "{contacts}", "-o", "{folder}/none/object.vtp"], "its folder does not exist"),
        (["reconstruct", "{contacts}", "-o", "{contacts}"], "is not a .vtp or .ply"),
        (["view", "{contacts}", "--html", "{rig}"], "is not a .html"),
        (["view", "{contacts}", "--screenshot", "{folder}/scene.jpg"], "is not a .png"),
        (["view", "{contacts}", "--object", "{contacts}", "--html", "{folder}/a.html"], "is not a .vtp or .ply"),
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


def test_view_writes_the_page(files: SimpleNamespace, capsys: pytest.CaptureFixture[str]) -> None:
    page = files.folder / "scene.html"
    argv = ["view", files.contacts, "--rig", files.rig, "--truth", files.truth, "--html", page]
    code, result, said = outcome(capsys, *argv, "--json")
    assert (code, result["contacts"], result["frames"]) == (0, 90, 92)
    assert "opens offline" in said
    code, _, said = outcome(capsys, *argv)
    assert code == 2
    assert "exists already" in said
    assert outcome(capsys, *argv, "--force")[0] == 0


def test_view_without_a_display_says_what_to_do(
    files: SimpleNamespace, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.setattr(sys, "platform", "linux")
    code, _, said = outcome(capsys, "view", files.contacts)
    assert code == 2
    assert "--screenshot" in said


def test_view_without_opengl_writes_the_page_and_says_what_to_install(
    files: SimpleNamespace, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(render, "PROBE", (sys.executable, "-c", "raise SystemExit(139)"))
    render.can_render.cache_clear()
    page, picture = files.folder / "scene.html", files.folder / "scene.png"
    code, _, said = outcome(capsys, "view", files.contacts, "--html", page, "--screenshot", picture)
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
