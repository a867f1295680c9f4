"""Undistortion, speed against error: OpenCV and kornia at several numbers of steps, and the metric layer."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import cv2
import numpy as np
import torch

from ..camera import Camera
from ..console import progress
from .lenses import lenses
from .timing import median_seconds

EXACT_PX = 1e-9
"""The accuracy at which methods are compared for speed."""
SILENT_PX = 1e-3
"""A point this far off that is not marked invalid is silently wrong."""
LADDER = (5, 10, 20, 50, 100, 200, 500, 1000, 2000)
"""Numbers of steps tried until a fixed-point method is exact."""
LIVE_POINTS = 200

Undistort = Callable[[np.ndarray], np.ndarray]
"""(N, 2) pixels → (N, 2) ideal normalized points; NaN where the method marks a point."""


@dataclass(frozen=True)
class Row:
    """One method on one lens.

    Attributes
    ----------
    error_px : largest reprojection error among the points that a converged inverse can reach.
    silent : fraction of all pixels of the picture that come out wrong and unmarked. marked : NaN on purpose.
    batch_ms, live_ms : median time for the batch, and for 200 points in one call.
    ratio : its batch time over ours.
    """

    lens: str
    method: str
    error_px: float
    silent: float
    marked: float
    batch_ms: float
    live_ms: float
    ratio: float


def _distorted(camera: Camera, points: np.ndarray) -> np.ndarray:
    """(N, 2) pixels of ideal points by OpenCV: the judge is none of the contestants' own code."""
    if camera.model == "fisheye":
        return cv2.fisheye.distortPoints(points[:, None], camera.matrix, camera.distortion).reshape(-1, 2)
    rays = np.column_stack([points, np.ones(len(points))])
    zero = np.zeros(3)
    return cv2.projectPoints(rays, zero, zero, camera.matrix, camera.distortion)[0].reshape(-1, 2)


def errors_px(camera: Camera, pixels: np.ndarray, ideal: np.ndarray) -> np.ndarray:
    """(N,) distance in pixels between the input and the output distorted again; NaN stays NaN."""
    finite = np.isfinite(ideal).all(axis=1)
    off = np.full(len(pixels), np.nan)
    with np.errstate(all="ignore"):
        again = _distorted(camera, np.where(finite[:, None], ideal, 0.0))
        off[finite] = np.hypot(*(again - pixels)[finite].T)
    return np.where(finite & ~np.isfinite(off), np.inf, off)


def _opencv(camera: Camera, steps: int) -> Undistort:
    if camera.model == "fisheye":
        # its default: 10 steps, and points that have not settled to 1e-8 rad are marked by (−1e6, −1e6)
        criteria = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, steps, 1e-8)

        def fisheye(pixels: np.ndarray) -> np.ndarray:
            out = cv2.fisheye.undistortPoints(pixels[:, None], camera.matrix, camera.distortion, criteria=criteria)
            return np.where(out == -1e6, np.nan, out).reshape(-1, 2)

        return fisheye
    if steps == 5:
        return lambda pixels: cv2.undistortPoints(pixels[:, None], camera.matrix, camera.distortion).reshape(-1, 2)
    criteria, eye = (cv2.TERM_CRITERIA_COUNT, steps, 0.0), np.eye(3)

    def iterated(pixels: np.ndarray) -> np.ndarray:
        out = cv2.undistortPointsIter(pixels[:, None], camera.matrix, camera.distortion, eye, eye, criteria)
        return out.reshape(-1, 2)

    return iterated


def _kornia(camera: Camera, steps: int) -> Undistort:
    from kornia.geometry.calibration import undistort_points

    matrix, distortion = (torch.from_numpy(values.copy()) for values in (camera.matrix, camera.distortion))
    identity = torch.eye(3, dtype=torch.float64)

    def undistort(pixels: np.ndarray) -> np.ndarray:
        given = torch.from_numpy(pixels)
        return undistort_points(given, matrix, distortion, identity, num_iters=steps).numpy()

    return undistort


def _ours(camera: Camera) -> Undistort:
    return lambda pixels: camera.unproject_normalized(pixels)[0]


def _ours_tensor(camera: Camera) -> Undistort:
    return lambda pixels: camera.unproject_normalized(torch.from_numpy(pixels))[0].numpy()


def contestants(camera: Camera, pixels: np.ndarray) -> Iterator[tuple[str, Undistort]]:
    """Name and function of every method for a lens; ours first, for the others' ratios."""
    yield "this layer", _ours(camera)
    yield "this layer, tensors", _ours_tensor(camera)
    reachable = pixels[np.isfinite(_ours(camera)(pixels)).all(axis=1)][:20_000]
    families: list[tuple[str, Callable[[Camera, int], Undistort], Sequence[int]]] = [("OpenCV", _opencv, (5,))]
    if camera.model == "opencv":
        families.append(("kornia", _kornia, (5, 10, 50)))
    for family, make, always in families:
        needed = steps_needed(camera, make, reachable)
        for steps in sorted({*always, needed}):
            yield f"{family}, {steps} steps", make(camera, steps)


def steps_needed(camera: Camera, make: Callable[[Camera, int], Undistort], pixels: np.ndarray) -> int:
    """Fewest steps of the ladder that make a method exact, or that it stops improving at."""
    best, chosen = np.inf, LADDER[0]
    for steps in LADDER:
        off = errors_px(camera, pixels, make(camera, steps)(pixels))
        error = float(np.nanmax(off, initial=0.0)) if not np.isnan(off).any() else np.inf
        if error < 0.5 * best:
            best, chosen = error, steps
        if best <= EXACT_PX:
            break
    return chosen


def run(points: int, seed: int, repeats: int) -> list[Row]:
    """Every method on every lens, over random pixels of the whole picture."""
    rows: list[Row] = []
    for name, camera in progress(lenses().items(), "lenses", len(lenses())):
        width, height = camera.image_size
        pixels = np.random.default_rng(seed).uniform((0, 0), (width - 1, height - 1), (points, 2))
        live = np.ascontiguousarray(pixels[:LIVE_POINTS])
        valid = camera.unproject_normalized(pixels)[1]
        ours_ms = np.nan
        for method, undistort in contestants(camera, pixels):
            off = errors_px(camera, pixels, undistort(pixels))
            batch_ms = 1e3 * median_seconds(partial(undistort, pixels), repeats)
            ours_ms = batch_ms if method == "this layer" else ours_ms
            rows.append(
                Row(
                    lens=name,
                    method=method,
                    error_px=float(np.nanmax(off[valid], initial=0.0)),
                    silent=float((off > SILENT_PX).mean()),
                    marked=float(np.isnan(off).mean()),
                    batch_ms=batch_ms,
                    live_ms=1e3 * median_seconds(partial(undistort, live), repeats),
                    ratio=batch_ms / ours_ms,
                )
            )
    return rows
