"""`vbaa bench calibration`: lenses from corners, in millimetres on plane C, beside an oracle and other calibrators."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
from scipy.stats import chi2

from benchmarks.boards import (
    BOARD,
    FAULTS,
    FISHEYE,
    HD,
    SQUARE,
    TALL,
    VGA,
    WIDE,
    Draw,
    Rig,
    draw,
    error_mm,
    offsets_on_plane_m,
    on_plane,
    rigs,
    seen_on_plane,
)
from benchmarks.harness import Draws, Findings, Options, column, mean_known, rms_known, row_of, table
from benchmarks.peers import INTERPRETERS, answers, interpreter_of, versions
from targets.board import BoardSpec, corner_points
from vbaa_calib.calibrate.lens.bundle import BoardCorners, Bundle, refine
from vbaa_calib.calibrate.lens.intrinsics import LensSolution, solve_intrinsics
from vbaa_calib.calibrate.lens.models import LENS_MODELS, camera_of, is_monotonic, pose_slopes, projected
from vbaa_calib.camera import Camera
from vbaa_calib.core.console import progress
from vbaa_calib.core.errors import VbaaError
from vbaa_calib.geometry import Pose

Rng = np.random.Generator
Size = tuple[int, int]

# --- the cells: rigs that are the same for each seed, and families of rigs that are drawn

_GROSS_PX = (3.0, 100.0)
_SMALL, _LARGE = BoardSpec(5, 4, 0.03, 0.022), BoardSpec(14, 10, 0.0125, 0.009)
_SIZES = (VGA, (1024, 768), HD, TALL, (1920, 1080), SQUARE)
_SPOILT_EVERY = 3
"""Of the rigs drawn, every third has outliers."""
_SKEWED: dict[str, Any] = {"stretch": (0.0, 0.02), "shear": 3e-3, "outliers": 0.02}
_SHARES = (0.01, 0.02, 0.05, 0.1, 0.2)


@cache
def cells() -> dict[str, Callable[[int], Rig]]:
    """Rows of the table: name → a rig for each seed, mostly the same.

    The published rigs, then what is wrong with corners, board, print and noise, then rigs drawn.
    """
    plain, _, wide, *_ = published = rigs()
    fisheye = Rig("fisheye f 420, 20 views", "fisheye", TALL, FISHEYE, 20)
    gross = replace(plain, outlier_px=_GROSS_PX)
    fixed = [
        *published,
        fisheye,
        *(replace(gross, name=f"f 900, {100 * share:.0f} % gross", outliers=share) for share in _SHARES),
        *(replace(gross, name=f"f 900, 5 % {kind}", outliers=0.05, faults=kind) for kind in FAULTS[1:]),
        replace(gross, name="f 900, 5 % gross, bowed 0.5 mm", outliers=0.05, sagittas_m=(5e-4, 0.0)),
        replace(wide, name="wide, 10 % gross", outliers=0.1, outlier_px=_GROSS_PX),
        replace(fisheye, name="fisheye, 5 % gross", outliers=0.05, outlier_px=_GROSS_PX),
        replace(gross, name="f 900, board half as large, 5 % gross", outliers=0.05, fill=0.5),
        replace(gross, name="f 900, 5x4 squares, 5 % gross", outliers=0.05, spec=_SMALL),
        replace(gross, name="f 900, 14x10 squares, 5 % marker", outliers=0.05, spec=_LARGE, faults="marker"),
        replace(plain, name="f 900, 3 views", views=3),
        replace(plain, name="f 900, 5 views", views=5),
        replace(gross, name="f 900, 5 views, 5 % gross", views=5, outliers=0.05),
        replace(gross, name="f 900, 40 views, 10 % gross", views=40, outliers=0.1),
        replace(plain, name="f 900, 8 views, bowed 0.5 mm", views=8, sagittas_m=(5e-4, 0.0)),
        replace(plain, name="f 900, bowed 1 mm, twisted 0.5 mm", sagittas_m=(1e-3, -3e-4), twist_m=5e-4),
        replace(plain, name="f 900, print 1 % too wide", stretch=(0.01, 0.0)),
        replace(gross, name="f 900, print 2 % too high, sheared, 2 % gross", **_SKEWED),
        replace(plain, name="f 900, noise 0.05 px", noise_px=0.05),
        replace(plain, name="f 900, noise 0.5 px", noise_px=0.5),
        replace(plain, name="f 900, long tails", tails=3.0),
        replace(plain, name="f 900, views blurred", blur=0.8),
        replace(plain, name="f 900, board moving by 1 px", motion_px=1.0),
    ]
    every: dict[str, Callable[[int], Rig]] = {rig.name: partial(lambda rig, _: rig, rig) for rig in fixed}
    return every | {f"drawn: {name}": partial(_drawn, family) for name, family in FAMILIES.items()}


def _core(size: Size, focal_px: float, rng: Rng) -> list[float]:
    """fx, fy, cx, cy: pixels nearly square, the axis within 2 % of the picture's middle."""
    middle = np.array(size) / 2.0 - 0.5 + rng.uniform(-0.02, 0.02, 2) * max(size)
    return [focal_px, focal_px * (1.0 + rng.normal(0.0, 2e-3)), *middle]


