"""Hostile input: exit 2, one line, nothing written, nothing touched, in bounded time and memory."""

from __future__ import annotations

import os
import subprocess
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from vbaa_calib.cli.completion import EXAMPLES
from vbaa_calib.cli.main import VERBS, _verb_parser, main
from vbaa_calib.sources.files import FolderSettings, FolderSource

from . import call_rows, every_file, mistake_rows, picture_rows
from . import damage as d
from .case import Case, expect_refused, run, tree

CASES: list[Case] = [case for table in (every_file, mistake_rows, picture_rows, call_rows) for case in table.CASES]
HEAVY = ("calibrate", "check", "intrinsics", "view", "simulate", "estimate")
"""Verbs that work for a while before they come to what is wrong: of these, all but mistakes run with the slow tests."""
MISTAKES = {case.id for case in mistake_rows.CASES}
SLOW = {case.id for number, case in enumerate(CASES) if case.verb in HEAVY and case.id not in MISTAKES and number % 3}


@pytest.mark.parametrize(
    "case", [pytest.param(case, id=case.id, marks=[pytest.mark.slow] * (case.id in SLOW)) for case in CASES]
)
def test_it_is_refused(case: Case, folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    case.damage(folder / case.path)
    before = tree(folder)
    capfd.readouterr()
    code = run(case.line)
    said = capfd.readouterr()
    expect_refused(code, said.out, said.err, case.words)
    assert tree(folder) == before


def test_every_verb_has_its_rows() -> None:
    """So that a new verb comes with rows of its own."""
    verbs = Counter(case.verb for case in CASES if case.id not in SLOW)
    assert {verb for verb in VERBS if not verbs[verb]} == set()
    assert max(Counter(case.id for case in CASES).values()) == 1


def test_bombs_pipes_and_dead_links_do_not_hold_up_the_one_picture(tmp_path: Path) -> None:
    """What cannot be read is told once; what is no file is passed over; the source comes to its end."""
    assert cv2.imwrite(str(tmp_path / "good.png"), np.zeros((36, 48), np.uint8))
    (tmp_path / "bomb.png").write_bytes(d.png(20_000, 20_000, bytes(1000)))
    d.giant(10**13)(tmp_path / "giant.png")
    d.pipe(tmp_path / "pipe.png")
    d.folder(tmp_path / "folder.png")
    d.link("nowhere.png")(tmp_path / "dead.png")
    d.loop(tmp_path / "loop.png")
    d.link("/dev/zero")(tmp_path / "zero.png")
    for path in ("good.png", "bomb.png", "giant.png"):
        os.utime(tmp_path / path, (1e9, 1e9))
    source = FolderSource(tmp_path, pace=FolderSettings(scan_s=0.01, steady_s=0.0, patience_s=0.05))
    until, offered = time.monotonic() + 20.0, []
    while not source.ended and time.monotonic() < until:
        found = source.next(0.1)
        offered += [] if found is None else [found.name]
    assert source.ended
    assert offered == ["good.png"]
    assert [note.partition(":")[0] for note in source.notes] == ["bomb.png", "giant.png"]
    assert "20000x20000 px" in source.notes[0]


LINES = (
    "convert camera.json --to ros -o disk/out.yaml",
    "board --squares 5x4 -o disk/out.pdf",
    "estimate session --rig rig.json --no-report -o disk/out.csv",
    "estimate session --rig rig.json --no-report -o kept.csv --overlay disk/out",
    "live rig.json session/recording/recording.csv -o disk/out.csv",
    "live rig.json session/recording/recording.csv --bag disk/out.mcap",
    "batch lined --rig rig.json --jobs 1 -o disk/out",
    "look free.png --rig rig.json -o disk/out.png",
    "reconstruct contacts.csv --rig rig.json -o disk/out.glb",
    "report contacts.csv -o disk/out.html",
    "wizard disk/out --answers answers.yaml --batch",
)
"""One for every way of writing; the other verbs' go the same ways."""
LONG = ("calibrate session -o disk/out.json", "simulate scene.yaml -o disk/out", "demo --out disk/out")
"""They work for seconds before they write."""


def mount(*options: str) -> None:
    subprocess.run(["mount", "-t", "tmpfs", *options], check=True, capture_output=True)


@pytest.fixture
def disk(folder: Path) -> Iterator[Path]:
    """A disk of 64 kB in the case's folder. Skips where none may be mounted."""
    place = folder / "disk"
    place.mkdir()
    try:
        mount("-o", "size=64k", "tmpfs", str(place))
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("only root may mount a small disk, and not everywhere")
    try:
        yield place
    finally:
        subprocess.run(["umount", "-l", str(place)], check=True, capture_output=True)


def fill(disk: Path, left: int) -> None:
    """With one file, but for so many bytes."""
    with (disk / "full").open("wb", buffering=0) as stream:
        try:
            while True:
                stream.write(bytes(4096))
        except OSError:
            stream.truncate(max(0, stream.tell() - left))


@pytest.mark.parametrize("line", [*LINES, *(pytest.param(line, marks=pytest.mark.slow) for line in LONG)])
def test_a_full_disk(line: str, disk: Path, capfd: pytest.CaptureFixture[str]) -> None:
    fill(disk, 0)
    before = tree(disk)
    capfd.readouterr()
    code = run(line)
    said = capfd.readouterr()
    last = said.err.strip().splitlines()[-1]
    assert (code, said.out) == (2, ""), said.err
    assert last.startswith("vbaa: ")
    assert "No space left on device" in last
    assert "; " in last
    kept = {name: what for name, what in tree(disk).items() if not name.startswith("out")}
    assert kept == before
    # these go on in what they have begun
    assert line.startswith(("demo", "wizard", "live", "batch")) or set(tree(disk)) == set(before)


@pytest.mark.parametrize("line", [*LINES, *LONG])
def test_a_disk_that_may_not_be_written(line: str, disk: Path, capfd: pytest.CaptureFixture[str]) -> None:
    mount("-o", "remount,ro", "tmpfs", str(disk))
    capfd.readouterr()
    code = run(line)
    said = capfd.readouterr()
    expect_refused(code, "", said.err, ("disk/out",))
    assert tree(disk) == {}


READ_ALONE = {"wizard", "demo", "bench", "batch", "next"}
"""Walked, run and measured whole in tests of their own, on more than lies here; here their options are checked."""
CODES = {"vbaa doctor": (0, 1), "vbaa doctor --json": (0, 1)}
LONG_EXAMPLES = {"calibrate", "check", "doctor", "handeye", "intrinsics", "report", "simulate", "view"}
"""Verbs that take seconds: their examples run with the slow tests, and here their options are checked."""
ROWS = [
    pytest.param(line, marks=[pytest.mark.slow] * (verb in LONG_EXAMPLES), id=line)
    for verb, lines in EXAMPLES.items()
    for line in lines
    if verb not in READ_ALONE
]


def test_every_verb_has_two() -> None:
    assert {verb: len(EXAMPLES.get(verb, ())) for verb in VERBS} == dict.fromkeys(VERBS, 2)
    for verb, lines in EXAMPLES.items():
        assert all(line.startswith(f"vbaa {verb}") for line in lines)
        for line in lines:
            assert line in _verb_parser(verb).format_help()
            _verb_parser(verb).parse_args(line.split()[2:])


@pytest.mark.parametrize("line", ROWS)
def test_it_runs(folder: Path, line: str, capsys: pytest.CaptureFixture[str]) -> None:
    _, verb, *rest = line.split()
    assert main([verb, *rest]) in CODES.get(line, (0,)), capsys.readouterr().err
