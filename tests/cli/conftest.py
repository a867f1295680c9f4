"""One small synthetic session and its rig, made once, and a way to call `vbaa` as its user sees it."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from vbaa_calib.cli.main import main
from viz.report import make as report_make

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


@pytest.fixture(autouse=True)
def undrawn(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """The scene in reports has its own tests; drawing it takes seconds."""
    if "demo" not in request.node.nodeid:
        nothing = report_make.Picture(b"", "not drawn here")
        monkeypatch.setattr(report_make, "scene_picture", lambda *_, **__: nothing)
