"""A simulated recording of whiskers: antennas next to each other in follicles that move and rotate, one of them at a
post.

The output is a tracker's: the whiskers' pixels from the follicle on. World frame: origin in the picture's middle in the
whiskers' plane, x to the right, y up, z to the camera.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import yaml
from pydantic import Field
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from vbaa_calib.antenna.rod import TORSION_RATIO, Rod
from vbaa_calib.core.csv_rows import csv_text
from vbaa_calib.core.errors import InputError, SolveError
from vbaa_calib.core.files import read_yaml, write_json, write_text
from vbaa_calib.core.folders import replacing_folder
from vbaa_calib.core.models import Number, WholeNumber, array_of, checked
from vbaa_calib.geometry import Pose
from vbaa_calib.session.whiskers import StatedFile

from .contact.touch import Touch, touch
from .scene.objects import TouchObject
from .scene.scene import degrees
from .write import refuse_target

_Small = Annotated[Number, Field(ge=0, le=0.1)]
_Plane = Annotated[np.ndarray, array_of(2, ge=-1, le=1)]


class _WhiskingFile(StatedFile):
    """A scene of whiskers: the stated parameters (here also the true ones) and their motion.

    Follicles move with one frequency; the fields are the amplitudes of the angle in the picture, of their displacement,
    of turns out of the plane and about the whisker's own axis, and of the depth. The post is upright; some whiskers
    reach it.
    """

    VERSION = "vbaa.whisking/1"
    seed: Annotated[WholeNumber, Field(ge=0)] = 1
    frames: Annotated[WholeNumber, Field(ge=1, le=1_000_000)]
    rate_hz: Annotated[Number, Field(gt=0, le=1e6)]
    follicles_m: dict[str, _Plane]
    angles_rad: Annotated[dict[str, Annotated[float, degrees(-180, 180)]], Field(alias="angles_deg")]
    whisk_hz: Annotated[Number, Field(gt=0, le=1e3)]
    swing_rad: Annotated[float, degrees(0, 90), Field(alias="swing_deg")]
    way_m: _Small = 5e-4
    elevation_rad: Annotated[float, degrees(0, 90), Field(alias="elevation_deg")] = 0.0
    roll_rad: Annotated[float, degrees(0, 90), Field(alias="roll_deg")] = 0.0
    depth_m: _Small = 0.0
    post_m: _Plane | None = None
    post_radius_m: Annotated[Number, Field(gt=0, le=0.1)] = 5e-4
    reach_post: list[str] = Field(default_factory=list)
    first_px: Annotated[Number, Field(ge=0, le=100, description="lines begin up to so far from the follicle")] = 1.0
    visible: Annotated[Number, Field(gt=0.1, le=1, description="part of the length that is traced")] = 0.97

    def poses(self, name: str, time_s: np.ndarray) -> list[Pose]:
        """T_world_antenna of a whisker at times (F,)."""
        phase = 2.0 * np.pi * self.whisk_hz * time_s
        angle = self.angles_rad[name] + self.swing_rad * np.sin(phase)
        # the others lag, and turn at frequencies of their own
        up, roll = self.elevation_rad * np.sin(0.77 * phase + 1.0), self.roll_rad * np.sin(phase + 0.5)
        turns = Rotation.from_euler("ZYX", np.column_stack([angle, -up, roll])).as_matrix()
        way = self.way_m * np.column_stack([np.cos(phase), np.sin(phase - 0.6)])
        place = np.column_stack([self.follicles_m[name] + way, self.depth_m * np.sin(0.61 * phase)])
        return [Pose(turn, where) for turn, where in zip(turns, place, strict=True)]

    def pixels(self, points_m: np.ndarray) -> np.ndarray:
        """(N, 2) pinhole projections of world points (N, 3)."""
        view = self.camera
        seen = view.focal_px * points_m[:, :2] / (view.distance_m - points_m[:, 2:])
        return seen * [1.0, -1.0] + view.centre_px


def write_whiskers(path: Path, folder: Path, *, force: bool = False, seed: int | None = None) -> dict[str, Any]:
    """Simulate the scene in a YAML file into a folder: centrelines.csv (antenna,frame,u_px,v_px), readings.csv, the
    stated rig in whiskers.yaml, and the true values in truth.json. Returns the true values.

    Raises InputError for a wrong scene, a whisker that the post bends too far, a folder in the way.
    """
    data = read_yaml(path)
    scene = checked(_WhiskingFile, data, path, "see the bundled scene whiskers")
    for key in ("follicles_m", "angles_deg"):
        if missing := sorted(scene.antennas.keys() - data[key].keys()):
            raise InputError(f"{key} has no {missing[0]}", where=path, remedy="give one for every antenna")
    refuse_target(folder, force, "whiskers.yaml")
    rng = np.random.default_rng(scene.seed if seed is None else seed)
    time_s = np.arange(scene.frames) / scene.rate_hz
    rows: list[dict[str, Any]] = []
    truth: list[dict[str, Any]] = []
    for name in scene.antennas:
        poses = scene.poses(name, time_s)
        touched = _touched(scene, name, poses, path)
        for frame, (pose, pixels) in enumerate(zip(poses, _lines(scene, touched, poses, rng), strict=True)):
            rows += [{"antenna": name, "frame": frame, "u_px": round(u, 3), "v_px": round(v, 3)} for u, v in pixels]
            truth.append({"frame": frame, "antenna": name} | _truth(touched, frame, pose))
    truth.sort(key=lambda row: int(row["frame"]))
    about = {"schema": "vbaa.truth/1", "scene": path.stem, "frames": truth}
    with replacing_folder(folder) as root:
        (root / "whiskers.yaml").write_text(_rig_yaml(data), encoding="utf-8")
        write_text(root / "centrelines.csv", csv_text(rows))
        readings = [{"frame": frame, "time_s": round(float(at), 6)} for frame, at in enumerate(time_s)]
        write_text(root / "readings.csv", csv_text([row | {"pan_rad": 0.0, "tilt_rad": 0.0} for row in readings]))
        write_json(root / "truth.json", about)
    return about


def _touched(scene: _WhiskingFile, name: str, poses: list[Pose], path: Path) -> Touch:
    """The whisker's contacts in every frame; the post is moved far away for whiskers that do not reach it."""
    whisker = scene.antennas[name]
    place = scene.post_m if scene.post_m is not None and name in scene.reach_post else np.array([1e3, 1e3])
    post = TouchObject("cylinder", np.append(place, 0.0), np.array([0.0, 0.0, 1.0]), scene.post_radius_m, 0.1)
    (stiffness, mass), bow = whisker.wire, np.array([0.0, whisker.bow_per_m])
    rod = Rod(whisker.length_m, stiffness, stiffness / TORSION_RATIO, mass, natural_curvature_per_m=bow)
    try:
        return touch(rod, whisker.diameter_m / 2, post, poses, scene.gravity_world)
    except SolveError as error:
        remedy = "move the post towards the tip, or swing less"
        raise InputError(f"whisker {name}: {error}", where=path, remedy=remedy) from error


