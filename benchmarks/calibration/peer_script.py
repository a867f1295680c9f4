"""Runs mrcal or lensboy on many problems: `python peer_script.py PEER`, a line of JSON in and out for each.

It is started with the interpreter that has the peer, so it imports numpy and the peer alone.

In: points_m [N, 3] of the board, row by row; columns, spacing_m of its corners; image_size; coefficients of the
distortion, 4, 5 or 8; focal_px, which mrcal asks its user for; views, each its ids [M] and corners [M, 2].
Out, after "answer: ": intrinsics [4 + k], seconds, and kept, per view whether a corner was used; or the failure.
"""

from __future__ import annotations

import json
import sys
import time
from importlib import import_module
from types import ModuleType
from typing import Any

import numpy as np

_START_DISTORTION = 1e-6

Views = list[tuple[np.ndarray, np.ndarray]]
"""Of each view ids (N,) and corners (N, 2) px."""


def _solve_with_mrcal(mrcal: ModuleType, given: dict[str, Any], seen: Views) -> tuple[np.ndarray, list[np.ndarray]]:
    """Its own seed, then the core, then all with outlier rejection, board warp and regularisation: its defaults."""
    views, columns, count = len(seen), given["columns"], given["coefficients"]
    observed = np.full((views, len(given["points_m"]), 3), -1.0)
    for row, (ids, corners) in zip(observed, seen, strict=True):
        row[ids, :2], row[ids, 2] = corners, 1.0
    board = observed.reshape(views, -1, columns, 3)
    sizes = np.array([given["image_size"]], dtype=np.int32)
    indices = np.column_stack([np.arange(views), np.zeros(views), np.full(views, -1)]).astype(np.int32)
    intrinsics, extrinsics, frames = mrcal.seed_stereographic(
        imagersizes=sizes,
        focal_estimate=given["focal_px"],
        indices_frame_camera=np.ascontiguousarray(indices[:, :2]),
        observations=board,
        object_spacing=given["spacing_m"],
    )
    shared: dict[str, Any] = {
        "imagersizes": sizes,
        "calibration_object_spacing": given["spacing_m"],
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
    # a start at exactly nil is a place where its regularisation has no slope
    start = _START_DISTORTION * np.random.default_rng(0).uniform(-1.0, 1.0, (1, count))
    intrinsics = np.hstack([intrinsics, start])
    lensmodel = f"LENSMODEL_OPENCV{count}"
    mrcal.optimize(intrinsics=intrinsics, lensmodel=lensmodel, calobject_warp=np.zeros(2), **shared)
    # it marks outliers in place
    return intrinsics[0], [row[ids, 2] > 0.0 for row, (ids, _) in zip(observed, seen, strict=True)]


def _solve_with_lensboy(lensboy: ModuleType, given: dict[str, Any], seen: Views) -> tuple[np.ndarray, list[np.ndarray]]:
    """Its OpenCV model with its defaults: target warp and outlier filter on."""
    included = np.arange(14) < given["coefficients"]
    width, height = given["image_size"]
    config = lensboy.OpenCVConfig(image_height=height, image_width=width, included_distortion_coefficients=included)
    frames = [lensboy.Frame(ids, corners) for ids, corners in seen]
    result = lensboy.calibrate_camera(np.array(given["points_m"]), frames, config)
    camera = result.camera_model
    core = [camera.fx, camera.fy, camera.cx, camera.cy]
    kept = [
        np.zeros(len(ids), bool) if told is None else np.asarray(told.inlier_mask, bool)
        for told, (ids, _) in zip(result.frame_diagnostics, seen, strict=True)
    ]
    return np.concatenate([core, np.ravel(camera.distortion_coeffs)[included]]), kept


def main(peer: str) -> None:
    """Solve each problem; the first once more before, which only warms up. Its seconds are processor time."""
    library, solve = import_module(peer), {"mrcal": _solve_with_mrcal, "lensboy": _solve_with_lensboy}[peer]
    problems = [json.loads(line) for line in sys.stdin]
    for place, given in enumerate([problems[0], *problems]):
        views = [(np.array(ids), np.array(corners)) for ids, corners in given["views"]]
        begun = time.process_time()
        answer: dict[str, Any]
        try:
            intrinsics, kept = solve(library, given, views)
            answer = {"intrinsics": intrinsics.tolist(), "kept": [one.tolist() for one in kept]}
        # whatever a foreign library raises is a failure of that draw
        except Exception as error:
            answer = {"failure": f"{type(error).__name__}: {error}".splitlines()[0]}
        answer["seconds"] = time.process_time() - begun
        if place:
            print(f"\nanswer: {json.dumps(answer)}", flush=True)


if __name__ == "__main__":
    main(sys.argv[1])
