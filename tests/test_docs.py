"""The documentation is true where a machine can tell: it builds, links lead on, code, commands and examples run."""

from __future__ import annotations

import argparse
import contextlib
import io
import pydoc
import re
import runpy
import shlex
import shutil
import subprocess
import sys
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from estimator import ContactEstimator
from targets.board import BoardSpec
from vbaa_calib.cli.main import VERBS, _verb_parser, main
from vbaa_calib.core.files import read_yaml
from vbaa_calib.rig import Rig

from .calibrate.test_hand_eye import POINTS, Arm, lens, views_and_poses
from .csv_files import read_rows
from .small_scene import simulated, small_rig

ROOT = Path(__file__).parents[1]
DOCS = sorted((ROOT / "docs").glob("*.md"))
BESIDE = [
    ROOT / "README.md",
    ROOT / "ARCHITECTURE.md",
    ROOT / "CONTRIBUTING.md",
    ROOT / "CHANGELOG.md",
    *sorted(ROOT.glob("benchmarks/*.md")),
]
PAGES = [*DOCS, *BESIDE]
FENCE = re.compile(r"^```(?P<language>[^\n]*)\n(?P<code>.*?)^```", re.MULTILINE | re.DOTALL)
_LINK = re.compile(r"!?\[[^\]]*\]\(([^)\s]+)\)")


_LOADED = re.compile(
    r"<(?:script|link|img|iframe|source|video)\b[^>]*?(?:src|href)=\"((?:https?:)?//[^\"]+)", re.DOTALL
)


