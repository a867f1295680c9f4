"""A simulated rig, calibrated as its own truth with honest deviations, and what it looks like after a month."""

from __future__ import annotations

import shutil
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from targets.board import BoardSpec
from vbaa_calib.antenna.rod import solve_rod
from vbaa_calib.calibrate.check.assessment import Assessment
from vbaa_calib.camera import Camera
from vbaa_calib.rig import Antenna, AntennaImage, MomentSensor, Rig
from vbaa_calib.session import Still
from vbaa_calib.simulate.plan import AntennaShot, BoardShot, plan, stream
from vbaa_calib.simulate.render.board import Sheet, print_sheet
from vbaa_calib.simulate.render.picture import Studio, studio
from vbaa_calib.simulate.scene.scene import Joints, SceneSpec, bundled_scene, true_rod
from vbaa_calib.simulate.scene.scene_file import load_scene
from vbaa_calib.simulate.shots import render_shot
from vbaa_calib.simulate.write import _session_yaml

from ..csv_files import write_rows
from ..made_once import made_once

PARTS = ("intrinsics", "plane", "noload", "loads")
LENS_STD = np.array([0.12, 0.12, 0.15, 0.13, 2e-4, 6e-4, 2e-5, 2e-5, 1e-3])
RIG_STD = np.array([5e-5] * 3 + [5e-5] * 3 + [5e-5] * 2 + [1e-4] * 2 + [1e-3] * 2 + [3e-4, 5e-3, 5e-5, 1.5e-3, 7e-6])
QUALITY: dict[str, Any] = {
    "lens_rms_px": 0.05,
    "plane_rms_px": 0.04,
    "plane_second_solution_ratio": 4.0,
    "warnings": [],
    "lens": {
        "verdict": "This lens can be trusted.",
        "rms_inliers_px": 0.045,
        "warnings": [],
        "dropped": [{"name": "board_007.png", "reason": "its corners lie (nearly) on a line"}],
        "model_comparison": [
            {"model": "opencv5", "free_parameters": 9, "rms_px": 0.045, "held_out_rms_px": 0.047, "monotonic": True}
        ],
    },
    "antenna": {"nominal_stiffness_Nm2": 3.88e-3},
}
"""Of rig.json."""


def answers(found: Assessment) -> dict[str, str]:
    """Levels of the answers from new pictures, by question."""
    return {one.name: one.level for one in found.session_findings}


def changed_answers(found: Assessment) -> set[str]:
    """Questions about new pictures whose answers are bad."""
    return {name for name, level in answers(found).items() if level not in ("holds", "not given")}


@cache
def scene() -> SceneSpec:
    """The upright camera of the bundled scene, with few pictures."""
    whole = load_scene(bundled_scene("upright_knife"))
    loads = (whole.loads[0], whole.loads[8])
    few = replace(whole.intrinsics, pictures=4)
    stroke = replace(whole.recording.sweeps[0], frames=1, free_frames=0)
    return replace(
        whole,
        seed=7,
        jig_pictures=1,
        noload=whole.noload[:1],
        loads=loads,
        intrinsics=few,
        recording=replace(whole.recording, sweeps=(stroke,)),
    )


def rig_of(scene: SceneSpec, seed: int = 3) -> Rig:
    """The rig that a calibration of the scene could have found: its truth, off as its deviations say."""
    rng, true = np.random.default_rng(seed), scene.true
    off = RIG_STD * rng.normal(size=17)
    lens = LENS_STD * rng.normal(size=9)
    matrix = scene.lens.matrix.copy()
    matrix[[0, 1, 0, 1], [0, 1, 2, 2]] += lens[:4]
    covariance = np.zeros((26, 26))
    covariance[:17, :17], covariance[17:, 17:] = np.diag(RIG_STD**2), np.diag(LENS_STD**2)
    nominal = scene.antenna
    parameters = np.concatenate(
        [
            true.clamp_offset_m[1:],
            true.clamp_angle_rad,
            true.natural_curvature_per_m,
            [np.log(nominal.stiffness_Nm2 * true.stiffness_factor), np.log(nominal.mass_per_length_kg_m), 0.0],
        ]
    )
    camera = Camera("opencv", scene.lens.image_size, matrix, scene.lens.distortion + lens[4:], np.diag(LENS_STD**2))
    return Rig(
        camera=camera,
        T_antenna_camera=scene.T_antenna_camera.retract(off[:6]),
        antenna=Antenna(nominal.length_m, nominal.diameter_m, parameters + off[6:15]),
        moment_sensor=MomentSensor(scene.moment.gain + off[15], scene.moment.offset_Nm + off[16], scene.moment.std_Nm),
        kinematics=scene.kinematics,
        gravity_world_m_s2=scene.gravity_world_m_s2,
        image=AntennaImage(0.05, 1.0, True),
        covariance=covariance,
    )


def rig_document(scene: SceneSpec, seed: int = 3) -> dict[str, Any]:
    """rig.json of `rig_of`, with board and jig recorded as `vbaa calibrate` does."""
    lens = dict(QUALITY["lens"]) | {"board": scene.board.to_dict()}
    recorded = {"lens": lens, "jig": {"T_antenna_board": scene.T_antenna_face.to_dict()}}
    return rig_of(scene, seed).to_dict() | {"quality": QUALITY | recorded}


