"""The lens solves that are compared: an oracle, OpenCV, peers in interpreters of their own, and ours."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from benchmarks.boards import Draw
from targets.board import corner_points
from vbaa_calib.calibrate.lens.bundle import BoardCorners, Bundle, refine
from vbaa_calib.calibrate.lens.intrinsics import LensSolution, solve_intrinsics
from vbaa_calib.calibrate.lens.models import LENS_MODELS, camera_of
from vbaa_calib.camera import Camera
from vbaa_calib.core.errors import VbaaError

_TIGHT = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 300, 1e-12)
"""OpenCV's own rule often stops far from the minimum."""
_FLAGS = {"rational": cv2.CALIB_RATIONAL_MODEL, "radial": cv2.CALIB_ZERO_TANGENT_DIST | cv2.CALIB_FIX_K3}
_FISHEYE = cv2.fisheye.CALIB_RECOMPUTE_EXTRINSIC | cv2.fisheye.CALIB_FIX_SKEW
_PEER_MODELS = {"fisheye": "rational", "radial": "opencv4"}
"""True lens model → what peers that lack it are given."""
_PEERS = {"lensboy": "pip install lensboy", "mrcal": "apt install mrcal python3-mrcal"}
"""Importable name → where to get it."""
INTERPRETERS = "VBAA_PEER_PYTHON"
"""Environment variable: more interpreters to look for peers in, separated as PATH is."""
_LEAST_CORNERS = 4
"""They fix the pose of a plane."""
_LOOK_S, _SOLVE_S = 60.0, 120.0
MARK = "answer: "
"""What an answer's line begins with."""


@dataclass(frozen=True, eq=False)
class Outcome:
    """One method on one draw; camera None where it failed, the rest None where the method does not say.

    seconds : processor time of the solve. good_dropped, outliers_found, views_dropped : shares of good corners, of
        outliers and of whole views that were withheld. trusted : what the verdict says.
    """

    camera: Camera | None
    seconds: float = np.nan
    good_dropped: float | None = None
    outliers_found: float | None = None
    views_dropped: float | None = None
    failure: str = ""
    model: str = ""
    trusted: bool | None = None


Method = Callable[[Sequence[Draw]], list[Outcome]]


def solve_oracle(given: Draw) -> Camera:
    """Least squares from the true start, outliers and the board's true shape known."""
    rig, points = given.rig, given.rig.board_points_m
    seen = [
        BoardCorners(points[view.ids[good]], view.corners_px[good])
        for view, good in zip(given.views, given.good, strict=True)
    ]
    fixed = [len(view.pixels) >= _LEAST_CORNERS for view in seen]
    start = Bundle.start(rig.model, rig.intrinsics, given.poses[fixed])
    bundle = refine(start, [view for view, own in zip(seen, fixed, strict=True) if own])
    return camera_of(rig.model, bundle.intrinsics, rig.image_size)


def _solve_opencv(given: Draw) -> Camera:
    """`cv2.calibrateCamera`, or that of its fisheye, with the true lens model and 300 iterations."""
    points, rig = corner_points(given.rig.spec).astype(np.float32), given.rig
    boards = [points[view.ids] for view in given.views]
    corners = [view.corners_px.astype(np.float32) for view in given.views]
    if rig.lens == "fisheye":
        boards, corners = ([one[:, None].astype(float) for one in each] for each in (boards, corners))
        start = np.eye(3), np.zeros(4)
        _, matrix, distortion, *_ = cv2.fisheye.calibrate(
            boards, corners, rig.image_size, *start, flags=_FISHEYE, criteria=_TIGHT
        )
        return Camera("fisheye", rig.image_size, matrix * [[1, 0, 1], [0, 1, 1], [0, 0, 1]], distortion.ravel())
    _, matrix, distortion, *_ = cv2.calibrateCamera(
        boards, corners, rig.image_size, None, None, flags=_FLAGS.get(rig.lens, 0), criteria=_TIGHT
    )
    return Camera("opencv", rig.image_size, matrix, distortion.ravel()[: len(rig.intrinsics) - 4])


def solve_ours(given: Draw, model: str | None = None) -> LensSolution:
    """Our solve with the true lens model, or with the model given."""
    return solve_intrinsics(given.views, given.rig.spec, model or given.rig.lens)


ORACLE, AUTO = "oracle", "ours, auto"
SOLVERS: dict[str, Callable[[Draw], Camera | LensSolution]] = {
    ORACLE: solve_oracle,
    "OpenCV": _solve_opencv,
    "ours, lens given": solve_ours,
    AUTO: partial(solve_ours, model="auto"),
}
"""Name → solver of those that are always there."""


def methods() -> dict[str, Method | str]:
    """Name → how all draws of a rig are solved, or why they cannot be; the oracle first."""
    found: dict[str, Method | str] = {
        name: partial(lambda solve, draws: [_outcome(solve, given) for given in draws], solve)
        for name, solve in SOLVERS.items()
    }
    for peer, source in _PEERS.items():
        interpreter = interpreter_of(peer)
        absent = f"absent ({source}; {INTERPRETERS} names the interpreter that has it)"
        found[peer] = partial(solve_with, peer, interpreter) if interpreter else absent
    return found


