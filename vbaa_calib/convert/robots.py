"""Camera files of robotics: ROS' camera_info and Kalibr's camchain, both YAML."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import yaml

from vbaa_calib.core.errors import InputError
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

_ROS_COUNTS = {"plumb_bob": (5, 4), "rational_polynomial": (8, 12, 14), "equidistant": (4,), "fisheye": (4,)}
"""Coefficients by model, as files in the wild have them. Azure Kinect's driver and others write the name fisheye."""
_ROS_MODELS = {("opencv", 5): "plumb_bob", ("opencv", 8): "rational_polynomial", ("fisheye", 4): "equidistant"}


def _read_ros(path: Path, _: str | None) -> Exchanged:
    """As camera_calibration_parsers writes and reads it (ros-perception/image_common, parse_yml.cpp).

    - Pixels: (0, 0) is the centre of the first pixel, as OpenCV, which calibrates for ROS, has it.
    - distortion_model: plumb_bob k1 k2 p1 p2 k3; rational_polynomial k1 k2 p1 p2 k3 k4 k5 k6; equidistant k1 k2 k3 k4,
      the fisheye of OpenCV (sensor_msgs/distortion_models.h). A file without it is a plumb_bob.
    - There is no place for thin prism and sensor tilt, nor for a pose (that is tf's); rectification_matrix and
      projection_matrix describe a rectified picture: we write the identity and the camera's own matrix.
    """
    data = read_yaml(path)

    def block(key: str, *counts: int) -> np.ndarray:
        if not isinstance(data.get(key), dict):
            raise InputError(f"{key} is missing", where=path, remedy="a mapping with rows, cols and data is needed")
        return np.array(numbers(data[key].get("data"), f"{key}.data", path, counts))

    model = one_of(data.get("distortion_model", "plumb_bob"), _ROS_COUNTS, "distortion_model", path)
    size = size_of([(key, data.get(key)) for key in ("image_width", "image_height")], path)
    matrix = block("camera_matrix", 9).reshape(3, 3)
    coefficients = block("distortion_coefficients", *_ROS_COUNTS[model])
    camera = checked("fisheye" if _ROS_COUNTS[model] == (4,) else "opencv", size, matrix, coefficients, path)
    notes = []
    key = "rectification_matrix"
    if key in data and not np.allclose(block(key, 9).reshape(3, 3), np.eye(3), atol=1e-9):
        notes.append(f"{key} turns the picture for a stereo pair: it is left out")
    if "projection_matrix" in data:
        onto = block("projection_matrix", 12).reshape(3, 4)
        if not np.allclose(onto[:, :3], matrix, atol=1e-6 * max(matrix.max(), 1.0)) or onto[:, 3].any():
            notes.append("projection_matrix is that of the rectified picture: it is left out")
    return Exchanged(camera, notes=tuple(notes))


def _write_ros(given: Exchanged) -> str:
    camera = given.camera
    model, coefficients = stated(camera, _ROS_MODELS, "a camera_info of ROS")
    fx, fy, cx, cy = intrinsics(camera)

    def block(rows: int, columns: int, data: list[float]) -> dict[str, Any]:
        return {"rows": rows, "cols": columns, "data": data}

    document = {
        "image_width": camera.image_size[0],
        "image_height": camera.image_size[1],
        "camera_name": "camera",
        "camera_matrix": block(3, 3, [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]),
        "distortion_model": model,
        "distortion_coefficients": block(1, len(coefficients), coefficients),
        "rectification_matrix": block(3, 3, np.eye(3).ravel().tolist()),
        "projection_matrix": block(3, 4, [fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0]),
    }
    return yaml.safe_dump(document, sort_keys=False, default_flow_style=None)


def _is_ros(text: str) -> bool:
    keys = ("image_width", "camera_matrix", "distortion_coefficients")
    return all(f"{key}:" in text for key in keys) and "opencv-matrix" not in text


_KALIBR_MODELS = {"radtan": "opencv", "equidistant": "fisheye", "none": "opencv"}


def _read_kalibr(path: Path, which: str | None) -> Exchanged:
    """ethz-asl/kalibr, wiki: YAML formats, supported models. `which` (cam0, cam1, …) where it holds several cameras.

    - Pixels: its pinhole starts from ((w - 1)/2, (h - 1)/2), so (0, 0) is the centre of the first pixel.
    - intrinsics fu fv pu pv; radtan k1 k2 p1 p2 as OpenCV's first four; equidistant k1 k2 k3 k4 as OpenCV's fisheye.
    - T_cam_imu takes points of the IMU's frame to the camera's, metres: the inverse of our T_reference_camera, our
      reference (the antenna frame) standing in for the IMU's.
    """
    data = {str(name): each for name, each in read_yaml(path).items() if str(name).startswith("cam")}
    name = which_of([name for name, each in data.items() if isinstance(each, dict)], which, path)
    data = data[name]
    one_of(data.get("camera_model"), ("pinhole",), f"{name}: camera_model", path)
    model = one_of(data.get("distortion_model", "none"), _KALIBR_MODELS, f"{name}: distortion_model", path)
    key = f"{name}.resolution"
    size = size_of([(key, side) for side in numbers(data.get("resolution"), key, path, (2,))], path)
    core = numbers(data.get("intrinsics"), f"{name}.intrinsics", path, (4,))
    given = [] if model == "none" else data.get("distortion_coeffs")
    coefficients = numbers(given, f"{name}.distortion_coeffs", path, (0,) if model == "none" else (4,))
    camera = checked(_KALIBR_MODELS[model], size, matrix_of(*core), coefficients, path)
    pose = None if data.get("T_cam_imu") is None else pose_of(data["T_cam_imu"], f"{name}.T_cam_imu", path).inverse()
    alone = pose is None and data.get("T_cn_cnm1") is not None
    notes = (f"{name}.T_cn_cnm1 counts from the camera before it, which is not taken along: left out",) if alone else ()
    return Exchanged(camera, pose, notes=notes)


def _write_kalibr(given: Exchanged) -> str:
    written = {("opencv", 4): "radtan", ("fisheye", 4): "equidistant"}
    model, coefficients = stated(given.camera, written, "Kalibr's pinhole-radtan")
    document: dict[str, Any] = {
        "camera_model": "pinhole",
        "intrinsics": intrinsics(given.camera),
        "distortion_model": model,
        "distortion_coeffs": coefficients,
        "resolution": list(given.camera.image_size),
        "rostopic": "/camera/image_raw",
    }
    if given.T_reference_camera is not None:
        document = {"T_cam_imu": given.T_reference_camera.inverse().matrix.tolist()} | document
    return yaml.safe_dump({"cam0": document}, sort_keys=False, default_flow_style=None)


def _is_kalibr(text: str) -> bool:
    return all(f"{key}:" in text for key in ("cam0", "camera_model", "intrinsics")) or (
        "distortion_coeffs:" in text and "camera_model:" in text
    )


ROS = Format("ros", "camera_info YAML of ROS", _read_ros, _write_ros, _is_ros)
KALIBR = Format(
    "kalibr", "camchain.yaml of Kalibr", _read_kalibr, _write_kalibr, _is_kalibr, with_pose=True, several=True
)
