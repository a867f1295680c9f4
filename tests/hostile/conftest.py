"""A folder with one good file of every kind, made once, and a copy of it for every case."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import yaml

from targets.board import corner_points
from vbaa_calib.camera import Camera
from vbaa_calib.cli.main import main
from vbaa_calib.core.files import read_json, read_yaml
from vbaa_calib.detect.board.board_file import load_board
from vbaa_calib.geometry import Pose

from ..formats.files import READ_ONLY, SAMPLES
from ..made_once import made_once
from ..small_scene import small_rig, small_scene

DEFLECTIONS = "x_m,unloaded_y_m,loaded_y_m\n" + "".join(
    f"{x:g},0,{0.01 * x * x * (3 * 0.2 - x) / (6 * 4e-3):.6f}\n" for x in (0.04, 0.08, 0.12, 0.16, 0.2)
)
POSES = "view,x_m,y_m,z_m,qx,qy,qz,qw"
READINGS = "image,pan_rad,tilt_rad,moment_Nm\nnoload_000.png,0,0,0.001\n"
ANSWERS = "antenna_length_mm: 240\nplane_way: jig\n"


def vbaa(line: str) -> None:
    assert main(line.split()) == 0, line


def good_files() -> Path:
    """One good file of every kind. Never to be written to."""
    return made_once("good_files", _make_files)


def _make_files(folder: Path) -> None:
    shutil.copytree(small_rig(), folder, dirs_exist_ok=True)
    session = folder / "session"
    vbaa(f"intrinsics {session}/intrinsics --board {session}/session.yaml -o {folder}/camera.json")
    for suffix in ("csv", "parquet"):
        vbaa(f"estimate {session} --rig {folder}/rig.json -o {folder}/contacts.{suffix} --no-report")
    _add_files(folder)


def _add_files(folder: Path) -> None:
    session = folder / "session"
    (folder / "board.yaml").write_text(yaml.safe_dump(read_yaml(session / "session.yaml")["board"]))
    for name, sample in (SAMPLES | READ_ONLY).items():
        (folder / f"{name}.txt").write_text(sample)
    (folder / "stiffness.csv").write_text(DEFLECTIONS)
    (folder / "answers.yaml").write_text(ANSWERS)
    (folder / "readings.csv").write_text(READINGS)
    shutil.copy(session / "truth.json", folder)
    shutil.copy(session / "noload" / "noload_000.png", folder / "free.png")
    shutil.copy(session / "plane" / "jig_000.png", folder / "jig.png")
    _add_arm(folder)
    few = small_scene(noload=1, loads=(1,))
    few["intrinsics"]["pictures"] = 1
    (folder / "few.yaml").write_text(yaml.safe_dump(few))
    vbaa(f"simulate {folder}/few.yaml --pictures none -o {folder}/few")
    for name in ("session.yaml", "recording/recording.csv", "recording/centrelines.csv"):
        place = folder / "lined" / name
        place.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(folder / "few" / name, place)
    shutil.rmtree(folder / "few")
    swept = Path(shutil.copytree(session, folder / "swept", ignore=shutil.ignore_patterns("recording")))
    shutil.copytree(session / "intrinsics", swept / "sweep")
    rows = (f"{path.name},{k / 10},{k % 2 / 10}\n" for k, path in enumerate(sorted((swept / "sweep").iterdir())))
    (swept / "sweep" / "sweep.csv").write_text("image,pan_rad,tilt_rad\n" + "".join(rows))
    assert main(f"wizard {folder}/store --answers {folder}/answers.yaml --batch".split()) == 2


def _add_arm(folder: Path) -> None:
    """corners.csv, and poses.csv of an arm: tool and camera are one frame, and so are base and board."""
    lens, corners, poses = read_json(folder / "camera.json"), ["view,id,u_px,v_px"], [POSES]
    camera, points = Camera.from_dict(lens), corner_points(load_board(folder / "board.yaml"))
    for view in lens["views"]:
        seen = Pose.from_dict(view["T_camera_board"])
        pixels = camera.project(seen @ points)[0]
        inside = np.flatnonzero(camera.in_picture(pixels))
        corners += [f"{view['name']},{k},{pixels[k, 0]!s},{pixels[k, 1]!s}" for k in inside]
        tool = seen.inverse().to_dict()
        poses.append(",".join(map(str, [view["name"], *tool["translation_m"], *tool["rotation_xyzw"]])))
    (folder / "corners.csv").write_text("\n".join(corners) + "\n")
    (folder / "poses.csv").write_text("\n".join(poses) + "\n")


@pytest.fixture
def folder(monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """One of the case's own, in which the command runs."""
    with tempfile.TemporaryDirectory(prefix="hostile-case-") as name:
        # hard links: no damage, and no verb, writes into a file that is there
        copy = Path(shutil.copytree(good_files(), Path(name, "work"), copy_function=os.link))
        monkeypatch.chdir(copy)
        yield copy
