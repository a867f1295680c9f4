"""What the pages tell their reader to type is run, page by page and in order, in a folder that holds what they name."""

from __future__ import annotations

import argparse
import io
import os
import re
import shlex
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from vbaa_calib.cli.main import VERBS, _verb_parser, main

from .page_folder import page_folder, photos
from .test_docs import FENCE, PAGES, name_of

QUICK = {"build", "convert", "howto_recordings", "live", "object", "simulators"}
"""Pages that are run with the other tests; of the rest, which take a minute, the options are checked there."""
NOT_RUN = {
    "vbaa wizard": "asks; walked in tests/wizard",
    "vbaa demo": "run in tests/cli",
    "vbaa bench": "hours; run in tests/test_bench*.py",
    "vbaa intrinsics DATA": "of real photographs that do not lie here",
    "vbaa live rig.json camera:0": "there is no camera",
    "tls://": "there is no cluster",
}
"""A part of a command line, and why it is not run here."""
OTHER_PHOTOS = (
    ("--circles", "circles"),
    ("--marker", "charuco"),
    ("--squares 9x6", "chessboard"),
    ("target.yaml", "aprilgrid"),
    ("--board", "A3"),
)
"""Whose board the photographs in photos/ show, by a part of the command line."""


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


def run_of(path: Path) -> list[str]:
    """The page's command lines that are run, in order."""
    whole = [line for line, is_whole in commands(path) if is_whole and words_of(line) and "--help" not in line]
    return [line for line in whole if not any(part in line for part in NOT_RUN)]


@pytest.mark.parametrize("path", PAGES, ids=name_of)
def test_commands_are_accepted(path: Path) -> None:
    """Those that are not run with this: the verb exists, and its parser takes the flags and their values."""
    run = run_of(path) if path.stem in QUICK else []
    for line, whole in commands(path):
        if not (words := words_of(line)) or line in run:
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


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of what the pages suppose, in which they are run."""
    work = Path(shutil.copytree(page_folder(), tmp_path / "work", symlinks=True, copy_function=os.link))
    monkeypatch.chdir(work)
    return work


@pytest.mark.parametrize(
    "path",
    [
        pytest.param(path, marks=[pytest.mark.slow] * (path.stem not in QUICK), id=name_of(path))
        for path in PAGES
        if run_of(path)
    ],
)
def test_the_commands_of_a_page_run(
    path: Path, folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = run_of(path)
    if any(line.startswith("vbaa board -o board.pdf") for line in lines):
        (folder / "board.yaml").unlink()  # that command writes it
    for line in lines:
        verb, *rest = words_of(line) or []
        if verb == "simulate" and rest[0] == "demo":
            rest[0] = "scene.yaml"  # the same scene in few and small pictures, of which is all that lies here
        if "photos/" in rest:
            (folder / "photos").unlink(missing_ok=True)
            (folder / "photos").symlink_to(photos(next(kind for flag, kind in OTHER_PHOTOS if flag in line)))
        monkeypatch.setattr(sys, "stdin", io.TextIOWrapper((folder / "stdin.jsonl").open("rb")))
        # alternatives on a page write the same file
        code = main([verb, *rest, "--force"])
        assert code in ((0, 1) if verb == "doctor" else (0,)), f"{line}\n{capsys.readouterr().err}"
