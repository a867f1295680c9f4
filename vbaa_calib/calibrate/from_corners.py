"""Lens calibration from corners that another program detected: checked, then solved like our own."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from targets.board import BoardPoints
from vbaa_calib.core.errors import InputError
from vbaa_calib.detect.board.corners import BoardView, require_corners

from .lens.intrinsics import LensSolution
from .lens.settings import LensSettings
from .lens_from_views import solve_lens


def calibrate_lens(
    views: Sequence[tuple[Any, Any]], image_size: tuple[int, int], board_points: Any, model: str = "auto"
) -> LensSolution:
    """Solve for a lens from corners of a flat board; outliers are found and left out.

    Parameters
    ----------
    views : for each picture the ids (N,) of the board's points it shows and their pixels (N, 2); (0, 0) is the centre
        of the first pixel. image_size : (width, height) px.
    board_points : (K, 3) m, or (K, 2), by id; z = 0 but for what a measured board is bent by.
    model : "auto", or one of none, radial, opencv4, opencv5, rational, thin, tilted, fisheye.

    Returns
    -------
    LensSolution : `camera` with its covariance; `outliers`, per view the ids of corners left out (all of a dropped
        view's); `board_points` (K, 3) m as solved; `trusted`; `verdict` in words.

    Raises InputError for arrays of another form, and for corners that are too few or do not determine the lens.
    """
    size = _size(image_size)
    points = _numbers(board_points, "board_points")
    if points.ndim != 2 or points.shape[1] not in (2, 3) or len(points) < 4:
        remedy = "give at least 4 points as (K, 3), in metres"
        raise InputError(f"board_points have the shape {points.shape}", remedy=remedy)
    points = np.pad(points, ((0, 0), (0, 3 - points.shape[1])))
    extent = float(np.ptp(points[:, :2], axis=0).max())
    if not 0.0 < extent < np.inf or float(np.ptp(points[:, 2])) > LensSettings.most_rise * extent:
        remedy = "give the points of a flat board in its own frame, z = 0, in metres"
        raise InputError("board_points lie in no plane z = 0", remedy=remedy)
    if isinstance(views, str) or not isinstance(views, Sequence):
        raise InputError("views are no list", remedy="give [(ids, pixels), …], a pair for each picture")
    seen, board = [_view(index, one, size, points) for index, one in enumerate(views)], BoardPoints(points)
    return solve_lens(seen, board, model)


def _view(index: int, one: Any, size: tuple[int, int], points: np.ndarray) -> BoardView:
    where = f"views[{index}]"
    try:
        ids, pixels = one
    except (TypeError, ValueError):
        raise InputError("it is no pair", where=where, remedy="give (ids (N,), pixels (N, 2))") from None
    ids, pixels = _numbers(ids, "ids", where), _numbers(pixels, "pixels", where)
    # a view without corners is dropped later, with the reason
    pixels = pixels.reshape(-1, 2) if not pixels.size else pixels
    require_corners(ids, pixels, len(points), where)
    if (np.abs(pixels) > LensSettings.furthest_px).any():
        raise InputError("a pixel lies far outside any picture", where=where, remedy="give pixels of the picture")
    return BoardView(f"view {index:06d}", ids.astype(int), pixels, size)


def _size(image_size: Any) -> tuple[int, int]:
    values = _numbers(image_size, "image_size")
    if (
        values.shape != (2,)
        or (values != np.round(values)).any()
        or not ((values > 0) & (values <= LensSettings.most_px)).all()
    ):
        raise InputError(f"image_size is {image_size!r}", remedy="give (width, height), whole numbers of pixels")
    return int(values[0]), int(values[1])


def _numbers(values: Any, name: str, where: str | None = None) -> np.ndarray:
    try:
        array = np.asarray(values)
    except ValueError:
        raise InputError(f"{name} are lists of different lengths", where=where, remedy="give an array") from None
    if np.ma.is_masked(values) or array.dtype.kind not in "iuf":
        raise InputError(f"{name} are no numbers", where=where, remedy="give an array of integers or floats")
    if not np.isfinite(array).all():
        raise InputError(f"{name} are not all finite", where=where, remedy="leave out what was not found")
    return array.astype(float)
