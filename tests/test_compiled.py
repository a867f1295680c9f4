"""Compiled functions: where nothing can be kept, they work all the same."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections import namedtuple
from pathlib import Path
from typing import Any, NoReturn

import numba
import pytest

from vbaa_calib.core import compiled

KERNELS = """
from math import sin
from vbaa_calib.core.compiled import compiled, kernel
BY = {by},

@compiled
def inner(values):  # too long to be put into what calls it
    total = 0.0
    {steps}
    return total

@kernel
def one(values):
    return inner(values) + inner(values + 1.0)

@kernel
def two(values):
    return inner(values) - inner(values + 1.0)
"""
STEPS = [f"total += BY[0] * sin({step} * values[0])" for step in range(60)]
ASKED = "import sys, numpy, kernels; print(*(getattr(kernels, name)(numpy.ones(2)) for name in sys.argv[1:]))"


def _twice(value: float) -> float:
    return 2.0 * value


def _value(kept: Any) -> float:
    return kept.value


def _half(value: float) -> float:
    return 0.5 * value


def test_what_another_version_kept_is_compiled_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where a type of its arguments is no more."""
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    Gone = namedtuple("Gone", "value")
    monkeypatch.setattr(sys.modules[__name__], "Gone", Gone, raising=False)
    assert compiled.kernel(_value)(Gone(3.0)) == 3.0
    assert len(list(tmp_path.rglob("*.nbi"))) == 1
    monkeypatch.delattr(sys.modules[__name__], "Gone")
    Other = namedtuple("Other", "value")
    monkeypatch.setattr(sys.modules[__name__], "Other", Other, raising=False)
    assert compiled.kernel(_value)(Other(4.0)) == 4.0


def test_where_nothing_can_be_kept_it_is_said_once(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def read_only(**_: object) -> NoReturn:
        raise OSError(30, "Read-only file system")

    monkeypatch.setattr(tempfile, "TemporaryFile", read_only)
    compiled._say_once.cache_clear()
    twice, half = compiled.kernel(_twice), compiled.kernel(_half)
    compiled._say_once.cache_clear()
    assert half(twice(3.0)) == 3.0
    assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.slow
def test_a_kernel_runs_its_own_copy_of_what_it_calls(tmp_path: Path) -> None:
    """What two kernels have kept of a function of one name differs; loaded side by side each runs its own."""
    module = tmp_path / "kernels.py"

    def asked(by: float, *names: str) -> list[float]:
        module.write_text(KERNELS.format(by=by, steps="; ".join(STEPS)))
        os.utime(module, (1e9, 1e9))
        path = os.pathsep.join([str(tmp_path), str(Path(__file__).parents[1])])
        kept = {"PYTHONPATH": path, "NUMBA_CACHE_DIR": str(tmp_path / "kept"), "PYTHONHASHSEED": "0"}
        done = subprocess.run(
            [sys.executable, "-c", ASKED, *names], env=os.environ | kept, capture_output=True, text=True, check=True
        )
        return list(map(float, done.stdout.split()))

    (one,), (two,) = asked(1.0, "one"), asked(2.0, "two")
    assert asked(3.0, "one", "two") == [one, two]
    assert asked(4.0, "two", "one") == [two, one]
