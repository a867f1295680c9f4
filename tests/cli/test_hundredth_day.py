"""What somebody who calls `vbaa` every day runs into: odd locales, no terminal, the same session twice."""

from __future__ import annotations

import itertools
import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from vbaa_calib.core import console


@pytest.mark.skipif(sys.platform == "win32", reason="names are Unicode there")
def test_json_is_utf8_whatever_the_locale(rig: Path, tmp_path: Path) -> None:
    output = tmp_path / "Prüfstand.json"
    call = [sys.executable, "-m", "vbaa_calib", "export", str(rig), "--to", "json", "-o", str(output), "--json"]
    environment = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0", "PYTHONPATH": str(Path.cwd())}
    done = subprocess.run(call, env=environment, capture_output=True, check=True)
    assert json.loads(done.stdout.decode("utf-8"))["output"] == str(output)


def test_without_a_terminal_long_work_says_how_far_it_is(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    clock: Iterator[float] = itertools.count(0.0, 4.0)
    monkeypatch.setattr(console.time, "monotonic", lambda: next(clock))
    assert list(console.progress(range(6), "pictures", 6)) == list(range(6))
    assert capsys.readouterr().err.count("pictures: ") == 2
