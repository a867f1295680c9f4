"""Verbs that write, killed without warning at any of their moves on the disk: the old stays, or the new is whole."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.cli.killed_inputs import VERBS, prepare

KILLS = int(os.environ.get("VBAA_KILLS", "2"))
"""Of each verb; 0 kills it at every single move."""
CHILD = """
import atexit, os, signal, sys

root, last, *argv = sys.argv[1:]
moves, count = {"open", "os.rename", "os.remove", "os.mkdir", "os.rmdir", "os.chmod", "shutil.rmtree"}, 0


def watch(event, args):
    global count
    if event in moves and args and isinstance(args[0], (str, bytes, os.PathLike)):
        if os.path.abspath(os.fsdecode(args[0])).startswith(root):
            count += 1
            if count == int(last):
                os.kill(os.getpid(), signal.SIGKILL)


sys.addaudithook(watch)
from vbaa_calib.cli.main import main

code = main(argv)
print(count, file=sys.stderr)
sys.exit(code)
"""
"""Runs a verb, and kills it just before that move in the folder `root`; 0 for never. Its last line counts the moves."""

pytestmark = pytest.mark.skipif(os.name != "posix", reason="SIGKILL is POSIX's")


def run(folder: Path, last: int, argv: list[str]) -> subprocess.CompletedProcess[str]:
    call = [sys.executable, "-c", CHILD, str(folder), str(last), *argv, "--force"]
    return subprocess.run(call, capture_output=True, text=True, check=False, cwd=Path(__file__).parents[2])


def contents(path: Path) -> dict[str, bytes]:
    """Of a file, or of all in a folder."""
    if path.is_file():
        return {"": path.read_bytes()}
    return {str(each.relative_to(path)): each.read_bytes() for each in path.rglob("*") if each.is_file()}


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("inputs")
    prepare(folder)
    return folder


@pytest.mark.parametrize("verb", list(VERBS))
def test_a_killed_verb_leaves_the_old_or_the_new(verb: str, inputs: Path, tmp_path: Path) -> None:
    name, argv = VERBS[verb](inputs)
    output = tmp_path / name
    first = run(tmp_path, 0, [*argv, "-o", str(output)])
    assert first.returncode == 0, first.stderr
    old = contents(output)
    moves = int(run(tmp_path, 0, [*argv, "-o", str(output)]).stderr.splitlines()[-1])
    assert moves > 2
    rng = np.random.default_rng(sum(map(ord, verb)))
    for last in rng.integers(1, moves + 1, KILLS) if KILLS else range(1, moves + 1):
        killed = run(tmp_path, int(last), [*argv, "-o", str(output)])
        assert killed.returncode == -signal.SIGKILL
        if not output.exists():  # between a folder's two names; the next writer gives the old one its own back
            assert (next(tmp_path.glob(f".{name}-old-*")) / "replaced").is_dir()
            continue
        assert contents(output) == old
    assert run(tmp_path, 0, [*argv, "-o", str(output)]).returncode == 0
    assert contents(output) == old
