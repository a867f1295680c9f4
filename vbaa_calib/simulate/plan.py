"""The plan of a session, made before the first picture: shapes, readings, true values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from targets.board import BoardWithIds
from vbaa_calib.antenna.rod import Rod, RodShape, solve_rod
from vbaa_calib.core.errors import InputError, SolveError, about
from vbaa_calib.geometry import Pose
from vbaa_calib.native import core
from vbaa_calib.session import READINGS
from vbaa_calib.simulate.contact.stick_slip import Setting
from vbaa_calib.simulate.contact.touch import Touch, touch_strokes
from vbaa_calib.simulate.scene.lens import Lens, normalise, project
from vbaa_calib.simulate.scene.scene import IntrinsicsSpec, Joints, KnownLoad, SceneSpec, true_rod

from .joint_paths import sweep_joints


def _board_poses(lens: Lens, board: BoardWithIds, spec: IntrinsicsSpec, rng: np.random.Generator) -> list[Pose]:
    """T_camera_board of every lens picture: in the middle of the picture, and reaching its borders and corners."""
    size, middle_m = np.array(board.size_m), board.outline_m.mean(axis=0)
    focal = np.diag(lens.matrix)[:2]
    middle = (np.array(lens.image_size) - 1) / 2
    poses = []
    places = ((0, 0), (-1, -1), (1, 1), (1, -1), (-1, 1), (-1, 0), (1, 0), (0, -1), (0, 1))
    for index in range(spec.pictures):
        distance, tilt = rng.uniform(*spec.distance_m), rng.uniform(*spec.tilt_rad)
        # the golden angle spreads directions evenly
        around = index * (np.pi * (3.0 - np.sqrt(5.0))) + rng.uniform(-0.3, 0.3)
        turn = Pose.from_rotvec(tilt * np.array([np.cos(around), np.sin(around), 0.0]), np.zeros(3))
        rotation = turn.rotation @ Pose.from_rotvec(np.array([0.0, 0.0, rng.uniform(-0.5, 0.5)]), np.zeros(3)).rotation
        # part of the board's half that must stay inside
        room = np.maximum(middle - 0.9 * focal * size / (2 * distance), 0.0)
        pixel = middle + room * places[index % len(places)] * rng.uniform(0.85, 1.0)
        centre = distance * np.append(normalise(lens, pixel[None])[0], 1.0)
        poses.append(Pose(rotation, centre - rotation[:, :2] @ middle_m))
    return poses


def _frame_truth(scene: SceneSpec, rod: Rod, touched: Touch, index: int, T_world_antenna: Pose) -> dict[str, Any]:
    """True values of one frame; None without contact."""
    contact = T_world_antenna @ touched.contact_antenna_m[index]
    surface, normal = touched.touched_world_m[index], touched.normal_world[index]
    radius_m = scene.radius_m * rod.taper.diameter(touched.contact_m[index] / rod.length_m)
    truth = {
        "in_contact": True,
        "distance_m": float(touched.contact_m[index]),
        "force_N": touched.force_antenna_N[index].tolist(),
        "contact_antenna_m": touched.contact_antenna_m[index].tolist(),
        "contact_world_m": contact.tolist(),
        "touched_world_m": surface.tolist(),
        "normal_world": normal.tolist(),
        "indentation_m": float(np.maximum(radius_m - (contact - surface) @ normal, 0.0)),
        "sticks": bool(touched.sticks[index]),
        "slip_world_m": touched.slip_world_m[index].tolist(),
    }
    if touched.in_contact[index]:
        return truth
    return dict.fromkeys(truth) | {"in_contact": False, "force_N": [0.0, 0.0, 0.0], "sticks": False}


def _plain(data: Any) -> dict[str, Any]:
    """A dataclass as JSON data: lists for arrays, null for infinite numbers."""
    fields = {name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in vars(data).items()}
    return {name: None if value == np.inf else value for name, value in fields.items()}


def _rig_truth(scene: SceneSpec, rod: Rod) -> dict[str, Any]:
    """True values of the rig, its sensors and the object."""
    return {
        "schema": "vbaa.truth/1",
        "scene": scene.name,
        "seed": scene.seed,
        "camera": _plain(scene.lens),
        "T_antenna_camera": scene.T_antenna_camera.to_dict(),
        "stiffness_Nm2": rod.bending_stiffness_Nm2,
        "antenna": {
            "length_m": rod.length_m,
            "diameter_m": scene.antenna.diameter_m,
            **({"pieces": rod.taper.pieces.tolist()} if rod.taper else {}),
            "torsional_stiffness_Nm2": rod.torsional_stiffness_Nm2,
            "mass_per_length_kg_m": rod.mass_per_length_kg_m,
            "T_antenna_clamp": rod.T_antenna_clamp.to_dict(),
            "clamp_angle_rad": scene.true.clamp_angle_rad.tolist(),
            "natural_curvature_per_m": rod.natural_curvature_per_m.tolist(),
        },
        "moment_sensor": scene.moment and {"std_Nm": scene.moment.std_Nm, **_plain(scene.moment)},
        "wrench_sensor": scene.wrench
        and _plain(scene.wrench) | {"T_antenna_sensor": scene.wrench.T_antenna_sensor.to_dict()},
        "object": _plain(scene.object) | {"bumps": [_plain(bump) for bump in scene.object.bumps]},
    }


def stream(scene: SceneSpec, purpose: str, index: int = 0) -> np.random.Generator:
    """The random generator of one purpose, or of one picture."""
    # an independent stream of random numbers for each purpose
    streams = {"bench": 0, "boards": 1, "moments": 2, "pictures": 3, "centrelines": 4, "over": 5}
    return np.random.default_rng(np.random.SeedSequence(scene.seed, spawn_key=(streams[purpose], index)))


@dataclass(frozen=True, eq=False)
class BoardShot:
    """One planned picture of the board. path : relative to the session. The pose is of the printed face. camera :
    the camera's name, if there are several."""

    path: str
    joints: Joints
    T_camera_board: Pose
    camera: str = ""


