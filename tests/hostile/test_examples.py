"""The examples of each verb's --help run as they stand, in a folder that holds what they name."""

from __future__ import annotations

from pathlib import Path

import pytest

from vbaa_calib.cli.completion import EXAMPLES
from vbaa_calib.cli.main import VERBS, _verb_parser, main

READ_ALONE = {"wizard", "demo", "bench", "batch", "next"}
"""Walked, run and measured whole in tests of their own, on more than lies here; here their options are checked."""
CODES = {"vbaa doctor": (0, 1), "vbaa doctor --json": (0, 1)}
LONG = {
    "vbaa selftest --board board.yaml --repeats 2 --json",
    "vbaa doctor",
    "vbaa doctor --json",
    "vbaa calibrate session --lens-model opencv4 -o rig4.json",
    "vbaa simulate scene.yaml -o synthetic/session",
    "vbaa check rig.json session",
    "vbaa report contacts.csv -o report.html",
}
"""They take seconds; another example of the verb, or its own tests, run with the quick ones."""
ROWS = [
    pytest.param(line, marks=[pytest.mark.slow] * (line in LONG), id=line)
    for lines in EXAMPLES.values()
    for line in lines
]


def test_every_verb_has_two() -> None:
    assert {verb: len(EXAMPLES.get(verb, ())) for verb in VERBS} == dict.fromkeys(VERBS, 2)
    for verb, lines in EXAMPLES.items():
        assert all(line.startswith(f"vbaa {verb}") for line in lines)
        assert all(line in _verb_parser(verb).format_help() for line in lines)


@pytest.mark.parametrize("line", ROWS)
def test_it_runs(folder: Path, line: str, capsys: pytest.CaptureFixture[str]) -> None:
    _, verb, *rest = line.split()
    if verb in READ_ALONE:
        _verb_parser(verb).parse_args(rest)
        return
    assert main([verb, *rest]) in CODES.get(line, (0,)), capsys.readouterr().err
