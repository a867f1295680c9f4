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

from vbaa_calib.core.files import read_yaml

from .values import (
    Exchanged,
    Format,
    checked,
    intrinsics,
    matrix_of,
    numbers,
    one_of,
    pose_of,
    size_of,
    stated,
    which_of,
)

_MODELS = {"radtan": "opencv", "equidistant": "fisheye", "none": "opencv"}


def _read(path: Path, which: str | None) -> Exchanged:
    """`which` (cam0, cam1, …) where it holds several cameras."""
    data = {str(name): each for name, each in read_yaml(path).items() if str(name).startswith("cam")}
    name = which_of([name for name, each in data.items() if isinstance(each, dict)], which, path)
    data = data[name]
    one_of(data.get("camera_model"), ("pinhole",), f"{name}: camera_model", path)
    model = one_of(data.get("distortion_model", "none"), _MODELS, f"{name}: distortion_model", path)
    key = f"{name}.resolution"
    size = size_of([(key, side) for side in numbers(data.get("resolution"), key, path, (2,))], path)
    core = numbers(data.get("intrinsics"), f"{name}.intrinsics", path, (4,))
    given = [] if model == "none" else data.get("distortion_coeffs")
    coefficients = numbers(given, f"{name}.distortion_coeffs", path, (0,) if model == "none" else (4,))
    camera = checked(_MODELS[model], size, matrix_of(*core), coefficients, path)
    pose = None if data.get("T_cam_imu") is None else pose_of(data["T_cam_imu"], f"{name}.T_cam_imu", path).inverse()
    alone = pose is None and data.get("T_cn_cnm1") is not None
    notes = (f"{name}.T_cn_cnm1 counts from the camera before it, which is not taken along: left out",) if alone else ()
    return Exchanged(camera, pose, notes=notes)


def _write(given: Exchanged) -> str:
    camera = given.camera
    written = {("opencv", 4): "radtan", ("fisheye", 4): "equidistant"}
    model, coefficients = stated(camera, written, "Kalibr's pinhole-radtan")
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


def _fits(text: str) -> bool:
    return all(f"{key}:" in text for key in ("cam0", "camera_model", "intrinsics")) or (
        "distortion_coeffs:" in text and "camera_model:" in text
    )


FORMAT = Format("kalibr", "camchain.yaml of Kalibr", _read, _write, _fits, with_pose=True, several=True)