def _lines(scene: _WhiskingFile, touched: Touch, poses: list[Pose], rng: np.random.Generator) -> Iterator[np.ndarray]:
    """(N, 2) pixels of each frame's line, a pixel apart, beginning at the follicle."""
    step_m = 1e-3 * scene.camera.mm_per_px
    for pose, arclength, points in zip(poses, touched.shape.arclength_m, touched.shape.points_m, strict=True):
        s = np.arange(step_m * scene.first_px * rng.uniform(), scene.visible * arclength[-1], step_m)
        pixels = scene.pixels(pose @ CubicSpline(arclength, points)(s))
        yield pixels + scene.noise_px * rng.standard_normal(pixels.shape)


def _truth(touched: Touch, frame: int, pose: Pose) -> dict[str, Any]:
    """True values of one frame in the form of other scenes' truth.json (None without contact), and the follicle."""
    turn = pose.rotation[:, 0]
    clamp = {"clamp_world_m": pose.translation_m.tolist(), "clamp_angle_rad": math.atan2(turn[1], turn[0])}
    if not touched.in_contact[frame]:
        nothing = dict.fromkeys(("distance_m", "contact_world_m", "force_world_N"))
        return {"in_contact": False, **nothing, "force_N": [0.0, 0.0, 0.0], **clamp}
    force = touched.force_antenna_N[frame]
    return {
        "in_contact": True,
        "distance_m": float(touched.contact_m[frame]),
        "contact_world_m": (pose @ touched.contact_antenna_m[frame]).tolist(),
        "force_world_N": (pose.rotation @ force).tolist(),
        "force_N": force.tolist(),
        **clamp,
    }


def _rig_yaml(data: Mapping[str, Any]) -> str:
    """The content of whiskers.yaml: what the user of such a rig would know, which excludes the bow."""
    antennas = {
        name: {key: value for key, value in whisker.items() if key != "bow_per_m"}
        for name, whisker in data["antennas"].items()
    }
    rig = {"schema": StatedFile.VERSION, "camera": dict(data["camera"]), "antennas": antennas}
    if "gravity_world" in data:
        rig["gravity_world"] = data["gravity_world"]
    return yaml.safe_dump(rig, sort_keys=False, default_flow_style=None, width=110)
