"""The lens solves that are compared: an oracle, OpenCV, peers in interpreters of their own, and ours."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path

import cv2
import numpy as np

from benchmarks.boards import BOARD, Draw
from targets.board import corner_points
from vbaa_calib.calibrate.lens.bundle import Bundle, refine
from vbaa_calib.calibrate.lens.information import observations_of
from vbaa_calib.calibrate.lens.intrinsics import LensSolution, solve_intrinsics
from vbaa_calib.calibrate.lens.models import camera_of
from vbaa_calib.camera import Camera
from vbaa_calib.core.errors import VbaaError

_DEFAULT = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 30, float(np.finfo(float).eps))
_TIGHT = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 300, 1e-12)
_FLAGS = {"opencv5": 0, "rational": cv2.CALIB_RATIONAL_MODEL}
_PEERS = {"lensboy": "pip install lensboy", "mrcal": "apt install mrcal python3-mrcal"}
"""Importable name → where to get it."""
INTERPRETERS = "VBAA_PEER_PYTHON"
"""Environment variable: more interpreters to look for peers in, separated as PATH is."""
_LOOK_S, _SOLVE_S = 60.0, 1800.0


@dataclass(frozen=True, eq=False)
class Outcome:
    """One method on one draw; the fields as in `calibration.Row`, `camera` None where it failed."""

    camera: Camera | None
    seconds: float
    good_dropped: float | None = None
    outliers_found: float | None = None
    failure: str = ""
    model: str = ""


Method = Callable[[Sequence[Draw]], list[Outcome]]


def solve_oracle(given: Draw) -> Camera:
    """Least squares from the true start, outliers and bend of the board known."""
    rig = given.rig
    pairs = zip(observations_of(given.views, BOARD), given.good, strict=True)
    start = Bundle.start(rig.model, rig.intrinsics, given.poses)
    bundle = refine(replace(start, sagittas_m=np.asarray(rig.sagittas_m)), [view.picked(good) for view, good in pairs])
    return camera_of(rig.model, bundle.intrinsics, rig.image_size)


def _solve_opencv(given: Draw, criteria: tuple[int, int, float] = _DEFAULT) -> Camera:
    """`cv2.calibrateCamera` with the true lens model."""
    points, rig = corner_points(BOARD).astype(np.float32), given.rig
    boards = [points[view.ids] for view in given.views]
    corners = [view.corners_px.astype(np.float32) for view in given.views]
    _, matrix, distortion, *_ = cv2.calibrateCamera(
        boards, corners, rig.image_size, None, None, flags=_FLAGS[rig.lens], criteria=criteria
    )
    return Camera("opencv", rig.image_size, matrix, distortion.ravel()[: len(rig.intrinsics) - 4])


def solve_ours(given: Draw, model: str | None = None) -> LensSolution:
    """Our solve with the true lens model, or with the model given."""
    return solve_intrinsics(given.views, BOARD, model or given.rig.lens)


SOLVERS: dict[str, Callable[[Draw], Camera | LensSolution]] = {
    "oracle": solve_oracle,
    "OpenCV, default": _solve_opencv,
    "OpenCV, 300 iterations": partial(_solve_opencv, criteria=_TIGHT),
    "ours, lens given": solve_ours,
    "ours, auto": partial(solve_ours, model="auto"),
}
"""Name → solver of those that are always there."""


def methods() -> dict[str, Method | str]:
    """Name → how all draws of a rig are solved, or why they cannot be; the oracle first."""
    found: dict[str, Method | str] = {
        name: partial(lambda solve, draws: [_outcome(solve, given) for given in draws], solve)
        for name, solve in SOLVERS.items()
    }
    for peer, source in _PEERS.items():
        interpreter = _interpreter_of(peer)
        absent = f"absent ({source}; {INTERPRETERS} names the interpreter that has it)"
        found[peer] = partial(solve_with, peer, interpreter) if interpreter else absent
    return found


def _outcome(solve: Callable[[Draw], Camera | LensSolution], given: Draw) -> Outcome:
    begun = time.perf_counter()
    try:
        solution = solve(given)
    except (VbaaError, cv2.error) as error:
        return Outcome(None, np.nan, failure=str(error).splitlines()[0])
    seconds = time.perf_counter() - begun
    if isinstance(solution, Camera):
        return Outcome(solution, seconds)
    return Outcome(solution.camera, seconds, *screening(kept_corners(solution, given), given), model=solution.model)


def screening(kept: Sequence[np.ndarray], given: Draw) -> tuple[float, float | None]:
    """Share of the good corners that were withheld, and of the outliers that were; None where there are none.

    kept : per view (N,), which corners were used.
    """
    left_out, good = ~np.concatenate(kept), np.concatenate(given.good)
    return float(left_out[good].mean()), float(left_out[~good].mean()) if (~good).any() else None


def kept_corners(solution: LensSolution, given: Draw) -> list[np.ndarray]:
    """Per view (N,), which corners our solution used."""
    outliers = {view.name: view.outlier_ids for view in solution.views}
    return [~np.isin(view.ids, outliers.get(view.name, view.ids)) for view in given.views]


# --- other calibrators on the same corners, each in the interpreter that has it

_ASK = """
import importlib.metadata, numpy, {peer}
try:
    print(importlib.metadata.version("{peer}"))