@dataclass(frozen=True, eq=False)
class AntennaShot:
    """One planned picture of the antenna.

    Attributes
    ----------
    path : its file, relative to the session.
    arclength_m, points_m : (N,) and (N, 3) the antenna's centreline, antenna frame.
    indentation_m : how far the object yields; None without the object. camera : its name, of several.
    """

    path: str
    joints: Joints
    arclength_m: np.ndarray
    points_m: np.ndarray
    indentation_m: float | None = None
    camera: str = ""


@dataclass(frozen=True, eq=False)
class Plan:
    """A planned session: pictures to take, tables to write (path → rows), true values."""

    shots: Sequence[BoardShot | AntennaShot]
    tables: Mapping[str, Sequence[Mapping[str, Any]]]
    truth: Mapping[str, Any] = field(default_factory=dict)


def plan(scene: SceneSpec, readout: float = 0.0) -> Plan:
    """Plan a scene. Raises InputError if the strokes miss the object, or a load is too large.

    readout : time between a recorded picture's first row and its last, as a fraction of that between two frames.
    """
    rod = true_rod(scene)
    noise = stream(scene, "moments")
    home = Joints(0.0, 0.0)
    poses = _board_poses(scene.lens, scene.board, scene.intrinsics, stream(scene, "boards"))
    in_jig = scene.T_antenna_camera.inverse() @ scene.T_antenna_face
    boards = [BoardShot(f"intrinsics/board_{i:03d}.png", home, pose) for i, pose in enumerate(poses)]
    boards += [BoardShot(f"plane/jig_{i:03d}.png", home, in_jig) for i in range(scene.jig_pictures)]
    noload, noload_rows, noload_truth = _held(scene, rod, scene.noload, "noload", noise)
    loads, load_rows, load_truth = _held(scene, rod, scene.loads, "loads", noise)
    frames, frame_rows, frame_truth = _recording(scene, rod, noise, readout)
    tables = {"noload/noload.csv": noload_rows, "loads/loads.csv": load_rows, "recording/recording.csv": frame_rows}
    truths = {"noload": noload_truth, "loads": load_truth, "frames": frame_truth}
    truth = _rig_truth(scene, rod) | {"T_camera_board": [pose.to_dict() for pose in poses]} | truths
    planned = Plan([*boards, *noload, *loads, *frames], tables, truth)
    return _for_cameras(scene, planned) if scene.cameras else planned


