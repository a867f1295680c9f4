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

from .exchanged import Exchanged, Format
from .values import camera_of, held_in, intrinsics, numbers, one_of, pose_of, which_of, whole

_MODELS = {"radtan": "opencv", "equidistant": "fisheye", "none": "opencv"}


def _read(path: Path, which: str | None) -> Exchanged:
    """`which` (cam0, cam1, …) where it holds several cameras."""
    data = {str(name): each for name, each in read_yaml(path).items() if str(name).startswith("cam")}
    name = which_of([name for name, each in data.items() if isinstance(each, dict)], which, path)
    data = data[name]
    one_of(data.get("camera_model"), ("pinhole",), f"{name}: camera_model", path)
    model = one_of(data.get("distortion_model", "none"), _MODELS, f"{name}: distortion_model", path)
    size = numbers(data.get("resolution"), f"{name}.resolution", path, (2,))
    width, height = (whole(side, f"{name}.resolution", path) for side in size)
    core = numbers(data.get("intrinsics"), f"{name}.intrinsics", path, (4,))
    given = [] if model == "none" else data.get("distortion_coeffs")
    coefficients = numbers(given, f"{name}.distortion_coeffs", path, (0,) if model == "none" else (4,))
    camera = camera_of(_MODELS[model], (width, height), core, coefficients, path)
    pose = None if data.get("T_cam_imu") is None else pose_of(data["T_cam_imu"], f"{name}.T_cam_imu", path).inverse()
    alone = pose is None and data.get("T_cn_cnm1") is not None
    notes = (f"{name}.T_cn_cnm1 counts from the camera before it, which is not taken along: left out",) if alone else ()
    return Exchanged(camera, pose, notes=notes)


def _write(given: Exchanged) -> str:
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


def _fits(text: str) -> bool:
    return all(f"{key}:" in text for key in ("cam0", "camera_model", "intrinsics")) or (
        "distortion_coeffs:" in text and "camera_model:" in text
    )


FORMAT = Format("kalibr", "camchain.yaml of Kalibr", _read, _write, _fits, with_pose=True, several=True)
