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

_LENSES = {
    "mild barrel, 4": ("opencv", (960, 720), 1004.0, (476.5, 363.2), (-0.182, 0.061, 7e-4, -5e-4)),
    "radial, 5": ("opencv", (1280, 720), 900.0, (643.2, 355.1), (-0.25, 0.09, 0.0, 0.0, -0.01)),
    "GoPro, 5": ("opencv", (1280, 720), 587.0, (640.2, 355.4), (-0.2717, 0.1042, 5e-4, -6e-4, -0.0215)),
    "endoscope, 5": ("opencv", (720, 576), 870.0, (280.2, 276.0), (-0.3159, 0.4299, -1.7e-3, 7.6e-3, 0.742)),
    "rational, 8": ("opencv", (1280, 720), 587.0, (641, 356.2), (0.31, 0.025, 4e-4, -3e-4, 1e-3, 0.56, 0.061, 5e-3)),
    "strong barrel, 5": ("opencv", (1280, 720), 600.0, (643.2, 355.1), (-0.38, 0.17, 8e-4, -5e-4, -0.035)),
    "fisheye 170°": ("fisheye", (1600, 1200), 640.0, (803.1, 596.4), (0.02, -0.006, 0.002, -0.0006)),
}
"""Name → OpenCV's model, picture size, focal length, principal point, distortion."""
_EXACT_PX, _SILENT_PX = 1e-9, 1e-3
"""The accuracy at which methods are compared for speed; a point this far off and unmarked is silently wrong."""
_STEPS = (5, 10, 20, 50, 100, 200, 500, 1000, 2000)
"""Numbers of steps tried until a fixed-point method is exact."""
_LIVE_POINTS = 200

Undistort = Callable[[np.ndarray], np.ndarray]
"""(N, 2) pixels → (N, 2) ideal normalized points; NaN where the method marks a point."""


@dataclass(frozen=True)
class Row:
    """One method on one lens.

    error_px : largest reprojection error among the points that a converged inverse can reach.
    silent : fraction of all pixels of the picture that come out wrong and unmarked. marked : NaN on purpose.
    batch_ms, live_ms : median time for the batch, and for 200 points in one call. ratio : its batch time over ours.
    """

    lens: str = column("lens")
    method: str = column("method")
    error_px: float = column("error px", ".1e")
    silent: float = column("silent %", ".2f", 100)
    marked: float = column("marked %", ".2f", 100)
    batch_ms: float = column("ms", ".1f")
    live_ms: float = column("200 ms", ".3f")
    ratio: float = column("× ours", ".2f")


def errors_px(camera: Camera, pixels: np.ndarray, ideal: np.ndarray) -> np.ndarray:
    """(N,) distance in pixels between the input and the output distorted again by OpenCV; NaN stays NaN."""
    finite = np.isfinite(ideal).all(axis=1)
    off, points = np.full(len(pixels), np.nan), np.where(finite[:, None], ideal, 0.0)
    with np.errstate(all="ignore"):
        if camera.model == "fisheye":
            again = cv2.fisheye.distortPoints(points[:, None], camera.matrix, camera.distortion)
        else:
            rays, zero = np.column_stack([points, np.ones(len(points))]), np.zeros(3)
            again = cv2.projectPoints(rays, zero, zero, camera.matrix, camera.distortion)[0]
        off[finite] = np.hypot(*(again.reshape(-1, 2) - pixels)[finite].T)
    return np.where(finite & ~np.isfinite(off), np.inf, off)


def _opencv(camera: Camera, steps: int) -> Undistort:
    given, eye = (camera.matrix, camera.distortion), np.eye(3)

    def fisheye(pixels: np.ndarray) -> np.ndarray:
        # its default: 10 steps, and points that have not settled to 1e-8 rad are marked by (−1e6, −1e6)
        criteria = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, steps, 1e-8)
        out = cv2.fisheye.undistortPoints(pixels[:, None], *given, criteria=criteria)
        return np.where(out == -1e6, np.nan, out).reshape(-1, 2)

    if camera.model == "fisheye":
        return fisheye
    if steps == 5:
        return lambda pixels: cv2.undistortPoints(pixels[:, None], *given).reshape(-1, 2)
    count = (cv2.TERM_CRITERIA_COUNT, steps, 0.0)
    return lambda pixels: cv2.undistortPointsIter(pixels[:, None], *given, eye, eye, count).reshape(-1, 2)


