"""`vbaa bench metric`: pixels to rays, speed against error, beside OpenCV and kornia."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import cv2
import numpy as np
import torch

from benchmarks.figures import AMBER, GREEN, VIOLET, label, label_x, legend, name_points, panels
from benchmarks.harness import Findings, Options, column, median_seconds, table
from vbaa_calib.camera import Camera
from vbaa_calib.core.console import progress

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def _camera(model: str, size: tuple[int, int], focal: float, centre: tuple[float, float], *distortion: float) -> Camera:
    matrix = np.array([[focal, 0.0, centre[0]], [0.0, focal, centre[1]], [0.0, 0.0, 1.0]])
    return Camera(model, size, matrix, np.array(distortion))


def lenses() -> dict[str, Camera]:
    """Name → camera."""
    return {
        "mild barrel, 4": _camera("opencv", (960, 720), 1004.0, (476.5, 363.2), -0.182, 0.061, 7e-4, -5e-4),
        "radial, 5": _camera("opencv", (1280, 720), 900.0, (643.2, 355.1), -0.25, 0.09, 0.0, 0.0, -0.01),
        "GoPro, 5": _camera("opencv", (1280, 720), 587.0, (640.2, 355.4), -0.2717, 0.1042, 5e-4, -6e-4, -0.0215),
        "endoscope, 5": _camera("opencv", (720, 576), 870.0, (280.2, 276.0), -0.3159, 0.4299, -1.7e-3, 7.6e-3, 0.742),
        "rational, 8": _camera(
            "opencv", (1280, 720), 587.0, (641.0, 356.2), 0.31, 0.025, 4e-4, -3e-4, 1e-3, 0.56, 0.061, 5e-3
        ),
        "strong barrel, 5": _camera("opencv", (1280, 720), 600.0, (643.2, 355.1), -0.38, 0.17, 8e-4, -5e-4, -0.035),
        "fisheye 170°": _camera("fisheye", (1600, 1200), 640.0, (803.1, 596.4), 0.02, -0.006, 0.002, -0.0006),
    }


_EXACT_PX = 1e-9
"""The accuracy at which methods are compared for speed."""
_SILENT_PX = 1e-3
"""A point this far off that is not marked invalid is silently wrong."""
LADDER = (5, 10, 20, 50, 100, 200, 500, 1000, 2000)
"""Numbers of steps tried until a fixed-point method is exact."""
_LIVE_POINTS = 200

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

    lens: str = column("lens")
    method: str = column("method")
    error_px: float = column("error px", ".1e")
    silent: float = column("silent %", ".2f", 100)
    marked: float = column("marked %", ".2f", 100)
    batch_ms: float = column("ms", ".1f")
    live_ms: float = column("200 ms", ".3f")
    ratio: float = column("× ours", ".2f")


def _distorted(camera: Camera, points: np.ndarray) -> np.ndarray:
    """(N, 2) pixels of ideal points by OpenCV: the judge is none of the compared methods."""
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


def _contestants(camera: Camera, pixels: np.ndarray) -> Iterator[tuple[str, Undistort]]:
    """Name and function of every method for a lens; ours first, for the others' ratios."""
    yield "this layer", lambda pixels: camera.unproject_normalized(pixels)[0]
    yield "this layer, tensors", lambda pixels: camera.unproject_normalized(torch.from_numpy(pixels))[0].numpy()
    reachable = pixels[np.isfinite(camera.unproject_normalized(pixels)[0]).all(axis=1)][:20_000]
    families: list[tuple[str, Callable[[Camera, int], Undistort], Sequence[int]]] = [("OpenCV", _opencv, (5,))]
    if camera.model == "opencv":
        families.append(("kornia", _kornia, (5, 10, 50)))
    for family, make, always in families:
        needed = _steps_needed(camera, make, reachable)
        for steps in sorted({*always, needed}):
            yield f"{family}, {steps} steps", make(camera, steps)


def _steps_needed(camera: Camera, make: Callable[[Camera, int], Undistort], pixels: np.ndarray) -> int:
    """Fewest steps of the ladder that make a method exact, or that it stops improving at."""
    best, chosen = np.inf, LADDER[0]
    for steps in LADDER:
        off = errors_px(camera, pixels, make(camera, steps)(pixels))
        error = float(np.nanmax(off, initial=0.0)) if not np.isnan(off).any() else np.inf
        if error < 0.5 * best:
            best, chosen = error, steps
        if best <= _EXACT_PX:
            break
    return chosen