def _outcome(solve: Callable[[Draw], Camera | LensSolution], given: Draw) -> Outcome:
    begun = time.process_time()
    try:
        solution = solve(given)
    # whatever a solver raises is a failure of that draw; ours is to say it in its own words
    except Exception as error:
        kind = "" if isinstance(error, VbaaError) else f"{type(error).__name__}: "
        return Outcome(None, failure=f"{kind}{error}".splitlines()[0])
    seconds = time.process_time() - begun
    if isinstance(solution, Camera):
        return Outcome(solution, seconds)
    kept = screening(kept_corners(solution, given), given)
    return Outcome(solution.camera, seconds, *kept, model=solution.model, trusted=solution.verdict.trusted)


def screening(kept: Sequence[np.ndarray], given: Draw) -> tuple[float, float | None, float]:
    """Shares withheld: of the good corners, of the outliers (None without any), of whole views.

    kept : per view (N,), which corners were used.
    """
    left_out, good = ~np.concatenate(kept), np.concatenate(given.good)
    gone = float(np.mean([not own.any() for own in kept]))
    return float(left_out[good].mean()), float(left_out[~good].mean()) if (~good).any() else None, gone


def kept_corners(solution: LensSolution, given: Draw) -> list[np.ndarray]:
    """Per view (N,), which corners our solution used."""
    outliers = {view.name: view.outlier_ids for view in solution.views}
    return [~np.isin(view.ids, outliers.get(view.name, view.ids)) for view in given.views]


# --- other calibrators on the same corners, each in the interpreter that has it

_ASK = """
import importlib.metadata, numpy, {peer}
try:
    names = importlib.metadata.packages_distributions().get("{peer}", ["{peer}"])
    print(importlib.metadata.version(names[0]))
except importlib.metadata.PackageNotFoundError:
    print(getattr({peer}, "__version__", "without a version"))
"""


@cache
def version_in(interpreter: str, peer: str) -> str | None:
    """What an interpreter that imports the peer says of it; None of one that does not."""
    command = [interpreter, "-c", _ASK.format(peer=peer)]
    try:
        asked = subprocess.run(command, capture_output=True, text=True, timeout=_LOOK_S, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return None
    return None if asked.returncode else asked.stdout.strip()


def interpreter_of(peer: str) -> str | None:
    """The first that imports the peer, of those in `VBAA_PEER_PYTHON`, this one and the system's."""
    named = [path for path in os.environ.get(INTERPRETERS, "").split(os.pathsep) if path]
    every = dict.fromkeys([*named, sys.executable, "/usr/bin/python3"])
    return next((path for path in every if version_in(path, peer) is not None), None)


def versions() -> dict[str, str]:
    """Peer → its version and interpreter, or "absent"."""
    found = {peer: interpreter_of(peer) for peer in _PEERS}
    return {peer: f"{version_in(path, peer)} ({path})" if path else "absent" for peer, path in found.items()}


def solve_with(peer: str, interpreter: str, draws: Sequence[Draw]) -> list[Outcome]:
    """The peer's answers to draws, with the true lens model where it has it and its own defaults for the rest."""
    lines = [json.dumps(_problem(given)) for given in draws]
    outcomes: list[Outcome] = []
    while len(outcomes) < len(draws):
        answers, failure = _asked(peer, interpreter, lines[len(outcomes) :])
        outcomes += [_answered(given, answer) for given, answer in zip(draws[len(outcomes) :], answers, strict=False)]
        if len(outcomes) < len(draws):
            # it died at this one; the others are asked anew
            outcomes.append(Outcome(None, failure=failure))
    return outcomes


def _problem(given: Draw) -> dict[str, Any]:
    rig = given.rig
    return {
        "points_m": corner_points(rig.spec).tolist(),
        "columns": rig.spec.squares_x - 1,
        "spacing_m": rig.spec.square_m,
        "image_size": rig.image_size,
        "coefficients": LENS_MODELS[_PEER_MODELS.get(rig.lens, rig.lens)].distortion_count,
        "focal_px": float(rig.intrinsics[0]),
        "views": [[view.ids.tolist(), view.corners_px.tolist()] for view in given.views],
    }


def _asked(peer: str, interpreter: str, problems: Sequence[str]) -> tuple[list[dict[str, Any]], str]:
    """Answers to the first problems, all of them unless it died; what it said then."""
    command = [interpreter, str(Path(__file__).with_name("peer_script.py")), peer]
    stated, said = "\n".join(problems), ""
    try:
        done = subprocess.run(
            command, input=stated, capture_output=True, text=True, timeout=_SOLVE_S * len(problems), check=False
        )
        said, failure = done.stdout, (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1]
    except subprocess.TimeoutExpired as late:
        said, failure = (late.stdout or b"").decode(), f"no answer within {_SOLVE_S:.0f} s"
    # whatever the peer says for people comes between the answers
    return [json.loads(line[len(MARK) :]) for line in said.splitlines() if line.startswith(MARK)], failure


def _answered(given: Draw, answer: dict[str, Any]) -> Outcome:
    intrinsics = np.array(answer.get("intrinsics", [np.nan]))
    if not np.isfinite(intrinsics).all():
        return Outcome(None, failure=answer.get("failure", "its lens is not a number"))
    kept, model = [np.array(used, bool) for used in answer["kept"]], _PEER_MODELS.get(given.rig.lens, given.rig.lens)
    try:
        camera = camera_of(LENS_MODELS[model], intrinsics, given.rig.image_size)
    except VbaaError as error:
        return Outcome(None, failure=str(error))
    return Outcome(camera, answer["seconds"], *screening(kept, given), model=model)
