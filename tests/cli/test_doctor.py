"""`vbaa doctor`: each illness is recognised and has its remedy, and a healthy machine has none."""

from __future__ import annotations

import argparse
import importlib.metadata as metadata
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from vbaa_calib.cli import doctor as verb
from vbaa_calib.core.errors import Diagnosis
from vbaa_calib.doctor import packages
from vbaa_calib.doctor.finding import FAILS, LOOK, OK, Finding


def names(found: Finding) -> list[str]:
    """What is wrong, by name."""
    return [problem.name for problem in found.problems]


def test_this_machine_has_what_it_needs() -> None:
    """The installation that runs the tests: nothing that was looked at fails."""
    slow = ("torch", "drawing")
    found = list(verb._examine({name: check for name, check in verb.CHECKS.items() if name not in slow}))
    assert [each.name for each in found if each.status == FAILS] == []
    assert {each.name for each in found} == set(verb.CHECKS) - set(slow)


def test_an_old_python_is_told_with_its_remedy() -> None:
    old = packages.python_version((3, 9, 2))
    assert (old.status, names(old)) == (FAILS, ["python_too_old"])
    assert "3.11" in old.problems[0].words
    assert packages.python_version((3, 11, 0)).status == OK


def versions(**known: str) -> Callable[[str], str]:
    """A fake `metadata.version`."""

    def version(name: str) -> str:
        if name not in known:
            raise metadata.PackageNotFoundError(name)
        return known[name]

    return version


def test_packages_missing_or_out_of_range() -> None:
    """Each by name, with the command that mends it."""
    asked = ["numpy>=2.0,<3", "scipy>=1.13,<2", "tqdm"]
    well = packages.packages(asked, versions(numpy="2.4.6", scipy="1.13", tqdm="1"))
    assert (well.status, well.numbers["versions"]["numpy"]) == (OK, "2.4.6")
    ill = packages.packages(asked, versions(numpy="1.26.4", tqdm="1"))
    assert (ill.status, names(ill)) == (FAILS, ["package_version", "package_missing"])
    assert ill.problems[0].words == "numpy is 1.26.4, and <3,>=2.0 is needed"
    assert 'pip install "numpy<3,>=2.0"' in ill.problems[0].remedy
    assert ill.problems[1].words == "scipy is not installed"


def fake_cv2(version: str = "4.14.0", charuco: bool = True, gui: str = "NONE") -> Any:
    """As much of OpenCV as is asked."""
    aruco = SimpleNamespace(CharucoDetector=object) if charuco else SimpleNamespace()
    return SimpleNamespace(
        __version__=version, aruco=aruco, getBuildInformation=lambda: f"  GUI:      {gui}\n  Other: 1\n"
    )


RIGHT = {"opencv-contrib-python-headless": "4.14.0.94"}


@pytest.mark.parametrize(
    ("wheels", "cv2", "problem"),
    [
        (RIGHT | {"opencv-python": "4.10.0.84"}, fake_cv2(), "several_opencv"),
        (RIGHT, fake_cv2("5.0.0"), "opencv_major"),
        ({"opencv-python-headless": "4.14.0.94"}, fake_cv2(charuco=False), "opencv_without_charuco"),
        (RIGHT, fake_cv2("4.10.0"), "opencv_other"),
        (RIGHT, ImportError("libGL.so.1: cannot open shared object file"), "opencv_broken"),
        ({}, ModuleNotFoundError("No module named 'cv2'"), "opencv_broken"),
    ],
)
def test_opencv_ill(wheels: dict[str, str], cv2: Any, problem: str) -> None:
    """The classic ones; each remedy installs the right wheel. The right one alone is well."""

    def load() -> Any:
        if isinstance(cv2, Exception):
            raise cv2
        return cv2

    found = packages.opencv(wheels, load)
    assert (found.status, names(found)) == (FAILS, [problem])
    assert "opencv-contrib-python-headless>=4.14,<5" in found.problems[0].remedy
    assert packages.opencv(RIGHT, fake_cv2).status == OK


def test_a_biased_detector(monkeypatch: pytest.MonkeyPatch) -> None:
    """OpenCV's half pixel of before 4.14, put back in."""
    from vbaa_calib.doctor import detector_test

    honest = detector_test.opencv_corners

    def half_a_pixel_off(image: Any, spec: Any) -> Any:
        view = honest(image, spec)
        return type(view)(view.name, view.ids, view.corners_px + 0.5, view.image_size)

    monkeypatch.setitem(detector_test.DETECTORS, detector_test.OPENCV, half_a_pixel_off)
    found = packages.detector()
    assert (found.status, names(found)) == (FAILS, ["detector_biased"])
    assert "(+0.4" in found.problems[0].words or "(+0.5" in found.problems[0].words


def test_a_folder_that_takes_a_packages_place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """`targets` of the user's own on the path is fatal, in the current folder a warning; an empty folder is neither."""
    (tmp_path / "targets").mkdir()
    assert packages.shadows(tmp_path).status == OK
    (tmp_path / "targets" / "__init__.py").write_text("")
    (tmp_path / "yaml.py").write_text("")
    waiting = packages.shadows(tmp_path)
    assert (waiting.status, names(waiting)) == (LOOK, ["name_taken", "name_taken"])
    assert str(tmp_path / "targets") in waiting.problems[0].words
    monkeypatch.syspath_prepend(tmp_path)
    for name in ("targets", "yaml"):
        monkeypatch.delitem(sys.modules, name)
    taken = packages.shadows(tmp_path)
    assert (taken.status, names(taken)) == (FAILS, ["package_shadowed", "package_shadowed"])
    assert f"targets is taken from {tmp_path / 'targets'}" in taken.problems[0].words
    assert "rename" in taken.problems[0].remedy


def run(monkeypatch: pytest.MonkeyPatch, checks: dict[str, Callable[[], Finding]]) -> dict[str, Any]:
    """The verb with these checks."""
    monkeypatch.setattr(verb, "CHECKS", checks)
    return verb.run(argparse.Namespace(skip=[]))


def test_the_table(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """A line each; problems with their remedies; a check that breaks is told and stops nothing."""

    def breaks() -> Finding:
        raise RuntimeError("two\nlines")

    look = Finding("b", "b is", (Diagnosis("odd", "b is odd", "turn it"),))
    result = run(monkeypatch, {"a": lambda: Finding("a", "a is well"), "b": lambda: look, "c": breaks})
    assert (result["healthy"], result["exit_code"], result["counts"]) == (False, 1, {OK: 1, LOOK: 1, FAILS: 1})
    said = capsys.readouterr().err
    assert "ok    a          a is well\n" in said
    assert "look  b          b is odd\n                 → turn it\n" in said
    assert "fails c" in said
    assert "RuntimeError: two lines" in said
    assert "not healthy: 1 of 3 fail" in said
    healthy = run(monkeypatch, {"a": lambda: Finding("a", "a is well"), "b": lambda: look})
    assert (healthy["healthy"], healthy["exit_code"]) == (True, 0)
    assert "healthy; 1 of 2 deserve a look" in capsys.readouterr().err
