"""Recordings with pictures, rendered, and what goes wrong with pictures: a table of mistakes, each drawn anew."""

from __future__ import annotations

import atexit
import json
import shutil
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml

from vbaa_calib.calibrate.pipeline import calibrate
from vbaa_calib.core.files import read_yaml
from vbaa_calib.core.images import read_picture
from vbaa_calib.rig import Rig
from vbaa_calib.session import Frame, load_session, read_recording
from vbaa_calib.simulate.scene.scene import bundled_scene
from vbaa_calib.simulate.scene.scene_file import load_scene
from vbaa_calib.simulate.write import write_session

from .recordings import DOUBTED, MOVED, NAMED, Mistake, Truth, frozen_rows, neighbour_rows, swapped_rows
from .rigs import NITINOL, STEEL


@dataclass(frozen=True, eq=False)
class Pictured:
    """A recording whose frames have pictures, and what is true of it."""

    rig: Rig
    frames: Sequence[Frame]
    truth: Truth

    def with_pictures(self, change: Callable[[np.ndarray, int], np.ndarray]) -> Pictured:
        """Each picture (H, W) changed, by its frame's index; in a folder that is gone with this process."""
        folder, frames = Path(_folder()), []
        for index, frame in enumerate(self.frames):
            assert frame.image is not None
            path = folder / frame.image.name
            cv2.imwrite(str(path), change(read_picture(frame.image), index))
            frames.append(replace(frame, image=path))
        return replace(self, frames=frames)


def _folder() -> str:
    name = tempfile.mkdtemp(prefix="vbaa-mistakes-")
    atexit.register(shutil.rmtree, name, ignore_errors=True)
    return name


SCENES = {
    "240 mm, 500 px, 30°": (0.24, 8e-4, STEEL, (30.0, 150.0), (502.0, 480)),
    "60 mm, 340 px, 55°": (0.06, 3e-4, STEEL, (55.0, 70.0), (340.0, 640)),
    "500 mm, 1,400 px, upright, nitinol": (0.5, 2e-3, NITINOL, (0.0, 90.0), (1400.0, 1280)),
}
"""Rig → length and diameter of the antenna, its material, where the camera leans to, focal length and width, px."""


def scene_of(name: str, seed: int, frames: int = 20) -> dict[str, Any]:
    """The demo's scene for another rig: all lengths in proportion, forces by stiffness."""
    length, diameter, (modulus, density), (incline, azimuth), (focal, width) = SCENES[name]
    scene: dict[str, Any] = read_yaml(bundled_scene("demo"))
    by, height = length / 0.24, int(0.75 * width)
    stiffer = modulus * diameter**4 / (193e9 * 8e-4**4)

    def larger(mapping: dict[str, Any], *keys: str) -> None:
        for key in keys:
            mapping[key] = (by * np.array(mapping[key], float)).tolist()

    camera = scene["camera"]
    matrix = [[focal, 0.0, 0.496 * width], [0.0, 0.997 * focal, 0.505 * height], [0.0, 0.0, 1.0]]
    camera |= {"image_size": [width, height], "matrix": matrix, "distortion": [-0.12, 0.03, 7e-4, -5e-4]}
    away = focal * length / (0.62 * width)
    camera["pose"] |= {"inclination_deg": incline, "azimuth_deg": azimuth, "distance_m": away}
    larger(camera["pose"], "look_at_m")
    larger(scene["board"], "square_m", "marker_m")
    larger(scene["jig"]["T_antenna_board"], "translation_m")
    scene["antenna"] |= {"diameter_m": diameter, "youngs_modulus_Pa": modulus, "density_kg_m3": density}
    larger(scene["antenna"], "length_m")
    actual = scene["antenna"]["actual"]
    larger(actual, "clamp_offset_m", "holder_m")
    actual["natural_curvature_per_m"] = (np.array(actual["natural_curvature_per_m"]) / by).tolist()
    larger(scene["kinematics"], "position_world_m")
    larger(scene["kinematics"]["T_actuator_antenna"], "translation_m")
    moment = stiffer / by
    sensor = scene["moment_sensor"]
    scene["moment_sensor"] = {"std_Nm": moment * sensor["std_Nm"], "gain": 1.04, "offset_Nm": moment * 1.5e-4}
    larger(scene["object"], "center_world_m", "radius_m", "half_length_m")
    scene["object"]["stiffness_N_m"] *= stiffer / by**3
    for load in scene["loads"]:
        load["distance_m"] = round(by * load["distance_m"], 4)
        for key in ("force_y_N", "force_z_N"):
            load[key] = float(f"{stiffer / by**2 * load[key]:.4g}")
    scene["intrinsics"] |= {"pictures": 10, "distance_m": [0.75 * away, 1.25 * away]}
    scene["recording"]["rate_hz"] *= min(1.0, by**-2.0)  # a long one swings slowly
    for sweep in scene["recording"]["sweeps"]:
        sweep |= {"frames": frames, "free_frames": 6}
    scene |= {"name": "pictures", "seed": seed}
    return scene


@cache
def clean_pictures(name: str, seed: int, traced: bool = False) -> Pictured:
    """A recording with pictures, on a rig calibrated from pictures; traced: by the second renderer."""
    folder = Path(_folder())
    (folder / "scene.yaml").write_text(yaml.safe_dump(scene_of(name, seed)))
    write_session(load_scene(folder / "scene.yaml"), folder / "session", traced=traced)
    session = load_session(folder / "session")
    rig = calibrate(session).rig
    truths = json.loads((folder / "session" / "truth.json").read_text())["frames"]

    def column(key: str, size: int) -> np.ndarray:
        none = [np.nan] * size
        return np.array([none if one[key] is None else np.atleast_1d(one[key]) for one in truths], float)

    touched = np.where([one["in_contact"] for one in truths], 1.0, np.nan)[:, None]
    distance, force, place = (
        touched * column(key, size) for key, size in (("distance_m", 1), ("force_N", 3), ("contact_world_m", 3))
    )
    return Pictured(rig, list(read_recording(session)), Truth(distance[:, 0], force, place))


