"""The lens solves that are compared: an oracle, OpenCV, peers in interpreters of their own, and ours."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import cv2
import numpy as np

from targets.board import corner_points
from vbaa_calib.calibrate.lens.bundle import Bundle, refine
from vbaa_calib.calibrate.lens.information import observations_of
from vbaa_calib.calibrate.lens.intrinsics import LensSolution, solve_intrinsics
from vbaa_calib.calibrate.lens.models import camera_of
from vbaa_calib.camera import Camera
from vbaa_calib.core.errors import VbaaError

from .peers import PEERS, absence, interpreter_of, solve_with
from .rigs import BOARD, Draw

_DEFAULT = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 30, float(np.finfo(float).eps))
_TIGHT = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 300, 1e-12)
_FLAGS = {"opencv5": 0, "rational": cv2.CALIB_RATIONAL_MODEL}


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
    observations = [
        view.picked(good) for view, good in zip(observations_of(given.views, BOARD), given.good, strict=True)
    ]
    start = Bundle.start(rig.model, rig.intrinsics, given.poses)
    bundle = refine(replace(start, sagittas_m=np.asarray(rig.sagittas_m)), observations)
    return camera_of(rig.model, bundle.intrinsics, rig.image_size)


def _solve_opencv(given: Draw, criteria: tuple[int, int, float] = _DEFAULT) -> Camera:
    """`cv2.calibrateCamera` with the true lens model."""
    points = corner_points(BOARD).astype(np.float32)
    rig = given.rig
    boards = [points[view.ids] for view in given.views]
    corners = [view.corners_px.astype(np.float32) for view in given.views]
    flags = _FLAGS[rig.lens]
    _, matrix, distortion, *_ = cv2.calibrateCamera(
        boards, corners, rig.image_size, None, None, flags=flags, criteria=criteria
    )
    count = len(rig.intrinsics) - 4
    return Camera("opencv", rig.image_size, matrix, distortion.ravel()[:count])


def solve_ours(given: Draw, model: str | None = None) -> LensSolution:
    """Our solve with the true lens model, or with the model given."""
    return solve_intrinsics(given.views, BOARD, model or given.rig.lens)


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


def methods() -> dict[str, Method | str]:
    """Name → how all draws of a rig are solved, or why they cannot be; the oracle first."""
    found: dict[str, Method | str] = {
        name: partial(lambda solve, draws: [_outcome(solve, given) for given in draws], solve)
        for name, solve in SOLVERS.items()
    }
    for peer in PEERS:
        interpreter = interpreter_of(peer)
        found[peer] = absence(peer) if interpreter is None else partial(_by_peer, peer, interpreter)
    return found


SOLVERS: dict[str, Callable[[Draw], Camera | LensSolution]] = {
    "oracle": solve_oracle,
    "OpenCV, default": _solve_opencv,
    "OpenCV, 300 iterations": partial(_solve_opencv, criteria=_TIGHT),
    "ours, lens given": solve_ours,
    "ours, auto": partial(solve_ours, model="auto"),
}
"""Name → solver of those that are always there."""


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


def _by_peer(peer: str, interpreter: str, draws: Sequence[Draw]) -> list[Outcome]:
    outcomes = []
    for given, answer in zip(draws, solve_with(peer, interpreter, draws), strict=True):
        if answer.intrinsics is None:
            outcomes.append(Outcome(None, np.nan, failure=answer.failure))
            continue
        camera = camera_of(given.rig.model, answer.intrinsics, given.rig.image_size)
        outcomes.append(Outcome(camera, answer.seconds, *screening(answer.kept, given)))
    return outcomes