def _mild(size: Size, rng: Rng) -> tuple[str, list[float]]:
    k1 = rng.uniform(-0.25, -0.05)
    k2 = rng.uniform(0.2, 1.2) * k1**2 + rng.normal(0.0, 5e-3)
    lens = [k1, k2, *rng.normal(0.0, 4e-4, 2), rng.normal(0.0, 0.01)]
    return "opencv5", [*_core(size, rng.uniform(0.65, 0.9) * size[0], rng), *lens]


def _long(size: Size, rng: Rng) -> tuple[str, list[float]]:
    lens = [rng.uniform(-0.2, 0.05), rng.normal(0.0, 0.2), *rng.normal(0.0, 4e-4, 2), 0.0]
    return "opencv5", [*_core(size, rng.uniform(1.2, 3.0) * size[0], rng), *lens]


def _wide(size: Size, rng: Rng) -> tuple[str, list[float]]:
    # in both polynomials much the same, as fits of real wide lenses have it
    lens = WIDE[4:] * rng.uniform(0.85, 1.15, 8)
    lens[2:4] = rng.normal(0.0, 4e-4, 2)
    return "rational", [*_core(size, rng.uniform(0.42, 0.55) * size[0], rng), *lens]


def _fisheye(size: Size, rng: Rng) -> tuple[str, list[float]]:
    focal = 0.5 * np.hypot(*size) / np.radians(rng.uniform(60.0, 75.0))
    return "fisheye", [*_core(size, focal, rng), *rng.normal(0.0, [0.04, 0.015, 5e-3, 1e-3])]


def _radial(size: Size, rng: Rng) -> tuple[str, list[float]]:
    lens = [0.0, 0.0] if rng.random() < 0.3 else [rng.uniform(-0.2, 0.1), rng.normal(0.0, 0.02)]
    return "radial", [*_core(size, rng.uniform(0.6, 1.5) * size[0], rng), *lens, 0.0, 0.0]


Family = Callable[[Size, Rng], tuple[str, list[float]]]
"""A picture's size → a lens drawn: its model and intrinsics (4 + k)."""
FAMILIES: dict[str, Family] = {
    "mild barrel": _mild,
    "long": _long,
    "wide rational": _wide,
    "fisheye": _fisheye,
    "radial or plain": _radial,
}


def _drawn(family: Family, seed: int) -> Rig:
    """A rig of the family: lens, board, print, noise, number of views; every third has outliers of any kind."""
    rng = np.random.default_rng([seed, 20])
    for _ in range(100):
        size = _SIZES[rng.integers(len(_SIZES))]
        model, intrinsics = family(size, rng)
        rig = Rig("", model, size, np.array(intrinsics), int(rng.integers(8, 41)))
        if is_monotonic(rig.model, rig.intrinsics, size):
            break
    spoilt = seed % _SPOILT_EVERY == _SPOILT_EVERY - 1
    return replace(
        rig,
        name=f"{rig.lens} f {rig.intrinsics[0]:.0f}, {rig.image_size[0]}x{rig.image_size[1]}, {rig.views} views",
        spec=(BOARD, BOARD, _SMALL, _LARGE)[rng.integers(4)],
        fill=float(rng.uniform(0.5, 1.0)),
        noise_px=float(np.exp(rng.uniform(np.log(0.05), np.log(0.5)))),
        blur=float(rng.choice([0.0, 0.4])),
        tails=float(rng.choice([np.inf, 4.0])),
        sagittas_m=tuple(rng.normal(0.0, 2.5e-4, 2).tolist()),
        twist_m=float(rng.normal(0.0, 2e-4)),
        stretch=tuple(rng.normal(0.0, 1e-3, 2).tolist()),
        outliers=float(np.exp(rng.uniform(np.log(0.01), np.log(0.2)))) if spoilt else 0.0,
        faults=FAULTS[0 if rng.random() < 0.5 else rng.integers(1, len(FAULTS))],
        outlier_px=_GROSS_PX,
    )