def _kornia(camera: Camera, steps: int) -> Undistort:
    from kornia.geometry.calibration import undistort_points

    matrix, distortion, eye = (torch.from_numpy(v.copy()) for v in (camera.matrix, camera.distortion, np.eye(3)))
    return lambda pixels: undistort_points(torch.from_numpy(pixels), matrix, distortion, eye, num_iters=steps).numpy()


def _contestants(camera: Camera, pixels: np.ndarray) -> Iterator[tuple[str, Undistort]]:
    """Name and function of every method for a lens; ours first, for the others' ratios."""
    yield "this layer", lambda pixels: camera.unproject_normalized(pixels)[0]
    yield "this layer, tensors", lambda pixels: camera.unproject_normalized(torch.from_numpy(pixels))[0].numpy()
    reachable = pixels[np.isfinite(camera.unproject_normalized(pixels)[0]).all(axis=1)][:20_000]
    families: list[tuple[str, Callable[[Camera, int], Undistort], Sequence[int]]] = [("OpenCV", _opencv, (5,))]
    if camera.model == "opencv":
        families.append(("kornia", _kornia, (5, 10, 50)))
    for family, make, always in families:
        # fewest steps that make a method exact, or that it stops improving at
        best, needed = np.inf, _STEPS[0]
        for steps in _STEPS:
            off = errors_px(camera, reachable, make(camera, steps)(reachable))
            error = float(np.nanmax(off, initial=0.0)) if not np.isnan(off).any() else np.inf
            if error < 0.5 * best:
                best, needed = error, steps
            if best <= _EXACT_PX:
                break
        for steps in sorted({*always, needed}):
            yield f"{family}, {steps} steps", make(camera, steps)


def run(points: int, seed: int, repeats: int) -> list[Row]:
    """Every method on every lens, over random pixels of the whole picture."""
    rows: list[Row] = []
    for name, (model, size, f, (cx, cy), lens) in progress(_LENSES.items(), "lenses", len(_LENSES)):
        camera = Camera(model, size, np.array([[f, 0.0, cx], [0.0, f, cy], [0.0, 0.0, 1.0]]), np.array(lens))
        width, height = size
        pixels = np.random.default_rng(seed).uniform((0, 0), (width - 1, height - 1), (points, 2))
        valid, batches = camera.unproject_normalized(pixels)[1], (pixels, pixels[:_LIVE_POINTS].copy())
        ours_ms = np.nan
        for method, undistort in _contestants(camera, pixels):
            off = errors_px(camera, pixels, undistort(pixels))
            batch, live = (1e3 * median_seconds(partial(undistort, some), repeats) for some in batches)
            ours_ms = batch if method == "this layer" else ours_ms
            error, silent = float(np.nanmax(off[valid], initial=0.0)), float((off > _SILENT_PX).mean())
            rows.append(Row(name, method, error, silent, float(np.isnan(off).mean()), batch, live, batch / ours_ms))
    return rows


_TITLE = "{} pixels over the whole picture; silent: wrong by over 0.001 px and not marked"
_FAMILIES = {"this layer": (GREEN, "s"), "OpenCV": (AMBER, "o"), "kornia": (VIOLET, "^")}
"""Family of methods → its colour and mark."""


def _figure(rows: Sequence[Row], points: int) -> Figure:
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


def measure(options: Options) -> Findings:
    """Every method on every lens; a draw is a random pixel."""
    rows = run(options.draws, options.seed, 3 if options.quick else 5)
    text, draw = table(rows, _TITLE.format(options.draws), once=1), partial(_figure, rows, options.draws)
    return Findings(text, {"metric.csv": rows}, {"metric.png": draw}, {"rows": rows}, _headline(rows))


def _headline(rows: Sequence[Row]) -> str:
    """Our error, and OpenCV's times at the accuracy that it needs most steps for."""
    ours = [row for row in rows if row.method == "this layer"]
    times = []
    for lens in (row.lens for row in ours):
        theirs = [row for row in rows if row.lens == lens and row.method.startswith("OpenCV")]
        enough = max(_EXACT_PX, 2.0 * min(row.error_px for row in theirs))
        times.append(min((row for row in theirs if row.error_px <= enough), key=lambda row: row.batch_ms).ratio)
    return (
        f"error ≤ {max(row.error_px for row in ours):.0e} px, silently wrong "
        f"{100 * max(row.silent for row in ours):.0f} %; at equal accuracy OpenCV takes {min(times):.1f} to "
        f"{max(times):.0f} times as long"
    )
