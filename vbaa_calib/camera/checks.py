"""What a camera is made of, checked once where it comes in."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..errors import InputError
from .models import MODELS, LensModel


def checked_model(name: Any) -> LensModel:
    """The model of that name. Raises InputError for an unknown one."""
    if not isinstance(name, str) or name not in MODELS:
        raise InputError(f"the camera model is {name!r}", remedy=f"choose one of {', '.join(sorted(MODELS))}")
    return MODELS[name]


def checked_image_size(image_size: Any) -> tuple[int, int]:
    """(width, height), positive integers."""
    size = list(image_size) if isinstance(image_size, Sequence | np.ndarray) else []
    if len(size) != 2 or not all(isinstance(side, int | np.integer) and side > 0 for side in size):
        raise InputError(f"image_size is {image_size!r}", remedy="give it as two positive integers, (width, height)")
    return int(size[0]), int(size[1])


def checked_matrix(matrix: Any) -> np.ndarray:
    """(3, 3) read-only copy of a camera matrix: fx, fy > 0, no skew, last row 0 0 1."""
    values = _numbers(matrix, "the camera matrix")
    if values.shape != (3, 3):
        raise InputError(f"the camera matrix has the shape {values.shape}", remedy="give it as (3, 3)")
    if values[0, 0] <= 0 or values[1, 1] <= 0:
        raise InputError(
            f"the camera matrix is singular or mirrored: fx = {values[0, 0]:g}, fy = {values[1, 1]:g}",
            remedy="both focal lengths must be positive pixels",
        )
    if values[0, 1] != 0 or values[1, 0] != 0 or values[2].tolist() != [0, 0, 1]:
        raise InputError("the camera matrix has skew or a wrong last row", remedy="give [[fx,0,cx],[0,fy,cy],[0,0,1]]")
    return values


def checked_distortion(distortion: Any, model: LensModel) -> np.ndarray:
    """(k,) read-only copy of the coefficients; OpenCV's (1, k) and (k, 1) are taken too."""
    values = _numbers(distortion, "distortion")
    if values.size != max(values.shape, default=0) or values.size not in model.counts:
        allowed = ", ".join(map(str, model.counts))
        raise InputError(
            f"distortion has the shape {values.shape}", remedy=f"the model {model.name!r} takes {allowed} coefficients"
        )
    return values.reshape(-1)


def checked_covariance(covariance: Any, count: int) -> np.ndarray:
    """(count, count) read-only copy of a symmetric, positive semidefinite matrix."""
    values = _numbers(covariance, "the covariance")
    if values.shape != (count, count):
        raise InputError(f"the covariance has the shape {values.shape}", remedy=f"give it as ({count}, {count})")
    deviation = np.sqrt(np.maximum(np.diag(values), 0.0))
    scale = np.where(deviation > 0, deviation, 1.0)
    correlation = values / np.outer(scale, scale)
    if np.abs(correlation - correlation.T).max() > 1e-6 or np.linalg.eigvalsh(correlation).min() < -1e-6 * count:
        raise InputError("the covariance is not symmetric and positive", remedy="calibrate again")
    return values


def _numbers(values: Any, name: str) -> np.ndarray:
    try:
        array = np.array(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{name} is not an array of numbers", remedy="give finite numbers") from None
    if not np.isfinite(array).all():
        raise InputError(f"{name} has NaN or infinity in it", remedy="give finite numbers")
    array.flags.writeable = False
    return array
