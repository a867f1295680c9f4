"""SIGKILL at random moments: a wizard loses nothing that it said it took, and called again comes to the same end."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from vbaa_calib.core.files import read_yaml

from .small_session import answers, answers_file, rendered, tiny_source

ROOT = Path(__file__).parents[2]


def killed(folder: Path, seeing: bool, **plans: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """What the killer found of each plan."""
    (folder / "plan.json").write_text(json.dumps({"seeing": seeing, **plans}))
    command = [sys.executable, "-m", "tests.wizard.killer", str(folder / "plan.json")]
    subprocess.run(command, cwd=ROOT, check=True, env=os.environ | {"OMP_NUM_THREADS": "1"}, capture_output=True)
    found: dict[str, dict[str, Any]] = json.loads((folder / "plan.found.json").read_text())
    return found


@pytest.fixture(scope="module", params=[3, pytest.param(100, marks=pytest.mark.slow)])
def folder(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where sessions of tiny pictures, which no step looks at, were killed so often."""
    folder = tmp_path_factory.mktemp("killed")
    given = answers(tiny_source(folder / "source"))
    first = ["--answers", str(answers_file(folder / "first.yaml", given))]
    sweep = ["--answers", str(answers_file(folder / "sweep.yaml", given | {"plane_way": "sweep"}))]
    often: dict[str, Any] = {"kills": request.param, "seed": 8}
    killed(
        folder,
        False,
        first=often | {"argv": first},
        redo=often | {"before": first, "argv": [*first, "--redo", "lens"], "again": first},
        way=often | {"before": first, "argv": sweep},
        given=often | {"before": first, "by_hand": True, "argv": []},
    )
    return folder


@pytest.mark.parametrize("name", ["first", "redo", "way", "given"])
def test_nothing_is_lost(name: str, folder: Path) -> None:
    """A redo is not asked for again: what was gone is taken anew, what was not gone is as it was."""
    found = json.loads((folder / "plan.found.json").read_text())[name]
    assert found["promises"] > 0 or name != "first"
    assert found["broken"] == []
    assert set(found["differing"]) <= ({"wizard.json"} if name == "redo" else set())


def test_nothing_of_another_way_is_left(folder: Path) -> None:
    """The calibration takes every way to plane C that it finds."""
    assert "jig" not in read_yaml(folder / "way" / "session.yaml")
    assert not (folder / "way" / "plane").exists()


def test_a_session_that_was_made_by_hand_stays(folder: Path) -> None:
    """Its pictures are there, and what the wizard writes anew is kept as it was."""
    assert len(list((folder / "given").glob("[!a]*/*.png"))) == 7
    kept = folder / "given" / "aside" / "given"
    assert (kept / "noload.csv").read_text().startswith("remark,")
    assert (kept / "session.yaml").exists()


@pytest.mark.slow
def test_with_eyes(tmp_path: Path) -> None:
    """Rendered pictures, real judgement, real verdict: rig.json is the same to the last bit."""
    file = answers_file(tmp_path / "a.yaml", answers(rendered()))
    plan = {"argv": ["--answers", str(file)], "kills": 40, "seed": 12}
    found = killed(tmp_path, True, rig=plan)["rig"]
    assert found["promises"] > 0
    assert found["broken"] == found["differing"] == []