Changed = Callable[[Pictured, np.random.Generator], Pictured]


def _warped(points: Callable[[Pictured, np.random.Generator], np.ndarray]) -> Changed:
    """Pictures in which each pixel is moved by a matrix (3, 3)."""

    def altered(was: Pictured, rng: np.random.Generator) -> Pictured:
        matrix = points(was, rng)
        size = was.rig.camera.image_size
        return was.with_pictures(
            lambda picture, _: cv2.warpPerspective(
                picture, matrix, size, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE
            )
        )

    return altered


def _scale(was: Pictured, by: float, centre: np.ndarray) -> np.ndarray:
    return np.array([[by, 0.0, (1 - by) * centre[0]], [0.0, by, (1 - by) * centre[1]], [0.0, 0.0, 1.0]])


def _shift(was: Pictured, rng: np.random.Generator) -> np.ndarray:
    around, by = rng.uniform(0, 2 * np.pi), rng.uniform(5.0, 15.0)
    return np.array([[1.0, 0.0, by * np.cos(around)], [0.0, 1.0, by * np.sin(around)], [0.0, 0.0, 1.0]])


def _turn(was: Pictured, rng: np.random.Generator) -> np.ndarray:
    """What a turn of the camera makes of a picture, but for the lens' distortion."""
    matrix, way = was.rig.camera.matrix, rng.normal(size=3)
    turn = cv2.Rodrigues(np.radians(rng.uniform(0.3, 0.6)) * way / np.linalg.norm(way))[0]
    return np.asarray(matrix @ turn @ np.linalg.inv(matrix))


def _focus(was: Pictured, rng: np.random.Generator) -> np.ndarray:
    by = 1.0 + rng.choice([-1.0, 1.0]) * rng.uniform(0.008, 0.03)
    return _scale(was, by, was.rig.camera.matrix[:2, 2])


def _crop(was: Pictured, rng: np.random.Generator) -> np.ndarray:
    return _scale(was, 1.0 / rng.uniform(0.8, 0.93), rng.uniform(0.3, 0.7, 2) * was.rig.camera.image_size)


def _reduced(was: Pictured, rng: np.random.Generator) -> np.ndarray:
    return _scale(was, rng.choice([0.5, 0.8, 0.9]), np.zeros(2))


def _each(change: Callable[[np.ndarray], np.ndarray]) -> Changed:
    return lambda was, rng: was.with_pictures(lambda picture, _: np.ascontiguousarray(change(picture)))


def _rectified(was: Pictured, rng: np.random.Generator) -> Pictured:
    camera = was.rig.camera
    return was.with_pictures(lambda picture, _: cv2.undistort(picture, camera.matrix, camera.distortion))


def _rows(which: Callable[[int, np.random.Generator], np.ndarray]) -> Changed:
    """Pictures of other rows."""

    def altered(was: Pictured, rng: np.random.Generator) -> Pictured:
        rows = which(len(was.frames), rng).tolist()
        images = [was.frames[row].image for row in rows]
        return replace(was, frames=[replace(one, image=image) for one, image in zip(was.frames, images, strict=True)])

    return altered


def _row(what: str, must: str, right: str, altered: Changed, says: str = "") -> Mistake[Pictured]:
    return Mistake(what, must, frozenset(right.split()), altered, says)


SCALED = "picture_scaled picture_cropped focus_changed"
PICTURES = (
    _row("pictures mirrored", NAMED, "picture_mirrored", _each(lambda p: p[:, ::-1])),
    _row("pictures upside down", NAMED, "picture_mirrored picture_turned", _each(lambda p: p[::-1])),
    _row("pictures turned by 180°", NAMED, "picture_turned", _each(lambda p: p[::-1, ::-1])),
    _row("pictures turned by 90°", NAMED, "picture_turned", _each(np.rot90), "resolution"),
    _row(
        *("pictures of half the size", NAMED, "picture_scaled"),
        _each(lambda p: cv2.resize(p, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)),
        "resolution",
    ),
    _row("pictures reduced within their size", NAMED, SCALED, _warped(_reduced)),
    _row("pictures cropped and enlarged", NAMED, SCALED, _warped(_crop)),
    _row("pictures rectified", NAMED, f"picture_rectified {SCALED}", _rectified),
    _row("pictures shifted by 5 to 15 px", NAMED, MOVED, _warped(_shift)),
    _row("camera turned by 0.3 to 0.6°", NAMED, MOVED, _warped(_turn)),
    _row("refocused by 0.8 to 3 %", NAMED, SCALED, _warped(_focus)),
    _row(
        "camera frozen for 8 to 16 frames",
        NAMED,
        "camera_frozen",
        _rows(lambda count, rng: frozen_rows(count, rng, (0.2, 0.6), 16)),
    ),
    _row(
        "two pictures exchanged", DOUBTED, "pictures_exchanged", _rows(lambda count, rng: swapped_rows(count, rng, 0))
    ),
    _row("pictures of the neighbour rows", NAMED, "pictures_late clock_offset", _rows(neighbour_rows)),
)
"""The matrix's rows about pictures. Edit the names of the findings here."""
