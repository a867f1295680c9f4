"""Other programs, each in an interpreter that has it: this file is run there, a line of JSON in and out for a problem.

What runs there imports NumPy and the program alone. Calibrators are given points_m [N, 3] of the board, row by row;
columns, spacing_m of its corners; image_size; coefficients of the distortion, 4, 5 or 8; focal_px, which mrcal asks its
user for; views, each its ids [M] and corners [M, 2]. They answer intrinsics [4 + k] and kept, per view whether a corner
was used. Simulators are given pan and tilt, rad, and force_N [3] at the tip, world frame in MuJoCo, antenna frame in
PyElastica. They answer tip_m [3] in the same frame and moment_Nm (null where there is no sensor). Both add seconds of
processor time; or there is only a failure.
"""

from __future__ import annotations

import json
import os
import runpy
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from functools import cache
from importlib import import_module
from typing import Any

import numpy as np

INTERPRETERS = "VBAA_PEER_PYTHON"
"""Environment variable: more interpreters to look for programs in, separated as PATH is."""
MARK = "answer: "
"""What an answer's line begins with."""
_IMPORT_S, _SOLVE_S = 60.0, 120.0
_VERSION = """
import importlib.metadata, numpy, {peer}
try:
    names = importlib.metadata.packages_distributions().get("{peer}", ["{peer}"])
    print(importlib.metadata.version(names[0]))
except importlib.metadata.PackageNotFoundError:
    print(getattr({peer}, "__version__", "without a version"))
"""
_RUN = "import runpy, sys; runpy.run_path(sys.argv[1], run_name='__main__')"