def run(points: int, seed: int, repeats: int) -> list[Row]:
    """Every method on every lens, over random pixels of the whole picture."""
    rows: list[Row] = []
    for name, camera in progress(lenses().items(), "lenses", len(lenses())):
        width, height = camera.image_size
        pixels = np.random.default_rng(seed).uniform((0, 0), (width - 1, height - 1), (points, 2))
        live = np.ascontiguousarray(pixels[:_LIVE_POINTS])
        valid = camera.unproject_normalized(pixels)[1]
        ours_ms = np.nan
        for method, undistort in _contestants(camera, pixels):
            off = errors_px(camera, pixels, undistort(pixels))
            batch_ms = 1e3 * median_seconds(partial(undistort, pixels), repeats)
            ours_ms = batch_ms if method == "this layer" else ours_ms
            rows.append(
                Row(
                    lens=name,
                    method=method,
                    error_px=float(np.nanmax(off[valid], initial=0.0)),
                    silent=float((off > _SILENT_PX).mean()),
                    marked=float(np.isnan(off).mean()),
                    batch_ms=batch_ms,
                    live_ms=1e3 * median_seconds(partial(undistort, live), repeats),
                    ratio=batch_ms / ours_ms,
                )
            )
    return rows


_TITLE = "{} pixels over the whole picture; silent: wrong by over 0.001 px and not marked"
_FAMILIES = {"this layer": (GREEN, "s"), "OpenCV": (AMBER, "o"), "kornia": (VIOLET, "^")}
"""Family of methods → its colour and mark."""


def figure(rows: Sequence[Row], points: int) -> Figure:
    """Error over time per point, one panel per lens, both logarithmic."""
    names = list(dict.fromkeys(row.lens for row in rows))
    drawn, every = panels(len(names), 3, (3.7, 2.6), sharex=True, sharey=True)
    for name, panel in zip(names, every, strict=True):
        points_named = []
        for row in (row for row in rows if row.lens == name):
            family, _, detail = row.method.partition(", ")
            colour, mark = _FAMILIES[family]
            at = 1e6 * row.batch_ms / points, max(row.error_px, 1e-14)
            panel.loglog(*at, mark, color=colour, markersize=5)
            points_named.append((detail.removesuffix(" steps"), *at, colour))
        name_points(panel, points_named)
        label(panel, name)
    legend(drawn, _FAMILIES, title="numbers: steps")
    label_x(every, 3, "time, ns per point")
    drawn.supylabel("largest error, px")
    return drawn


_REPEATS = {False: 5, True: 3}
"""Timings of each number, without and with --quick."""


def measure(options: Options) -> Findings:
    """Every method on every lens; a draw is a random pixel."""
    rows = run(options.draws, options.seed, _REPEATS[options.quick])
    return Findings(
        table(rows, _TITLE.format(options.draws), once=1),
        {"metric.csv": rows},
        {"metric.png": lambda: figure(rows, options.draws)},
        {"rows": rows},
        headline(rows),
    )


def headline(rows: Sequence[Row]) -> str:
    """Our error, and OpenCV's times at the accuracy that it needs most steps for."""
    ours = [row for row in rows if row.method == "this layer"]
    times = [_equal(rows, row.lens, "OpenCV").ratio for row in ours]
    silent = 100 * max(row.silent for row in ours)
    return (
        f"error ≤ {max(row.error_px for row in ours):.0e} px, silently wrong {silent:.0f} %; at equal accuracy OpenCV "
        f"takes {min(times):.1f} to {max(times):.0f} times as long"
    )


def _equal(rows: Sequence[Row], lens: str, family: str) -> Row:
    """Of one family the quickest method that is exact, or as good as it gets."""
    own = [row for row in rows if row.lens == lens and row.method.startswith(family)]
    best = min(row.error_px for row in own)
    return min((row for row in own if row.error_px <= max(_EXACT_PX, 2.0 * best)), key=lambda row: row.batch_ms)
