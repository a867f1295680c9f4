"""Runs mrcal or lensboy on many problems: `python peer_script.py PEER PROBLEMS.npz ANSWERS.npz`.

It is started with the interpreter that has the peer, so it imports numpy and the peer alone.

PROBLEMS.npz: points_m (N, 3) of the board, row by row; columns, spacing_m of its corners; image_size (2,); lens,
"opencv5" or "rational"; focal_px, which mrcal asks its user for; and of every corner seen its draw, view and ids (M,)
and corners_px (M, 2).
ANSWERS.npz: of every draw its intrinsics (D, 4 + k), NaN where the peer failed, seconds (D,) and failures (D,); kept
(M,), whether a corner was used.
"""

from __future__ import annotations

import sys
import time
from importlib import import_module
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np

_START_DISTORTION = 1e-6


class Problem(NamedTuple):
    """One draw: the board, the picture's size, and per view its ids (N,) and corners (N, 2) px."""

    points_m: np.ndarray
    columns: int
    spacing_m: float
    image_size: tuple[int, int]
    lens: str
    focal_px: float
    ids: list[np.ndarray]
    corners_px: list[np.ndarray]


class Answer(NamedTuple):
    """Intrinsics (4 + k,), and per view (N,) which corners were used."""

    intrinsics: np.ndarray
    kept: list[np.ndarray]


def _solve_with_mrcal(mrcal: ModuleType, given: Problem) -> Answer:
    """Its own seed, then the core, then all with outlier rejection, board warp and regularisation: its defaults."""
    views, rows = len(given.ids), len(given.points_m) // given.columns
    observed = np.full((views, rows * given.columns, 3), -1.0)
    for row, ids, corners in zip(observed, given.ids, given.corners_px, strict=True):
        row[ids, :2], row[ids, 2] = corners, 1.0
    board = observed.reshape(views, rows, given.columns, 3)
    sizes = np.array([given.image_size], dtype=np.int32)
    indices = np.column_stack([np.arange(views), np.zeros(views), np.full(views, -1)]).astype(np.int32)
    intrinsics, extrinsics, frames = mrcal.seed_stereographic(
        imagersizes=sizes,
        focal_estimate=given.focal_px,
        indices_frame_camera=np.ascontiguousarray(indices[:, :2]),
        observations=board,
        object_spacing=given.spacing_m,
    )
    shared: dict[str, Any] = {
        "imagersizes": sizes,
        "calibration_object_spacing": given.spacing_m,
        "indices_frame_camintrinsics_camextrinsics": indices,
        "observations_board": board,
        "extrinsics_rt_fromref": extrinsics,
        "frames_rt_toref": frames,
        "points": None,
        "observations_point": None,
        "indices_point_camintrinsics_camextrinsics": None,
    }
    seeding = {"do_optimize_calobject_warp": False, "do_apply_outlier_rejection": False}
    for core in ({"do_optimize_intrinsics_core": False}, {}):
        mrcal.optimize(intrinsics=intrinsics, lensmodel="LENSMODEL_STEREOGRAPHIC", **core, **seeding, **shared)
    count = {"opencv5": 5, "rational": 8}[given.lens]
    # a start at exactly nil is a place where its regularisation has no slope
    start = _START_DISTORTION * np.random.default_rng(0).uniform(-1.0, 1.0, (1, count))
    intrinsics = np.hstack([intrinsics, start])
    lensmodel = f"LENSMODEL_OPENCV{count}"
    mrcal.optimize(intrinsics=intrinsics, lensmodel=lensmodel, calobject_warp=np.zeros(2), **shared)
    # it marks outliers in place
    return Answer(intrinsics[0], [row[ids, 2] > 0.0 for row, ids in zip(observed, given.ids, strict=True)])


def _solve_with_lensboy(lensboy: ModuleType, given: Problem) -> Answer:
    """Its OpenCV model with its defaults: target warp and outlier filter on."""
    included = np.zeros(14, dtype=bool)
    included[: {"opencv5": 5, "rational": 8}[given.lens]] = True
    config = lensboy.OpenCVConfig(
        image_height=given.image_size[1],
        image_width=given.image_size[0],
        included_distortion_coefficients=included,
    )
    frames = [lensboy.Frame(ids, corners) for ids, corners in zip(given.ids, given.corners_px, strict=True)]
    result = lensboy.calibrate_camera(given.points_m, frames, config)
    camera = result.camera_model
    core = [camera.fx, camera.fy, camera.cx, camera.cy]
    kept = [
        np.zeros(len(ids), bool) if seen is None else np.asarray(seen.inlier_mask, bool)
        for seen, ids in zip(result.frame_diagnostics, given.ids, strict=True)
    ]
    return Answer(np.concatenate([core, np.ravel(camera.distortion_coeffs)[included]]), kept)


SOLVERS = {"mrcal": _solve_with_mrcal, "lensboy": _solve_with_lensboy}


def main(peer: str, problems: str, answers: str) -> None:
    """Solve each draw, after one solve that only warms up; the seconds are those of the solve alone."""
    library, solve = import_module(peer), SOLVERS[peer]
    given = dict(np.load(problems))
    draws = int(given["draw"].max()) + 1
    size = 4 + {"opencv5": 5, "rational": 8}[str(given["lens"])]
    intrinsics, seconds = np.full((draws, size), np.nan), np.full(draws, np.nan)
    kept, failures = np.ones(len(given["ids"]), bool), [""] * draws
    for number in [0, *range(draws)]:
        corners = np.flatnonzero(given["draw"] == number)
        views = np.split(corners, np.flatnonzero(np.diff(given["view"][corners])) + 1)
        problem = Problem(
            given["points_m"],
            int(given["columns"]),
            float(given["spacing_m"]),
            (int(given["image_size"][0]), int(given["image_size"][1])),
            str(given["lens"]),
            float(given["focal_px"]),
            [given["ids"][view] for view in views],
            [given["corners_px"][view] for view in views],
        )
        begun = time.perf_counter()
        try:
            answer = solve(library, problem)
        # whatever a foreign library raises is a failure of that draw
        except Exception as error:
            failures[number] = f"{type(error).__name__}: {error}".splitlines()[0]
            continue
        seconds[number] = time.perf_counter() - begun
        intrinsics[number] = answer.intrinsics
        kept[corners] = np.concatenate(answer.kept)
    np.savez(answers, intrinsics=intrinsics, seconds=seconds, kept=kept, failures=np.array(failures))


if __name__ == "__main__":
    main(*sys.argv[1:])
