"""Ended at any moment, the wizard has lost nothing that it said it took; called again, it comes to the same end."""

from __future__ import annotations

import errno
import json
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pytest
import yaml

from vbaa_calib.core.files import read_yaml

from .small_session import answers, answers_file, tiny_source

ROOT = Path(__file__).parents[2]
STEPS = ("board", "lens", "plane", "noload", "loads")
Ends = tuple[dict[str, Any], list[dict[str, Any]]]
Found = Mapping[str, Ends]
QUICK = ("first run", "redo lens", "other way", "by hand", "full")


def plans(folder: Path) -> dict[str, dict[str, Any]]:
    """What is run, and what is run again where it was ended."""
    source = tiny_source(folder / "source")
    old = read_yaml(source / "session.yaml")["board"]
    (source / "other.yaml").write_text(yaml.safe_dump({"board": old | {"square_m": 0.012, "marker_m": 0.009}}))
    board = {"board": str(source / "other.yaml"), "board_along_x_mm": 132.0, "board_along_y_mm": 96.0}
    changes: dict[str, dict[str, Any]] = {"first": {}, "sweep": {"plane_way": "sweep"}, "board": board}
    files = {name: answers_file(folder / f"{name}.yaml", answers(source) | change) for name, change in changes.items()}
    first, sweep, board_changed = (["--answers", str(file)] for file in files.values())
    made: dict[str, dict[str, Any]] = {
        "first run": {"argv": first, "again": first},
        "other way": {"before": [first], "argv": sweep, "again": sweep},
        "other board": {"before": [first], "argv": board_changed, "again": board_changed},
        "by hand": {"before": [first], "by_hand": True, "argv": [], "again": []},
        "full": {"argv": first, "errno": errno.ENOSPC},
        "read-only": {"argv": first, "errno": errno.EROFS, "stride": 20},
    }
    redone = {f"redo {step}": {"before": [first], "argv": [*first, "--redo", step], "again": first} for step in STEPS}
    return made | redone


@pytest.fixture(scope="module", params=[pytest.param(1, marks=pytest.mark.slow, id="all"), pytest.param(20, id="some")])
def folder(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the driver worked: every moment that leaves something different behind, or a few of them of a few plans."""
    folder = tmp_path_factory.mktemp("crash")
    which = {"first": min(request.param - 1, 3), "stride": request.param}
    all_plans = [which | {"root": str(folder / name)} | plan for name, plan in plans(folder).items()]
    all_plans = [plan for plan in all_plans if request.param == 1 or Path(plan["root"]).name in QUICK]
    (folder / "plan.json").write_text(json.dumps(all_plans))
    command = [sys.executable, "-m", "tests.wizard.crash_driver", str(folder / "plan.json")]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True, env=os.environ | {"OMP_NUM_THREADS": "1"})
    return folder


@pytest.fixture(scope="module")
def found(folder: Path) -> Found:
    """Plan → the run that nothing ended, and one entry per moment of death."""
    made = json.loads((folder / "plan.found.json").read_text())
    names = [Path(plan["root"]).name for plan in json.loads((folder / "plan.json").read_text())]
    return {name: (whole, deaths) for name, (whole, *deaths) in zip(names, made, strict=True)}


def expect_same_end(whole: dict[str, Any], deaths: list[dict[str, Any]], but: Sequence[str] = ()) -> None:
    """Every promise was kept, and every file is the same in the end."""
    assert whole["code"] == 0, whole["said"]
    assert deaths
    for death in deaths:
        assert not death["broken"], death
        assert death["code"] == 0, (death["moment"], death["said"])
        names = {*whole["tree"], *death["tree"]}.difference(but)
        differing = {name for name in names if whole["tree"].get(name) != death["tree"].get(name)}
        assert not differing, (death["moment"], differing)


def test_the_first_run(found: Found) -> None:
    expect_same_end(*found["first run"])


def test_a_step_that_starts_again(found: Found) -> None:
    """Called again without --redo: what was gone is taken again, what was not gone is as it was."""
    redone = [name for name in found if name.startswith("redo ")]
    assert redone
    for name in redone:
        expect_same_end(*found[name], but=["wizard.json"])
        assert "starts again" in found[name][0]["said"]


def test_other_answers(found: Found, folder: Path) -> None:
    """The calibration takes every way to plane C that it finds: nothing of the old one may be left."""
    expect_same_end(*found["other way"])
    assert "jig" not in read_yaml(folder / "other way" / "session.yaml")
    assert not (folder / "other way" / "plane").exists()
    if "other board" in found:
        expect_same_end(*found["other board"])
        board = read_yaml(folder / "other board" / "session.yaml")["board"]
        assert board["square_m"] == pytest.approx(0.012, rel=1e-6)


def test_a_session_that_was_made_by_hand(found: Found, folder: Path) -> None:
    """Adopted as it is: its pictures stay, and what the wizard writes anew is kept as it was."""
    whole, deaths = found["by hand"]
    expect_same_end(whole, deaths)
    assert len([name for name in whole["tree"] if name.endswith(".png")]) == 7
    given = folder / "by hand" / "aside" / "given"
    assert (given / "noload.csv").read_text().startswith("remark,")
    assert (given / "session.yaml").exists()


def test_a_disk_that_fails(found: Found) -> None:
    """From any write on: one line that says so, nothing lost, and with the disk mended the same end."""
    faults = {"full": "No space left on device", "read-only": "Read-only file system"}
    for name in faults.keys() & found.keys():
        whole, ends = found[name]
        expect_same_end(whole, ends)
        *failed, last = ends
        assert last["fault"] == 0
        for end in failed:
            assert end["fault"] in (1, 2)
            line = end["failed"].strip().splitlines()[-1]
            assert line.startswith("vbaa: ")
            assert faults[name] in line
            assert "; " in line
