"""One small synthetic session and its rig, made once, and a way to call `vbaa` as its user sees it."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from vbaa_calib.cli.main import main

from ..small_scene import small_rig


@dataclass(frozen=True)
class Outcome:
    """What a call left behind: exit code, stdout, stderr."""

    code: int
    out: str
    err: str

    @property
    def result(self) -> dict[str, Any]:
        """The one JSON object on stdout."""
        data = json.loads(self.out)
        assert isinstance(data, dict)
        return data


Call = Callable[..., Outcome]
Damage = Callable[[Path], None]
PICTURES = {"noload": "noload/noload_001.png", "recording": "recording/frame_0003.png"}


def repaint(name: str, change: Callable[[np.ndarray], np.ndarray]) -> Damage:
    """A picture put in place of another."""

    def damage(root: Path) -> None:
        for path in sorted(root.glob(name)):
            picture = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
            assert cv2.imwrite(str(path), change(picture))

    return damage


def grey(picture: np.ndarray) -> np.ndarray:
    return np.full_like(picture, 90)


def noise(picture: np.ndarray) -> np.ndarray:
    return np.random.default_rng(1).normal(90, 12, picture.shape).clip(0, 255).astype(np.uint8)


def refused(said: Outcome, *words: str) -> None:
    assert said.code == 2, said
    assert said.out == ""
    assert said.err.count("\n") == 1
    assert said.err.startswith("vbaa: ")
    assert "Traceback" not in said.err
    for word in words:
        assert word in said.err


@pytest.fixture
def vbaa(capfd: pytest.CaptureFixture[str]) -> Call:
    """Calls the command in this process; what C libraries print counts as well."""

    def call(*argv: object) -> Outcome:
        capfd.readouterr()
        code = main([str(part) for part in argv])
        said = capfd.readouterr()
        return Outcome(code, said.out, said.err)

    return call


@pytest.fixture(scope="session")
def made() -> Path:
    """A folder with scene.yaml, session/ and rig.json, never to be written to."""
    return small_rig()


@pytest.fixture
def session(made: Path, tmp_path: Path) -> Path:
    """A session of the test's own."""
    return Path(shutil.copytree(made / "session", tmp_path / "session"))


@pytest.fixture
def rig(made: Path, tmp_path: Path) -> Path:
    """A rig.json of the test's own."""
    return Path(shutil.copy(made / "rig.json", tmp_path / "rig.json"))
