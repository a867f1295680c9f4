"""Camera files of computer vision: OpenCV's FileStorage and plain numbers, mrcal, CAHVOR, COLMAP's cameras.txt."""

from __future__ import annotations

import json
import math
import re
import struct
from collections.abc import Mapping
from decimal import Decimal, InvalidOperation, localcontext
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from vbaa_calib.camera import Camera
from vbaa_calib.core.arrays import PLAUSIBLE
from vbaa_calib.core.errors import InputError, quoted
from vbaa_calib.core.files import read_bytes, read_json, read_text, read_yaml
from vbaa_calib.geometry import Pose

from .child import read_in_child, read_literal, read_storage
from .refit import PROJECTIONS, refitted
from .values import Exchanged, Format, Wanted, checked, numbers, one_of, size_of, stated

_NAMES = {
    "matrix": r"(camera|intrinsic)_?matrix|camera_?intrinsics|mtx|[mk]",
    "coefficients": r"dist(ortion)?(_?coef(f|ficient)?s?)?|d",
    "width": r"(image|img)?_?width",
    "height": r"(image|img)?_?height",
    "size": r"(image|img)?_?size|resolution",
    "fisheye_model": "fisheye_model",
}
"""What files call a camera's numbers: patterns of names in small letters; with a number or side, of one of several."""