def _for_cameras(scene: SceneSpec, planned: Plan) -> Plan:
    """The plan for several cameras: each takes its own pictures of the board, and all take pictures of the antenna."""
    shots: list[BoardShot | AntennaShot] = []
    of_antenna = [shot for shot in planned.shots if isinstance(shot, AntennaShot)]
    for index, name in enumerate(scene.cameras):
        one = scene.of_camera(name)
        poses = _board_poses(one.lens, one.board, one.intrinsics, stream(scene, "boards", index))
        in_jig = one.T_antenna_camera.inverse() @ one.T_antenna_face
        named = [(f"intrinsics/{name}/board_{i:03d}.png", pose) for i, pose in enumerate(poses)]
        named += [(f"plane/{name}/jig_{i:03d}.png", in_jig) for i in range(scene.jig_pictures)]
        shots += [BoardShot(path, Joints(0.0, 0.0), pose, name) for path, pose in named]
        for shot in of_antenna:
            folder, file = shot.path.split("/")
            shots.append(replace(shot, path=f"{folder}/{name}/{file}", camera=name))
    tables = {
        path: [
            {
                (f"{key}_{name}" if key == "image" else key): f"{name}/{value}" if key == "image" else value
                for key, value in row.items()
                for name in (scene.cameras if key == "image" else ("",))
            }
            for row in rows
        ]
        for path, rows in planned.tables.items()
    }
    cameras = {
        name: {"camera": _plain(lens), "T_antenna_camera": pose.to_dict()}
        for name, (lens, pose) in scene.cameras.items()
    }
    return Plan(shots, tables, dict(planned.truth) | {"cameras": cameras})


def _measured(
    scene: SceneSpec,
    rod: Rod,
    shape: RodShape,
    force_N: np.ndarray,
    gravity_m_s2: np.ndarray,
    noise: np.random.Generator,
) -> tuple[list[float], list[dict[str, float]]]:
    """The true moments x·f_z − z·f_x (the paper's τ_y) of forces (B, 3) and weight, and the sensor's readings, by
    column."""
    # minus the right-handed y moment
    true_Nm, sensor, several = -shape.clamp_moment_Nm[:, 1], scene.moment, scene.wrench
    if several is not None:
        weight = rod.mass_per_length_kg_m * rod.length_m * gravity_m_s2
        read = several.read(several.true(force_N + weight, shape.clamp_moment_Nm), noise)
        columns = [READINGS[name] for name in several.components]
        return true_Nm.tolist(), [dict(zip(columns, row, strict=True)) for row in read.tolist()]
    if sensor is None:
        return true_Nm.tolist(), [{}] * len(true_Nm)
    readings = sensor.gain * true_Nm + sensor.offset_Nm + sensor.std_Nm * noise.standard_normal(len(true_Nm))
    return true_Nm.tolist(), [{"moment_Nm": reading} for reading in readings.tolist()]


def _row(image: str, joints: Joints, readings: Mapping[str, float]) -> dict[str, Any]:
    return {"image": image, "pan_rad": joints.pan_rad, "tilt_rad": joints.tilt_rad, **readings}