except importlib.metadata.PackageNotFoundError:
    print(getattr({peer}, "__version__", "without a version"))
"""


@cache
def _version(interpreter: str, peer: str) -> str | None:
    """What an interpreter that imports the peer says of it; None of one that does not."""
    command = [interpreter, "-c", _ASK.format(peer=peer)]
    try:
        asked = subprocess.run(command, capture_output=True, text=True, timeout=_LOOK_S, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return None
    return None if asked.returncode else asked.stdout.strip()


def _interpreter_of(peer: str) -> str | None:
    """The first that imports the peer, of those in `VBAA_PEER_PYTHON`, this one and the system's."""
    named = [path for path in os.environ.get(INTERPRETERS, "").split(os.pathsep) if path]
    every = dict.fromkeys([*named, sys.executable, "/usr/bin/python3"])
    return next((path for path in every if _version(path, peer) is not None), None)


def versions() -> dict[str, str]:
    """Peer → its version and interpreter, or "absent"."""
    found = {peer: _interpreter_of(peer) for peer in _PEERS}
    return {peer: f"{_version(path, peer)} ({path})" if path else "absent" for peer, path in found.items()}


def solve_with(peer: str, interpreter: str, draws: Sequence[Draw]) -> list[Outcome]:
    """The peer's answers to draws of one rig, with the true lens model and its own defaults for the rest."""
    rig = draws[0].rig
    problems = {
        "points_m": corner_points(BOARD).tolist(),
        "columns": BOARD.squares_x - 1,
        "spacing_m": BOARD.square_m,
        "image_size": rig.image_size,
        "coefficients": len(rig.intrinsics) - 4,
        "focal_px": float(rig.intrinsics[0]),
        "draws": [[[view.ids.tolist(), view.corners_px.tolist()] for view in given.views] for given in draws],
    }
    command = [interpreter, str(Path(__file__).with_name("peer_script.py")), peer]
    try:
        done = subprocess.run(
            command, input=json.dumps(problems), capture_output=True, text=True, timeout=_SOLVE_S, check=False
        )
    except subprocess.TimeoutExpired:
        return [Outcome(None, np.nan, failure=f"no answer within {_SOLVE_S:.0f} s") for _ in draws]
    if done.returncode:
        failure = (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1]
        return [Outcome(None, np.nan, failure=failure) for _ in draws]
    outcomes = []
    # whatever the peer says for people comes before the answers
    for given, answer in zip(draws, json.loads(done.stdout.splitlines()[-1]), strict=True):
        intrinsics = np.array(answer.get("intrinsics", [np.nan]))
        if not np.isfinite(intrinsics).all():
            outcomes.append(Outcome(None, np.nan, failure=answer.get("failure", "")))
            continue
        kept = [np.array(used, bool) for used in answer["kept"]]
        camera = camera_of(given.rig.model, intrinsics, given.rig.image_size)
        outcomes.append(Outcome(camera, answer["seconds"], *screening(kept, given)))
    return outcomes
