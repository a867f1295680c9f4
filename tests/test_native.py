"""The compiled core: builds for processors, and what it refuses."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from vbaa_calib.native import core, levels

ROOT = Path(__file__).parents[1]
NAMES = """
from vbaa_calib.native import core
print(core.__name__, *(f"{room}.{name}" for room in dir(core) for name in dir(getattr(core, room))))
"""


def _functions() -> Iterator[tuple[str, Callable[..., object]]]:
    rooms = [room for room in vars(core).values() if isinstance(room, ModuleType)]
    for room in rooms:
        for name, function in vars(room).items():
            if type(function).__name__ == "nb_func":
                yield f"{room.__name__.rpartition('.')[2]}.{name}", function


FUNCTIONS = dict(_functions())


def _in_child(code: str, **variables: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", code], env=os.environ | variables, cwd=ROOT, capture_output=True, text=True, check=False
    )


@pytest.mark.parametrize("level", levels)
def test_every_build_has_the_same_functions(level: str) -> None:
    name, *functions = _in_child(NAMES, VBAA_PROCESSOR=level).stdout.split()
    assert name == f"vbaa_calib.native.{level}.core"
    assert {each for each in functions if each in FUNCTIONS} == set(FUNCTIONS)


def test_an_unknown_build_is_refused_in_one_line() -> None:
    done = _in_child("import vbaa_calib.native", VBAA_PROCESSOR="v9")
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1
    assert "v9" in done.stderr


@pytest.mark.parametrize("name", FUNCTIONS)
def test_what_is_no_array_is_refused(name: str) -> None:
    """Also arrays of another kind, without entries or with holes: an error of Python's, never a crash."""
    holes = np.zeros((6, 6))[::2, ::2]
    for wrong in ("text", None, holes, np.zeros(3, np.complex64), np.empty((0, 0, 0, 0))):
        for count in range(1, 14):
            with pytest.raises((TypeError, ValueError, AttributeError)):
                FUNCTIONS[name](*[wrong] * count)


@pytest.mark.slow
def test_zig_builds_it_where_there_is_no_compiler(tmp_path: Path) -> None:
    """Minutes: zig builds its C++ library first."""
    pytest.importorskip("nanobind")
    tools, build = tmp_path / "tools", tmp_path / "build"
    subprocess.run([sys.executable, "-m", "pip", "-q", "install", "--target", str(tools), "ziglang"], check=True)
    variables = {}
    for name, variable in (("c++", "CXX"), ("cc", "CC")):
        script = tmp_path / f"zig-{name}"
        script.write_text(f'#!/bin/sh\nexec "{tools}/ziglang/zig" {name} -mcpu=baseline "$@"\n')
        script.chmod(0o755)
        variables[variable] = str(script)
    cmake = ["cmake", "-S", str(ROOT / "vbaa_calib/native"), "-B", str(build), "-G", "Ninja", "-DLEVELS=base"]
    environment = (
        os.environ | variables | {"PATH": os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])}
    )
    subprocess.run([*cmake, f"-DPython_EXECUTABLE={sys.executable}"], env=environment, check=True)
    subprocess.run(["cmake", "--build", str(build)], env=environment, check=True)
    found = subprocess.run(
        [sys.executable, "-c", "import core; print(*dir(core))"],
        cwd=build / "base",
        capture_output=True,
        text=True,
        check=True,
    )
    assert {name.partition(".")[0] for name in FUNCTIONS} <= set(found.stdout.split())