def _held(
    scene: SceneSpec, rod: Rod, cases: Sequence[Joints | KnownLoad], folder: str, noise: np.random.Generator
) -> tuple[list[AntennaShot], list[dict[str, Any]], list[dict[str, Any]]]:
    """Pictures, rows and true values of the antenna at rest, free or under a known load."""
    gravity = np.array([scene.T_world_antenna(at).rotation.T @ scene.gravity_world_m_s2 for at in cases])
    loads = [
        {name: getattr(case, name) for name in ("distance_m", "force_y_N", "force_z_N")}
        if isinstance(case, KnownLoad)
        else {}
        for case in cases
    ]
    contact = np.array([load.get("distance_m", rod.length_m) for load in loads])
    force = np.array([[0.0, load.get("force_y_N", 0.0), load.get("force_z_N", 0.0)] for load in loads])
    try:
        shape = solve_rod(rod, gravity, contact, force)
    except SolveError as error:
        where = f"scene {scene.name}: {folder}"
        raise InputError(str(error), where=where, remedy="take a smaller load or a stiffer antenna") from error
    shots, rows, truth = [], [], []
    for i, (moment, reading) in enumerate(zip(*_measured(scene, rod, shape, force, gravity, noise), strict=True)):
        image, points = f"{folder}_{i:03d}.png", shape.points_m[i]
        shots.append(AntennaShot(f"{folder}/{image}", cases[i], shape.arclength_m[i], points))
        rows.append(_row(image, cases[i], reading) | loads[i])
        truth.append({"image": image, "moment_true_Nm": moment, "tip_antenna_m": points[-1].tolist()})
    return shots, rows, truth


def _pressed(scene: SceneSpec, rod: Rod) -> list[tuple[list[Joints], Touch]]:
    """Each stroke's joint angles and contacts. Raises InputError when the antenna slips off or never touches."""
    sweeps = scene.recording.sweeps
    remedy = "push less, sweep less or move the object"
    where = f"scene {scene.name}: recording.sweeps"
    setting = Setting(rod, scene.radius_m, scene.object, scene.gravity_world_m_s2)
    with about(where):
        joints = [sweep_joints(setting, scene.kinematics, sweep) for sweep in sweeps]
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
    scene: SceneSpec, rod: Rod, noise: np.random.Generator, readout: float
) -> tuple[list[AntennaShot], list[dict[str, Any]], list[dict[str, Any]]]:
    shots: list[AntennaShot] = []
    rows: list[dict[str, Any]] = []
    truth: list[dict[str, Any]] = []
    start_s = 0.0
    for joints, touched in _pressed(scene, rod):
        gravity = np.array([scene.T_world_antenna(at).rotation.T @ scene.gravity_world_m_s2 for at in joints])
        force = np.where(touched.in_contact[:, None], touched.force_antenna_N, 0.0)
        measured = _measured(scene, rod, touched.shape, force, gravity, noise)
        for i, (moment, reading) in enumerate(zip(*measured, strict=True)):
            frame, image, at = len(rows), f"frame_{len(rows):04d}.png", joints[i]
            facts = _frame_truth(scene, rod, touched, i, scene.T_world_antenna(at))
            time_s = round(start_s + i / scene.recording.rate_hz, 6)
            rows.append({"frame": frame, "time_s": time_s} | _row(image, at, reading))
            truth.append({"frame": frame} | facts | {"moment_true_Nm": moment})
            arclength, points = touched.shape.arclength_m[i], _rolled(scene, touched.shape, i, readout)
            shots.append(AntennaShot(f"recording/{image}", at, arclength, points, facts["indentation_m"] or 0.0))
        start_s += len(joints) / scene.recording.rate_hz + scene.recording.pause_s
    return shots, rows, truth


def _rolled(scene: SceneSpec, shape: RodShape, index: int, readout: float) -> np.ndarray:
    """(N, 3) a moving antenna as a rolling shutter sees it: each point at the time when its picture row is read.

    The middle row is read at the frame's time. In the last frame of a stroke all rows are read at that time.
    """
    s, now = shape.arclength_m[index], shape.points_m[index]
    if readout == 0.0 or index + 1 == len(shape.points_m):
        return now
    motion, points = core.simulate.spline(shape.arclength_m[index + 1], shape.points_m[index + 1], s)[0] - now, now
    # each round brings row and instant together by the factor rows over motion
    for _ in range(8):
        row = project(scene.lens, scene.T_antenna_camera.inverse() @ points)[:, 1]
        share = readout * (np.clip(row / (scene.lens.image_size[1] - 1), 0.0, 1.0) - 0.5)
        points = now + share[:, None] * motion
    return points
