"""The folder that the pages suppose: what their commands name lies there, simulated or drawn."""

from __future__ import annotations

import csv
import json
import shutil
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml

from targets.board import AprilGrid, BoardSpec, Chessboard
from targets.sheet import fill_in, paper_named
from tests.small_scene import small_scene
from vbaa_calib.cli.main import main
from vbaa_calib.core.files import read_json
from vbaa_calib.geometry import Pose

from .calibrate.test_stiffness_photo import drawn as photographed
from .calibrate.test_stiffness_photo import rod
from .detect import drawn_grids, drawn_sheets
from .hostile.conftest import POSES, good_files
from .made_once import made_once

VIEWS = 6
WEIGHT_N_M, ROD_NM2 = 0.031, 8e-5
BAR_N, BAR_M, BAR_NM2 = 5.18, 0.54, 170.0
RATE_HZ = 30.0


def vbaa(*words: object) -> None:
    assert main([str(word) for word in words]) == 0, words


def page_folder() -> Path:
    """All but photographs of other boards. Never to be written to."""
    return made_once("page_folder", _make)


def photos(kind: str) -> Path:
    """A folder of photographs of a board: "A3" (the sheet for that paper), "aprilgrid", "charuco", "chessboard" or
    "circles"."""
    return made_once(f"photos_{kind}", lambda folder: _photograph(kind, folder))


def _make(folder: Path) -> None:
    shutil.copytree(good_files(), folder, dirs_exist_ok=True, ignore=shutil.ignore_patterns("swept", "store"))
    for name in ("SESSION", "rig_2026-03-01", "rig_2026-04-02", "rig_2026-05-01", "rig_2026-06-03"):
        (folder / name).symlink_to("session")
    (folder / "views").symlink_to("session/intrinsics")
    (folder / "my_rig").mkdir()
    for part in (folder / "session").iterdir():
        (folder / "my_rig" / part.name).symlink_to(Path("..", "session", part.name))
    (folder / "demo").symlink_to(".")
    for name in ("my_rig/rig.json", "rig_b.json", "rig_march.json", "rig_april.json"):
        shutil.copy(folder / "rig.json", folder / name)
    for name in ("before", "after"):
        (folder / name).mkdir()
        shutil.copy(folder / "contacts.csv", folder / name)
    for name in ("results_0.1", "results_0.2"):
        (folder / name).symlink_to("results")  # which an earlier command of the page makes
    (folder / "dates.csv").write_text("session,date\nrig_2026-03-01,2026-03-01\nrig_2026-04-02,2026-04-02\n")
    vbaa("convert", folder / "camera.json", "--to", "ros", "-o", folder / "camera_info.yaml")
    vbaa("convert", folder / "camera.json", "--to", "kalibr", "-o", folder / "camchain.yaml")
    _add_recordings(folder)
    _add_a_month_later(folder)
    _add_held_board(folder)
    _add_rods(folder)


