"""Lenses in files of other programs, read by OpenCV and by Python's own parser. `child` runs these in another process:
small files can hang the one, and the other takes a hundred times a file's size of memory."""

from __future__ import annotations

import ast
import json
import warnings
from pathlib import Path

import cv2
import numpy as np

LITERAL_KEYS = ("lens_model", "lensmodel", "intrinsics", "extrinsics", "imagersize", "valid_intrinsics_region")
NUMBERS = ("image_width", "image_height", "fisheye_model")
MATRICES = ("camera_matrix", "distortion_coefficients")


def read_storage(path: Path) -> dict[str, np.ndarray]:
    """The `NUMBERS`, as (), and `MATRICES`, two-dimensional, that a YAML, XML or JSON file has.

    Raises
    ------
    ValueError : OpenCV cannot read it; in its words.
    """
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    try:
        storage = cv2.FileStorage(path.read_text(encoding="utf-8-sig"), cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
        numbers, matrices = ({key: storage.getNode(key) for key in keys} for keys in (NUMBERS, MATRICES))
        found = {key: np.array(node.real()) for key, node in numbers.items() if node.isInt() or node.isReal()}
        for key, node in matrices.items():
            matrix = node.mat() if node.isMap() else None
            if matrix is not None and matrix.size and matrix.ndim == 2:
                found[key] = matrix.astype(float)
    except (cv2.error, SystemError) as error:
        raise ValueError(str(getattr(error, "err", "") or error).strip().partition("\n")[0]) from None
    return found


def read_literal(path: Path) -> dict[str, np.ndarray]:
    """The `LITERAL_KEYS` of the Python mapping that a file is, each as JSON.

    Raises
    ------
    ValueError : it is none, or holds what JSON has no word for.
    """
    try:
        with warnings.catch_warnings(action="ignore"):  # of odd escapes in its strings
            data = ast.literal_eval(path.read_text(encoding="utf-8-sig"))
        if not isinstance(data, dict):
            raise ValueError("is no mapping")
        return {key: np.array(json.dumps(data[key])) for key in LITERAL_KEYS if key in data}
    except (SyntaxError, TypeError, RecursionError, MemoryError) as error:
        line = getattr(error, "lineno", None)
        raise ValueError(f"line {line} is no Python" if line else "is no Python literal") from None
