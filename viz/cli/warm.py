"""`python -m viz.cli.warm`, which `make install` runs: compile the inner loops, so that nobody waits at a first call.

The verbs themselves are run, on a session so small that compiling takes most of the time. Two processes share the
work, which is about as long in either: one compiles the detector, the other the simulator, the lens and the estimator.
"""

from __future__ import annotations

import contextlib
import gc
import io
import multiprocessing
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml

from estimator import ContactEstimator
from estimator.budget.budget import error_budget
from vbaa_calib.camera import Camera
from vbaa_calib.cli.main import run_verb
from vbaa_calib.core.console import say
from vbaa_calib.core.files import read_yaml
from vbaa_calib.detect.whisker.antenna import find
from vbaa_calib.detect.whisker.corridor import Corridor
from vbaa_calib.geometry import Kinematics, Pose
from vbaa_calib.rig import RIG_PARAMETERS, Antenna, AntennaImage, MomentSensor, Rig
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


def plain_rig() -> Rig:
    """A straight, weightless antenna seen from above by a camera of 480 x 360 px."""
    parameters = np.zeros(9)
    parameters[6:8] = np.log([4e-3, 4e-3])
    matrix = np.array([[500.0, 0.0, 240.0], [0.0, 500.0, 180.0], [0.0, 0.0, 1.0]])
    return Rig(
        camera=Camera("opencv", (480, 360), matrix, np.zeros(5)),
        T_antenna_camera=Pose(np.diag([1.0, -1.0, -1.0]), np.array([0.12, 0.0, 0.32])),
        antenna=Antenna(0.24, 8e-4, parameters),
        moment_sensor=MomentSensor(1.0, 0.0, 2e-5),
        kinematics=Kinematics(),
        gravity_world_m_s2=np.zeros(3),
        image=AntennaImage(0.1, 1.0, True),
        covariance=np.diag(np.full(len(RIG_PARAMETERS), 1e-10)),
    )


AXIS_PX = np.stack([np.linspace(52.5, 427.5, 300), np.full(300, 180.0)], axis=-1)
"""Its pixels."""


_BENT_PX = AXIS_PX + np.linspace(0.0, 1.0, len(AXIS_PX))[:, None] ** 2 * [0.0, 20.0]
"""The same, bent."""


def _compile_detector() -> None:
    """What finds the antenna in pictures of any depth: a line and noise; at last one here brighter, there darker."""
    gc.disable()  # the compiler keeps what it makes: looking for garbage took an eighth of its time
    picture = np.random.default_rng(1).normal(70.0, 2.0, (360, 480)).astype(np.uint8)
    cv2.polylines(picture, [_BENT_PX.round().astype(int)], False, 150, 2, cv2.LINE_AA)
    corridor = Corridor(AXIS_PX, np.linspace(5.0, 80.0, len(AXIS_PX)), 2.0)
    for depth in (np.uint8, np.uint16, np.float32):
        find(picture.astype(depth), corridor)
    find(picture, corridor, None)


def _compile_estimator() -> None:
    """What estimates a contact from a centreline, and says how far a rig's contacts are off."""
    ContactEstimator(plain_rig()).estimate(_BENT_PX, moment=5e-3, pan=0.0, tilt=0.0)
    error_budget(plain_rig())


def main() -> None:
    """Run the verbs one after the other, with a line for each and none of their own; beside them, the detector."""
    gc.disable()  # as in `_compile_detector`: costs 0.4 GB
    detector = multiprocessing.get_context("spawn").Process(target=_compile_detector)
    detector.start()
    with tempfile.TemporaryDirectory() as folder:
        names = ("scene.yaml", "session", "camera.json", "rig.json", "contacts.csv")
        scene, session, camera, rig, contacts = (Path(folder) / name for name in names)
        board = ("--squares", "11x8", "--square", "0.015", "--marker", "0.011", "--dict", "DICT_4X4_100")
        scene.write_text(yaml.safe_dump(small_scene(noload=3, loads=(1, 3, 8, 9))))
        steps: tuple[Callable[[], object], ...] = (
            lambda: _quietly("simulate", scene, "-o", session),
            lambda: _quietly("intrinsics", session / "intrinsics", *board, "-o", camera),
            _compile_estimator,
            detector.join,
            lambda: _quietly("calibrate", session, "-o", rig),
            lambda: _quietly("look", session / "noload" / "noload_001.png", "--rig", rig),
            lambda: _quietly("estimate", session, "--rig", rig, "-o", contacts, "--no-report"),
        )
        for number, step in enumerate(steps, 1):
            say(f"compiling the inner loops: {number} of {len(steps)}")
            step()


def _quietly(*words: object) -> None:
    with contextlib.redirect_stderr(io.StringIO()):
        run_verb([str(word) for word in words])


if __name__ == "__main__":
    main()
