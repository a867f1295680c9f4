"""Every row of every table: exit 2, one line, nothing written, nothing touched, in bounded time and memory."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import pytest

from vbaa_calib.cli.main import VERBS

from . import call_rows, every_file, mistake_rows, picture_rows
from .case import Case, expect_refused, run, tree

CASES: list[Case] = [case for table in (every_file, mistake_rows, picture_rows, call_rows) for case in table.CASES]
HEAVY = ("calibrate", "check", "intrinsics", "report", "view", "simulate", "estimate")
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
