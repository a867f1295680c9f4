"""`vbaa doctor` on the machine around the installation: folders, memory, terminal, drawing, cameras, torch."""

from __future__ import annotations

import io
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from vbaa_calib.cli import doctor as verb
from vbaa_calib.doctor import machine
from vbaa_calib.doctor.finding import FAILS, LOOK, OK, Finding
from vbaa_calib.doctor.machine import Tried


def names(found: Finding) -> list[str]:
    """What is wrong, by name."""
    return [problem.name for problem in found.problems]


def ends(code: int | None, out: str = "", err: str = "") -> Callable[[Sequence[str], float], Tried]:
    """A process that ends like this."""
    return lambda arguments, seconds: Tried(code, out, err)


def test_folders_that_cannot_be_written(tmp_path: Path) -> None:
    """A file in place of a folder stops root too; none at all; the cache is not needed."""
    (tmp_path / "file").write_text("")
    folders = {"current": tmp_path / "file", "temporary": None, "cache": tmp_path / "absent"}
    found = machine.writable(folders)
    assert names(found) == ["folder_not_writable"] * 3
    assert [problem.grave for problem in found.problems] == [True, True, False]
    assert "TMPDIR" in found.problems[1].remedy
    assert machine.writable({"current": tmp_path}).status == OK
    assert list(tmp_path.iterdir()) == [tmp_path / "file"]


def test_memory_and_threads(tmp_path: Path) -> None:
    """Too little memory, threads that are too many or no number; a system that does not tell."""
    (tmp_path / "meminfo").write_text("MemTotal: 9 kB\nMemAvailable:    1048576 kB\n")
    assert machine.available_memory(tmp_path / "meminfo") == 2**30
    assert names(machine.computing(lambda: 2**30, {})) == ["memory_low"]
    assert names(machine.computing(lambda: 2**40, {"OMP_NUM_THREADS": "two"})) == ["threads_wrong"]
    assert [machine.disk(free_bytes=free).status for free in (10**12, 10**9, 10**7)] == [OK, LOOK, FAILS]
    assert names(machine.computing(lambda: 2**40, {"OMP_NUM_THREADS": "99999"})) == ["threads_many"]
    assert machine.computing(lambda: None, {"OMP_NUM_THREADS": "1"}).status == OK


def test_a_terminal_without_signs(monkeypatch: pytest.MonkeyPatch) -> None:
    """It is told, and the doctor's own words get through."""
    printed = io.BytesIO()
    latin = io.TextIOWrapper(printed, encoding="latin-1")
    found = machine.terminal({"stderr": latin})
    assert (found.status, names(found)) == (LOOK, ["not_utf8"])
    monkeypatch.setattr(sys, "stderr", latin)
    verb._print(verb._as_lines(found))
    latin.flush()
    assert b"PYTHONUTF8=1" in printed.getvalue()
    assert machine.terminal({"stdout": SimpleNamespace(encoding=None)}).status == LOOK


@pytest.mark.parametrize(
    ("attempt", "words"),
    [
        (ends(1), "found no OpenGL that works"),
        (ends(1, err="Traceback\nImportError: no vtk\n"), "failed (ImportError: no vtk)"),
        (ends(-11), "was ended by signal 11"),
        (ends(None), "took longer than 90 s"),
    ],
)
def test_drawing_that_fails(attempt: Any, words: str) -> None:
    """It crashes, hangs or says no: never more than a look, for pages do without."""
    found = machine.drawing(attempt)
    assert (found.status, names(found)) == (LOOK, ["no_drawing"])
    assert words in found.problems[0].words
    assert machine.drawing(ends(0)).status == OK


def test_a_process_may_crash_or_hang() -> None:
    """Real ones: the doctor outlives them, and keeps what they had said."""
    crashed = machine.try_python(["-c", "import os; os.abort()"], 20)
    assert crashed.code is not None
    assert crashed.code != 0
    hung = machine.try_python(["-c", "import time; print('[0, null]', flush=True); time.sleep(60)"], 1.5)
    assert (hung.code, hung.out.strip()) == (None, "[0, null]")


def camera(devices: Sequence[str], readable: bool, attempt: Any) -> Finding:
    """The check for cameras with everything replaced."""
    return machine.cameras(devices, lambda path: readable, attempt, "linux")


def test_cameras() -> None:
    """None is no fault. Not readable, silent, stuck and crashing ones are told; one that works is enough."""
    none = camera([], True, ends(1))
    assert (none.status, none.words) == (OK, "no camera seen; folders, video files and streams work without")
    shut = camera(["/dev/video0"], False, ends(1))
    assert (shut.status, names(shut)) == (LOOK, ["camera_not_readable"])
    assert "usermod -aG video" in shut.problems[0].remedy
    works = camera(["/dev/video0", "/dev/video1"], True, ends(0, "[0, [640, 480]]\n[1, null]\n"))
    assert (works.status, works.words) == (OK, "camera 0 gives 640 x 480")
    assert names(camera(["/dev/video0"], True, ends(0, "[0, null]\n"))) == ["camera_silent"]
    stuck = camera(["/dev/video0", "/dev/video1"], True, ends(None, "[0, [640, 480]]\n"))
    assert names(stuck) == ["camera_stuck"]
    assert stuck.problems[0].words == "camera 1 does not answer"
    assert names(camera(["/dev/video0"], True, ends(-11))) == ["camera_stuck"]
    assert machine.cameras(None, attempt=ends(0, "[0, null]\n[1, null]\n"), system="darwin").status == OK


def test_torch() -> None:
    """Well, slow, broken, hanging."""
    assert machine.torch(ends(0, "1.5 2.13.0 2 False\n")).numbers["seconds"] == 1.5
    assert names(machine.torch(ends(0, "55.0 2.13.0 2 False\n"))) == ["torch_slow"]
    broken = machine.torch(ends(1, err="OSError: [WinError 126] c10.dll"))
    assert (broken.status, names(broken)) == (FAILS, ["torch_broken"])
    assert "c10.dll" in broken.problems[0].words
    assert names(machine.torch(ends(None))) == ["torch_broken"]