@cache
def _version_in(interpreter: str, peer: str) -> str | None:
    """The program's version in an interpreter that imports it; None in one that does not."""
    command = [interpreter, "-c", _VERSION.format(peer=peer)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=_IMPORT_S, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return None
    return None if done.returncode else done.stdout.strip()


def interpreter_of(peer: str) -> str | None:
    """The first that imports the program, of those in `VBAA_PEER_PYTHON`, this one and the system's."""
    named = [path for path in os.environ.get(INTERPRETERS, "").split(os.pathsep) if path]
    every = dict.fromkeys([*named, sys.executable, "/usr/bin/python3"])
    return next((path for path in every if _version_in(path, peer) is not None), None)


def versions(peers: Sequence[str]) -> dict[str, str]:
    """Program → its version and interpreter, or "absent"."""
    found = {peer: interpreter_of(peer) for peer in peers}
    return {peer: f"{_version_in(path, peer)} ({path})" if path else "absent" for peer, path in found.items()}


def answers(peer: str, problems: Sequence[dict[str, Any]], path: str = "") -> tuple[list[dict[str, Any]], str]:
    """Answers to the first problems, all of them unless the program died, and its last words then.

    path : the exported antenna, for a simulator.
    """
    command = [interpreter_of(peer) or "", "-c", _RUN, __file__, peer, path]
    lines, text, limit_s = "\n".join(map(json.dumps, problems)), "", _SOLVE_S * len(problems)
    try:
        done = subprocess.run(command, input=lines, capture_output=True, text=True, timeout=limit_s, check=False)
        text, failure = done.stdout, (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1]
    except subprocess.TimeoutExpired as late:
        text, failure = (late.stdout or b"").decode(), f"no answer within {_SOLVE_S:.0f} s"
    # the program's own output may come between the answers
    return [json.loads(line[len(MARK) :]) for line in text.splitlines() if line.startswith(MARK)], failure


# --- in the interpreter that has the program

_START_DISTORTION = 1e-6
_AT_REST_RAD_S, _MOST_STEPS, _MORE_DAMPING = 1e-6, 20_000, 60.0


def _mrcal(mrcal: Any, given: dict[str, Any], _: str) -> dict[str, Any]:
    """Its own seed, then the core, then all with outlier rejection, board warp and regularisation: its defaults."""
    views, columns, count = given["views"], given["columns"], given["coefficients"]
    observed = np.full((len(views), len(given["points_m"]), 3), -1.0)
    for row, (ids, corners) in zip(observed, views, strict=True):
        row[ids, :2], row[ids, 2] = corners, 1.0
    board = observed.reshape(len(views), -1, columns, 3)
    sizes = np.array([given["image_size"]], dtype=np.int32)
    indices = np.column_stack([np.arange(len(views)), np.zeros(len(views)), np.full(len(views), -1)]).astype(np.int32)
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
    intrinsics, model = np.hstack([intrinsics, start]), f"LENSMODEL_OPENCV{count}"
    mrcal.optimize(intrinsics=intrinsics, lensmodel=model, calobject_warp=np.zeros(2), **shared)
    # it marks outliers in place
    kept = [(row[ids, 2] > 0.0).tolist() for row, (ids, _) in zip(observed, views, strict=True)]
    return {"intrinsics": intrinsics[0].tolist(), "kept": kept}


def _lensboy(lensboy: Any, given: dict[str, Any], _: str) -> dict[str, Any]:
    """Its OpenCV model with its defaults: target warp and outlier filter on."""
    included = np.arange(14) < given["coefficients"]
    width, height = given["image_size"]
    config = lensboy.OpenCVConfig(image_height=height, image_width=width, included_distortion_coefficients=included)
    frames = [lensboy.Frame(np.array(ids), np.array(corners)) for ids, corners in given["views"]]
    result = lensboy.calibrate_camera(np.array(given["points_m"]), frames, config)
    camera = result.camera_model
    core = [camera.fx, camera.fy, camera.cx, camera.cy]
    kept = [
        [False] * len(ids) if one is None else np.asarray(one.inlier_mask, bool).tolist()
        for one, (ids, _) in zip(result.frame_diagnostics, given["views"], strict=True)
    ]
    return {"intrinsics": [*map(float, core), *np.ravel(camera.distortion_coeffs)[included].tolist()], "kept": kept}


def _mujoco(mujoco: Any, load: dict[str, Any], path: str) -> dict[str, Any]:
    model = mujoco.MjModel.from_xml_path(path)
    model.dof_damping[model.jnt_stiffness > 0] *= _MORE_DAMPING  # to its rest sooner
    data, tip = mujoco.MjData(model), model.site("tip").id
    body, force = model.site_bodyid[tip], np.array(load["force_N"])
    for name in ("pan", "tilt"):
        data.joint(name).qpos = load[name]
        data.actuator(name).ctrl = load[name]
    for step in range(_MOST_STEPS):
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        data.xfrc_applied[body] = [*force, *np.cross(data.site_xpos[tip] - data.xipos[body], force)]
        mujoco.mj_step(model, data)
        if step > 200 and np.abs(data.qvel).max() < _AT_REST_RAD_S:
            break
    mujoco.mj_forward(model, data)
    return {"tip_m": data.site_xpos[tip].tolist(), "moment_Nm": float(data.sensor("moment").data[1])}


def _pyelastica(_: Any, load: dict[str, Any], path: str) -> dict[str, Any]:
    return {"tip_m": runpy.run_path(path)["at_rest"](load["force_N"])[-1].tolist(), "moment_Nm": None}


_SOLVERS: dict[str, Callable[[Any, dict[str, Any], str], dict[str, Any]]] = {
    "mrcal": _mrcal,
    "lensboy": _lensboy,
    "mujoco": _mujoco,
    "elastica": _pyelastica,
}
_WARMED = ("mrcal", "lensboy")
"""Solve their first problem once more before, so that no import counts."""


def main(peer: str, path: str) -> None:
    """Answer every line of stdin."""
    program, problems = import_module(peer), [json.loads(line) for line in sys.stdin]
    warm = problems[:1] if peer in _WARMED else []
    for place, given in enumerate([*warm, *problems]):
        begun = time.process_time()
        try:
            answer = _SOLVERS[peer](program, given, path)
        # whatever a foreign library raises is a failure of that problem
        except Exception as error:
            answer = {"failure": f"{type(error).__name__}: {error}".splitlines()[0]}
        answer["seconds"] = time.process_time() - begun
        if place >= len(warm):
            print(f"\n{MARK}{json.dumps(answer)}", flush=True)


if __name__ == "__main__":
    main(*sys.argv[2:])
