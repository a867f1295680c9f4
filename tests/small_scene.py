"""A small rig, made once: for tests that need a whole session quickly."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml

from vbaa_calib.cli.main import main
from vbaa_calib.core.files import read_yaml
from vbaa_calib.simulate.scene.scene import bundled_scene

from .made_once import made_once


def small_rig() -> Path:
    """A folder with scene.yaml, session/ and rig.json. Never to be written to."""
    return made_once("small_rig", lambda folder: calibrated(folder, small_scene(noload=3, loads=(1, 3, 8, 9))))


def simulated(folder: Path, scene: dict[str, Any], *options: str) -> Path:
    """The session of a scene, both in the folder."""
    (folder / "scene.yaml").write_text(yaml.safe_dump(scene))
    assert main(["simulate", str(folder / "scene.yaml"), "-o", str(folder / "session"), *options]) == 0
    return folder / "session"


def calibrated(folder: Path, scene: dict[str, Any]) -> None:
    """The same and its rig.json."""
    assert main(["calibrate", str(simulated(folder, scene)), "-o", str(folder / "rig.json")]) == 0


def small_scene(noload: int, loads: Sequence[int]) -> dict[str, Any]:
    """The demo's scene with few and small pictures: so many no-load frames, and the loads of these numbers."""
    scene = read_yaml(bundled_scene("demo"))
    scene["name"] = "small"
    scene["camera"]["image_size"] = [480, 360]
    scene["camera"]["matrix"] = [[502.0, 0.0, 238.3], [0.0, 500.5, 181.6], [0.0, 0.0, 1.0]]
    scene["intrinsics"]["pictures"] = 5
    scene["jig"]["pictures"] = 1
    scene["noload"] = scene["noload"][:noload]
    scene["loads"] = [scene["loads"][index] for index in loads]
    scene["recording"]["sweeps"] = [scene["recording"]["sweeps"][0] | {"frames": 2, "free_frames": 1}]
    return scene
