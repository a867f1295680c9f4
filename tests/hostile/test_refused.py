"""Every row of every table: exit 2, one line, nothing written, nothing touched, in bounded time and memory."""

from __future__ import annotations

import zlib
from collections import Counter
from pathlib import Path

import pytest

from vbaa_calib.cli.main import VERBS

from . import (
    call_rows,
    every_file,
    folder_rows,
    other_rows,
    picture_rows,
    rig_rows,
    scene_rows,
    settings_rows,
    table_rows,
)
from .case import Case, expect_refused, run, tree

TABLES = (every_file, folder_rows, settings_rows, rig_rows, table_rows, scene_rows, other_rows, picture_rows, call_rows)
CASES: list[Case] = [case for table in TABLES for case in table.CASES]
LEAST_ROWS, LEAST_OF_A_VERB, LEAST_OF_A_KIND = 1000, 4, 5
KINDS = {
    *("session.yaml", "board.yaml", "rig.json", "camera.json", "contacts.csv", "recording.csv", "centrelines.csv"),
    *(
        "noload.csv",
        "loads.csv",
        "sweep.csv",
        "stiffness.csv",
        "poses.csv",
        "corners.csv",
        "truth.json",
        "scene.yaml",
        "answers.yaml",
        "wizard.json",
    ),
    *(
        "ros",
        "opencv",
        "kalibr",
        "mrcal",
        "colmap",
        "numbers",
        "orbslam",
        "cahvor",
        "object.vtp",
        "object.ply",
        "object.glb",
    ),
    *("board_002.png", "jig_000.png", "noload_001.png", "loads_002.png", "frame_0003.png", "free.png", "jig.png"),
    *("session", "intrinsics", "plane", "recording", "output", "call"),
}
"""Of files that are read; outputs, and calls in which no file is wrong."""


HEAVY = ("calibrate", "check", "intrinsics", "report", "view", "simulate", "estimate")
"""Verbs that work for a while before they come to what is wrong."""
FIRST: dict[tuple[str, str], str] = {}
"""(path, damage) → the first command that meets it. Others read the file by the same reader."""
for _case in CASES:
    FIRST.setdefault((_case.path, _case.name), _case.line)


def often(case: Case) -> bool:
    """Whether the row runs with the quick tests: of heavy verbs, and of a damage met before, one in four does."""
    if case.name == "not on the pictures":
        return False  # every kind of board is looked for, which takes ten seconds; tests/detect/test_grids does it
    first = FIRST[case.path, case.name] == case.line and case.verb not in HEAVY
    return first or zlib.crc32(case.id.encode()) % 4 == 0


ROWS = [pytest.param(case, id=case.id, marks=() if often(case) else pytest.mark.slow) for case in CASES]


@pytest.mark.parametrize("case", ROWS)
def test_it_is_refused(case: Case, folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    case.damage(folder / case.path)
    before = tree(folder)
    capfd.readouterr()
    code = run(case.line)
    said = capfd.readouterr()
    expect_refused(code, said.out, said.err, case.words)
    assert tree(folder) == before


def test_every_verb_and_every_file_has_its_rows() -> None:
    """So that the suite does not shrink in silence, and a new verb comes with rows of its own."""
    assert len(CASES) >= LEAST_ROWS
    assert sum(map(often, CASES)) >= 0.5 * LEAST_ROWS
    assert {case.verb for case in CASES if often(case)} == {case.verb for case in CASES}
    verbs, kinds = Counter(case.verb for case in CASES), Counter(case.kind for case in CASES)
    assert {verb: verbs[verb] for verb in VERBS if verbs[verb] < LEAST_OF_A_VERB} == {}
    assert {kind: kinds[kind] for kind in KINDS if kinds[kind] < LEAST_OF_A_KIND} == {}
    assert max(Counter(case.id for case in CASES).values()) == 1
