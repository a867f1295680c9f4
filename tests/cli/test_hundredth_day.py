"""What somebody who calls `vbaa` every day runs into: odd locales, no terminal, the same session twice."""

from __future__ import annotations

import itertools
import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml

from estimator.object import next_touch
from estimator.object.next_touch import NextTouch
from vbaa_calib.core import console
from vbaa_calib.core.files import read_yaml

from .conftest import Call


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


def test_a_touch_that_improves_nothing_is_not_said_to(
    vbaa: Call, rig: Path, session: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    contacts = tmp_path / "contacts.csv"
    assert vbaa("estimate", session, "--rig", rig, "--no-report", "-o", contacts).code == 0
    place, here = ((0.0, 0.0), (0.0, 0.1), (0.0, 0.2), (0.0, 0.2)), (0.1, 0.0, 0.0)
    for after, better in ((1.9201e-5, False), (1.2e-5, True)):
        touch = NextTouch("surface", *place, 0.1, 0.05, here, (0.0, 1.0, 0.0), 1.92e-5, after, 9)
        monkeypatch.setattr(next_touch, "next_touch", lambda *_, touch=touch, **__: touch)
        words = vbaa("next", contacts, "--rig", rig).err
        assert ("should then be known" in words) == better, words


def test_the_calibrations_own_pictures_are_called_so(vbaa: Call, rig: Path, session: Path) -> None:
    verdict = vbaa("check", rig, session).err.splitlines()[-1]
    assert verdict.startswith("verdict")
    assert "calibrated from" in verdict


def test_a_lens_is_not_said_to_know_the_boards_scale(vbaa: Call, session: Path, tmp_path: Path) -> None:
    """A square typed a quarter too large fits as well."""
    board = read_yaml(session / "session.yaml")["board"]
    (tmp_path / "board.yaml").write_text(
        yaml.safe_dump(board | {"square_m": 1.25 * board["square_m"], "marker_m": 1.25 * board["marker_m"]})
    )
    call = ("intrinsics", session / "intrinsics", "--board", tmp_path / "board.yaml", "-o", tmp_path / "lens.json")
    assert "how large its squares are, no picture of it shows" in vbaa(*call).err
