"""SIGKILL from outside at random moments of the whole way, the verdict included."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from .small_session import answers, answers_file, rendered, tiny_source

ROOT = Path(__file__).parents[2]


def killed(tmp_path: Path, source: Path, **plan: Any) -> dict[str, Any]:
    """What the driver found; its numbers are printed."""
    argv = ["--answers", str(answers_file(tmp_path / "a.yaml", answers(source)))]
    path = tmp_path / "plan.json"
    path.write_text(json.dumps({"root": str(tmp_path / "session"), "argv": argv} | plan))
    command = [sys.executable, "-m", "tests.wizard.kill_driver", str(path)]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True, env=os.environ | {"OMP_NUM_THREADS": "1"})
    found: dict[str, Any] = json.loads(path.with_suffix(".found.json").read_text())
    print(found)
    return found


@pytest.mark.parametrize("kills", [10, pytest.param(160, marks=pytest.mark.slow)])
def test_all_but_seeing(kills: int, tmp_path: Path) -> None:
    """Nearly all the time goes into what is kept: most kills meet a write."""
    found = killed(tmp_path, tiny_source(tmp_path / "source"), seeing=False, kills=kills, seed=8)
    assert found["kills"] == kills
    assert found["promises"] > 0
    assert not found["broken"]
    assert not found["differing"]


@pytest.mark.slow
def test_everything(tmp_path: Path) -> None:
    """Rendered pictures, real judgement, real verdict: rig.json is the same to the last bit."""
    found = killed(tmp_path, rendered(), seeing=True, kills=40, seed=9)
    assert found["kills"] == 40
    assert found["flows"] >= 5
    assert found["promises"] > 0
    assert not found["broken"]
    assert not found["differing"]
