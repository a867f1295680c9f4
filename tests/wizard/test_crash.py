"""Ended at any moment, the wizard has lost nothing that it said it took; called again, it comes to the same end."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
import yaml

from vbaa_calib.files import read_yaml
from vbaa_calib.wizard.journal import STEPS

from .small_session import answers, answers_file, tiny_source

ROOT = Path(__file__).parents[2]


@pytest.fixture
def source(tmp_path: Path) -> Path:
    """Tiny pictures; nothing looks at them here."""
    return tiny_source(tmp_path / "source")


Ends = tuple[dict[str, Any], list[dict[str, Any]]]


def found(tmp_path: Path, *plans: dict[str, Any]) -> list[Ends]:
    """What the driver found for each plan: the run that nothing ended, and one entry per moment of death."""
    path = tmp_path / "plan.json"
    path.write_text(json.dumps([{"root": str(tmp_path / f"session{n}")} | plan for n, plan in enumerate(plans)]))
    command = [sys.executable, "-m", "tests.wizard.crash_driver", str(path)]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True, env=os.environ | {"OMP_NUM_THREADS": "1"})
    return [(whole, deaths) for whole, *deaths in json.loads(path.with_suffix(".found.json").read_text())]


def expect_same_end(whole: dict[str, Any], deaths: list[dict[str, Any]], but: Sequence[str] = ()) -> None:
    """Every promise was kept, and every file is the same in the end."""
    assert whole["code"] == 0, whole["said"]
    for death in deaths:
        assert not death["broken"], death
        assert death["code"] == 0, (death["moment"], death["said"])
        names = {*whole["tree"], *death["tree"]}.difference(but)
        differing = {name for name in names if whole["tree"].get(name) != death["tree"].get(name)}
        assert not differing, (death["moment"], differing)


@pytest.fixture(params=[pytest.param((0, 1), marks=pytest.mark.slow, id="all"), pytest.param((3, 20), id="some")])
def moments(request: pytest.FixtureRequest) -> dict[str, int]:
    """All moments of a run that leave something different behind, or a few of them."""
    return dict(zip(("first", "stride"), request.param, strict=True))


def test_the_first_run(source: Path, tmp_path: Path, moments: dict[str, int]) -> None:
    argv = ["--answers", str(answers_file(tmp_path / "a.yaml", answers(source)))]
    [ends] = found(tmp_path, moments | {"argv": argv, "again": argv})
    expect_same_end(*ends)


def test_a_step_that_starts_again(source: Path, tmp_path: Path, moments: dict[str, int]) -> None:
    """Called again without --redo: what was gone is taken again, what was not gone is as it was."""
    argv = ["--answers", str(answers_file(tmp_path / "a.yaml", answers(source)))]
    steps = STEPS[:-2] if moments["stride"] == 1 else ("board", "lens")
    plans = (moments | {"before": [argv], "argv": [*argv, "--redo", step], "again": argv} for step in steps)
    for step, ends in zip(steps, found(tmp_path, *plans), strict=True):
        expect_same_end(*ends, but=["wizard.json"])
        assert "starts again, what it had is in" in ends[0]["said"] or step == "board"


def test_other_answers(source: Path, tmp_path: Path, moments: dict[str, int]) -> None:
    """Another way to plane C and another board start those steps again, and nothing of the old ones is left."""
    old = read_yaml(source / "session.yaml")["board"]
    (source / "other.yaml").write_text(yaml.safe_dump({"board": old | {"square_m": 0.012, "marker_m": 0.009}}))
    board = {"board": str(source / "other.yaml"), "board_along_x_mm": 132.0, "board_along_y_mm": 96.0}
    first = ["--answers", str(answers_file(tmp_path / "first.yaml", answers(source)))]
    files = {name: tmp_path / f"{name}.yaml" for name in ("sweep", "board")}
    answers_file(files["sweep"], answers(source) | {"plane_way": "sweep"})
    answers_file(files["board"], answers(source) | board)
    then = [["--answers", str(file)] for file in files.values()]
    for ends in found(tmp_path, *(moments | {"before": [first], "argv": argv, "again": argv} for argv in then)):
        expect_same_end(*ends)
    by_sweep, by_board = (read_yaml(tmp_path / name / "session.yaml") for name in ("session0", "session1"))
    assert "jig" not in by_sweep
    assert not (tmp_path / "session0" / "plane").exists()
    assert by_board["board"]["square_m"] == pytest.approx(0.012, rel=1e-6)


def test_a_session_that_was_made_by_hand(source: Path, tmp_path: Path, moments: dict[str, int]) -> None:
    """Adopted as it is: its pictures stay, and what the wizard writes anew is kept as it was."""
    argv = ["--answers", str(answers_file(tmp_path / "a.yaml", answers(source)))]
    by_hand = tmp_path / "session0"
    found(tmp_path, {"argv": argv, "again": argv, "first": 999})
    by_hand = by_hand.rename(tmp_path / "by-hand")
    (by_hand / "wizard.json").unlink()
    header, *rows = (by_hand / "noload" / "noload.csv").read_text().split()
    (by_hand / "noload" / "noload.csv").write_text("\n".join([f"remark,{header}", *(f"x,{row}" for row in rows)]))
    [(whole, deaths)] = found(tmp_path, moments | {"start": str(by_hand), "argv": [], "again": []})
    expect_same_end(whole, deaths)
    assert len([name for name in whole["tree"] if name.endswith(".png")]) == 7
    given = tmp_path / "session0" / "aside" / "given"
    assert (given / "noload.csv").read_text().startswith("remark,")
    assert (given / "session.yaml").read_bytes() == (by_hand / "session.yaml").read_bytes()