# --- the solves: an oracle, OpenCV, ours, and peers in interpreters of their own

_TIGHT = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 300, 1e-12)
"""OpenCV's own rule often stops far from the minimum."""
_FLAGS = {"rational": cv2.CALIB_RATIONAL_MODEL, "radial": cv2.CALIB_ZERO_TANGENT_DIST | cv2.CALIB_FIX_K3}
_FISHEYE = cv2.fisheye.CALIB_RECOMPUTE_EXTRINSIC | cv2.fisheye.CALIB_FIX_SKEW
_PEER_MODELS = {"fisheye": "rational", "radial": "opencv4"}
"""True lens model → what peers that lack it are given."""
PEERS = {"lensboy": "pip install lensboy", "mrcal": "apt install mrcal python3-mrcal"}
"""Importable name → where to get it."""
_LEAST_CORNERS = 4
"""They fix the pose of a plane."""


@dataclass(frozen=True, eq=False)
class Outcome:
    """One method on one draw; camera None where it failed, NaN where the method does not say.

    seconds : processor time of the solve. good_dropped, outliers_found, views_dropped : shares of good corners, of
        outliers and of whole views that were withheld. trusted : by the verdict.
    """

    camera: Camera | None
    seconds: float = np.nan
    good_dropped: float = np.nan
    outliers_found: float = np.nan
    views_dropped: float = np.nan
    failure: str = ""
    model: str = ""
    trusted: float = np.nan


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
    for peer, source in PEERS.items():
        absent = f"absent ({source}; {INTERPRETERS} names the interpreter that has it)"
        found[peer] = partial(_solve_with, peer) if interpreter_of(peer) else absent
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
    return Outcome(solution.camera, seconds, *kept, model=solution.model, trusted=solution.trusted)


def screening(kept: Sequence[np.ndarray], given: Draw) -> tuple[float, float, float]:
    """Shares withheld: of the good corners, of the outliers (NaN without any), of whole views.

    kept : per view (N,), which corners were used.
    """
    left_out, good = ~np.concatenate(kept), np.concatenate(given.good)
    gone = float(np.mean([not own.any() for own in kept]))
    return float(left_out[good].mean()), float(left_out[~good].mean()) if (~good).any() else np.nan, gone


def kept_corners(solution: LensSolution, given: Draw) -> list[np.ndarray]:
    """Per view (N,), which corners our solution used."""
    outliers = {view.name: view.outlier_ids for view in solution.views}
    return [~np.isin(view.ids, outliers.get(view.name, view.ids)) for view in given.views]


def _solve_with(peer: str, draws: Sequence[Draw]) -> list[Outcome]:
    """The peer's answers to draws, with the true lens model where it has it and its own defaults for the rest."""
    problems, outcomes = [_problem(given) for given in draws], list[Outcome]()
    while len(outcomes) < len(draws):
        found, failure = answers(peer, problems[len(outcomes) :])
        outcomes += [_answered(given, answer) for given, answer in zip(draws[len(outcomes) :], found, strict=False)]
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


# --- errors on plane C

_REGION, _FAR = 0.95, 2.0


def judged(outcome: Outcome, given: Draw) -> SimpleNamespace:
    """An outcome with the errors and stated deviations of its lens, as the columns of `Row` take them.

    stated, jig_stated : error over the deviation stated, both rms over C. covered, jig_covered : share of the 95 %
        regions of points on C that hold the truth. NaN where the method does not say.
    wrong : either error is over twice its 95 % bound. folds : the lens folds inside the picture.
    """
    camera, truth, found = outcome.camera, given.rig.camera, vars(outcome)
    if camera is None:
        return SimpleNamespace(
            **found, error_mm=np.inf, jig_error_mm=np.inf, wrong=False, **dict.fromkeys(_SAID, np.nan)
        )
    errors = {"error_mm": error_mm(camera, truth), "jig_error_mm": error_mm(camera, truth, True)}
    free, jig = (_said(camera, truth, from_jig) for from_jig in (False, True))
    said = dict(zip(_SAID, (*free[:2], *jig[:2], float(camera.valid_region().image_fraction < 1.0)), strict=True))
    return SimpleNamespace(**found, **errors, **said, wrong=bool(outcome.trusted == 1.0 and (free[2] or jig[2])))


