"""Everything that happens in a session, worked out before the first picture: shapes, readings, truth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..antenna.rod import Rod, RodShape, solve_rod
from ..errors import InputError, SolveError
from ..geometry import Pose
from .board_poses import board_poses
from .paths import sweep_joints
from .scene import Joints, KnownLoad, Scene, true_rod
from .touch import Touch, touch_strokes
from .truth import frame_truth, rig_truth

STREAMS = {"bench": 0, "boards": 1, "moments": 2, "pictures": 3, "centrelines": 4, "over": 5}
"""One independent stream of random numbers for each purpose, so that more of one does not change another."""


def stream(scene: Scene, purpose: str, index: int = 0) -> np.random.Generator:
    """The random numbers of one purpose, or of one picture."""
    return np.random.default_rng(np.random.SeedSequence(scene.seed, spawn_key=(STREAMS[purpose], index)))


@dataclass(frozen=True, eq=False)
class BoardShot:
    """One picture of the board. `path` is relative to the session; the pose is that of the printed face."""

    path: str
    joints: Joints
    T_camera_board: Pose


@dataclass(frozen=True, eq=False)
class AntennaShot:
    """One picture of the antenna.

    Attributes
    ----------
    path : its file, relative to the session.
    arclength_m, points_m : (N,) and (N, 3) the antenna's centreline, antenna frame.
    indentation_m : how far the object gives way to the antenna; None when the object is not there.
    """

    path: str
    joints: Joints
    arclength_m: np.ndarray
    points_m: np.ndarray
    indentation_m: float | None = None


@dataclass(frozen=True, eq=False)
class Plan:
    """A whole session: pictures to take, tables to write (path → rows), truth to keep."""

    shots: Sequence[BoardShot | AntennaShot]
    tables: Mapping[str, Sequence[Mapping[str, Any]]]
    truth: Mapping[str, Any] = field(default_factory=dict)


def plan(scene: Scene) -> Plan:
    """Work out a scene. Raises InputError when path and object do not fit, or a load is too much."""
    rod = true_rod(scene)
    noise = stream(scene, "moments")
    boards = _boards(scene)
    noload, noload_rows, noload_truth = _held(scene, rod, [(j, None) for j in scene.noload], "noload", noise)
    loads, load_rows, load_truth = _held(scene, rod, [(load.joints, load) for load in scene.loads], "loads", noise)
    frames, frame_rows, frame_truth = _recording(scene, rod, noise)
    tables = {
        "noload/noload.csv": noload_rows,
        "loads/loads.csv": load_rows,
        "recording/recording.csv": frame_rows,
    }
    held = {"noload": noload_truth, "loads": load_truth, "frames": frame_truth}
    views = [shot.T_camera_board.to_dict() for shot in boards if shot.path.startswith("intrinsics/")]
    truth = rig_truth(scene, rod) | {"T_camera_board": views} | held
    return Plan([*boards, *noload, *loads, *frames], tables, truth)


def _boards(scene: Scene) -> list[BoardShot]:
    home = Joints(0.0, 0.0)
    poses = board_poses(scene.lens, scene.board, scene.intrinsics, stream(scene, "boards"))
    hand_held = [BoardShot(f"intrinsics/board_{i:03d}.png", home, pose) for i, pose in enumerate(poses)]
    in_jig = scene.T_antenna_camera.inverse() @ scene.T_antenna_face
    return hand_held + [BoardShot(f"plane/jig_{i:03d}.png", home, in_jig) for i in range(scene.jig_pictures)]


def _gravity(scene: Scene, joints: Sequence[Joints]) -> np.ndarray:
    return np.array([scene.T_world_antenna(j).rotation.T @ scene.gravity_world_m_s2 for j in joints])


def _true_moments(shape: RodShape) -> np.ndarray:
    """(B,) x·f_z − z·f_x of all loads, the paper's τ_y: minus the right-handed y moment."""
    return -shape.clamp_moment_Nm[:, 1]


def _readings(scene: Scene, true_Nm: np.ndarray, noise: np.random.Generator) -> np.ndarray:
    sensor = scene.moment
    return sensor.gain * true_Nm + sensor.offset_Nm + sensor.std_Nm * noise.standard_normal(len(true_Nm))


