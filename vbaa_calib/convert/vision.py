"""Camera files of computer vision: OpenCV's FileStorage, mrcal's .cameramodel and COLMAP's cameras.txt."""

from __future__ import annotations

import json
import math
import re
from decimal import Decimal, InvalidOperation, localcontext
from pathlib import Path

import cv2
import numpy as np

from vbaa_calib.core.arrays import FARTHEST_M
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import read_text
from vbaa_calib.geometry import Pose

from .child import MATRICES, read_in_child, read_literal, read_storage
from .values import Exchanged, Format, checked, intrinsics, matrix_of, numbers, one_of, size_of, stated, which_of

_OPENCV_COUNTS = (4, 5, 8, 12, 14)
_MOST_OPENCV = 1_000_000
"""Bytes; calibration samples write a picture's corners and pose, too."""
_OPENCV_NEEDS = "camera_matrix and distortion_coefficients are needed, as OpenCV's calibration samples write them"


def _read_opencv(path: Path, _: str | None) -> Exchanged:
    """FileStorage with the keys of OpenCV's calibration samples (samples/cpp/calibration.cpp, camera_calibration.cpp).

    - Pixels: (0, 0) is the centre of the first pixel. Coefficients: 4, 5, 8, 12 or 14, (k, 1) or (1, k).
    - fisheye_model: 1 where the four coefficients are those of cv::fisheye. `calibration.cpp` does not write it.
    - The samples keep poses of the board, picture by picture; there is no place for the pose of the camera.
    - Written and read by OpenCV itself, 17 digits a number; XML and JSON are read, too.
    """
    text = read_text(path, _MOST_OPENCV)
    if not text.strip():
        raise InputError("is empty", where=path, remedy=_OPENCV_NEEDS)
    try:
        found = read_in_child(read_storage, path)
    except ValueError as error:
        raise InputError(f"OpenCV cannot read it ({error!s:.100})", where=path, remedy=_OPENCV_NEEDS) from None
    for key in MATRICES:
        if key not in found:
            raise InputError(f"{key} is missing or no matrix", where=path, remedy=_OPENCV_NEEDS)
    size = size_of(
        [(key, float(found[key]) if key in found else None) for key in ("image_width", "image_height")], path
    )
    matrix, coefficients = (found[key] for key in MATRICES)
    listed = numbers(coefficients.ravel().tolist(), MATRICES[1], path, _OPENCV_COUNTS)
    fisheye = float(found.get("fisheye_model", 0.0))
    if fisheye and len(listed) != 4:
        raise InputError(f"fisheye_model has {len(listed)} coefficients", where=path, remedy="it takes 4")
    camera = checked("fisheye" if fisheye else "opencv", size, matrix, listed, path)
    guess = "four coefficients without fisheye_model are taken as k1 k2 p1 p2, not as a fisheye's"
    return Exchanged(camera, notes=(guess,) if len(listed) == 4 and "fisheye_model" not in found else ())


def _write_opencv(given: Exchanged) -> str:
    camera = given.camera
    coefficients = camera.distortion if camera.distortion.size else np.zeros(5)
    storage = cv2.FileStorage(".yml", cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY | cv2.FILE_STORAGE_FORMAT_YAML)
    storage.write("image_width", camera.image_size[0])
    storage.write("image_height", camera.image_size[1])
    storage.write("fisheye_model", int(camera.model == "fisheye"))
    storage.write("camera_matrix", np.array(camera.matrix))
    storage.write("distortion_coefficients", np.array(coefficients).reshape(-1, 1))
    return str(storage.releaseAndGetString())


_MRCAL_COUNTS = {"LENSMODEL_PINHOLE": 0} | {f"LENSMODEL_OPENCV{count}": count for count in (4, 5, 8, 12)}
_LARGEST = 100_000_000
"""Bytes; the data of a whole calibration stand in such a file as text."""


