"""The front door: quick, one line for every error, and the exit codes that scripts rely on."""

from __future__ import annotations

import argparse
import errno
import json
import os
import shlex
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from vbaa_calib.cli import schema as schema_cli
from vbaa_calib.core.errors import InputError, SolveError

from .conftest import Call

HEAVY = {"torch", "pyvista", "cv2", "kornia", "scipy", "vtk", "vtkmodules", "pydantic", "rich"}


def in_fresh_python(code: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)


def test_help_needs_no_heavy_library() -> None:
    lines = ["import sys", "from vbaa_calib.cli.main import main, VERBS", f"heavy = {HEAVY}"]
    lines += ["assert main(['--help']) == 0", "assert not heavy & set(sys.modules), 'vbaa --help'"]
    lines += ["for verb in VERBS:"]
    lines += ["    assert main([verb, '--help']) == 0, verb", "    assert not heavy & set(sys.modules), verb"]
    done = in_fresh_python("\n".join(lines))
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("report", [True, False])
def test_an_estimate_loads_what_it_needs(made: Path, tmp_path: Path, report: bool) -> None:
    """Neither torch nor VTK, matplotlib or what minimises in SciPy; a report needs the last."""
    argv = ["estimate", f"{made / 'session'}", "--rig", f"{made / 'rig.json'}", "-o", f"{tmp_path / 'contacts.csv'}"]
    heavy = {"torch", "kornia", "pyvista", "vtkmodules", "matplotlib", "dask", "pandas"}
    heavy |= set() if report else {"scipy.optimize", "jinja2"}
    lines = ["import sys", "from vbaa_calib.cli.main import main"]
    lines += [f"assert main({argv + ['--no-report'] * (not report)}) == 0", f"print({heavy} & set(sys.modules))"]
    done = in_fresh_python("\n".join(lines))
    assert (done.returncode, done.stdout) == (0, "set()\n"), done.stderr


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


def test_a_caller_keeps_its_own_signals(vbaa: Call, raising: Callable[[BaseException], None]) -> None:
    """Called in a program of the user's own, it leaves nothing behind, however it ends."""
    for error in (InputError("is odd"), KeyboardInterrupt()):
        raising(error)
        for handler in (signal.SIG_DFL, signal.SIG_IGN):
            before = signal.signal(signal.SIGTERM, handler)
            try:
                vbaa("schema", "rig")
                assert signal.getsignal(signal.SIGTERM) is handler
            finally:
                signal.signal(signal.SIGTERM, before)


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


def test_a_folder_that_is_gone_is_said(tmp_path: Path) -> None:
    """Libraries that look for it end the process, or say that no such file is there."""
    (tmp_path / "gone").mkdir()
    call = f"cd {tmp_path}/gone && rmdir ../gone && {shlex.quote(sys.executable)} -m vbaa_calib check a"
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).parents[2])}
    done = subprocess.run(["bash", "-c", call], capture_output=True, text=True, check=False, env=environment)
    assert done.returncode == 2, done.stderr
    assert done.stderr == "vbaa: the folder that this runs in is gone; change to one that is there\n"