def _row(image: str, joints: Joints, reading_Nm: float) -> dict[str, Any]:
    return {"image": image, "pan_rad": joints.pan_rad, "tilt_rad": joints.tilt_rad, "moment_Nm": reading_Nm}


def _held(
    scene: Scene, rod: Rod, cases: Sequence[tuple[Joints, KnownLoad | None]], folder: str, noise: np.random.Generator
) -> tuple[list[AntennaShot], list[dict[str, Any]], list[dict[str, Any]]]:
    """Pictures, rows and truth of the antenna held still, free or under a known load."""
    joints = [case[0] for case in cases]
    contact = np.array([load.distance_m if load else rod.length_m for _, load in cases])
    force = np.array([[0.0, load.force_y_N, load.force_z_N] if load else [0.0, 0.0, 0.0] for _, load in cases])
    try:
        shape = solve_rod(rod, _gravity(scene, joints), contact, force)
    except SolveError as error:
        where = f"scene {scene.name}: {folder}"
        raise InputError(str(error), where=where, remedy="take a smaller load or a stiffer antenna") from error
    moments = _true_moments(shape)
    shots, rows, truth = [], [], []
    for i, reading in enumerate(_readings(scene, moments, noise)):
        image = f"{folder}_{i:03d}.png"
        shots.append(AntennaShot(f"{folder}/{image}", joints[i], shape.arclength_m[i], shape.points_m[i]))
        load = cases[i][1]
        known = (
            {"distance_m": load.distance_m, "force_y_N": load.force_y_N, "force_z_N": load.force_z_N} if load else {}
        )
        rows.append(_row(image, joints[i], float(reading)) | known)
        truth.append(
            {"image": image, "moment_true_Nm": float(moments[i]), "tip_antenna_m": shape.points_m[i, -1].tolist()}
        )
    return shots, rows, truth


def _pressed(scene: Scene, rod: Rod) -> list[tuple[list[Joints], Touch]]:
    """Each stroke's joint angles and contacts. Raises InputError when the antenna slips off or never touches."""
    sweeps = scene.recording.sweeps
    joints = [sweep_joints(scene, rod, sweep) for sweep in sweeps]
    remedy = "push less, sweep less or move the object"
    where = f"scene {scene.name}: recording.sweeps"
    poses = [[scene.T_world_antenna(j) for j in stroke] for stroke in joints]
    try:
        touches = touch_strokes(rod, scene.radius_m, scene.object, poses, scene.gravity_world_m_s2)
    except SolveError as error:
        raise InputError(str(error), where=where, remedy=remedy) from error
    for number, (sweep, touched) in enumerate(zip(sweeps, touches, strict=True)):
        missed = np.flatnonzero(~touched.in_contact[sweep.free_frames : len(joints[number]) - sweep.free_frames])
        if missed.size:
            raise InputError(
                f"frame {missed[0]} of the stroke passes the object by", where=f"{where}[{number}]", remedy=remedy
            )
    return list(zip(joints, touches, strict=True))


def _recording(
    scene: Scene, rod: Rod, noise: np.random.Generator
) -> tuple[list[AntennaShot], list[dict[str, Any]], list[dict[str, Any]]]:
    shots: list[AntennaShot] = []
    rows: list[dict[str, Any]] = []
    truth: list[dict[str, Any]] = []
    start_s = 0.0
    for joints, touched in _pressed(scene, rod):
        moments = _true_moments(touched.shape)
        readings = _readings(scene, moments, noise)
        for i, at in enumerate(joints):
            frame, image = len(rows), f"frame_{len(rows):04d}.png"
            facts = frame_truth(scene, touched, i, scene.T_world_antenna(at))
            time_s = round(start_s + i / scene.recording.rate_hz, 6)
            rows.append({"frame": frame, "time_s": time_s} | _row(image, at, float(readings[i])))
            truth.append({"frame": frame} | facts | {"moment_true_Nm": float(moments[i])})
            arclength, points = touched.shape.arclength_m[i], touched.shape.points_m[i]
            shots.append(AntennaShot(f"recording/{image}", at, arclength, points, facts["indentation_m"] or 0.0))
        start_s += len(joints) / scene.recording.rate_hz + scene.recording.pause_s
    return shots, rows, truth
