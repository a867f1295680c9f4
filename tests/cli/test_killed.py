"""Every verb that writes, killed without warning: the old stays whole, or the new is there."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from .killer import CALLS

pytestmark = pytest.mark.skipif(os.name != "posix", reason="SIGKILL is POSIX's")
QUICK = ("convert", "estimate parquet", "live", "look")
"""Once each; the slow test takes them all."""


@pytest.mark.parametrize(
    ("names", "kills"), [(QUICK, len(QUICK)), pytest.param(tuple(CALLS), 2000, marks=pytest.mark.slow)]
)
def test_a_killed_verb_leaves_the_old_or_the_new(names: tuple[str, ...], kills: int) -> None:
    """In a process of its own, which forks: the tests' has threads."""
    call = [sys.executable, "-m", "tests.cli.killer", "--kills", str(kills), "--verbs", *names]
    done = subprocess.run(call, capture_output=True, text=True, check=False, cwd=Path(__file__).parents[2])
    assert done.returncode == 0, done.stdout + done.stderr
    assert "kills in all, 0 wrong" in done.stdout
