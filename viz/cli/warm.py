"""`python -m viz.cli.warm`, which `make install` runs: compile the inner loops, so that nobody waits at a first call.

The verbs themselves are run, on a session so small that compiling takes most of the time.
"""

from __future__ import annotations

import contextlib
import io
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml

from vbaa_calib.cli.main import run_verb
from vbaa_calib.core.console import say
from vbaa_calib.core.files import read_yaml
from vbaa_calib.simulate.scene.scene import bundled_scene


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


def main() -> None:
    """Run the verbs one after the other, with a line for each and none of their own."""
    with tempfile.TemporaryDirectory() as folder:
        names = ("scene.yaml", "session", "rig.json", "contacts.csv")
        scene, session, rig, contacts = (Path(folder) / name for name in names)
        scene.write_text(yaml.safe_dump(small_scene(noload=3, loads=(1, 3, 8, 9))))
        calls = (
            ["simulate", scene, "-o", session],
            ["calibrate", session, "-o", rig],
            ["look", session / "noload" / "noload_001.png", "--rig", rig],
            ["estimate", session, "--rig", rig, "-o", contacts, "--no-report"],
        )
        for number, call in enumerate(calls, 1):
            say(f"compiling the inner loops: {number} of {len(calls)}")
            with contextlib.redirect_stderr(io.StringIO()):
                run_verb([str(word) for word in call])


if __name__ == "__main__":
    main()
