"""OpenCV's FileStorage with the keys of its calibration samples (samples/cpp/calibration.cpp, camera_calibration.cpp).

- Pixels: (0, 0) is the centre of the first pixel. Coefficients: 4, 5, 8, 12 or 14, (k, 1) or (1, k).
- fisheye_model: 1 where the four coefficients are those of cv::fisheye. `calibration.cpp` does not write it.
- The samples keep poses of the board, picture by picture; there is no place for the pose of the camera.
- Written and read by OpenCV itself, 17 digits a number; XML and JSON are read, too.
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import read_text

from .values import Exchanged, Format, checked, numbers, size_of

_COUNTS = (4, 5, 8, 12, 14)
_MEMORY = cv2.FILE_STORAGE_MEMORY
_REMEDY = "camera_matrix and distortion_coefficients are needed, as OpenCV's calibration samples write them"


def _read(path: Path, _: str | None) -> Exchanged:
    text = read_text(path)
    if not text.strip():
        raise InputError("is empty", where=path, remedy=_REMEDY)
    level = cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    try:
        storage = cv2.FileStorage(text, cv2.FILE_STORAGE_READ | _MEMORY)
        return _taken(storage, path)
    except (cv2.error, SystemError, UnicodeDecodeError, ValueError) as error:
        why = str(getattr(error, "err", "") or error).strip().partition("\n")[0]
        raise InputError(f"OpenCV cannot read it ({why:.100})", where=path, remedy=_REMEDY) from None
    finally:
        cv2.utils.logging.setLogLevel(level)


def _taken(storage: cv2.FileStorage, path: Path) -> Exchanged:
    size = size_of([(key, _number(storage, key)) for key in ("image_width", "image_height")], path)
    matrix = _mat(storage, "camera_matrix", path)
    coefficients = numbers(
        _mat(storage, "distortion_coefficients", path).ravel().tolist(), "distortion_coefficients", path, _COUNTS
    )
    fisheye = _number(storage, "fisheye_model")
    if fisheye and len(coefficients) != 4:
        raise InputError(f"fisheye_model has {len(coefficients)} coefficients", where=path, remedy="it takes 4")
    camera = checked("fisheye" if fisheye else "opencv", size, matrix, coefficients, path)
    guess = "four coefficients without fisheye_model are taken as k1 k2 p1 p2, not as a fisheye's"
    return Exchanged(camera, notes=(guess,) if len(coefficients) == 4 and fisheye is None else ())


def _write(given: Exchanged) -> str:
    camera = given.camera
    coefficients = camera.distortion if camera.distortion.size else np.zeros(5)
    storage = cv2.FileStorage(".yml", cv2.FILE_STORAGE_WRITE | _MEMORY | cv2.FILE_STORAGE_FORMAT_YAML)
    storage.write("image_width", camera.image_size[0])
    storage.write("image_height", camera.image_size[1])
    storage.write("fisheye_model", int(camera.model == "fisheye"))
    storage.write("camera_matrix", np.array(camera.matrix))
    storage.write("distortion_coefficients", np.array(coefficients).reshape(-1, 1))
    return str(storage.releaseAndGetString())


def _fits(text: str) -> bool:
    return "camera_matrix" in text and ("opencv-matrix" in text or "opencv_storage" in text)


def _number(storage: cv2.FileStorage, key: str) -> float | None:
    node = storage.getNode(key)
    return node.real() if node.isInt() or node.isReal() else None


def _mat(storage: cv2.FileStorage, key: str, path: Path) -> np.ndarray:
    node = storage.getNode(key)
    matrix = node.mat() if node.isMap() else None
    if matrix is None or matrix.size == 0 or matrix.ndim != 2:
        raise InputError(f"{key} is missing or no matrix", where=path, remedy=_REMEDY)
    return matrix.astype(float)


FORMAT = Format("opencv", "YAML of OpenCV's calibration samples", _read, _write, _fits)
