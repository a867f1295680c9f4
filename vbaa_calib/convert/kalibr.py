"""Kalibr's camchain.yaml (ethz-asl/kalibr, wiki: YAML formats, supported models).

- Pixels: its pinhole starts from ((w - 1)/2, (h - 1)/2), so (0, 0) is the centre of the first pixel.
- intrinsics fu fv pu pv; radtan k1 k2 p1 p2 as OpenCV's first four; equidistant k1 k2 k3 k4 as OpenCV's fisheye.
- T_cam_imu takes points of the IMU's frame to the camera's, metres: the inverse of our T_reference_camera, our
  reference (the antenna frame) standing in for the IMU's.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import read_yaml

from .exchanged import Exchanged, Format
from .values import camera_of, held_in, intrinsics, numbers, pose_of, whole

MODELS = {"radtan": "opencv", "equidistant": "fisheye", "none": "opencv"}


def read(path: Path, which: str | None) -> Exchanged:
    """From camchain.yaml; `which` (cam0, cam1, …) where it holds several cameras."""
    name, data = _one_of(read_yaml(path), which, path)
    projection, model = data.get("camera_model"), data.get("distortion_model", "none")
    if projection != "pinhole":
        raise InputError(
            f"{name}: camera_model is {projection!r:.60}", where=path, remedy="only pinhole has a counterpart here"
        )
    if not isinstance(model, str) or model not in MODELS:
        raise InputError(
            f"{name}: distortion_model is {model!r:.60}", where=path, remedy=f"one of {', '.join(MODELS)} is needed"
        )
    size = numbers(data.get("resolution"), f"{name}.resolution", path, (2,))
    width, height = (whole(side, f"{name}.resolution", path) for side in size)
    core = numbers(data.get("intrinsics"), f"{name}.intrinsics", path, (4,))
    coefficients = (
        [] if model == "none" else numbers(data.get("distortion_coeffs"), f"{name}.distortion_coeffs", path, (4,))
    )
    camera = camera_of(MODELS[model], (width, height), core, coefficients, path)
    pose = None if data.get("T_cam_imu") is None else pose_of(data["T_cam_imu"], f"{name}.T_cam_imu", path).inverse()
    alone = pose is None and data.get("T_cn_cnm1") is not None
    notes = (f"{name}.T_cn_cnm1 counts from the camera before it, which is not taken along: left out",) if alone else ()
    return Exchanged(camera, pose, notes=notes)


def write(given: Exchanged) -> str:
    """camchain.yaml with one camera, cam0."""
    camera = given.camera
    coefficients, model = camera.distortion.tolist(), "equidistant"
    if camera.model == "opencv":
        coefficients, model = held_in(camera, (4,), "Kalibr's pinhole-radtan"), "radtan"
    document: dict[str, Any] = {
        "camera_model": "pinhole",
        "intrinsics": intrinsics(camera),
        "distortion_model": model,
        "distortion_coeffs": coefficients,
        "resolution": list(camera.image_size),
        "rostopic": "/camera/image_raw",
    }
    if given.T_reference_camera is not None:
        document = {"T_cam_imu": given.T_reference_camera.inverse().matrix.tolist()} | document
    return yaml.safe_dump({"cam0": document}, sort_keys=False, default_flow_style=None)


def fits(text: str) -> bool:
    """Whether the text has the keys of a camchain."""
    return all(f"{key}:" in text for key in ("cam0", "camera_model", "intrinsics")) or (
        "distortion_coeffs:" in text and "camera_model:" in text
    )


def _one_of(data: dict[str, Any], which: str | None, path: Path) -> tuple[str, dict[str, Any]]:
    names = [str(name) for name, value in data.items() if str(name).startswith("cam") and isinstance(value, dict)]
    if not names:
        raise InputError("holds no camera", where=path, remedy="cam0 with camera_model, intrinsics, … is needed")
    if which is None and len(names) > 1:
        raise InputError(f"holds {', '.join(names)}", where=path, remedy="say which with --camera")
    if which is not None and which not in names:
        raise InputError(f"holds no {which}", where=path, remedy=f"it holds {', '.join(names)}")
    name = which or names[0]
    return name, data[name]


FORMAT = Format("kalibr", "camchain.yaml of Kalibr", read, write, fits, with_pose=True)