def with_camera_moved(scene: SceneSpec, step: np.ndarray) -> SceneSpec:
    """The camera a step (6,) away from where it was."""
    return replace(scene, T_antenna_camera=scene.T_antenna_camera.retract(step))


def with_lens(scene: SceneSpec, factor: float) -> SceneSpec:
    """Refocused: another focal length."""
    matrix = scene.lens.matrix.copy()
    matrix[[0, 1], [0, 1]] *= factor
    return replace(scene, lens=replace(scene.lens, matrix=matrix))


def with_clamp_turned(scene: SceneSpec, about_z_rad: float, about_y_rad: float = 0.0) -> SceneSpec:
    """The clamp slipped."""
    angles = scene.true.clamp_angle_rad + np.array([about_y_rad, about_z_rad])
    return replace(scene, true=replace(scene.true, clamp_angle_rad=angles))


def with_wire_bent(scene: SceneSpec, about_z_per_m: float, about_y_per_m: float = 0.0) -> SceneSpec:
    """The wire has another bow."""
    bow = scene.true.natural_curvature_per_m + np.array([about_y_per_m, about_z_per_m])
    return replace(scene, true=replace(scene.true, natural_curvature_per_m=bow))


def with_stiffness(scene: SceneSpec, factor: float) -> SceneSpec:
    """Another wire."""
    return replace(scene, true=replace(scene.true, stiffness_factor=factor * scene.true.stiffness_factor))


def with_sensor(scene: SceneSpec, gain: float = 1.0, offset_Nm: float = 0.0) -> SceneSpec:
    """The moment sensor's gain by a factor and its offset by an amount."""
    sensor = scene.moment
    return replace(scene, moment=replace(sensor, gain=gain * sensor.gain, offset_Nm=sensor.offset_Nm + offset_Nm))


@cache
def _sheet(spec: BoardSpec) -> Sheet:
    return print_sheet(spec)


@cache
def _studio(matrix: bytes, distortion: bytes, seed: int, bench: int | None) -> Studio:
    """Of the scene with this lens: working out the ray of each pixel takes longer than the pictures.

    bench : what lies behind; None for what the scene has of this seed.
    """
    seen = replace(scene(), seed=seed)
    own = replace(seen.lens, matrix=np.frombuffer(matrix).reshape(3, 3), distortion=np.frombuffer(distortion))
    rng = stream(seen, "bench") if bench is None else np.random.default_rng(bench)
    return studio(own, seen.picture, rng)


def one_picture_each(scene: SceneSpec, folder: Path) -> tuple[Path, Still]:
    """One picture of the board in its jig and one of the free antenna, as it now is, with the sensor's reading.

    The bench behind them is one of four, by the scene's seed.
    """
    joints, rod, sensor = scene.noload[0], true_rod(scene), scene.moment
    gravity = scene.T_world_antenna(joints).rotation.T @ scene.gravity_world_m_s2
    shape = solve_rod(rod, gravity[None], np.array([rod.length_m]), np.zeros((1, 3)))
    in_jig = scene.T_antenna_camera.inverse() @ scene.T_antenna_face
    shots: tuple[BoardShot | AntennaShot, ...] = (
        BoardShot("board.png", Joints(0.0, 0.0), in_jig),
        AntennaShot("free.png", joints, shape.arclength_m[0], shape.points_m[0]),
    )
    place = _studio(scene.lens.matrix.tobytes(), scene.lens.distortion.tobytes(), 0, scene.seed % 4)
    for index, shot in enumerate(shots):
        picture = render_shot(scene, place, _sheet(scene.board), shot, stream(scene, "pictures", index))
        cv2.imwrite(str(folder / shot.path), picture, [cv2.IMWRITE_PNG_COMPRESSION, 1])
    noise_Nm = sensor.std_Nm * stream(scene, "moments").standard_normal()
    reading_Nm = sensor.offset_Nm - sensor.gain * float(shape.clamp_moment_Nm[0, 1]) + noise_Nm
    return folder / "board.png", Still(folder / "free.png", joints.pan_rad, joints.tilt_rad, reading_Nm)


def unchanged() -> Path:
    """A session of the unchanged scene, made once. Never to be written to."""
    return made_once("unchanged", lambda folder: month_later(scene(), folder / "session")) / "session"


def only(session: Path, target: Path, parts: tuple[str, ...]) -> Path:
    """A copy of a session with some of its parts."""
    target.mkdir()
    shutil.copy(session / "session.yaml", target)
    for part in parts:
        shutil.copytree(session / part, target / part)
    return target


def month_later(scene: SceneSpec, folder: Path, parts: tuple[str, ...] = PARTS) -> Path:
    """A session of the scene as it now is, with some of its parts."""
    planned = plan(scene)
    place = _studio(scene.lens.matrix.tobytes(), scene.lens.distortion.tobytes(), scene.seed, None)
    folder.mkdir()
    (folder / "session.yaml").write_text(_session_yaml(scene))
    for index, shot in enumerate(planned.shots):
        part = shot.path.partition("/")[0]
        if part in parts:
            (folder / part).mkdir(exist_ok=True)
            picture = render_shot(scene, place, _sheet(scene.board), shot, stream(scene, "pictures", index))
            cv2.imwrite(str(folder / shot.path), picture, [cv2.IMWRITE_PNG_COMPRESSION, 1])
    for name, rows in planned.tables.items():
        if name.partition("/")[0] in parts:
            write_rows(folder / name, rows)
    return folder