def name_of(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The built site. Every warning is an error, as in `make docs`."""
    out = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-n", "-q", "-b", "html", "-d", str(out / "trees")]
    command += [str(ROOT / "docs"), str(out / "html")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return out / "html"


@pytest.mark.slow
def test_the_site_builds_and_loads_nothing_from_elsewhere(site: Path) -> None:
    """No script, style, font or picture of another host, in any page or style sheet."""
    pages = list(site.glob("*.html"))
    assert {path.stem for path in pages} >= {path.stem for path in DOCS}
    loaded = {found for path in pages for found in _LOADED.findall(path.read_text(encoding="utf-8"))}
    styles = [path.read_text(encoding="utf-8") for path in site.rglob("*.css")]
    loaded |= {
        found for style in styles for found in re.findall(r"(?:@import|url\()\s*[\"']?((?:https?:)?//[^\"')]+)", style)
    }
    assert loaded == set()


def test_every_verb_has_its_row() -> None:
    """In docs/verbs.md, and none that does not exist."""
    rows = re.findall(r"^\| `vbaa (\w+)` \|", (ROOT / "docs" / "verbs.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert sorted(rows) == sorted(VERBS)


@pytest.mark.parametrize("path", PAGES, ids=name_of)
def test_links_lead_somewhere(path: Path) -> None:
    """Every relative link and picture, and every anchor in a page of ours."""
    for link in _LINK.findall(re.sub(r"`[^`\n]+`", "", FENCE.sub("", path.read_text(encoding="utf-8")))):
        if "://" in link:
            continue
        target, _, anchor = link.partition("#")
        there = (path.parent / target).resolve() if target else path
        assert there.exists(), link
        assert ROOT in (there, *there.parents), link
        if anchor:
            assert anchor in anchors(there), link


def anchors(path: Path) -> set[str]:
    """Of a page's headings, as GitHub and the site make them."""
    headings = re.findall(r"^#+ (.+)$", FENCE.sub("", path.read_text(encoding="utf-8")), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def test_every_picture_is_shown() -> None:
    """Nothing lies in docs/images that no page shows."""
    shown = {
        (path.parent / link).resolve()
        for path in PAGES
        for link in _LINK.findall(path.read_text(encoding="utf-8"))
        if link.endswith((".png", ".jpg", ".svg"))
    }
    assert set((ROOT / "docs" / "images").rglob("*.*")) - shown == set()


def test_the_api_page_names_what_exists() -> None:
    """Each class and function in docs/api.md."""
    named = re.findall(
        r"^\.\. auto\w+:: ([\w.]+)", (ROOT / "docs" / "api.md").read_text(encoding="utf-8"), re.MULTILINE
    )
    assert len(named) > 50
    assert [name for name in named if pydoc.locate(name) is None] == []


def test_troubleshooting_has_the_table_of_hypotheses() -> None:
    """`python docs/quote_hypotheses.py` would change nothing."""
    table = runpy.run_path(str(ROOT / "docs" / "quote_hypotheses.py"))["hypotheses"]()
    assert table in (ROOT / "docs" / "troubleshooting.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def at_work(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder as the pages suppose it: session/, rig.json, contacts.csv, and the same as a demo's."""
    folder = tmp_path_factory.mktemp("at_work")
    scene = read_yaml(small_rig() / "scene.yaml")
    scene["recording"]["sweeps"] = [scene["recording"]["sweeps"][0] | {"frames": 12, "free_frames": 3}]
    session, rig = str(simulated(folder, scene, "--pictures", "none")), str(folder / "rig.json")
    shutil.copy(small_rig() / "rig.json", rig)
    assert main(["estimate", session, "--rig", rig, "-o", str(folder / "contacts.csv"), "--no-report"]) == 0
    shutil.copy(next((small_rig() / "session" / "loads").glob("*.png")), folder / "picture.png")
    (folder / "demo").symlink_to(folder, target_is_directory=True)
    return folder


def blocks() -> list[Any]:
    """Pages and the Python in them."""
    found = []
    for path in PAGES:
        matches = FENCE.finditer(path.read_text(encoding="utf-8"))
        if python := [block["code"] for block in matches if block["language"] == "python"]:
            found.append(pytest.param(python, id=name_of(path)))
    return found


@pytest.mark.parametrize("python", blocks())
def test_code_runs(python: list[str], at_work: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One page's blocks, one after the other, in a folder that holds what the page speaks of."""
    monkeypatch.chdir(at_work)
    names = given(at_work)
    with contextlib.redirect_stdout(io.StringIO()) as said:
        for code in python:
            exec(compile(code, "docs", "exec"), names)
    assert said.getvalue()


def given(folder: Path) -> dict[str, Any]:
    """What the pages take for granted: a rig, extracted points and readings, a picture, a board, views of a robot."""
    frames = rows(folder / "session" / "recording" / "recording.csv")
    points = rows(folder / "session" / "recording" / "centrelines.csv")
    centrelines = [
        np.array([(row["u_px"], row["v_px"]) for row in points if row["frame"] == frame["frame"]]) for frame in frames
    ]
    arm, rig = Arm(), Rig.load(folder / "rig.json")
    views, robot_poses = views_and_poses(arm)
    return {
        "rig": rig,
        "estimator": ContactEstimator(rig),
        "image": np.zeros(rig.camera.image_size[::-1], np.uint8),
        "time_s": 0.5,
        "views": [(view.ids, view.corners_px) for view in views],
        "board_views": views,
        "robot_poses": robot_poses,
        "board_points": POINTS,
        "camera": lens(arm),
        "centreline_px": centrelines[8],
        "centrelines_px": centrelines,
        "moments": [frame["moment_Nm"] for frame in frames],
        "pans": [frame["pan_rad"] for frame in frames],
        "tilts": [frame["tilt_rad"] for frame in frames],
        "pixels": np.array([[200.0, 150.0], [240.0, 180.0]]),
        "spec": BoardSpec(**read_yaml(folder / "scene.yaml")["board"]),
    }


def rows(path: Path) -> list[dict[str, float]]:
    """A CSV of numbers."""
    return [{name: float(value) for name, value in row.items()} for row in read_rows(path)]


def commands(path: Path) -> Iterator[tuple[str, bool]]:
    """What a page tells its reader to type, and whether it is a whole command line or named in passing."""
    text = path.read_text(encoding="utf-8")
    for block in FENCE.finditer(text):
        if block["language"] in ("", "sh", "bash", "shell"):
            yield from ((line, True) for line in block["code"].splitlines())
    prose = FENCE.sub("", text)
    yield from ((line.strip(), True) for line in prose.splitlines() if line.startswith("    "))
    for line in prose.splitlines():
        if not line.startswith("    "):
            yield from ((found, False) for found in re.findall(r"`((?:\w+=\S+ )*vbaa [^`]+)`", line))


def words_of(line: str) -> list[str] | None:
    """Verb and arguments of a command line; None of another program's, or of one that is not whole."""
    found = re.match(r"(?:\$ )?(?:\w+=\S+ )*vbaa (?P<rest>[a-z].*)", line)
    return None if found is None or "…" in line else shlex.split(found["rest"], comments=True)


@pytest.mark.parametrize("path", PAGES, ids=name_of)
def test_commands_are_accepted(path: Path) -> None:
    """The verb exists, and its parser takes the flags and their values."""
    for line, whole in commands(path):
        if not (words := words_of(line)):
            continue
        verb, *rest = words
        assert verb in VERBS, f"there is no verb {verb}"
        parser = _verb_parser(verb)
        if not whole:
            _ask_for_nothing(parser)
        if "--help" not in rest:
            parser.parse_args(rest)


def _ask_for_nothing(parser: argparse.ArgumentParser) -> None:
    """What is named in passing need not be complete."""
    for action in parser._actions:
        action.required = False
        if not action.option_strings or action.nargs is None:
            action.nargs = "?"


EXAMPLES = sorted((ROOT / "examples").glob("[0-9]*.py"))
LONG = ("06_calibrating_a_session", "09_the_ladder")
"""They take ten seconds."""


@pytest.mark.parametrize(
    "path", [pytest.param(path, id=path.stem, marks=[pytest.mark.slow] * (path.stem in LONG)) for path in EXAMPLES]
)
def test_it_runs(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out, err = io.StringIO(), io.StringIO()
    monkeypatch.setattr(sys, "argv", [str(path), "--figures", str(tmp_path)])
    monkeypatch.syspath_prepend(str(path.parent))
    with warnings.catch_warnings(), contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", ".torch.jit.script. is deprecated", DeprecationWarning)
        runpy.run_path(str(path), run_name="__main__")
    assert out.getvalue()
    assert err.getvalue() == ""
    assert cv2.imread(str(tmp_path / f"{path.stem}.png")) is not None
