"""ROS' camera_info YAML as camera_calibration_parsers writes and reads it (ros-perception/image_common, parse_yml.cpp).

- Pixels: (0, 0) is the centre of the first pixel, as OpenCV, which calibrates for ROS, has it.
- distortion_model: plumb_bob k1 k2 p1 p2 k3; rational_polynomial k1 k2 p1 p2 k3 k4 k5 k6; equidistant k1 k2 k3 k4, the
  fisheye of OpenCV (sensor_msgs/distortion_models.h). A file without it is a plumb_bob.
- There is no place for thin prism and sensor tilt, nor for a pose (that is tf's); rectification_matrix and
  projection_matrix describe a rectified picture: we write the identity and the camera's own matrix.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import yaml

from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import read_yaml

from .values import Exchanged, Format, checked, intrinsics, numbers, one_of, size_of, stated

_COUNTS = {"plumb_bob": (5, 4), "rational_polynomial": (8, 12, 14), "equidistant": (4,), "fisheye": (4,)}
"""Coefficients by model, as files in the wild have them. Azure Kinect's driver and others write the name fisheye."""
_MODELS = {("opencv", 5): "plumb_bob", ("opencv", 8): "rational_polynomial", ("fisheye", 4): "equidistant"}


def _read(path: Path, _: str | None) -> Exchanged:
    data = read_yaml(path)
    model = one_of(data.get("distortion_model", "plumb_bob"), _COUNTS, "distortion_model", path)
    size = size_of([(key, data.get(key)) for key in ("image_width", "image_height")], path)
    matrix = np.array(_block(data, "camera_matrix", path, (9,))).reshape(3, 3)
    coefficients = _block(data, "distortion_coefficients", path, _COUNTS[model])
    camera = checked("fisheye" if _COUNTS[model] == (4,) else "opencv", size, matrix, coefficients, path)
    return Exchanged(camera, notes=_notes(data, matrix, path))


def _write(given: Exchanged) -> str:
    camera = given.camera
    model, coefficients = stated(camera, _MODELS, "a camera_info of ROS")
    fx, fy, cx, cy = intrinsics(camera)
    document = {
        "image_width": camera.image_size[0],
        "image_height": camera.image_size[1],
        "camera_name": "camera",
        "camera_matrix": _matrix(3, 3, [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]),
        "distortion_model": model,
        "distortion_coefficients": _matrix(1, len(coefficients), coefficients),
        "rectification_matrix": _matrix(3, 3, np.eye(3).ravel().tolist()),
        "projection_matrix": _matrix(3, 4, [fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0]),
    }
    return yaml.safe_dump(document, sort_keys=False, default_flow_style=None)


def _fits(text: str) -> bool:
    return all(f"{key}:" in text for key in ("image_width", "camera_matrix", "distortion_coefficients")) and (
        "opencv-matrix" not in text
    )


def _block(data: dict[str, Any], key: str, path: Path, counts: tuple[int, ...]) -> list[float]:
    block = data.get(key)
    if not isinstance(block, dict):
        raise InputError(f"{key} is missing", where=path, remedy="a mapping with rows, cols and data is needed")
    return numbers(block.get("data"), f"{key}.data", path, counts)


def _matrix(rows: int, columns: int, data: list[float]) -> dict[str, Any]:
    return {"rows": rows, "cols": columns, "data": data}


def _notes(data: dict[str, Any], matrix: np.ndarray, path: Path) -> tuple[str, ...]:
    """A rectification that is not the identity belongs to a stereo pair, and is not carried over."""
    notes = []
    if "rectification_matrix" in data:
        turn = np.array(_block(data, "rectification_matrix", path, (9,))).reshape(3, 3)
        if not np.allclose(turn, np.eye(3), atol=1e-9):
            notes.append("rectification_matrix turns the picture for a stereo pair: it is left out")
    if "projection_matrix" in data:
        onto = np.array(_block(data, "projection_matrix", path, (12,))).reshape(3, 4)
        if not np.allclose(onto[:, :3], matrix, atol=1e-6 * max(matrix.max(), 1.0)) or onto[:, 3].any():
            notes.append("projection_matrix is that of the rectified picture: it is left out")
    return tuple(notes)


FORMAT = Format("ros", "camera_info YAML of ROS", _read, _write, _fits)
