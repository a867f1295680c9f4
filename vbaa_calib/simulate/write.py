"""Writes a planned session to a folder, completely or not at all."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
import yaml

from vbaa_calib.antenna.taper import profiles_to_dict
from vbaa_calib.core.console import progress
from vbaa_calib.core.csv_rows import csv_text
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import refuse_folder_of, write_json, write_text
from vbaa_calib.core.folders import replacing_folder
from vbaa_calib.geometry import Pose
from vbaa_calib.session import SCHEMA
from vbaa_calib.simulate.joint_paths import sweep_of_the_board
from vbaa_calib.simulate.plan import AntennaShot, BoardShot, Plan, plan, stream
from vbaa_calib.simulate.render.antenna import tube_patches, visible, visible_centreline
from vbaa_calib.simulate.render.board import Sheet, outline, print_sheet
from vbaa_calib.simulate.render.picture import Studio, studio
from vbaa_calib.simulate.scene.lens import project
from vbaa_calib.simulate.scene.scene import SceneSpec
from vbaa_calib.simulate.shots import free_wires, obstacle_of, render_over, render_shot, seen_antenna

if TYPE_CHECKING:
    from vbaa_calib.simulate.traced import TracedPictures


def _antenna_mask(scene: SceneSpec, place: Studio, shot: AntennaShot) -> np.ndarray:
    """(height, width) uint8 mask: 255 times the fraction of each pixel that the antenna covers."""
    width, height = scene.lens.image_size
    mask = np.zeros((height, width), np.uint8)
    for patch in tube_patches(place, seen_antenna(scene, shot), 1.0, obstacle=obstacle_of(scene, place, shot)):
        region = mask[patch.where]
        covered = cv2.resize(patch.laid_out(patch.alpha), region.shape[::-1], interpolation=cv2.INTER_AREA)
        region += np.rint(255 * np.clip(covered, 0.0, 1.0)).astype(np.uint8)
    return mask


def _centreline_rows(scene: SceneSpec, place: Studio, shot: AntennaShot) -> list[dict[str, Any]]:
    """Rows of the whole centreline from clamp to tip, about one a pixel, including covered parts and those outside
    the picture."""
    seen = seen_antenna(scene, shot)
    s = np.linspace(shot.arclength_m[0], shot.arclength_m[-1], len(seen.pixels))
    in_sight = visible(scene.lens, seen.pixels, seen.depth_m, obstacle_of(scene, place, shot))
    numbers = np.column_stack([s, seen.pixels, seen.normals, 2 * seen.half_width_px])
    names = ("s_m", "u_px", "v_px", "normal_u", "normal_v", "width_px")
    return [
        {"image": shot.path} | dict(zip(names, np.round(row, 5).tolist(), strict=True)) | {"visible": int(one)}
        for row, one in zip(numbers[::2], in_sight[::2], strict=True)
    ]


def _contact_row(scene: SceneSpec, place: Studio, shot: AntennaShot, truth: Mapping[str, Any]) -> dict[str, Any]:
    """The row of the contact in one picture, with empty cells without contact. truth : of the frame."""
    row: dict[str, Any] = dict.fromkeys(("distance_m", "u_px", "v_px", "visible", "force_y_N", "force_z_N"), "")
    if truth.get("in_contact"):
        point = scene.T_antenna_camera.inverse() @ np.array([truth["contact_antenna_m"]])
        u, v = pixel = project(scene.lens, point)[0]
        in_sight = visible(scene.lens, pixel[None], point[:, 2] - scene.radius_m, obstacle_of(scene, place, shot))
        where = {"distance_m": truth["distance_m"], "u_px": round(float(u), 4), "v_px": round(float(v), 4)}
        row |= where | {"visible": int(in_sight[0]), "force_y_N": truth["force_N"][1], "force_z_N": truth["force_N"][2]}
    return {"image": shot.path, "in_contact": int(bool(truth.get("in_contact")))} | row


Take = Callable[[BoardShot | AntennaShot, AntennaShot | None, np.random.Generator], np.ndarray]
"""Of a shot, the frame after it in its stroke (None: there is none) and random numbers: the picture, uint8."""


def refuse_target(path: Path, force: bool, marker: str = "session.yaml") -> None:
    """Raises InputError unless a session may be written to `path`: only empty folders, and folders with a `marker`
    as sessions have, are replaced."""
    refuse_folder_of(path)
    if not os.path.lexists(path):
        return
    if not force:
        raise InputError("exists already", where=path, remedy="give --force to replace it, or another name")
    ours = path.is_dir() and not path.is_symlink()
    if not ours or not ((path / marker).is_file() or not any(path.iterdir())):
        raise InputError(
            f"is not a session, with {marker} in it: it is not replaced", where=path, remedy="take another name"
        )


def write_session(
    scene: SceneSpec,
    folder: Path,
    *,
    force: bool = False,
    recording_pictures: bool = True,
    traced: bool = False,
    labels: bool = False,
) -> Plan:
    """Simulate a scene and write it as a session.

    Parameters
    ----------
    folder : the session; replaced with `force`, but only when it is a session or empty.
    recording_pictures : False writes recording/centrelines.csv in place of the recording's pictures.
    traced : mitsuba takes the pictures. labels : also write what each picture shows, into labels/.

    Raises
    ------
    InputError : the folder is in the way, the scene cannot be carried out, or mitsuba is not installed.
    """
    folder = Path(folder)
    refuse_target(folder, force)
    if scene.cameras and (traced or labels):
        what = "several cameras are drawn, neither traced nor labelled"
        raise InputError(
            what, where=f"scene {scene.name}", remedy="leave out --render and --labels, or give one camera"
        )
    place, sheet = studio(scene.lens, scene.picture, stream(scene, "bench")), print_sheet(scene.board)
    photographer = None
    if traced:
        from vbaa_calib.simulate.traced import TracedPictures

        photographer = TracedPictures(scene, place, sheet, stream(scene, "bench"))
    take = photographer.shot if photographer else _drawn_pictures(scene, place, sheet)
    if scene.cameras:
        take = _by_camera(scene, sheet)
    planned = plan(scene, scene.traced.readout if traced else 0.0)
    with replacing_folder(folder) as root:
        for name in ("intrinsics", "plane", "noload", "loads", "recording"):
            for camera in scene.cameras or ("",):
                (root / name / camera).mkdir(parents=True, exist_ok=True)
        (root / "session.yaml").write_text(_session_yaml(scene), encoding="utf-8")
        truth = dict(planned.truth) | ({"traced": vars(scene.traced)} if traced else {})
        if scene.sweep:
            truth["sweep"] = {"T_world_board": _write_sweep(scene, take, sheet, root).to_dict()}
        if scene.over is not None:
            truth["over"] = _write_over(scene, place, sheet, root, photographer)
        write_json(root / "truth.json", truth)
        for name, rows in planned.tables.items():
            drop = not recording_pictures and name == "recording/recording.csv"
            plain = [{k: v for k, v in row.items() if not (drop and k.startswith("image"))} for row in rows]
            write_text(root / name, csv_text(plain))
        if not recording_pictures:
            each = [scene.of_camera(name) for name in scene.cameras] or [scene]
            places = [studio(one.lens, one.picture, stream(scene, "bench")) for one in each]
            lines = [row for one, own in zip(each, places, strict=True) for row in _centrelines(one, own, planned)]
            write_text(root / "recording/centrelines.csv", csv_text(lines))
        taken = [recording_pictures or not shot.path.startswith("recording/") for shot in planned.shots]
        _write_pictures(scene, take, planned, taken, root, 1 if traced else os.cpu_count())
        if labels:
            _write_labels(scene, place, planned, taken, root)
    return planned


def _by_camera(scene: SceneSpec, sheet: Sheet) -> Take:
    """A function that takes pictures as `_drawn_pictures` does, each by the camera that it names."""
    takes = {}
    for index, name in enumerate(scene.cameras):
        one = scene.of_camera(name)
        takes[name] = _drawn_pictures(one, studio(one.lens, one.picture, stream(scene, "bench", index)), sheet)
    return lambda shot, after, rng: takes[shot.camera](shot, after, rng)


def _write_picture(path: Path, picture: np.ndarray) -> None:
    # Noise does not compress: a real search takes three times as long and makes larger files.
    options = (
        *(cv2.IMWRITE_PNG_COMPRESSION, 1),
        *(cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_HUFFMAN_ONLY),
        *(cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_UP),
    )
    path.write_bytes(cv2.imencode(".png", picture, options)[1].tobytes())


def _drawn_pictures(scene: SceneSpec, place: Studio, sheet: Sheet) -> Take:
    """A function that draws pictures with our own renderer, each at one instant."""
    return lambda shot, after, rng: render_shot(scene, place, sheet, shot, rng)


def _write_pictures(
    scene: SceneSpec, take: Take, planned: Plan, taken: Sequence[bool], root: Path, threads: int | None
) -> None:
    following = {} if scene.cameras else dict(_following(planned, 1.0 / scene.recording.rate_hz))

    def write(index: int) -> None:
        # a picture's noise depends on its place in the plan, not on which other pictures are taken
        shot = planned.shots[index]
        _write_picture(root / shot.path, take(shot, following.get(shot.path), stream(scene, "pictures", index)))

    wanted = [index for index, wish in enumerate(taken) if wish]
    with ThreadPoolExecutor(threads) as pool:
        for _ in progress(pool.map(write, wanted), "pictures", len(wanted)):
            pass


def _following(planned: Plan, step_s: float) -> Iterator[tuple[str, AntennaShot]]:
    """For each frame of a stroke but its last: its path, and the next frame's shot."""
    shots = [shot for shot in planned.shots if isinstance(shot, AntennaShot) and shot.path.startswith("recording/")]
    times = [row["time_s"] for row in planned.tables["recording/recording.csv"]]
    for (shot, after), (start, end) in zip(pairwise(shots), pairwise(times), strict=True):
        if end - start < 1.5 * step_s:
            yield shot.path, after