def _add_recordings(folder: Path) -> None:
    """A video, a bag, a tracker's table, lines for standard input, and a folder of recordings."""
    recording = folder / "session" / "recording"
    frames = list(csv.DictReader((recording / "recording.csv").open(newline="")))
    pictures = [cv2.imread(str(recording / frame["image"])) for frame in frames]
    writer = cv2.VideoWriter(
        str(folder / "video.mp4"), cv2.VideoWriter.fourcc(*"mp4v"), RATE_HZ, pictures[0].shape[1::-1]
    )
    for picture in pictures:
        writer.write(picture)
    writer.release()
    names = ("pan_rad", "tilt_rad", "moment_Nm")
    rows = [[frame["frame"], f"{k / RATE_HZ:.6f}", *(frame[name] for name in names)] for k, frame in enumerate(frames)]
    table = [",".join(("frame", "time_s", *names)), *map(",".join, rows)]
    (folder / "readings.csv").write_text("\n".join(table) + "\n")
    shutil.copy(folder / "lined" / "recording" / "centrelines.csv", folder / "pixels.csv")
    lines = [
        {"time_s": k / RATE_HZ, "image": str(recording / frame["image"])} | {name: float(frame[name]) for name in names}
        for k, frame in enumerate(frames)
    ]
    (folder / "stdin.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))
    vbaa("simulate", folder / "scene.yaml", "--bag", folder / "recording.mcap")
    (folder / "demo.mcap").symlink_to("recording.mcap")
    (folder / "runs").mkdir()
    for name in ("one", "two"):
        shutil.copytree(folder / "lined", folder / "runs" / name)
    (folder / "recordings.csv").write_text("recording,rig\nruns/one,rig.json\nruns/two,rig.json\n")


def _add_a_month_later(folder: Path) -> None:
    """The same rig in pictures that its calibration has not seen, which is a second camera's session, too."""
    (folder / "free.png").unlink()
    vbaa("simulate", folder / "few.yaml", "--pictures", "none", "--seed", 9, "-o", folder / "session_b")
    shutil.copy(folder / "session_b" / "plane" / "jig_000.png", folder / "board.png")
    shutil.copy(folder / "session_b" / "noload" / "noload_000.png", folder / "free.png")


def _add_held_board(folder: Path) -> None:
    """held.csv: the poses of a tool that is one frame with the board, in a base that is one with the camera; seen.csv:
    the same as poses of the board in the camera."""
    rows = [POSES]
    for view in read_json(folder / "camera.json")["views"]:
        tool = Pose.from_dict(view["T_camera_board"]).to_dict()
        rows.append(",".join(map(str, [view["name"], *tool["translation_m"], *tool["rotation_xyzw"]])))
    for name in ("held.csv", "seen.csv"):
        (folder / name).write_text("\n".join(rows) + "\n")
    target = {"target_type": "aprilgrid", "tagCols": 4, "tagRows": 3, "tagSize": 0.035, "tagSpacing": 0.3}
    (folder / "target.yaml").write_text(yaml.safe_dump(target))


def _add_rods(folder: Path) -> None:
    """A dial gauge's table of a bar, and photographs of a rod under its own weight and without."""
    places = np.linspace(0.06, BAR_M, 9)
    bent = BAR_N * places**2 * (3 * BAR_M - places) / (6 * BAR_NM2)
    rows = [f"{x:g},0,{y:.6f}\n" for x, y in zip(places, bent, strict=True)]
    (folder / "table.csv").write_text("x_m,unloaded_y_m,loaded_y_m\n" + "".join(rows))
    rng = np.random.default_rng(3)
    for name, weight in (("photo.jpg", WEIGHT_N_M), ("before.jpg", 0.0)):
        line = rod(lambda s, moment: moment / ROD_NM2, 0.0, weight)
        near = cv2.resize(photographed(line, rng), None, fx=4, fy=4, interpolation=cv2.INTER_CUBIC)
        cv2.imwrite(str(folder / name), near, [cv2.IMWRITE_JPEG_QUALITY, 98])


def _photograph(kind: str, folder: Path) -> None:
    if kind in ("chessboard", "circles"):
        spec: Any = Chessboard("chessboard", 9, 6, 0.025) if kind == "chessboard" else drawn_grids.ASYMMETRIC
        for seed in range(VIEWS):
            grey = drawn_grids.drawn(spec, *drawn_grids.pose(seed, spec))[0]
            cv2.imwrite(str(folder / f"{seed}.png"), drawn_grids.picture(grey, seed=seed))
        return
    if kind == "aprilgrid":
        drawn = drawn_sheets.grid_sheet(AprilGrid("aprilgrid", 4, 3, 0.035, 0.3))
        for seed in range(VIEWS):
            cv2.imwrite(str(folder / f"{seed}.png"), drawn_sheets.view([drawn], seed)[0])
        return
    sheet = fill_in(paper=paper_named("A3"))
    board = sheet if kind == "A3" else BoardSpec(9, 6, 0.025, 0.018)
    scene = small_scene(noload=1, loads=(1,)) | {"board": board.to_dict()}
    scene["intrinsics"]["pictures"] = VIEWS
    (folder / "scene.yaml").write_text(yaml.safe_dump(scene))
    vbaa("simulate", folder / "scene.yaml", "--pictures", "none", "-o", folder / "session")
    for path in (folder / "session" / "intrinsics").iterdir():
        shutil.move(path, folder / path.name)
    shutil.rmtree(folder / "session")
    (folder / "scene.yaml").unlink()
