"""One meaning and one unit for each option over all verbs; suggestions, completion and the version."""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from collections import defaultdict
from pathlib import Path

import pytest

import vbaa_calib
from vbaa_calib.cli.main import VERBS, _verb_parser

from .conftest import Call, refused

UNITS = {"M", "RAD", "N", "NM", "DEG", "S", "M4", "KG", "HZ"}
TAKES = {
    "--board": Path,
    "--rig": Path,
    "--session": Path,
    "--camera": Path,
    "--html": Path,
    "--out": Path,
    "--truth": Path,
    "--seed": int,
    "--poses": Path,
    "--jobs": int,
    "--distance": float,
}


def options() -> dict[str, list[tuple[str, argparse.Action]]]:
    """Option → verbs that have it; the wizard's answers are questions with their own units in their names."""
    found = defaultdict(list)
    for verb in VERBS:
        for action in _verb_parser(verb)._actions:
            if not action.dest.startswith("answer_"):
                for name in (name for name in action.option_strings if name.startswith("--")):
                    found[name].append((verb, action))
    return found


def test_one_unit_and_one_kind_over_all_verbs() -> None:
    for name, uses in options().items():
        units = {action.metavar for _, action in uses if action.metavar in UNITS}
        assert len(units) <= 1, f"{name}: {units}"
        assert len({action.nargs == 0 for _, action in uses}) == 1, name
        kinds = {action.type for _, action in uses if action.nargs != 0}
        assert len(kinds) <= 1, f"{name}: {kinds}"
        assert name not in TAKES or kinds == {TAKES[name]}


def test_no_length_force_or_angle_in_other_than_si() -> None:
    """But for what is read off a photograph with a protractor, and what has its unit in its name."""
    degrees = {name for name, uses in options().items() if any(action.metavar == "DEG" for _, action in uses)}
    assert degrees <= {"--tilt-std", "--gravity-angle", "--gravity-std"}
    small = {name for name, uses in options().items() if any(action.metavar in {"MM", "MN"} for _, action in uses)}
    assert all(name.endswith("-mm") for name in small)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (("estimat",), "do you mean estimate?"),
        (("estimate", "session", "--rig", "rig.json", "-o", "c.csv", "--no-momnet"), "do you mean --no-moment?"),
        (("estimate", "--centerlines", "pixels.csv"), "do you mean --centrelines?"),
    ],
)
def test_a_slip_is_named(vbaa: Call, call: tuple[str, ...], words: str) -> None:
    refused(vbaa(*call), words)


def test_what_begins_with_a_minus_may_be_a_value(vbaa: Call) -> None:
    """A number of any notation and an axis, after a space as after =; a slip in an option is one as before."""
    for words in (["--force-z", "-4e-2"], ["--force-z=-4e-2"], ["--force-z", "-.04"]):
        refused(vbaa("budget", "none.json", *words), "add --distance, --force-y")
    for words in (["--moment-axis", "-y"], ["--moment-axis=-y"]):
        refused(vbaa("live", "none.json", "none.mcap", *words), "none.json: no such file")
    refused(vbaa("live", "none.json", "none.mcap", "--moment-axis", "--lines"), "expected one argument")


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion_names_verbs_and_options(vbaa: Call, shell: str) -> None:
    said = vbaa("completion", shell)
    assert said.code == 0
    assert all(verb in said.out for verb in VERBS)
    assert "no-moment" in said.out


def test_bash_completes(vbaa: Call, tmp_path: Path) -> None:
    script = tmp_path / "vbaa.bash"
    script.write_text(vbaa("completion", "bash").out)
    ask = 'source "$1"; COMP_WORDS=({words}); COMP_CWORD={at}; _vbaa; echo "${{COMPREPLY[@]}}"'
    for words, at, wanted in (("vbaa esti", 1, "estimate"), ("vbaa estimate --no-m", 2, "--no-moment")):
        code = ask.format(words=words, at=at)
        done = subprocess.run(["bash", "-c", code, "bash", script], capture_output=True, text=True, check=True)
        assert done.stdout.strip() == wanted


def test_module_and_version(tmp_path: Path) -> None:
    environment = {**os.environ, "PYTHONPATH": str(Path(vbaa_calib.__file__).parents[1])}
    command = [sys.executable, "-m", "vbaa_calib", "--version"]
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=environment, cwd=tmp_path)
    name, version, digest = done.stdout.split()
    assert (name, version) == ("vbaa-calib", vbaa_calib.__version__)
    assert len(digest.strip("()")) == 12
