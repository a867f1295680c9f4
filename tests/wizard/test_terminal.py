"""The wizard in a terminal, typed to as a newcomer would."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from .pseudo_terminal import PseudoTerminal
from .small_session import rendered

Start = Callable[..., PseudoTerminal]
MAIN = "import sys; from vbaa_calib.cli.main import main; sys.exit(main(['wizard', *sys.argv[1:]]))"


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Start]:
    """Starts `vbaa wizard rig` with more arguments, in a terminal; ends it with the test."""
    begun: list[PseudoTerminal] = []

    def begin(*arguments: object, **more: str) -> PseudoTerminal:
        begun.append(PseudoTerminal(["wizard", "rig", *map(str, arguments)], tmp_path, **more))
        return begun[-1]

    yield begin
    for one in begun:
        one.close()


def journal(tmp_path: Path) -> dict:
    """What is on the disk."""
    return json.loads((tmp_path / "rig" / "wizard.json").read_text())


def put(number: int, folder: Path) -> None:
    """A picture of the board, as a camera's program writes it."""
    name = sorted((rendered() / "intrinsics").iterdir())[number].name
    shutil.copy(rendered() / "intrinsics" / name, folder / f"{number}.png")


@pytest.mark.slow
def test_the_first_minutes_of_a_newcomer(start: Start, tmp_path: Path) -> None:
    shutil.copy(rendered() / "session.yaml", tmp_path / "board.yaml")
    camera = tmp_path / "camera"
    camera.mkdir()
    wizard = start()
    greeting = wizard.until("half an hour")
    assert "You need: the camera" in greeting
    wizard.until("http://127.0.0.1:")
    wizard.until("1 of 7 · Board")
    wizard.until("Which board do you use?")
    wizard.type("help")
    wizard.until("quit stop here; run the wizard again to go on")
    wizard.type("board.jaml")
    wizard.until("no such file")
    wizard.until("Enter for new:")
    wizard.type("board.yaml")
    wizard.until("How long is the pattern along x")
    for typed, reason in (
        ("165,1", "the decimal sign is a point"),
        ("165 kg", "'kg' is no unit of it"),
        ("0", "0 mm cannot be"),
    ):
        wizard.type(typed)
        wizard.until(reason)
        wizard.until("mm:")
    wizard.type("165.1")
    wizard.until("along y")
    wizard.type("back")
    wizard.until("along x")
    wizard.until("Enter for 165.1:")
    wizard.type("16.5 cm")
    wizard.until("mm:")
    wizard.type("120 mm")
    wizard.until("board_reading_std_mm = 0.25")
    wizard.until("2 of 7 · Lens")
    wizard.until("Enter for camera:0:")
    wizard.type("enough")
    wizard.until("enough is for pictures")
    wizard.type("nowhere")
    for typed in ("240", "370"):
        wizard.until("mm:")
        wizard.type(typed)
    wizard.until("camera_inclination_deg = 0")
    wizard.until("no such folder or video")
    wizard.until("Enter for camera:0:")
    wizard.type("camera")
    wizard.until("3 more pictures, then there is a first lens")
    wizard.until("next board")
    assert not [line for line in wizard.screen.splitlines() if len(line) > 80 and "token=" not in line]
    put(0, camera)
    wizard.until("took 0.png as intrinsics/0001.png")
    assert "seen 1 picture" in " ".join(wizard.until("2 more pictures").split())
    wizard.type("camera_inclination_deg = 95")
    wizard.until("not changed: camera_inclination_deg is '95': 95 degrees cannot be")
    wizard.type("camera_inclination_deg = 30")
    wizard.until("camera_inclination_deg is 30 degrees")
    wizard.type("drop")
    wizard.until("intrinsics/0001.png is set aside")
    wizard.type("dorp")
    wizard.until("'dorp' is none of enough, take, drop")
    wizard.press(b"\x03")
    assert wizard.ended() == 130
    assert "`vbaa wizard rig` goes on here" in wizard.screen
    assert "Traceback" not in wizard.raw
    kept = journal(tmp_path)
    assert kept["answers"]["board_along_x_mm"] == 165
    assert kept["answers"]["antenna_length_mm"] == 240
    assert [one["why"] for one in kept["steps"]["lens"]["left"]] == ["taken back"]


def test_without_a_terminal_it_never_waits(tmp_path: Path) -> None:
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "TERM": "xterm"}
    command = ["/bin/sh", "-c", 'exec "$@" <&-', "sh", sys.executable, "-c", MAIN, "rig"]
    closed = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, env=environment)
    assert closed.returncode == 2
    assert "board_along_x_mm is not answered" in closed.stderr
    assert "\033" not in closed.stderr
