"""Lens solves on the same corners, judged in millimetres on plane C: OpenCV, others that are installed, and ours."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import cv2
import numpy as np

from targets.charuco import corner_points

from ..calibrate.board_flex import observations_of
from ..calibrate.bundle import free_directions, refine
from ..calibrate.corner_stack import Observation
from ..calibrate.intrinsics import LensSolution, solve_intrinsics
from ..calibrate.lens_models import LensModel, camera_of
from ..camera import Camera
from ..console import progress
from ..errors import VbaaError
from ..geometry import Pose
from .calibration_peers import not_run
from .calibration_rigs import BOARD, Draw, Rig, draw, rigs

_SIDES_M = (0.24, 0.12)
_DISTANCE_M = 0.4
_TILT_RAD = np.radians(35.0)
_GRID = (13, 7)
DEFAULT = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 30, float(np.finfo(float).eps))
_TIGHT = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 300, 1e-12)
_FLAGS = {"opencv5": 0, "rational": cv2.CALIB_RATIONAL_MODEL}


@dataclass(frozen=True)
class Row:
    """One method on one rig, over the draws.

    Attributes
    ----------
    error_mm : median over draws of the rms error of points on C, whose pose is told; None where the method is absent
        or mostly failed. ratio : the same over the oracle's.
    jig_error_mm, jig_ratio : the same with the pose of C solved with the method's own lens.
    seconds : median time of one solve. folds : share of draws whose lens folds inside the picture.
    good_dropped : share of the good corners that were left out; None where the method does not say.
    outliers_found : share of the outliers that were left out; None as above or where there are none.
    note : why there are no numbers.
    """

    rig: str
    method: str
    error_mm: float | None = None
    ratio: float | None = None
    jig_error_mm: float | None = None
    jig_ratio: float | None = None
    seconds: float | None = None
    folds: float | None = None
    good_dropped: float | None = None
    outliers_found: float | None = None
    note: str = ""


def plane_c() -> tuple[Pose, np.ndarray]:
    """Pose of plane C in the camera frame, and (M, 2) points on it, m: 240 x 120 mm at 0.4 m, tilted by 35°."""
    x, y = (np.linspace(-0.5, 0.5, count) * side for count, side in zip(_GRID, _SIDES_M, strict=True))
    tilt = Pose.from_rotvec(np.array([0.0, _TILT_RAD, 0.0]), np.array([0.0, 0.0, _DISTANCE_M]))
    return tilt, np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def error_mm(camera: Camera, truth: Camera, from_jig: bool = False) -> float:
    """Rms distance on C between points and where the camera puts their pixels, mm.

    The pose of C is told; with `from_jig` it is solved with this camera from the same points, exactly seen, as a board
    in the jig gives it, which takes up much of a lens' error. Points outside the true picture are left out; a pixel
    that has no ray counts as 100 mm.
    """
    told, points = plane_c()
    space = np.column_stack([points, np.zeros(len(points))])
    pixels, valid = truth.project(told @ space)
    inside = valid & np.all((pixels > -0.5) & (pixels < np.array(truth.image_size) - 0.5), axis=1)
    pose = _solved_pose(camera, told, Observation(space[inside], pixels[inside])) if from_jig else told
    rays, seen = camera.unproject(pixels[inside])
    normal, origin = pose.rotation[:, 2], pose.translation_m
    with np.errstate(all="ignore"):
        hits = rays * ((normal @ origin) / (rays @ normal))[:, None]
    off = np.linalg.norm((hits - origin) @ pose.rotation[:, :2] - points[inside], axis=1)
    return 1e3 * float(np.sqrt(np.mean(np.where(seen & np.isfinite(off), np.minimum(off, 0.1), 0.1) ** 2)))


def _solved_pose(camera: Camera, start: Pose, board: Observation) -> Pose:
    intrinsics = np.concatenate([camera.matrix[[0, 1, 0, 1], [0, 1, 2, 2]], camera.distortion])
    model = LensModel("any", camera.model, len(camera.distortion), (), None)
    fixed = free_directions(model)[:, :0]
    vector = np.concatenate([start.rotvec_rad, start.translation_m])[None]
    pose = refine(model, intrinsics, vector, [board], fixed).poses[0]
    return Pose.from_rotvec(pose[:3], pose[3:])


def solve_oracle(given: Draw) -> Camera:
    """Least squares from the true start, told the outliers and the bend of the board."""
    rig = given.rig
    observations = [
        view.picked(good) for view, good in zip(observations_of(given.views, BOARD), given.good, strict=True)
    ]
    bundle = refine(
        rig.model,
        rig.intrinsics,
        given.poses,
        observations,
        free_directions(rig.model),
        sagittas_m=rig.sagittas_m,
    )
    return camera_of(rig.model, bundle.intrinsics, rig.image_size)


def solve_opencv(given: Draw, criteria: tuple[int, int, float] = DEFAULT) -> Camera:
    """`cv2.calibrateCamera` with the true lens model."""
    points = corner_points(BOARD).astype(np.float32)
    rig = given.rig
    _, matrix, distortion, *_ = cv2.calibrateCamera(
        [points[view.ids] for view in given.views],
        [view.corners_px.astype(np.float32) for view in given.views],
        rig.image_size,
        None,
        None,
        flags=_FLAGS[rig.lens],
        criteria=criteria,
    )
    count = len(rig.intrinsics) - 4
    return Camera("opencv", rig.image_size, matrix, distortion.ravel()[:count])


def solve_ours(given: Draw, model: str | None = None) -> LensSolution:
    """Our solve with the true lens model, or with the model given."""
    return solve_intrinsics(given.views, BOARD, model or given.rig.lens)


def run(draws: int, seed: int) -> list[Row]:
    """Every method on every rig over the same draws, the oracle first."""
    rows = []
    for rig in progress(rigs(), "rigs", len(rigs())):
        given = [draw(rig, seed + number) for number in range(draws)]
        measured = [_row(rig, name, solve, given) for name, solve in SOLVERS.items()]
        rows += [_beside(row, measured[0]) for row in measured]
        rows += [Row(rig.name, name, note=why) for name, why in not_run().items()]
    return rows


SOLVERS: dict[str, Callable[[Draw], Camera | LensSolution]] = {
    "oracle": solve_oracle,
    "OpenCV, default": solve_opencv,
    "OpenCV, 300 iterations": partial(solve_opencv, criteria=_TIGHT),
    "ours, lens given": solve_ours,
    "ours, auto": partial(solve_ours, model="auto"),
}
"""Name → solver of those that are always there."""


def _row(rig: Rig, name: str, solve: Callable[[Draw], Camera | LensSolution], given: Sequence[Draw]) -> Row:
    errors, seconds, folds, dropped, found, failure = [], [], [], [], [], ""
    for one in given:
        begun = time.perf_counter()
        try:
            solution = solve(one)
        except (VbaaError, cv2.error) as error:
            failure = str(error).splitlines()[0]
            errors.append((np.inf, np.inf))
            continue
        seconds.append(time.perf_counter() - begun)
        camera = solution.camera if isinstance(solution, LensSolution) else solution
        errors.append((error_mm(camera, rig.camera), error_mm(camera, rig.camera, from_jig=True)))
        folds.append(camera.valid_region().image_fraction < 1.0)
        if isinstance(solution, LensSolution):
            lost, caught = screening(solution, one)
            dropped.append(lost)
            found.append(caught)
    told, jig = np.transpose(errors)
    return Row(
        rig=rig.name,
        method=name,
        error_mm=_median(told),
        jig_error_mm=_median(jig),
        seconds=_median(seconds),
        folds=float(np.mean(folds)) if folds else None,
        good_dropped=float(np.mean(dropped)) if dropped else None,
        outliers_found=float(np.nanmean(found)) if np.isfinite(found).any() else None,
        note=failure,
    )


def _beside(row: Row, oracle: Row) -> Row:
    """The row with its ratios to the oracle's."""
    return replace(
        row, ratio=_over(row.error_mm, oracle.error_mm), jig_ratio=_over(row.jig_error_mm, oracle.jig_error_mm)
    )


def _over(value: float | None, reference: float | None) -> float | None:
    return value / reference if value is not None and reference else None


def screening(solution: LensSolution, given: Draw) -> tuple[float, float]:
    """Share of the good corners that were left out, and of the outliers that were; NaN where there are none."""
    used = {view.name: set(view.outlier_ids) for view in solution.views}
    out = [np.isin(view.ids, list(used.get(view.name, view.ids))) for view in given.views]
    left_out, good = np.concatenate(out), np.concatenate(given.good)
    return float(left_out[good].mean()), float(left_out[~good].mean()) if (~good).any() else np.nan


def _median(values: Sequence[float] | np.ndarray) -> float | None:
    middle = float(np.median(values)) if len(values) else np.nan
    return middle if np.isfinite(middle) else None
