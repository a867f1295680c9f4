"""`vbaa doctor`: each illness is recognised and has its remedy, and a healthy machine has none."""

from __future__ import annotations

import importlib.metadata as metadata
import sys
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from vbaa_calib import doctor
from vbaa_calib.cli import doctor as verb
from vbaa_calib.doctor import CHECKS, HealthFinding, _Ended


def names(found: HealthFinding) -> list[str]:
    """What is wrong, by name."""
    return [problem.name for problem in found.problems]


def test_this_machine_has_what_it_needs() -> None:
    """The installation that runs the tests: nothing that was looked at fails."""
    slow = ("torch", "drawing")
    found = list(verb._examine({name: check for name, check in verb.CHECKS.items() if name not in slow}))
    assert [each.name for each in found if each.status == "fails"] == []
    assert {each.name for each in found} == set(verb.CHECKS) - set(slow)


def ends(code: int | None, out: str = "", err: str = "") -> Callable[[Sequence[str], float], _Ended]:
    """A process that ends like this."""
    return lambda arguments, seconds: (code, out, err)


def installed(*asked: str, **known: str) -> HealthFinding:
    """The check of packages where these are known."""

    def version(name: str) -> str:
        if name not in known:
            raise metadata.PackageNotFoundError(name)
        return known[name]

    return CHECKS["packages"](list(asked), version)


def cv2(
    wheels: dict[str, str], version: str = "4.14.0", charuco: bool = True, error: Exception | None = None
) -> HealthFinding:
    """The check of OpenCV with as much of it as is asked."""

    def load() -> Any:
        if error is not None:
            raise error
        aruco = SimpleNamespace(CharucoDetector=object) if charuco else SimpleNamespace()
        return SimpleNamespace(__version__=version, aruco=aruco, getBuildInformation=lambda: "  GUI:      NONE\n")

    return CHECKS["opencv"](wheels, load)


def camera(devices: Sequence[str], readable: bool, attempt: Any) -> HealthFinding:
    """The check for cameras with everything replaced."""
    return CHECKS["cameras"](devices, lambda path: readable, attempt, "linux")


RIGHT = {"opencv-contrib-python-headless": "4.14.0.94"}
TWO = RIGHT | {"opencv-python": "4.10.0.84"}
WEBCAM, TWO_CAMERAS = ["/dev/video0"], ["/dev/video0", "/dev/video1"]
threads = partial(CHECKS["computing"], lambda: 2**40)


