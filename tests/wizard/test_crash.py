"""Ended at any moment, the wizard has lost nothing that it said it took, and comes to the same end when called again."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml

from vbaa_calib.files import read_yaml
from vbaa_calib.synth.scene import bundled_scene

from .small_session import answers, answers_file

ROOT = Path(__file__).parents[2]
ROWS = {
    "noload": "image,pan_rad,tilt_rad,moment_Nm\n1.png,0,0,0.001\n2.png,0,0.3,0.002\n",
    "loads": "image,pan_rad,tilt_rad,moment_Nm,distance_m,force_y_N,force_z_N\n1.png,0,0,0.01,0.1,0,-0.05\n",
    "sweep": "image,pan_rad,tilt_rad\n1.png,0,0\n2.png,0.1,0\n",
}
PICTURES = {"intrinsics": ("1", "2", "bad", "3"), "plane": ("1",), "noload": ("1", "2"), "loads": ("1",), "sweep": "12"}


@pytest.fixture
def source(tmp_path: Path) -> Path:
    """Folders of tiny pictures with their tables; nothing looks at them here."""
    rng = np.random.default_rng(3)
    for folder, names in PICTURES.items():
        (tmp_path / "source" / folder).mkdir(parents=True)
        for name in names:
            path = tmp_path / "source" / folder / f"{name}.png"
            assert cv2.imwrite(str(path), rng.integers(0, 255, (12, 16), np.uint8))
            os.utime(path, (1e9, 1e9))
        if folder in ROWS:
            (tmp_path / "source" / folder / f"{folder}.csv").write_text(ROWS[folder])
    board = read_yaml(bundled_scene("demo"))["board"]
    (tmp_path / "source" / "session.yaml").write_text(yaml.safe_dump({"board": board}))
    return tmp_path / "source"


def found(tmp_path: Path, **plan: Any) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """What the driver found: the run that nothing ended, and one entry per place of death."""
    path = tmp_path / "plan.json"
    path.write_text(json.dumps({"root": str(tmp_path / "session")} | plan))
    command = [sys.executable, "-m", "tests.wizard.crash_driver", str(path)]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True, env=os.environ | {"OMP_NUM_THREADS": "1"})
    whole, *deaths = json.loads(path.with_suffix(".found.json").read_text())
    return whole, deaths


def expect_same_end(whole: dict[str, Any], deaths: list[dict[str, Any]], but: Sequence[str] = ()) -> None:
    """Every promise was kept, and every file is the same in the end."""
    assert whole["code"] == 0, whole["said"]
    for death in deaths:
        assert not death["broken"], death
        assert death["code"] == 0, (death["moment"], death["said"])
        names = {*whole["tree"], *death["tree"]}.difference(but)
        differing = {name for name in names if whole["tree"].get(name) != death["tree"].get(name)}
        assert not differing, (death["moment"], differing)


@pytest.fixture(params=[pytest.param((0, 1), marks=pytest.mark.slow, id="all"), pytest.param((3, 12), id="some")])
def moments(request: pytest.FixtureRequest) -> dict[str, int]:
    """All moments of a run that leave something different behind, or a few of them."""
    return dict(zip(("first", "stride"), request.param, strict=True))


def test_the_first_run(source: Path, tmp_path: Path, moments: dict[str, int]) -> None:
    argv = ["--answers", str(answers_file(tmp_path / "a.yaml", answers(source)))]
    expect_same_end(*found(tmp_path, argv=argv, again=argv, **moments))


@pytest.mark.parametrize("step", ["board", "lens", "plane", "noload", "loads"])
def test_a_step_that_starts_again(step: str, source: Path, tmp_path: Path, moments: dict[str, int]) -> None:
    """Called again without --redo: what was gone is taken again, what was not gone is as it was."""
    argv = ["--answers", str(answers_file(tmp_path / "a.yaml", answers(source)))]
    whole, deaths = found(tmp_path, before=[argv], argv=[*argv, "--redo", step], again=argv, **moments)
    expect_same_end(whole, deaths, but=["wizard.json"])
    assert all(step in json.loads((tmp_path / "session" / "wizard.json").read_text())["redone"] for _ in deaths[-1:])


def test_another_way_to_plane_c(source: Path, tmp_path: Path, moments: dict[str, int]) -> None:
    jig = answers(source)
    argv = ["--answers", str(answers_file(tmp_path / "a.yaml", jig))]
    sweep = ["--answers", str(answers_file(tmp_path / "b.yaml", jig | {"plane_way": "sweep"}))]
    whole, deaths = found(tmp_path, before=[argv], argv=sweep, again=sweep, **moments)
    expect_same_end(whole, deaths)
    assert "jig" not in read_yaml(tmp_path / "session" / "session.yaml")
    assert not (tmp_path / "session" / "plane").exists()


def test_another_board(source: Path, tmp_path: Path, moments: dict[str, int]) -> None:
    other = read_yaml(source / "session.yaml")["board"] | {"square_m": 0.012, "marker_m": 0.009}
    (source / "other.yaml").write_text(yaml.safe_dump({"board": other}))
    changed = {"board": str(source / "other.yaml"), "board_along_x_mm": 132.0, "board_along_y_mm": 96.0}
    argv = ["--answers", str(answers_file(tmp_path / "a.yaml", answers(source)))]
    again = ["--answers", str(answers_file(tmp_path / "b.yaml", answers(source) | changed))]
    expect_same_end(*found(tmp_path, before=[argv], argv=again, again=again, **moments))
    assert read_yaml(tmp_path / "session" / "session.yaml")["board"]["square_m"] == pytest.approx(0.012, rel=1e-6)


def test_a_session_that_was_made_by_hand(source: Path, tmp_path: Path, moments: dict[str, int]) -> None:
    """Adopted as it is: its pictures stay, and what the wizard writes anew is kept as it was."""
    argv = ["--answers", str(answers_file(tmp_path / "a.yaml", answers(source)))]
    by_hand = tmp_path / "by-hand"
    whole, _ = found(tmp_path, before=[], argv=argv, again=argv, stride=1000)
    shutil.copytree(tmp_path / "session", by_hand)
    (by_hand / "wizard.json").unlink()
    (by_hand / "noload" / "noload.csv").write_text("remark," + ROWS["noload"].replace("\n", "\nx,")[:-2])
    shutil.rmtree(tmp_path / "session")
    shutil.rmtree(tmp_path / "session-moments")
    whole, deaths = found(tmp_path, start=str(by_hand), argv=[], again=[], **moments)
    expect_same_end(whole, deaths)
    pictures = [name for name in whole["tree"] if name.endswith(".png")]
    assert len(pictures) == 7
    given = tmp_path / "session" / "aside" / "given"
    assert (given / "noload.csv").read_text().startswith("remark,")
    assert (given / "session.yaml").read_bytes() == (by_hand / "session.yaml").read_bytes()
