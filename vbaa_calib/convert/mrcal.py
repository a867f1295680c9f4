"""mrcal's .cameramodel (dkogan/mrcal, mrcal/cameramodel.py): a Python literal, there and here for `ast.literal_eval`.

- Pixels: (0, 0) is the centre of the first pixel. intrinsics: fx, fy, cx, cy, then OpenCV's coefficients in its order.
- LENSMODEL_PINHOLE, _OPENCV4, 5, 8, 12. There is no equidistant fisheye and no sensor tilt.
- extrinsics: a rotation vector and a shift that take points of the reference frame to the camera's (rt_cam_ref, before
  version 2.5 rt_fromref): the inverse of our T_reference_camera. mrcal leaves the unit of length open; ours is metres.
"""

from __future__ import annotations

import ast
import re
import warnings
from pathlib import Path
from typing import Any

import numpy as np

from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import read_text
from vbaa_calib.geometry import Pose

from .values import Exchanged, Format, checked, intrinsics, matrix_of, numbers, one_of, size_of, stated

_COUNTS = {"LENSMODEL_PINHOLE": 0} | {f"LENSMODEL_OPENCV{count}": count for count in (4, 5, 8, 12)}
_LARGEST = 100_000_000
"""Characters; the data of a whole calibration stand in such a file as text."""


def _read(path: Path, _: str | None) -> Exchanged:
    data = _literal(read_text(path), path)
    name = one_of(data.get("lens_model", data.get("lensmodel")), _COUNTS, "lens_model", path)
    sides = numbers(data.get("imagersize"), "imagersize", path, (2,))
    size = size_of([("imagersize", side) for side in sides], path)
    values = numbers(data.get("intrinsics"), "intrinsics", path, (4 + _COUNTS[name],))
    turn_shift = np.array(numbers(data.get("extrinsics"), "extrinsics", path, (6,)))
    pose = Pose.from_rotvec(turn_shift[:3], turn_shift[3:]).inverse()
    region = ("valid_intrinsics_region is left out",) if data.get("valid_intrinsics_region") else ()
    return Exchanged(checked("opencv", size, matrix_of(*values[:4]), values[4:], path), pose, notes=region)


def _write(given: Exchanged) -> str:
    """Without a pose the camera is its own reference."""
    camera = given.camera
    name, coefficients = stated(camera, {("opencv", count): name for name, count in _COUNTS.items()}, "mrcal")
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


def _fits(text: str) -> bool:
    return re.search(r"['\"]lens_?model['\"]\s*:\s*['\"]LENSMODEL_", text) is not None


def _literal(text: str, path: Path) -> dict[str, Any]:
    remedy = "a Python mapping with lens_model, intrinsics, extrinsics and imagersize is needed"
    if len(text) > _LARGEST:
        raise InputError(f"has {len(text)} characters", where=path, remedy="this is no .cameramodel file")
    try:
        with warnings.catch_warnings(action="ignore"):  # of odd escapes in its strings
            data = ast.literal_eval(text)
    except (ValueError, SyntaxError, TypeError, RecursionError, MemoryError) as error:
        line = getattr(error, "lineno", None)
        raise InputError(
            "is no mrcal .cameramodel", where=f"{path} line {line}" if line else path, remedy=remedy
        ) from None
    if not isinstance(data, dict):
        raise InputError("is no mapping", where=path, remedy=remedy)
    return data


FORMAT = Format("mrcal", ".cameramodel of mrcal", _read, _write, _fits, with_pose=True)
