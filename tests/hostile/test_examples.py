"""The examples of each verb's --help run as they stand, in a folder that holds what they name."""

from __future__ import annotations

from pathlib import Path

import pytest

from vbaa_calib.cli.completion import EXAMPLES
from vbaa_calib.cli.main import VERBS, _verb_parser, main

READ_ALONE = {"wizard", "demo", "bench", "batch", "next"}
"""Walked, run and measured whole in tests of their own, on more than lies here; here their options are checked."""
CODES = {"vbaa doctor": (0, 1), "vbaa doctor --json": (0, 1)}
LONG = {"calibrate", "check", "doctor", "handeye", "intrinsics", "report", "simulate", "view"}
"""Verbs that take seconds: their examples run with the slow tests, and here their options are checked."""
ROWS = [
    pytest.param(line, marks=[pytest.mark.slow] * (verb in LONG), id=line)
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