@pytest.mark.parametrize(
    ("check", "status", "problems", "words"),
    [
        (partial(CHECKS["python"], (3, 11, 0)), "ok", [], ""),
        (partial(CHECKS["python"], (3, 9, 2)), "fails", ["python_too_old"], "3.11"),
        (partial(installed, "numpy>=2.0,<3", "tqdm", numpy="2.4.6", tqdm="1"), "ok", [], ""),
        (partial(installed, "numpy>=2,<3", numpy="1.26"), "fails", ["package_version"], "numpy is 1.26, and <3,>=2"),
        (partial(installed, "scipy>=1.13,<2"), "fails", ["package_missing"], "scipy is not installed"),
        (partial(cv2, RIGHT), "ok", [], ""),
        (partial(cv2, TWO), "fails", ["several_opencv"], "opencv-contrib-python-headless>=4.14,<5"),
        (partial(cv2, RIGHT, "5.0.0"), "fails", ["opencv_major"], "opencv-contrib-python-headless>=4.14,<5"),
        (partial(cv2, {"opencv-python-headless": "4.14.0.94"}, charuco=False), "fails", ["opencv_without_charuco"], ""),
        (partial(cv2, RIGHT, "4.10.0"), "fails", ["opencv_other"], "opencv-contrib-python-headless>=4.14,<5"),
        (partial(cv2, RIGHT, error=ImportError("libGL.so.1")), "fails", ["opencv_broken"], "libGL.so.1"),
        (partial(CHECKS["computing"], lambda: 2**30, {}), "look", ["memory_low"], ""),
        (partial(CHECKS["computing"], lambda: None, {"OMP_NUM_THREADS": "1"}), "ok", [], ""),
        (partial(threads, {"OMP_NUM_THREADS": "two"}), "look", ["threads_wrong"], ""),
        (partial(threads, {"OMP_NUM_THREADS": "99999"}), "look", ["threads_many"], ""),
        (partial(CHECKS["disk"], free_bytes=10**12), "ok", [], ""),
        (partial(CHECKS["disk"], free_bytes=10**9), "look", ["disk_low"], ""),
        (partial(CHECKS["disk"], free_bytes=10**7), "fails", ["disk_low"], ""),
        (partial(CHECKS["terminal"], {"stdout": SimpleNamespace(encoding=None)}), "look", ["not_utf8"], "PYTHONUTF8=1"),
        (partial(CHECKS["drawing"], ends(0)), "ok", [], ""),
        (partial(CHECKS["drawing"], ends(1)), "look", ["no_drawing"], "found no OpenGL that works"),
        (partial(CHECKS["drawing"], ends(1, err="Traceback\nImportError: no vtk")), "look", ["no_drawing"], "no vtk"),
        (
            partial(CHECKS["drawing"], ends(1, err="No module named 'vtkmodules'")),
            "look",
            ["no_drawing"],
            "calib[view]",
        ),
        (partial(CHECKS["drawing"], ends(-11)), "look", ["no_drawing"], "was ended by signal 11"),
        (partial(CHECKS["drawing"], ends(None)), "look", ["no_drawing"], "took longer than 90 s"),
        (partial(camera, [], True, ends(1)), "ok", [], ""),
        (partial(camera, WEBCAM, False, ends(0)), "look", ["camera_not_readable"], "usermod -aG video"),
        (partial(camera, TWO_CAMERAS, True, ends(0, "[0, [640, 480]]\n[1, null]\n")), "ok", [], ""),
        (partial(camera, WEBCAM, True, ends(0, "[0, null]\n")), "look", ["camera_silent"], ""),
        (partial(camera, TWO_CAMERAS, True, ends(None, "[0, [640, 480]]\n")), "look", ["camera_stuck"], "camera 1"),
        (partial(camera, WEBCAM, True, ends(-11)), "look", ["camera_stuck"], ""),
        (partial(CHECKS["torch"], ends(0, "1.5 2.13.0 2 False\n")), "ok", [], ""),
        (partial(CHECKS["torch"], ends(0, "55.0 2.13.0 2 False\n")), "look", ["torch_slow"], ""),
        (
            partial(CHECKS["torch"], ends(1, err="OSError: [WinError 126] c10.dll")),
            "fails",
            ["torch_broken"],
            "c10.dll",
        ),
        (partial(CHECKS["torch"], ends(None)), "fails", ["torch_broken"], ""),
    ],
)
def test_what_is_well_and_what_is_not(
    check: Callable[[], HealthFinding], status: str, problems: list[str], words: str
) -> None:
    found = check()
    assert (found.status, names(found)) == (status, problems)
    assert words in " ".join(problem.words + problem.remedy for problem in found.problems)


def test_a_folder_that_takes_a_packages_place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """`targets` of the user's own on the path is fatal, in the current folder a warning; an empty folder is neither."""
    (tmp_path / "targets").mkdir()
    assert CHECKS["shadows"](tmp_path).status == "ok"
    (tmp_path / "targets" / "__init__.py").write_text("")
    (tmp_path / "yaml.py").write_text("")
    waiting = CHECKS["shadows"](tmp_path)
    assert (waiting.status, names(waiting)) == ("look", ["name_taken", "name_taken"])
    monkeypatch.syspath_prepend(tmp_path)
    for name in ("targets", "yaml"):
        monkeypatch.delitem(sys.modules, name)
    taken = CHECKS["shadows"](tmp_path)
    assert (taken.status, names(taken)) == ("fails", ["package_shadowed", "package_shadowed"])
    assert f"targets is taken from {tmp_path / 'targets'}" in taken.problems[0].words


def test_a_process_may_crash_or_hang() -> None:
    """Real ones: the doctor outlives them, and keeps what they had said."""
    crashed, *_ = doctor._try_python(["-c", "import os; os.abort()"], 20)
    assert crashed is not None
    assert crashed != 0
    hung, out, _ = doctor._try_python(["-c", "import time; print('[0, null]', flush=True); time.sleep(60)"], 1.5)
    assert (hung, out.strip()) == (None, "[0, null]")
