"""A planned session to a folder, whole or not at all."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from vbaa_calib.core.console import progress
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import replacing_folder, write_json
from vbaa_calib.session import SCHEMA
from vbaa_calib.simulate.plan.plan import AntennaShot, Plan, plan, stream
from vbaa_calib.simulate.render.board import Sheet, print_sheet
from vbaa_calib.simulate.render.picture import Studio, studio
from vbaa_calib.simulate.render.render import render_shot, seen_centreline
from vbaa_calib.simulate.scene.scene import OverSpec, Scene

from .write_boards import write_over, write_picture, write_rows, write_sweep

CENTRELINE_STD_PX = 0.1


def refuse_target(path: Path, force: bool) -> None:
    """Raises InputError unless a session may be written to `path`; a folder that is not a session is never replaced."""
    if not Path(os.path.realpath(path)).parent.is_dir():
        raise InputError("its folder does not exist", where=path, remedy=f"create {path.parent} first")
    if not os.path.lexists(path):
        return
    if not force:
        raise InputError("exists already", where=path, remedy="give --force to replace it, or another name")
    ours = path.is_dir() and not path.is_symlink()
    if not ours or not ((path / "session.yaml").is_file() or not any(path.iterdir())):
        raise InputError("is not a session, it is not replaced", where=path, remedy="take another name")


def write_session(scene: Scene, folder: Path, *, force: bool = False, recording_pictures: bool = True) -> Plan:
    """Simulate a scene and write it as a session.

    Parameters
    ----------
    folder : the session; replaced with `force`, but only when it is a session or empty.
    recording_pictures : False writes recording/centrelines.csv in place of the recording's pictures.

    Raises
    ------
    InputError : the folder is in the way, or the scene cannot be carried out.
    """
    folder = Path(folder)
    refuse_target(folder, force)
    planned = plan(scene)
    place = studio(scene.lens, scene.picture, stream(scene, "bench"))
    with replacing_folder(folder) as root:
        for name in ("intrinsics", "plane", "noload", "loads", "recording"):
            (root / name).mkdir()
        (root / "session.yaml").write_text(session_yaml(scene), encoding="utf-8")
        truth = dict(planned.truth)
        sheet = print_sheet(scene.board)
        if scene.sweep:
            truth["sweep"] = {"T_world_board": write_sweep(scene, place, sheet, root).to_dict()}
        if scene.over is not None:
            truth["over"] = write_over(scene, place, sheet, scene.over, root, stream(scene, "over"))
        write_json(root / "truth.json", truth)
        for name, rows in planned.tables.items():
            drop = () if recording_pictures or name != "recording/recording.csv" else ("image",)
            write_rows(root / name, [{k: v for k, v in row.items() if k not in drop} for row in rows])
        if not recording_pictures:
            write_rows(root / "recording/centrelines.csv", list(_centrelines(scene, place, planned)))
        _write_pictures(scene, place, planned, root, recording_pictures)
    return planned


def _write_pictures(scene: Scene, place: Studio, planned: Plan, root: Path, recording_pictures: bool) -> None:
    sheet = print_sheet(scene.board)
    # a picture's noise hangs on its place in the plan, not on which other pictures are taken
    wanted = [
        index
        for index, shot in enumerate(planned.shots)
        if recording_pictures or not shot.path.startswith("recording/")
    ]

    def take(index: int) -> None:
        _take(scene, place, sheet, planned, index, root)

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        for _ in progress(pool.map(take, wanted), "pictures", len(wanted)):
            pass


def _take(scene: Scene, place: Studio, sheet: Sheet, planned: Plan, index: int, root: Path) -> None:
    shot = planned.shots[index]
    picture = render_shot(scene, place, sheet, shot, stream(scene, "pictures", index))
    write_picture(root / shot.path, picture)


def _centrelines(scene: Scene, place: Studio, planned: Plan) -> Iterator[dict[str, Any]]:
    frames = planned.tables["recording/recording.csv"]
    shots = [s for s in planned.shots if isinstance(s, AntennaShot) and s.path.startswith("recording/")]
    for row, shot in zip(frames, shots, strict=True):
        points = seen_centreline(scene, place, shot)
        noise = stream(scene, "centrelines", int(row["frame"])).standard_normal(len(points))
        for u, v in points[:, :2] + CENTRELINE_STD_PX * noise[:, None] * points[:, 2:]:
            yield {
                "frame": row["frame"],
                "u_px": round(float(u), 4),
                "v_px": round(float(v), 4),
                "sigma_px": CENTRELINE_STD_PX,
            }


def _floats(values: np.ndarray | Iterable[float]) -> list[float]:
    return [float(value) for value in values]


def _over_key(scene: Scene) -> dict[str, Any]:
    over: OverSpec | None = scene.over
    if over is None:
        return {}
    return {"over": {"height_m": over.height_m, "pan_rad": over.joints.pan_rad, "tilt_rad": over.joints.tilt_rad}}


def session_yaml(scene: Scene) -> str:
    """session.yaml: what the user of such a rig would know, not what is true of it."""
    antenna = scene.antenna
    data = {
        "schema": SCHEMA,
        "board": scene.board.to_dict(),
        "antenna": {name: float(getattr(antenna, name)) for name in antenna.__dataclass_fields__},
        "jig": {"T_antenna_board": scene.T_antenna_board.to_dict()},
        "kinematics": {
            "T_actuator_antenna": scene.kinematics.T_actuator_antenna.to_dict(),
            "position_world_m": _floats(scene.kinematics.position_world_m),
        },
        **_over_key(scene),
        "gravity_world": _floats(scene.gravity_world_m_s2) if scene.gravity_world_m_s2.any() else None,
        "moment_sensor": {"std_Nm": scene.moment.std_Nm},
        # nobody reads a ruler here
        "load_readings": {"distance_std_m": 0.0, "force_std_relative": 0.0},
    }
    return yaml.safe_dump(data, sort_keys=False, default_flow_style=None, width=110)