_SAID = ("stated", "covered", "jig_stated", "jig_covered", "folds")


def _said(camera: Camera, truth: Camera, from_jig: bool) -> tuple[float, float, bool]:
    """Error over the deviation stated, share of regions that hold the truth, whether it is over twice its bound."""
    if camera.covariance is None:
        return np.nan, np.nan, False
    T_camera_plane, points, pixels = seen_on_plane(truth, camera if from_jig else None)
    off = offsets_on_plane_m(camera, T_camera_plane, points, pixels)
    by_lens = plane_jacobian(camera, T_camera_plane, points, from_jig)
    each = by_lens @ camera.covariance @ np.swapaxes(by_lens, -1, -2)
    square, stated = float(np.mean(np.sum(off**2, axis=1))), float(np.mean(np.trace(each, axis1=1, axis2=2)))
    if not np.isfinite(stated) or stated <= 0.0:
        return np.inf, 0.0, True
    each = each + 1e-12 * stated * np.eye(2)
    squares = np.einsum("mi,mi->m", off, np.linalg.solve(each, off[..., None])[..., 0])
    # a sum of squares of unequal share, by the chi-squared law with its mean and variance
    spread = np.einsum("mki,mkj->ij", by_lens, by_lens) / len(points) @ camera.covariance
    freedom = stated**2 / float(np.sum(spread * spread.T))
    bound = stated * chi2.ppf(_REGION, freedom) / freedom
    inside = float(np.mean(squares <= chi2.ppf(_REGION, 2)))
    return float(np.sqrt(square / stated)), inside, bool(square > _FAR**2 * bound)


def plane_jacobian(camera: Camera, T_camera_plane: Pose, points_m: np.ndarray, from_jig: bool) -> np.ndarray:
    """(M, 2, 4 + k) by how much points (M, 2) of a plane move on it with the lens, their pixels fixed.

    from_jig : the pose of the plane goes along as least squares over the same points make it.
    """
    lever = on_plane(points_m) @ T_camera_plane.rotation.T
    _, by_place, by_lens = projected(camera, lever + T_camera_plane.translation_m)
    by_lens = by_lens.reshape(2 * len(points_m), -1)
    if from_jig:
        by_pose = pose_slopes(by_place, lever).reshape(-1, 6)
        by_lens = by_lens - by_pose @ np.linalg.lstsq(by_pose, by_lens, rcond=None)[0]
    by_point = by_place @ T_camera_plane.rotation[:, :2]
    return -np.linalg.solve(by_point, by_lens.reshape(len(points_m), 2, -1))


def _statistic(name: str, of: Callable[[np.ndarray], Any], heading: str, spec: str, scale: float = 1.0) -> Any:
    """A column: a statistic of what the draws have of that name; NaN where a method is absent."""
    return column(heading, spec, scale, lambda draws: float(of(getattr(draws, name))), default=np.nan)


def _over(name: str, of: Callable[[np.ndarray], Any], heading: str) -> Any:
    """A column: a statistic of errors over that of the oracle's."""
    ratio = lambda draws: float(of(getattr(draws, name)) / of(getattr(draws, f"oracle_{name}")))  # noqa: E731
    return column(heading, ".2f", of=ratio, default=np.nan)