def _cameras(values: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """The cameras in a file by number or side ("" for a single one), each with its values by the keys of `_NAMES`."""
    found: dict[str, dict[str, Any]] = {}
    for name, value in values.items():
        for key, pattern in _NAMES.items():
            fits = re.fullmatch(rf"(?:{pattern})(?:_?(\d|l|r|left|right))?", str(name).lower())
            if fits and (key != "matrix" or np.shape(value) == (3, 3)):
                found.setdefault(fits.groups()[-1] or "", {})[key] = value
    # what several share, such as the picture's size
    common = found.get("", {})
    several = {side: common | own for side, own in found.items() if "matrix" in own and side}
    return several or {"": common}


def _camera_of(
    values: Mapping[str, Any], wanted: Wanted, path: Path, needs: str, *, pinhole: bool = False
) -> tuple[Camera, list[str]]:
    """The camera in a mapping of numbers and matrices, and notes. pinhole : whether four coefficients without a
    model name are k1 k2 p1 p2; otherwise the user must say."""
    cameras = _cameras(values)
    one = cameras[wanted.one_of(list(cameras), path) if wanted.which or len(cameras) > 1 else min(cameras)]
    matrix, coefficients = (np.asarray(one.get(key, ()), object) for key in ("matrix", "coefficients"))
    if matrix.shape != (3, 3):
        raise InputError("camera_matrix is missing or no matrix", where=path, remedy=needs)
    if "coefficients" not in one or coefficients.size != max(coefficients.shape, default=0):
        raise InputError("distortion_coefficients is missing or no matrix", where=path, remedy=needs)
    matrix = np.reshape(numbers(matrix.ravel().tolist(), "camera_matrix", path, (9,)), (3, 3))
    listed = numbers(coefficients.ravel().tolist(), "distortion_coefficients", path, (0, 4, 5, 8, 12, 14))
    size = _size(one, matrix, wanted, path)
    notes = []
    fisheye = wanted.fisheye if wanted.fisheye is not None else one.get("fisheye_model")
    if fisheye and len(listed) != 4:
        raise InputError(f"fisheye_model has {len(listed)} coefficients", where=path, remedy="it takes 4")
    if len(listed) == 4 and fisheye is None:
        if not pinhole:
            what = "has four coefficients: k1 k2 p1 p2 of a pinhole, or k1 to k4 of a fisheye"
            raise InputError(what, where=path, remedy="say --no-fisheye or --fisheye")
        notes.append("four coefficients without fisheye_model are taken as k1 k2 p1 p2, not as a fisheye's (--fisheye)")
    found = Exchanged.of("fisheye" if fisheye else "opencv", size, matrix, listed, path)
    return found.camera, [*notes, *found.notes]


def _size(one: Mapping[str, Any], matrix: np.ndarray, wanted: Wanted, path: Path) -> tuple[int, int]:
    """(width, height) px. Raises InputError where they are missing, or may be exchanged."""
    sides = [(f"image_{key}", one.get(key)) for key in ("width", "height")]
    if one.get("size") is not None:
        size = one["size"]
        listed = [size.get(key) for key in ("width", "height")] if isinstance(size, dict) else np.ravel(size).tolist()
        sides = [("the picture's size", side) for side in [*listed, None, None][:2]]
    turned = tuple(reversed([side for _, side in sides])) == wanted.size
    width, height = wanted.size if turned and wanted.size else wanted.size_of(sides, path)
    centre = matrix[:2, 2]
    upright, lying = (np.abs(centre / each - 0.5).max() for each in ((width, height), (height, width)))
    if "size" in one and not isinstance(one["size"], dict) and wanted.size is None and lying < 0.1 < upright:
        what = (
            f"states {width} and {height} px, but its centre ({centre[0]:.0f}, {centre[1]:.0f}) is that of a picture "
        )
        remedy = f"give --size {height}x{width} for the latter, --size {width}x{height} for the former"
        raise InputError(f"{what}of {height}x{width}", where=path, remedy=remedy)
    return width, height


def _read_opencv(path: Path, wanted: Wanted) -> Exchanged:
    """A camera in OpenCV's FileStorage with the keys of its calibration samples (samples/cpp/calibration.cpp,
    stereo_calib.cpp: M1 D1 M2 D2, without the picture's size).

    - Pixels: (0, 0) is the centre of the first pixel. Coefficients: 4, 5, 8, 12 or 14, (k, 1) or (1, k).
    - fisheye_model: 1 where the four coefficients are those of cv::fisheye. `calibration.cpp` does not write it.
    - The samples keep poses of the board, picture by picture; there is no place for the pose of the camera.
    - Written and read by OpenCV itself, 17 digits a number; XML and JSON are read, too.
    """
    needs = "camera_matrix and distortion_coefficients are needed, as OpenCV's calibration samples write them"
    text = read_text(path, 1_000_000)
    if not text.strip():
        raise InputError("is empty", where=path, remedy=needs)
    try:
        found = read_in_child(read_storage, path)
    except ValueError as error:
        raise InputError(f"OpenCV cannot read it ({error!s:.100})", where=path, remedy=needs) from None
    values = {key: float(value) if value.ndim == 0 else value for key, value in found.items()}
    camera, notes = _camera_of(values, wanted, path, needs, pinhole=True)
    return Exchanged(camera, notes=tuple(notes))


def _unpacked(value: Any) -> Any:
    """Nested values with lists as arrays, nine numbers as (3, 3), and a mapping with `data` as its matrix."""
    if isinstance(value, dict):
        return _unpacked(value["data"]) if "data" in value else value
    try:
        array = np.asarray(value, object)
    except ValueError:  # lists of several lengths
        return None
    return array.reshape(3, 3) if array.size == 9 else array if array.ndim else value


def _read_numbers(path: Path, wanted: Wanted) -> Exchanged:
    """A camera from a matrix and coefficients under usual names such as mtx and dist: JSON or YAML with lists, the
    .npz of OpenCV's tutorial, a calibration by PhotonVision (matrices with rows, cols and data)."""
    needs = "a 3x3 camera_matrix (mtx, K) and distortion_coefficients (dist, D) are needed"
    if read_bytes(path, most=_LARGEST)[:2] == b"PK":
        try:
            values: dict[str, Any] = dict(read_in_child(read_storage, path))
        except ValueError as error:
            raise InputError(f"NumPy cannot read it ({error!s:.100})", where=path, remedy=needs) from None
    else:
        values = read_json(path) if read_text(path, _LARGEST).lstrip().startswith("{") else read_yaml(path)
    camera, notes = _camera_of({name: _unpacked(value) for name, value in values.items()}, wanted, path, needs)
    return Exchanged(camera, notes=tuple(notes))


def _write_opencv(exchanged: Exchanged) -> str:
    camera = exchanged.camera
    coefficients = camera.distortion if camera.distortion.size else np.zeros(5)
    storage = cv2.FileStorage(".yml", cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY | cv2.FILE_STORAGE_FORMAT_YAML)
    storage.write("image_width", camera.image_size[0])
    storage.write("image_height", camera.image_size[1])
    storage.write("fisheye_model", int(camera.model == "fisheye"))
    storage.write("camera_matrix", np.array(camera.matrix))
    storage.write("distortion_coefficients", np.array(coefficients).reshape(-1, 1))
    return str(storage.releaseAndGetString())


_MRCAL_COUNTS = {"LENSMODEL_PINHOLE": 0} | {f"LENSMODEL_OPENCV{count}": count for count in (4, 5, 8, 12)}
_MRCAL_REFITTED = {
    "LENSMODEL_SPLINED_STEREOGRAPHIC": "splined",
    "LENSMODEL_CAHVOR": "cahvor",
    "LENSMODEL_CAHVORE": "cahvor",
    "LENSMODEL_STEREOGRAPHIC": "stereographic",
}
_LARGEST = 100_000_000
"""Bytes; the data of a whole calibration stand in such a file as text."""


def _read_mrcal(path: Path, _: Wanted) -> Exchanged:
    """A camera of mrcal (dkogan/mrcal, mrcal/cameramodel.py): a Python literal, read there and here by
    `ast.literal_eval`.

    - Pixels: (0, 0) is the centre of the first pixel. intrinsics: fx, fy, cx, cy, then OpenCV's coefficients in order.
    - LENSMODEL_PINHOLE, _OPENCV4, 5, 8, 12. There is no equidistant fisheye and no sensor tilt. Splined and CAHVOR
      models are refitted (`refit`), where there is one in valid_intrinsics_region.
    - extrinsics: a rotation vector and a shift that take points of the reference frame to the camera's (rt_cam_ref,
      before version 2.5 rt_fromref): the inverse of our T_reference_camera. mrcal leaves the unit of length open; ours
      is metres.
    """
    remedy = "a Python mapping with lens_model, intrinsics, extrinsics and imagersize is needed"
    read_text(path, _LARGEST)
    try:
        data = {key: json.loads(str(value)) for key, value in read_in_child(read_literal, path).items()}
    except ValueError as error:
        raise InputError(f"is no mrcal .cameramodel ({error!s:.100})", where=path, remedy=remedy) from None
    whole = data.get("lens_model", data.get("lensmodel"))
    name, config = _mrcal_name(whole)
    one_of(name, (*_MRCAL_COUNTS, *_MRCAL_REFITTED), "lens_model", path)
    if name.endswith("SPLINED_STEREOGRAPHIC") and not _sound_spline(config):
        raise InputError(f"lens_model is {quoted(whole)}", where=path, remedy="order, Nx, Ny and fov_x_deg are needed")
    sides = numbers(data.get("imagersize"), "imagersize", path, (2,))
    size = size_of([("imagersize", side) for side in sides], path)
    turn_shift = np.array(numbers(data.get("extrinsics"), "extrinsics", path, (6,), PLAUSIBLE.place_m))
    pose = Pose.from_rotvec(turn_shift[:3], turn_shift[3:]).inverse()
    region = data.get("valid_intrinsics_region")
    if name in _MRCAL_COUNTS:
        values = numbers(data.get("intrinsics"), "intrinsics", path, (4 + _MRCAL_COUNTS[name],))
        notes = ("valid_intrinsics_region is left out",) if region else ()
        return Exchanged(checked("opencv", size, values[:4], values[4:], path), pose, notes=notes)
    count = {"splined": 4 + int(2 * config.get("Nx", 0) * config.get("Ny", 0)), "stereographic": 4}.get(
        _MRCAL_REFITTED[name], 12 if name.endswith("E") else 9
    )
    values = numbers(data.get("intrinsics"), "intrinsics", path, (count,))
    if name.endswith("CAHVORE") and any(values[9:]):
        what = "its CAHVORE lens has no single centre: a ray's place changes with its angle"
        raise InputError(what, where=path, remedy="calibrate the lens again, with vbaa intrinsics")
    inside = None if not region else np.array([numbers(each, "valid_intrinsics_region", path, (2,)) for each in region])
    camera, words = refitted(PROJECTIONS[_MRCAL_REFITTED[name]](values, config), size, str(name), path, inside)
    return Exchanged(camera, pose, notes=(words,))


def _mrcal_name(whole: Any) -> tuple[Any, dict[str, float]]:
    """A lens model's name and its configuration values: LENSMODEL_CAHVORE_linearity=0.4."""
    if not isinstance(whole, str):
        return whole, {}
    pairs = r"_(order|Nx|Ny|fov_x_deg|linearity)=(\d{1,5}(?:\.\d{1,9})?)"
    return re.sub(pairs, "", whole), {key: float(value) for key, value in re.findall(pairs, whole)}


def _sound_spline(config: Mapping[str, float]) -> bool:
    order, columns, rows = (config.get(key, 0.0) for key in ("order", "Nx", "Ny"))
    return order in (2, 3) and min(columns, rows) > order and 0.0 < config.get("fov_x_deg", 0.0) < 360.0


def _read_cahvor(path: Path, wanted: Wanted) -> Exchanged:
    """A camera in JPL's .cahvor, as mrcal/cahvor.py reads it: the vectors C A H V, and O R of CAHVOR, E of CAHVORE;
    or mrcal's line of OpenCV's coefficients. A camera with H and V not orthogonal is refitted, too."""
    lines = re.findall(r"(?m)^\s*(\w+)\s*=\s*(.+?)\s*$", read_text(path, _LARGEST))
    cells = {name.replace("DISTORTION", "LENSMODEL"): value.split() for name, value in lines}

    def vector(key: str, *counts: int) -> np.ndarray:
        try:
            listed = [float(cell) for cell in cells[key]]
        except (KeyError, ValueError):
            listed = []
        return np.array(numbers(listed, key, path, counts or (3,), PLAUSIBLE.place_m))

    size = size_of([("Dimensions", side) for side in vector("Dimensions", 2).tolist()], path)
    place, axis, across, down = (vector(key) for key in "CAHV")
    if not (np.linalg.norm(axis) > 0.0 and np.linalg.norm(np.cross(axis, across)) > 0.0):
        raise InputError("A and H are no directions", where=path, remedy="write the file again")
    axis = axis / np.linalg.norm(axis)
    cx, cy = across @ axis, down @ axis
    right = across - cx * axis
    fx = np.linalg.norm(right)
    below = np.cross(axis, right / fx)
    rows = np.stack([right / fx, below, axis])
    # V along H's direction: the picture's rows are not square to its columns
    skew, fy = (down - cy * axis) @ rows[0], down @ below
    pose = Pose(rows.T, place)
    core = [fx, fy, cx, cy]
    opencv = next((name for name in cells if name in _MRCAL_COUNTS), None)
    square = abs(skew) < 1e-6 * fy
    if opencv or (square and ("R" not in cells or not vector("R").any())):
        listed = vector(opencv, _MRCAL_COUNTS[opencv]) if opencv else np.zeros(0)
        notes = () if square else (f"H and V are not square by {skew / fy:.2g} rad: that is left out",)
        return Exchanged(checked("opencv", size, core, listed, path), pose, notes=notes)
    if "E" in cells and vector("E").any():
        what = "its CAHVORE lens has no single centre: a ray's place changes with its angle"
        raise InputError(what, where=path, remedy="calibrate the lens again, with vbaa intrinsics")
    towards = rows @ (vector("O") if "O" in cells else axis)
    values = [*core, math.atan2(towards[0], towards[2]), math.asin(max(-1.0, min(1.0, towards[1])))]
    values += vector("R").tolist() if "R" in cells else [0.0] * 3
    kind = " ".join(cells.get("Model", ()))
    general = re.match(r"CAHVORE\s*([123])(?:\s*,\s*([\d.]+))?", kind)
    linearity = 1.0 if general is None or general[1] == "1" else 0.0 if general[1] == "2" else float(general[2] or 1.0)
    name = kind.partition("=")[0].strip() or "CAHVOR"
    camera, words = refitted(PROJECTIONS["cahvor"](values, {"linearity": linearity, "skew": skew}), size, name, path)
    return Exchanged(camera, pose, notes=(words,))


def _write_mrcal(exchanged: Exchanged) -> str:
    """Write a .cameramodel; a camera without a pose is its own reference."""
    camera = exchanged.camera
    name, coefficients = stated(camera, {("opencv", count): name for name, count in _MRCAL_COUNTS.items()}, "mrcal")
    pose = (exchanged.T_reference_camera or Pose.identity()).inverse()
    numbers_text = ", ".join(map(repr, [*camera.parameters[:4].tolist(), *coefficients]))
    turn_shift = ", ".join(map(repr, [*pose.rotvec_rad.tolist(), *pose.translation_m.tolist()]))
    return (
        "{\n"
        f"    'lens_model':  '{name}',\n\n"
        "    # intrinsics are fx,fy,cx,cy,distortion0,distortion1,....\n"
        f"    'intrinsics': [ {numbers_text} ],\n\n"
        "    # extrinsics are rt_cam_ref, metres\n"
        f"    'extrinsics': [ {turn_shift} ],\n\n"
        f"    'imagersize': [ {camera.image_size[0]}, {camera.image_size[1]} ]\n"
        "}\n"
    )


_COLMAP_MODELS = {
    "SIMPLE_PINHOLE": ("opencv", 1, 0),
    "PINHOLE": ("opencv", 2, 0),
    "SIMPLE_RADIAL": ("opencv", 1, 1),
    "RADIAL": ("opencv", 1, 2),
    "OPENCV": ("opencv", 2, 4),
    "FULL_OPENCV": ("opencv", 2, 8),
    "SIMPLE_RADIAL_FISHEYE": ("fisheye", 1, 1),
    "RADIAL_FISHEYE": ("fisheye", 1, 2),
    "OPENCV_FISHEYE": ("fisheye", 2, 4),
    "FOV": ("fov", 2, 1),
    "THIN_PRISM_FISHEYE": ("thin_prism_fisheye", 2, 8),
}
"""Name → our model, or the projection that is refitted; focal lengths, coefficients (filled up with zeros to four)."""


def _read_colmap(path: Path, wanted: Wanted) -> Exchanged:
    """A camera of COLMAP (colmap/colmap, doc/format.rst; models in src/colmap/sensor/models.h), by its CAMERA_ID
    where there are several.

    - Pixels: (0.5, 0.5) is the centre of the first pixel: cx and cy stand there larger by 0.5 than here. The half is
      added and taken away in decimal, so that no bit is lost.
    - One line a camera: CAMERA_ID MODEL WIDTH HEIGHT PARAMS. FULL_OPENCV has k1 k2 p1 p2 k3 k4 k5 k6 as OpenCV's eight,
      OPENCV the first four; OPENCV_FISHEYE k1 to k4 of OpenCV's fisheye. The models with one focal length, and the
      radial ones with one or two coefficients, are special cases of these.
    - Poses stand picture by picture in images.txt, which is not written here.
    """
    text = _text_of_binary(path) if path.name == "cameras.bin" else read_text(path)
    lines = [(number, line.split()) for number, line in enumerate(text.splitlines(), 1)]
    rows = {cells[0]: (number, cells) for number, cells in lines if cells and not cells[0].startswith("#")}
    number, cells = rows[wanted.one_of(list(rows), path)]
    place = Path(f"{path} line {number}")
    model = one_of(cells[1] if len(cells) > 1 else "", _COLMAP_MODELS, "the model", place)
    ours, focal, count = _COLMAP_MODELS[model]
    needed = 4 + focal + 2 + count
    if len(cells) != needed:
        raise InputError(f"{len(cells)} cells, {model} has {needed}", where=place, remedy="write the line again")
    size = size_of([("the picture's side", _plain(cell, place)) for cell in cells[2:4]], place)
    f = [_plain(cell, place) for cell in cells[4 : 4 + focal]]
    centre = [float(_decimal(cell, place, Decimal("-0.5"))) for cell in cells[4 + focal : 6 + focal]]
    coefficients = [_plain(cell, place) for cell in cells[6 + focal :]]
    if ours in PROJECTIONS:
        values = numbers([f[0], f[-1], *centre, *coefficients], "PARAMS", place, (4 + count,))
        camera, words = refitted(PROJECTIONS[ours](values[:4], values[4:]), size, model, place)
        return Exchanged(camera, notes=(words,))
    filled = coefficients + [0.0] * (4 - count) if 0 < count < 4 else coefficients
    values = numbers([f[0], f[-1], *centre, *filled], "PARAMS", place, (4 + len(filled),))
    return Exchanged(checked(ours, size, values[:4], values[4:], place))


def _text_of_binary(path: Path) -> str:
    """The lines of the cameras.txt equivalent to a cameras.bin (src/colmap/scene/reconstruction_io_binary.cc)."""
    names = ["SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "OPENCV_FISHEYE", "FULL_OPENCV", "FOV"]
    names += ["SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE", "THIN_PRISM_FISHEYE"]
    data, lines = read_bytes(path, most=_LARGEST), []
    try:
        (count,), at = struct.unpack_from("<Q", data), 8
        for _ in range(min(count, 100_000)):
            number, kind, width, height = struct.unpack_from("<iiQQ", data, at)
            _, focal, coefficients = _COLMAP_MODELS[names[kind]]
            values = struct.unpack_from(f"<{focal + 2 + coefficients}d", data, at + 24)
            lines.append(f"{number} {names[kind]} {width} {height} {' '.join(map(repr, values))}")
            at += 24 + 8 * len(values)
    except (struct.error, IndexError):
        raise InputError("is no cameras.bin that is known here", where=path, remedy="export it as text") from None
    return "\n".join(lines)


def _write_colmap(exchanged: Exchanged) -> str:
    camera = exchanged.camera
    models = _COLMAP_MODELS.items()
    written = {
        (model, count): name for name, (model, focal, count) in models if focal == 2 and model not in PROJECTIONS
    }
    name, coefficients = stated(camera, written, "COLMAP's FULL_OPENCV")
    fx, fy, cx, cy = camera.parameters[:4].tolist()
    centre = [str(_decimal(repr(value), None, Decimal("0.5"))) for value in (cx, cy)]
    cells = [repr(fx), repr(fy), *centre, *map(repr, coefficients)]
    return (
        "# Camera list with one line of data per camera:\n"
        "#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n"
        "# Number of cameras: 1\n"
        f"1 {name} {camera.image_size[0]} {camera.image_size[1]} {' '.join(cells)}\n"
    )


def _is_colmap(text: str) -> bool:
    lines = (line.split() for line in text.splitlines() if not line.lstrip().startswith("#"))
    first = next((cells for cells in lines if cells), [])
    return len(first) > 4 and first[1] in _COLMAP_MODELS


def _plain(text: str, place: Path) -> float:
    value = float(_decimal(text, place, Decimal(0)))
    if not math.isfinite(value):
        raise InputError(f"{text:.60} is too large", where=place, remedy="write the line again")
    return value


def _decimal(text: str, place: Path | None, shift: Decimal) -> Decimal:
    """The text of a decimal number with a shift added exactly."""
    digits = 400
    try:
        value = Decimal(text)
        if not value.is_finite() or abs(value.adjusted()) > 320 or len(text) > digits:
            raise InvalidOperation
    except InvalidOperation:
        raise InputError(f"{text!r:.60} is no number", where=place, remedy="write the line again") from None
    with localcontext() as context:
        context.prec = digits
        return value + shift


def _named(key: str, text: str) -> bool:
    """Whether a JSON or YAML text has a key of `_NAMES`."""
    return re.search(rf"(?im)(?<![\w.])[\"']?(?:{_NAMES[key]})_?(?:1|l|left)?[\"']?\s*:", text) is not None


OPENCV = Format(
    "opencv",
    "YAML of OpenCV's calibration samples",
    _read_opencv,
    _write_opencv,
    lambda text: (
        re.search(r"camera_matrix|\b[MK]1\b", text) is not None
        and re.search("opencv[-_](matrix|storage)", text) is not None
    ),
    takes=("which", "size", "fisheye"),
)
NUMBERS = Format(
    "numbers",
    "matrix and coefficients in JSON, YAML or .npz",
    _read_numbers,
    None,
    lambda text: (
        text.startswith("PK")
        or (
            all(_named(key, text) for key in ("matrix", "coefficients"))
            and not re.search(r"(?m)opencv|\"vbaa\.|^\s*(rows|distortion_model):", text)
        )
    ),
    takes=("which", "size", "fisheye"),
)
MRCAL = Format(
    "mrcal",
    ".cameramodel of mrcal",
    _read_mrcal,
    _write_mrcal,
    lambda text: (
        re.search(r"['\"]lens_?model['\"]\s*:\s*['\"]LENSMODEL_", text) is not None and "cameraIntrinsics" not in text
    ),
    with_pose=True,
)
CAHVOR = Format(
    "cahvor",
    ".cahvor of JPL",
    _read_cahvor,
    None,
    lambda text: all(re.search(rf"(?m)^\s*{key}\s*=", text) for key in ("Dimensions", "C", "A", "H", "V")),
    with_pose=True,
)
COLMAP = Format("colmap", "cameras.txt of COLMAP", _read_colmap, _write_colmap, _is_colmap, takes=("which",))
