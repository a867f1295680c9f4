"""Camera files of robotics: ROS' camera_info, Kalibr's camchain, ORB-SLAM's settings."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from vbaa_calib.core.arrays import PLAUSIBLE
from vbaa_calib.core.errors import InputError, quoted
from vbaa_calib.core.files import is_bag, read_text, read_yaml
from vbaa_calib.geometry import Pose

from .child import read_camera_infos, read_in_child
from .refit import PROJECTIONS, refitted
from .values import Exchanged, Format, Wanted, checked, numbers, one_of, size_of, stated


def _read_ros(path: Path, wanted: Wanted) -> Exchanged:
    """A camera from ROS's camera_info YAML or INI (ros-perception/image_common, parse_yml.cpp, parse_ini.cpp), or
    a sensor_msgs/CameraInfo as `ros topic echo` prints it; of several messages the first."""
    if is_bag(path):
        return _read_bag(path, wanted)
    if wanted.which is not None:
        raise InputError("holds one camera", where=path, remedy="leave --camera-name out")
    text = read_text(path, 1_000_000)
    if "[image]" in text:
        return _camera_of_message(_ini(text, path), path, wanted)
    data = read_yaml(path, first=True)
    names = {
        "camera_matrix": "k",
        "distortion_coefficients": "d",
        "rectification_matrix": "r",
        "projection_matrix": "p",
    }
    message = {"width": data.get("image_width"), "height": data.get("image_height")}
    for key, value in data.items():
        if names.get(key) and not isinstance(value, dict):
            raise InputError(
                f"{key} is {quoted(value)}", where=path, remedy="a mapping with rows, cols and data is needed"
            )
        message[names.get(key, str(key).lower())] = value.get("data") if key in names else value
    return _camera_of_message(message, path, wanted)


def _read_bag(path: Path, wanted: Wanted) -> Exchanged:
    """The camera of the first CameraInfo of a topic of a bag."""
    try:
        found = read_in_child(read_camera_infos, path)
    except ValueError as error:
        what, remedy = f"cannot be read as a bag ({error!s:.100})", "record or copy it again"
        raise InputError(what, where=path, remedy=remedy) from None
    messages: dict[str, dict[str, Any]] = {}
    for key, value in found.items():
        topic, _, name = key.rpartition(".")
        messages.setdefault(topic, {})[name] = value.tolist()
    topic = wanted.one_of(sorted(messages), path)
    roi = dict(zip(("x_offset", "y_offset", "width", "height"), messages[topic].pop("roi"), strict=True))
    rectified = messages[topic].pop("rectified")
    read = _camera_of_message(messages[topic] | {"roi": roi}, path, wanted)
    if wanted.rectified or not rectified:
        return read
    return replace(read, notes=(*read.notes, f"for pictures of {', '.join(rectified)} give --rectified"))


def _camera_of_message(message: Mapping[str, Any], path: Path, wanted: Wanted) -> Exchanged:
    """The camera of a sensor_msgs/CameraInfo by its fields, in small letters: width, height, distortion_model, d, k, r,
    p, binning_x, binning_y, roi.

    - Pixels: (0, 0) is the centre of the first pixel, as OpenCV, which calibrates for ROS, has it.
    - distortion_model: plumb_bob k1 k2 p1 p2 k3; rational_polynomial k1 k2 p1 p2 k3 k4 k5 k6; equidistant k1 k2 k3 k4,
      the fisheye of OpenCV (sensor_msgs/distortion_models.h). One without it is a plumb_bob.
    - There is no place for thin prism and sensor tilt, nor for a pose (that is tf's). p is the camera of rectified
      pictures; of others r and p are written as the identity and the camera's own matrix, and not read.
    - Its numbers are those of the whole picture, of which roi and binning make the published one.
    """

    def block(key: str, *counts: int) -> np.ndarray:
        # A field of CameraInfo → its name in camera_info's YAML.
        names = {
            "k": "camera_matrix",
            "d": "distortion_coefficients",
            "r": "rectification_matrix",
            "p": "projection_matrix",
        }
        if message.get(key) is None:
            remedy = "a mapping with rows, cols and data is needed, or CameraInfo's k, d, r, p"
            raise InputError(f"{names[key]} is missing", where=path, remedy=remedy)
        return np.array(numbers(message[key], f"{names[key]}.data", path, counts))

    # coefficients by model, as files in the wild have them: Azure Kinect's driver and others write fisheye, Tango's a
    # rational_polynomial of five
    known = {"plumb_bob": (5, 4, 0), "rational_polynomial": (8, 12, 14, 5, 4), "equidistant": (4,), "fisheye": (4,)}
    model = one_of(message.get("distortion_model") or "plumb_bob", known, "distortion_model", path)
    size = size_of([(f"image_{key}", message.get(key)) for key in ("width", "height")], path)
    matrix = block("k", 9).reshape(3, 3)
    coefficients = block("d", *known[model])
    notes = []
    if model == "rational_polynomial" and len(coefficients) < 8:
        notes.append(f"{model} with {len(coefficients)} coefficients is read as plumb_bob")
    binning = tuple(_whole(message.get(key), key, path) or 1 for key in ("binning_x", "binning_y"))
    area = message["roi"] if isinstance(message.get("roi"), dict) else {}
    roi = [_whole(area.get(key), f"roi.{key}", path) for key in ("x_offset", "y_offset", "width", "height")]
    part: dict[str, Any] = {"binning": binning, "roi": tuple(roi) if roi[2] and roi[3] else None}
    # drivers that rectify nothing write zeros
    turn, onto = (
        block(key, count) if message.get(key) is not None else np.zeros(count) for key, count in (("r", 9), ("p", 12))
    )
    turn, onto = turn.reshape(3, 3), onto.reshape(3, 4)
    turned = turn.any() and not np.allclose(turn, np.eye(3), atol=1e-9)
    words = (
        f"of raw pictures (image_raw) is camera_matrix, fx {matrix[0, 0]:.6g} px, with its distortion, of rectified "
    )
    words += f"ones (image_rect) projection_matrix, fx {onto[0, 0]:.6g} px, without"
    if wanted.rectified:
        onto = block("p", 12).reshape(3, 4)[:, :3]
        notes.append(f"{words}: the latter is taken")
        if turned:
            notes.append("rectification_matrix turns the camera's axes: a pose is that of the turned ones")
        found = Exchanged.of("opencv", size, onto, np.zeros(0), path)
        return replace(found, notes=(*notes, *found.notes), **part)
    if not matrix.any():
        raise InputError("is of a camera that is not calibrated: k is zero", where=path, remedy="calibrate it")
    found = Exchanged.of("fisheye" if known[model] == (4,) else "opencv", size, matrix, coefficients, path)
    notes += found.notes
    if turned:
        notes.append("rectification_matrix turns the picture for a stereo pair: it is left out")
    same = np.allclose(onto[:, :3], matrix, atol=1e-6 * max(matrix.max(), 1.0)) and not onto[:, 3].any()
    if onto.any() and not same:
        notes.append(f"{words}: the former is taken, --rectified takes the latter")
    return replace(found, notes=tuple(notes), **part)


def _whole(value: Any, key: str, path: Path) -> int:
    """A number of pixels; 0 where the message has none."""
    value = 0 if value is None else value
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value < 100_000:
        raise InputError(f"{key} is {quoted(value)}", where=path, remedy="a whole number of pixels is needed")
    return value


def _ini(text: str, path: Path) -> dict[str, Any]:
    """The fields of CameraInfo in an ost.ini: names in lines of their own, their numbers below them."""
    names = {"camera matrix": "k", "distortion": "d", "rectification": "r", "projection": "p"}
    message: dict[str, Any] = {}
    key = ""
    for line in (line.strip() for line in text.splitlines()):
        if line.lower() in (*names, "width", "height"):
            key = names.get(line.lower(), line.lower())
            message[key] = []
        elif key and line and line[0] not in "#;[":
            try:
                message[key] += [float(cell) for cell in line.split()]
            except ValueError:
                raise InputError(f"{key} holds {quoted(line)}", where=path, remedy="numbers are needed") from None
    for key in ("width", "height"):
        message[key] = message[key][0] if message.get(key) else None
    if len(message.get("d", ())) == 8:
        message["distortion_model"] = "rational_polynomial"
    return message


def _write_ros(exchanged: Exchanged) -> str:
    camera = exchanged.camera
    model, coefficients = stated(
        camera,
        {("opencv", 5): "plumb_bob", ("opencv", 8): "rational_polynomial", ("fisheye", 4): "equidistant"},
        "a camera_info of ROS",
    )
    fx, fy, cx, cy = camera.parameters[:4].tolist()

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
    files = ("image_width:", "camera_matrix:", "distortion_coefficients:"), ("[image]", "camera matrix", "distortion")
    echoed = all(re.search(rf"(?mi)^{key}:", text) for key in ("height", "width", "distortion_model", "d", "k"))
    return "opencv-matrix" not in text and (echoed or any(all(key in text for key in keys) for keys in files))


def _read_kalibr(path: Path, wanted: Wanted) -> Exchanged:
    """A camera of Kalibr's camchain.yaml: one of cam0, cam1, … where there are several. Source: ethz-asl/kalibr, wiki.

    - Pixels: its pinhole starts from ((w - 1)/2, (h - 1)/2), so (0, 0) is the centre of the first pixel.
    - intrinsics fu fv pu pv; radtan k1 k2 p1 p2 as OpenCV's first four; equidistant k1 k2 k3 k4 as OpenCV's fisheye.
    - pinhole-fov, omni, ds and eucm are refitted (`refit`).
    - T_cam_imu takes points of the IMU's frame to the camera's, metres: the inverse of our T_reference_camera, our
      reference (the antenna frame) standing in for the IMU's.
    """
    data = {str(name): each for name, each in read_yaml(path).items() if str(name).startswith("cam")}
    name = wanted.one_of([name for name, each in data.items() if isinstance(each, dict)], path)
    data = data[name]
    # Camera models that are refitted: their number of intrinsics, and the distortions they come with.
    refitted_models = {"omni": (5, ("none", "radtan")), "ds": (6, ("none",)), "eucm": (6, ("none",))}
    kind = one_of(data.get("camera_model"), ("pinhole", *refitted_models), f"{name}: camera_model", path)
    models = {"radtan": "opencv", "equidistant": "fisheye", "none": "opencv"}
    count, known = refitted_models.get(kind, (4, (*models, "fov")))
    model = one_of(data.get("distortion_model", "none"), known, f"{name}: distortion_model", path)
    key = f"{name}.resolution"
    size = size_of([(key, side) for side in numbers(data.get("resolution"), key, path, (2,))], path)
    core = numbers(data.get("intrinsics"), f"{name}.intrinsics", path, (count,))
    listed = [] if model == "none" else data.get("distortion_coeffs")
    coefficients = numbers(listed, f"{name}.distortion_coeffs", path, ({"none": 0, "fov": 1}.get(model, 4),))
    pose = None if data.get("T_cam_imu") is None else _pose_of(data["T_cam_imu"], f"{name}.T_cam_imu", path).inverse()
    alone = pose is None and data.get("T_cn_cnm1") is not None
    notes = (f"{name}.T_cn_cnm1 counts from the camera before it, which is not taken along: left out",) if alone else ()
    if kind == "pinhole" and model != "fov":
        camera = checked(models[model], size, core, coefficients, path)
        return Exchanged(camera, pose, notes=notes)
    projection = PROJECTIONS["fov" if model == "fov" else kind](core, coefficients)
    camera, words = refitted(projection, size, f"{kind}-{model}", path)
    return Exchanged(camera, pose, notes=(*notes, words))


def _pose_of(matrix: Any, key: str, path: Path) -> Pose:
    """A pose from four rows of four numbers. Raises InputError where its rotation is invalid."""
    if not isinstance(matrix, list | tuple) or len(matrix) != 4:
        raise InputError(f"{key} is {quoted(matrix)}", where=path, remedy="four rows of four numbers are needed")
    rows = np.array([numbers(row, key, path, (4,), PLAUSIBLE.place_m) for row in matrix])
    turn = rows[:3, :3]
    off = np.abs(turn @ turn.T - np.eye(3)).max() if np.abs(turn).max() < 2 else math.inf
    if off > 1e-3 or np.linalg.det(turn) < 0 or np.abs(rows[3] - [0, 0, 0, 1]).max() > 1e-9:
        raise InputError(f"{key} is no rigid motion", where=path, remedy="a rotation, a shift, and 0 0 0 1 are needed")
    from scipy.spatial.transform import Rotation  # slow to load

    return Pose(Rotation.from_matrix(turn).as_matrix(), rows[:3, 3])


def _write_kalibr(exchanged: Exchanged) -> str:
    written = {("opencv", 4): "radtan", ("fisheye", 4): "equidistant"}
    model, coefficients = stated(exchanged.camera, written, "Kalibr's pinhole-radtan")
    document: dict[str, Any] = {
        "camera_model": "pinhole",
        "intrinsics": exchanged.camera.parameters[:4].tolist(),
        "distortion_model": model,
        "distortion_coeffs": coefficients,
        "resolution": list(exchanged.camera.image_size),
        "rostopic": "/camera/image_raw",
    }
    if exchanged.T_reference_camera is not None:
        document = {"T_cam_imu": exchanged.T_reference_camera.inverse().matrix.tolist()} | document
    return yaml.safe_dump({"cam0": document}, sort_keys=False, default_flow_style=None)


def _is_kalibr(text: str) -> bool:
    return all(f"{key}:" in text for key in ("cam0", "camera_model", "intrinsics")) or (
        "distortion_coeffs:" in text and "camera_model:" in text
    )


def _read_orb_slam(path: Path, wanted: Wanted) -> Exchanged:
    """A camera of ORB-SLAM's settings (UZ-SLAMLab/ORB_SLAM3, Examples/*/*.yaml; also ORB_SLAM2): Camera.fx, or
    Camera1.fx and Camera2.fx.

    - Pixels: as OpenCV, which it calls. PinHole k1 k2 p1 p2 k3, of which the last may be missing; KannalaBrandt8 k1 to
      k4 of OpenCV's fisheye; Rectified without any. Camera.newWidth is the size it works at, not that of its numbers.
    """
    found = dict(re.findall(r"(?m)^(Camera\d?\.\w+)[ \t]*:[ \t]*\"?([^\s\"#]+)", read_text(path, 1_000_000)))
    names = [name for name in ("Camera", "Camera1", "Camera2") if f"{name}.fx" in found]
    name = wanted.one_of(names, path)

    def value(key: str) -> float:
        try:
            return float(found[key])
        except (KeyError, ValueError):
            raise InputError(f"{key} is {found.get(key, 'missing')}", where=path, remedy="a number is needed") from None

    sides = [(key, value(key) if key in found else None) for key in ("Camera.width", "Camera.height")]
    kind = one_of(found.get("Camera.type", "PinHole"), ("PinHole", "KannalaBrandt8", "Rectified"), "Camera.type", path)
    keys = {"PinHole": ("k1", "k2", "p1", "p2"), "KannalaBrandt8": ("k1", "k2", "k3", "k4"), "Rectified": ()}[kind]
    keys = (*keys, "k3") if kind == "PinHole" and f"{name}.k3" in found else keys
    coefficients = [value(f"{name}.{key}") for key in keys]
    matrix = [value(f"{name}.{key}") for key in ("fx", "fy", "cx", "cy")]
    size = wanted.size_of(sides, path)
    return Exchanged(checked("fisheye" if kind == "KannalaBrandt8" else "opencv", size, matrix, coefficients, path))


ROS = Format(
    "ros", "camera_info YAML, message or ost.ini of ROS", _read_ros, _write_ros, _is_ros, takes=("rectified", "which")
)
KALIBR = Format(
    "kalibr", "camchain.yaml of Kalibr", _read_kalibr, _write_kalibr, _is_kalibr, with_pose=True, takes=("which",)
)
ORB_SLAM = Format(
    "orbslam",
    "settings YAML of ORB-SLAM",
    _read_orb_slam,
    None,
    lambda text: re.search(r"(?m)^Camera1?\.fx[ \t]*:", text) is not None,
    takes=("which", "size"),
)
