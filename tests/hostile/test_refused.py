"""Every row of every table: exit 2, one line, nothing written, nothing touched, in bounded time and memory."""

from __future__ import annotations

from pathlib import Path

import pytest

from . import every_file
from .case import Case, expect_refused, run, tree

CASES: list[Case] = [*every_file.CASES]


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.id)
def test_it_is_refused(case: Case, folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    case.damage(folder / case.path)
    before = tree(folder)
    capfd.readouterr()
    code = run(case.line)
    said = capfd.readouterr()
    expect_refused(code, said.out, said.err, case.words)
    assert tree(folder) == before
