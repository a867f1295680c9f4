"""A small rig, made once: for tests that need a whole session quickly."""

from __future__ import annotations

from pathlib import Path

import yaml

from vbaa_calib.cli.main import main
from viz.cli.warm import small_scene

from .made_once import made_once


def small_rig() -> Path:
    """A folder with scene.yaml, session/ and rig.json. Never to be written to."""
    return made_once("small_rig", _make)


def _make(folder: Path) -> None:
    (folder / "scene.yaml").write_text(yaml.safe_dump(small_scene(noload=3, loads=(1, 3, 8, 9))))
    assert main(["simulate", str(folder / "scene.yaml"), "-o", str(folder / "session")]) == 0
    assert main(["calibrate", str(folder / "session"), "-o", str(folder / "rig.json")]) == 0