def _write_labels(scene: SceneSpec, place: Studio, planned: Plan, taken: Sequence[bool], root: Path) -> None:
    """Write labels/: a mask for each picture of the antenna, centrelines.csv, contacts.csv."""
    shots = [shot for shot, wish in zip(planned.shots, taken, strict=True) if wish and isinstance(shot, AntennaShot)]
    truths = {f"recording/frame_{row['frame']:04d}.png": row for row in planned.truth["frames"]}
    for folder in {Path(shot.path).parent for shot in shots}:
        (root / "labels" / folder).mkdir(parents=True)
    for shot in shots:
        _write_picture(root / "labels" / shot.path, _antenna_mask(scene, place, shot))
    rows = [row for shot in shots for row in _centreline_rows(scene, place, shot)]
    write_text(root / "labels/centrelines.csv", csv_text(rows))
    contacts = [_contact_row(scene, place, shot, truths.get(shot.path, {})) for shot in shots]
    write_text(root / "labels/contacts.csv", csv_text(contacts))


def _write_sweep(scene: SceneSpec, take: Take, sheet: Sheet, root: Path) -> Pose:
    """Write sweep/*.png and sweep/sweep.csv: a board fixed in the world, always wholly in the picture.

    Returns T_world_board of the printed face. Raises InputError if the board cannot stay in view.
    """
    T_world_board, joints = sweep_of_the_board(scene, outline(sheet))
    folder = root / "sweep"
    folder.mkdir()
    rows: list[dict[str, Any]] = []
    for index, at in enumerate(joints):
        name = f"sweep_{index:03d}.png"
        shot = BoardShot(f"sweep/{name}", at, scene.T_world_camera(at).inverse() @ T_world_board)
        # the sweep's pictures take their noise after all those of the plan
        _write_picture(folder / name, take(shot, None, stream(scene, "pictures", 1_000_000 + index)))
        rows.append({"image": name, "pan_rad": at.pan_rad, "tilt_rad": at.tilt_rad})
    write_text(folder / "sweep.csv", csv_text(rows))
    return T_world_board