@dataclass(frozen=True)
class Row:
    """One method in one cell, over the draws; NaN where the method is absent or does not say.

    error_mm, worst_mm : median and largest over draws of the rms error of points on C, whose true pose is given.
    ratio, worst_ratio : the same over the oracle's.
    jig_... : likewise with the pose of C solved with the method's own lens.
    stated, jig_stated : error over the deviation stated, both rms over C, rms over draws. covered, jig_covered : share
        of the 95 % regions of points on C that hold the truth.
    seconds : median processor time of one solve. folds : share of draws whose lens folds inside the picture.
    good_dropped, outliers_found, views_dropped : shares withheld of good corners, outliers and whole views.
    trusted : share of draws whose verdict is trust; wrong : of those trusted whose error is over twice its 95 % bound,
        of all draws. models : the lens models chosen and how often, where there was a choice.
    failed : share of draws without a lens; they count as infinitely wrong. note : why.
    """

    cell: str = column("cell")
    method: str = column("method")
    error_mm: float = _statistic("error_mm", np.median, "mm", ".3f")
    worst_mm: float = _statistic("error_mm", np.max, "worst", ".2f")
    ratio: float = _over("error_mm", np.median, "× oracle")
    worst_ratio: float = _over("error_mm", np.max, "worst")
    jig_error_mm: float = _statistic("jig_error_mm", np.median, "jig mm", ".4f")
    jig_worst_mm: float = _statistic("jig_error_mm", np.max, "worst", ".3f")
    jig_ratio: float = _over("jig_error_mm", np.median, "× oracle")
    jig_worst_ratio: float = _over("jig_error_mm", np.max, "worst")
    stated: float = _statistic("stated", rms_known, "stated", ".2f")
    covered: float = _statistic("covered", mean_known, "in %", ".0f", 100)
    jig_stated: float = _statistic("jig_stated", rms_known, "stated, jig", ".2f")
    jig_covered: float = _statistic("jig_covered", mean_known, "in %", ".0f", 100)
    folds: float = _statistic("folds", mean_known, "folds %", ".0f", 100)
    good_dropped: float = _statistic("good_dropped", mean_known, "lost %", ".2f", 100)
    outliers_found: float = _statistic("outliers_found", mean_known, "caught %", ".1f", 100)
    views_dropped: float = _statistic("views_dropped", mean_known, "views %", ".1f", 100)
    trusted: float = _statistic("trusted", mean_known, "trust %", ".0f", 100)
    wrong: float = column("wrong %", ".0f", 100, default=np.nan)
    seconds: float = _statistic("seconds", np.nanmedian, "s", ".2f")
    failed: float = _statistic("error_mm", lambda errors: np.mean(errors == np.inf), "failed %", ".0f", 100)
    models: str = column("models", default="")
    note: str = column("note", default="")


def run(draws: int, seed: int, chosen: Sequence[str] | None = None) -> list[Row]:
    """Every method, the oracle first, in every cell (or those chosen) over the same draws."""
    rows, names = list[Row](), list(cells()) if chosen is None else chosen
    for name in progress(names, "cells", len(names)):
        given = [draw(cells()[name](each), each) for each in range(seed, seed + draws)]
        oracle: list[SimpleNamespace] = []
        for one, method in methods().items():
            if isinstance(method, str):
                rows.append(Row(name, one, note=method))
                continue
            own = [judged(outcome, one_set) for one_set, outcome in zip(given, method(given), strict=True)]
            oracle = oracle or own
            for mine, best in zip(own, oracle, strict=True):
                mine.oracle_error_mm, mine.oracle_jig_error_mm = best.error_mm, best.jig_error_mm
            models = Counter(each.model for each in own if each.model).most_common()
            more: dict[str, Any] = {"models": ", ".join(f"{model} {count}" for model, count in models)}
            more["note"] = next((each.failure for each in own if each.failure), "")
            if any(np.isfinite(each.trusted) for each in own):
                more["wrong"] = float(np.mean([each.wrong for each in own if each.camera is not None]))
            rows.append(row_of(Row, Draws(own), name, one, **more))
    return rows


_TITLE = (
    "mm: rms error on C with its true pose, median of {} draws, then the worst; × oracle: of medians, then of worst;\n"
    "jig: C's pose solved with the same lens; stated: error over the deviation stated, in: 95 % regions that hold the\n"
    "truth; lost: good corners withheld; caught: outliers withheld; views: withheld; trust: verdicts; wrong: of all\n"
    "draws, trusted and over twice the 95 % bound; s: of one processor"
)


def measure(options: Options) -> Findings:
    """Every method in every cell; a draw is one set of views. Quick: the published rigs and those drawn."""
    names = [name for place, name in enumerate(cells()) if not options.quick or place < 5 or name.startswith("drawn")]
    rows = run(options.draws, options.seed, names)
    spans = (np.nan_to_num([row.ratio for row in rows if row.method == one], nan=np.inf) for one in (AUTO, "OpenCV"))
    ours, opencv = (f"{np.median(each):.2f}, at most {each.max():.2f}" for each in spans)
    return Findings(
        table(rows, _TITLE.format(options.draws), once=1),
        {"calibration.csv": rows},
        numbers={"rows": rows},
        headline=f"error over the oracle's: ours {ours}, OpenCV {opencv}",
        versions=versions(tuple(PEERS)),
    )
