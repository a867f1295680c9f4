"""The front door: quick, one line for every error, exit codes, flags alike over all verbs, odd locales."""

from __future__ import annotations

import argparse
import errno
import json
import os
import shlex
import signal
import subprocess
import sys
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import vbaa_calib
from vbaa_calib.cli import schema as schema_cli
from vbaa_calib.cli.main import VERBS, _verb_parser
from vbaa_calib.core.errors import InputError, SolveError

from .conftest import Call, refused

HEAVY = {"torch", "pyvista", "cv2", "kornia", "scipy", "vtk", "vtkmodules", "pydantic", "rich"}


def test_help_needs_no_heavy_library() -> None:
    lines = ["import sys", "from vbaa_calib.cli.main import main, VERBS", f"heavy = {HEAVY}"]
    lines += ["assert main(['--help']) == 0", "assert not heavy & set(sys.modules), 'vbaa --help'"]
    lines += ["for verb in VERBS:"]
    lines += ["    assert main([verb, '--help']) == 0, verb", "    assert not heavy & set(sys.modules), verb"]
    done = subprocess.run([sys.executable, "-c", "\n".join(lines)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_json_is_one_object_and_prose_goes_elsewhere(vbaa: Call, made: Path) -> None:
    call = ("look", made / "session" / "noload" / "noload_001.png", "--rig", made / "rig.json")
    quiet, loud = vbaa(*call), vbaa(*call, "--json")
    assert (quiet.code, quiet.out) == (0, "")
    assert "verdict" in quiet.err
    assert loud.out.count("\n") == 1
    assert loud.result["verdict"] == "ok"
    assert loud.err == quiet.err


def test_a_rig_tells_where_it_comes_from_and_how_good_it_is(made: Path) -> None:
    written = json.loads((made / "rig.json").read_text())
    truth = json.loads((made / "session" / "truth.json").read_text())
    assert written["antenna"]["stiffness_Nm2"] == pytest.approx(truth["stiffness_Nm2"], rel=0.02)
    assert written["command"] == ["vbaa", "calibrate", str(made / "session"), "-o", str(made / "rig.json")]
    named = {name.partition("/")[0] for name in written["inputs_sha256"]}
    assert named == {"session.yaml", "intrinsics", "plane", "noload", "loads"}


@pytest.fixture
def raising(monkeypatch: pytest.MonkeyPatch) -> Callable[[BaseException], None]:
    """Makes `vbaa schema rig` fail."""

    def make(error: BaseException) -> None:
        def run(args: argparse.Namespace) -> dict[str, Any]:
            raise error

        monkeypatch.setattr(schema_cli, "_run", run)

    return make


@pytest.mark.parametrize(
    ("error", "code", "words"),
    [
        (InputError("is odd", where="file.csv", remedy="even it"), 2, "vbaa: file.csv: is odd; even it"),
        (SolveError("the fit\ndid not converge"), 1, "vbaa: the fit did not converge"),
        (KeyboardInterrupt(), 130, "vbaa: interrupted"),
        (RuntimeError("two\nlines"), 1, "vbaa: something went wrong that should not (RuntimeError: two lines); run"),
        (OSError(errno.EIO, "Input/output error", "rig.json"), 1, "vbaa: rig.json: Input/output error"),
        (OSError("odd"), 1, "vbaa: something went wrong that should not (OSError: odd)"),
    ],
)
def test_every_error_is_one_line(
    vbaa: Call, raising: Callable[[BaseException], None], error: BaseException, code: int, words: str
) -> None:
    raising(error)
    said = vbaa("schema", "rig")
    assert (said.code, said.out) == (code, "")
    assert said.err.startswith(words)
    assert said.err.count("\n") == 1


HALF_WRITTEN = """
import ctypes, os, signal, sys
from pathlib import Path
from vbaa_calib.cli.main import main
from vbaa_calib.core.files import replacing
from vbaa_calib.cli import schema as schema_cli

def stopped(args):
    with replacing(Path("out.csv"), True) as temporary:
        temporary.write_text("half")
        if sys.argv[2] == "lost":  # as C does with what is raised in a function that it calls
            sys.unraisablehook = lambda _: None
            ctypes.CFUNCTYPE(None)(lambda: os.kill(os.getpid(), getattr(signal, sys.argv[1])))()
            raise RuntimeError
        os.kill(os.getpid(), getattr(signal, sys.argv[1]))
        temporary.write_text("whole")

schema_cli._run = stopped
sys.exit(main(["schema", "rig"]))
"""


@pytest.mark.parametrize(("name", "where"), [("SIGTERM", ""), ("SIGHUP", ""), ("SIGTERM", "lost"), ("SIGINT", "lost")])
def test_a_signal_that_ends_it_leaves_nothing_half_written(tmp_path: Path, name: str, where: str) -> None:
    command = [sys.executable, "-c", HALF_WRITTEN, name, where]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path)
    assert done.returncode == 128 + getattr(signal, name)
    assert done.stderr == ("vbaa: interrupted\n" if name == "SIGINT" else "vbaa: ended by a signal\n")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("redirected", "code", "said"),
    [(">&-", 0, ""), ("| true", 1, ""), (">/dev/full", 1, "vbaa: No space left on device\n")],
)
def test_stdout_that_is_closed_or_full(redirected: str, code: int, said: str) -> None:
    """No traceback, nor anything of the interpreter's at its exit."""
    call = f"sleep 0.1; {shlex.quote(sys.executable)} -m vbaa_calib schema rig; echo $? >&2"
    shell = ["bash", "-c", f"({call}) {redirected}"]
    done = subprocess.run(shell, stderr=subprocess.PIPE, text=True, check=False, cwd=Path(__file__).parents[2])
    assert done.stderr == f"{said}{code}\n"


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


def test_what_begins_with_a_minus_may_be_a_value(vbaa: Call) -> None:
    """A number of any notation and an axis, after a space as after =; a slip in an option is one as before."""
    for words in (["--force-z", "-4e-2"], ["--force-z=-4e-2"], ["--force-z", "-.04"]):
        refused(vbaa("budget", "none.json", *words), "add --distance, --force-y")
    for words in (["--moment-axis", "-y"], ["--moment-axis=-y"]):
        refused(vbaa("live", "none.json", "none.mcap", *words), "none.json: no such file")
    refused(vbaa("live", "none.json", "none.mcap", "--moment-axis", "--lines"), "expected one argument")


def test_module_and_version(tmp_path: Path) -> None:
    environment = {**os.environ, "PYTHONPATH": str(Path(vbaa_calib.__file__).parents[1])}
    command = [sys.executable, "-m", "vbaa_calib", "--version"]
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=environment, cwd=tmp_path)
    name, version, digest = done.stdout.split()
    assert (name, version) == ("vbaa-calib", vbaa_calib.__version__)
    assert len(digest.strip("()")) == 12


@pytest.mark.skipif(sys.platform == "win32", reason="names are Unicode there")
def test_json_is_utf8_whatever_the_locale(rig: Path, tmp_path: Path) -> None:
    output = tmp_path / "Prüfstand.json"
    call = [sys.executable, "-m", "vbaa_calib", "export", str(rig), "--to", "json", "-o", str(output), "--json"]
    environment = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0", "PYTHONPATH": str(Path.cwd())}
    done = subprocess.run(call, env=environment, capture_output=True, check=True)
    assert json.loads(done.stdout.decode("utf-8"))["output"] == str(output)