def _write_over(
    scene: SceneSpec, place: Studio, sheet: Sheet, root: Path, photographer: TracedPictures | None
) -> dict[str, Any]:
    """Write over/over_000.png …; returns its entry of truth.json."""
    assert scene.over is not None
    folder, over = root / "over", scene.over
    folder.mkdir()
    wires, rng = free_wires(scene, over.joints), stream(scene, "over")
    for index in range(over.pictures):
        drawn = render_over(scene, place, sheet, over, wires, rng) if photographer is None else photographer.over(rng)
        _write_picture(folder / f"over_{index:03d}.png", drawn)
    return {
        "T_antenna_board": over.T_antenna_board(sheet.spec).to_dict(),
        "height_m": over.height_m,
        "tip_antenna_m": wires[0].points_m[-1].tolist(),
    }


def _centrelines(scene: SceneSpec, place: Studio, planned: Plan) -> Iterator[dict[str, Any]]:
    frames = planned.tables["recording/recording.csv"]
    shots = [s for s in planned.shots if isinstance(s, AntennaShot) and s.path.startswith("recording/")]
    own = [shot for shot in shots if shot.camera == scene.camera]
    at = list(scene.cameras).index(scene.camera) if scene.cameras else 0
    std_px = 0.1
    for row, shot in zip(frames, own, strict=True):
        points = _seen_centreline(scene, place, shot)
        noise = stream(scene, "centrelines", int(row["frame"]) + at * len(frames)).standard_normal(len(points))
        for u, v in points[:, :2] + std_px * noise[:, None] * points[:, 2:]:
            pixel = {"u_px": round(float(u), 4), "v_px": round(float(v), 4)}
            named = {"camera": scene.camera} if scene.cameras else {}
            yield {"frame": row["frame"]} | named | pixel | {"sigma_px": std_px}