def _read_mrcal(path: Path, _: str | None) -> Exchanged:
    """dkogan/mrcal, mrcal/cameramodel.py: a Python literal, there and here for `ast.literal_eval`.

    - Pixels: (0, 0) is the centre of the first pixel. intrinsics: fx, fy, cx, cy, then OpenCV's coefficients in order.
    - LENSMODEL_PINHOLE, _OPENCV4, 5, 8, 12. There is no equidistant fisheye and no sensor tilt.
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
    name = one_of(data.get("lens_model", data.get("lensmodel")), _MRCAL_COUNTS, "lens_model", path)
    sides = numbers(data.get("imagersize"), "imagersize", path, (2,))
    size = size_of([("imagersize", side) for side in sides], path)
    values = numbers(data.get("intrinsics"), "intrinsics", path, (4 + _MRCAL_COUNTS[name],))
    turn_shift = np.array(numbers(data.get("extrinsics"), "extrinsics", path, (6,), FARTHEST_M))
    pose = Pose.from_rotvec(turn_shift[:3], turn_shift[3:]).inverse()
    region = ("valid_intrinsics_region is left out",) if data.get("valid_intrinsics_region") else ()
    return Exchanged(checked("opencv", size, matrix_of(*values[:4]), values[4:], path), pose, notes=region)


def _write_mrcal(given: Exchanged) -> str:
    """Without a pose the camera is its own reference."""
    camera = given.camera
    name, coefficients = stated(camera, {("opencv", count): name for name, count in _MRCAL_COUNTS.items()}, "mrcal")
    pose = (given.T_reference_camera or Pose.identity()).inverse()
    numbers_text = ", ".join(map(repr, [*intrinsics(camera), *coefficients]))
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
}
"""Name → our model, focal lengths, coefficients (filled up with zeros to four)."""
_HALF = Decimal("0.5")
_DIGITS = 400


def _read_colmap(path: Path, which: str | None) -> Exchanged:
    """colmap/colmap, doc/format.rst; models in src/colmap/sensor/models.h. `which` is the CAMERA_ID of several.

    - Pixels: (0.5, 0.5) is the centre of the first pixel: cx and cy stand there larger by 0.5 than here. The half is
      added and taken away in decimal, so that no bit is lost.
    - One line a camera: CAMERA_ID MODEL WIDTH HEIGHT PARAMS. FULL_OPENCV has k1 k2 p1 p2 k3 k4 k5 k6 as OpenCV's eight,
      OPENCV the first four; OPENCV_FISHEYE k1 to k4 of OpenCV's fisheye. The models with one focal length, and the
      radial ones with one or two coefficients, are special cases of these.
    - Poses stand picture by picture in images.txt, which is not written here.
    """
    lines = [(number, line.split()) for number, line in enumerate(read_text(path).splitlines(), 1)]
    rows = {cells[0]: (number, cells) for number, cells in lines if cells and not cells[0].startswith("#")}
    number, cells = rows[which_of(list(rows), which, path)]
    place = Path(f"{path} line {number}")
    model = one_of(cells[1] if len(cells) > 1 else "", _COLMAP_MODELS, "the model", place)
    ours, focal, count = _COLMAP_MODELS[model]
    wanted = 4 + focal + 2 + count
    if len(cells) != wanted:
        raise InputError(f"{len(cells)} cells, {model} has {wanted}", where=place, remedy="write the line again")
    size = size_of([("the picture's side", _plain(cell, place)) for cell in cells[2:4]], place)
    f = [_plain(cell, place) for cell in cells[4 : 4 + focal]]
    centre = [float(_decimal(cell, place, -_HALF)) for cell in cells[4 + focal : 6 + focal]]
    coefficients = [_plain(cell, place) for cell in cells[6 + focal :]]
    filled = coefficients + [0.0] * (4 - count) if 0 < count < 4 else coefficients
    values = numbers([f[0], f[-1], *centre, *filled], "PARAMS", place, (4 + len(filled),))
    return Exchanged(checked(ours, size, matrix_of(*values[:4]), values[4:], place))


def _write_colmap(given: Exchanged) -> str:
    camera = given.camera
    written = {(model, count): name for name, (model, focal, count) in _COLMAP_MODELS.items() if focal == 2}
    name, coefficients = stated(camera, written, "COLMAP's FULL_OPENCV")
    fx, fy, cx, cy = intrinsics(camera)
    centre = [str(_decimal(repr(value), None, _HALF)) for value in (cx, cy)]
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
    """A number as it is written, plus a shift, exactly."""
    try:
        value = Decimal(text)
        if not value.is_finite() or abs(value.adjusted()) > 320 or len(text) > _DIGITS:
            raise InvalidOperation
    except InvalidOperation:
        raise InputError(f"{text!r:.60} is no number", where=place, remedy="write the line again") from None
    with localcontext() as context:
        context.prec = _DIGITS
        return value + shift


OPENCV = Format(
    "opencv",
    "YAML of OpenCV's calibration samples",
    _read_opencv,
    _write_opencv,
    lambda text: "camera_matrix" in text and ("opencv-matrix" in text or "opencv_storage" in text),
)
MRCAL = Format(
    "mrcal",
    ".cameramodel of mrcal",
    _read_mrcal,
    _write_mrcal,
    lambda text: re.search(r"['\"]lens_?model['\"]\s*:\s*['\"]LENSMODEL_", text) is not None,
    with_pose=True,
)
COLMAP = Format("colmap", "cameras.txt of COLMAP", _read_colmap, _write_colmap, _is_colmap, several=True)