def _sensor(scene: SceneSpec) -> dict[str, Any]:
    """The sensor's entry of session.yaml."""
    several = scene.wrench
    if several is None:
        return {"moment_sensor": scene.moment and {"std_Nm": scene.moment.std_Nm}}
    std = {"f": ("std_N", several.std_N), "m": ("std_Nm", several.std_Nm)}
    noise = dict(std[name[0]] for name in several.components)
    pose = several.T_antenna_sensor.to_dict()
    return {"wrench_sensor": {"components": list(several.components), **noise, "T_antenna_sensor": pose}}


def _session_yaml(scene: SceneSpec) -> str:
    """The content of session.yaml: what the user of such a rig would know, not the true values."""
    antenna, over = scene.antenna, scene.over
    numbers = ("length_m", "diameter_m", "youngs_modulus_Pa", "density_kg_m3")
    data = {
        "schema": SCHEMA,
        "board": scene.board.to_dict(),
        "antenna": {name: float(getattr(antenna, name)) for name in numbers} | profiles_to_dict(antenna),
        "jig": {"T_antenna_board": scene.T_antenna_board.to_dict()},
        "kinematics": {
            "T_actuator_antenna": scene.kinematics.T_actuator_antenna.to_dict(),
            "position_world_m": scene.kinematics.position_world_m.tolist(),
        },
        **({} if over is None else {"over": {"height_m": over.height_m, **vars(over.joints)}}),
        "gravity_world": scene.gravity_world_m_s2.tolist() if scene.gravity_world_m_s2.any() else None,
        **_sensor(scene),
        **({"cameras": {name: {} for name in scene.cameras}} if scene.cameras else {}),
        # nobody reads a ruler here
        "load_readings": {"distance_std_m": 0.0, "force_std_relative": 0.0},
    }
    return yaml.safe_dump(data, sort_keys=False, default_flow_style=None, width=110)


def _seen_centreline(scene: SceneSpec, place: Studio, shot: AntennaShot) -> np.ndarray:
    """(M, 4) pixels and unit normals, about one per pixel, of the antenna's visible centreline in this shot."""
    return visible_centreline(scene.lens, seen_antenna(scene, shot), obstacle_of(scene, place, shot))
