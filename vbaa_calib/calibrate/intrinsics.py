"""The lens from views of the board."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from targets.board import BoardSpec

from ..camera import Camera
from ..detect.corners import BoardView
from ..errors import InputError
from ..geometry import Pose
from .board_flex import BoardFlex, observations_of
from .bundle import residuals_px
from .corner_stack import FLEX, Observation
from .lens_choice import Candidate
from .lens_fold import is_monotonic
from .lens_models import LENS_MODELS, camera_matrix
from .lens_solve import LensFit, decide, screen
from .lens_verdict import lens_warnings, verdict
from .view_screening import DroppedView, usable_views

MIN_CORNERS = 6
MIN_VIEWS = 3
_OUTLYING = 3.5


@dataclass(frozen=True, eq=False)
class UsedView:
    """A view the lens rests on.

    Attributes
    ----------
    name : of the picture. corners : how many were used. left_out : how many are outliers and were not.
    rms_px : reprojection error. outlying : it stands out (median + 3.5 scaled MAD), but was kept.
    T_camera_board : pose of the board.
    outlier_ids : (left_out,) their corner ids.
    """

    name: str
    corners: int
    left_out: int
    rms_px: float
    outlying: bool
    T_camera_board: Pose
    outlier_ids: tuple[int, ...] = ()


@dataclass(frozen=True, eq=False)
class LensSolution:
    """A lens with its uncertainty and the evidence.

    Attributes
    ----------
    camera : with the covariance of (fx, fy, cx, cy, distortion), poses and board marginalised, scaled by the residual
        variance.
    model : name of the lens model.
    rms_px : recomputed from the parameters returned, over all corners of the views used, outliers too: what other tools
        call RMS. rms_inliers_px : without the outliers, which is what was minimised.
    comparison : the lens models that were assessed: all that `auto` compared, or the one that was given.
    monotonic : whether the lens maps the whole picture without folding.
    board_flex : how far the board is bent, and whether the lens was solved with that.
    views, dropped : in the order of their names.
    verdict : what to make of it, in words. warnings : what the user ought to know, in words.
    """

    camera: Camera
    model: str
    rms_px: float
    rms_inliers_px: float
    views: tuple[UsedView, ...]
    dropped: tuple[DroppedView, ...]
    comparison: tuple[Candidate, ...]
    monotonic: bool
    board_flex: BoardFlex
    verdict: str
    warnings: tuple[str, ...]


def solve_intrinsics(
    views: Sequence[BoardView],
    spec: BoardSpec,
    model: str = "auto",
    min_corners: int = MIN_CORNERS,
    square_pixels: bool = False,
) -> LensSolution:
    """Solve for the lens, with it the poses of all views, the outliers, and the bend of the board if it has one.

    Views with fewer than `min_corners` corners, or whose corners fix no homography, are dropped. Outlier corners are
    left out (`outliers`), views that are wrong as a whole are dropped; milder ones are kept and flagged.

    Parameters
    ----------
    model : "auto" or a name in `LENS_MODELS`.
    square_pixels : hold fx = fy.

    Raises
    ------
    InputError : fewer than 3 usable views, views that leave a parameter of the lens open, or an unknown model.
    """
    if model != "auto" and model not in LENS_MODELS:
        raise InputError(f"there is no lens model {model!r}", remedy=f"take auto, {', '.join(LENS_MODELS)}")
    # held-out views and halves are dealt out in turn: the lens must not depend on the order in which views were listed
    usable, dropped = usable_views(sorted(views, key=_rank), spec, min_corners)
    observations = observations_of(usable, spec)
    _require_enough(observations, dropped, model)
    size = usable[0].image_size
    start = screen(observations, size, model, square_pixels, min_corners)
    _require_enough(start.inliers.of(observations), [*dropped, *_contradicting(usable, start.inliers.views)], model)
    fit = decide(start, observations, size, model, square_pixels, min_corners)
    dropped += _contradicting(usable, fit.inliers.views)
    good = fit.inliers.of(observations)
    _require_enough(good, dropped, model)
    if fit.information is None:
        raise InputError(
            f"the pictures leave the {fit.lens.name} lens open",
            remedy="add views of the board tilted in different directions, or choose a simpler --model",
        )
    whole = [observations[index] for index in fit.inliers.views.tolist()]
    distances = np.concatenate([np.linalg.norm(r, axis=1) for r in residuals_px(fit.lens, fit.bundle, whole)])
    rms_px = float(np.sqrt((distances**2).mean()))
    return _solution(fit, fit.information.covariance[:-FLEX, :-FLEX], usable, good, dropped, rms_px)


def _rank(view: BoardView) -> tuple[object, ...]:
    """By name; views without one by their corners."""
    order = np.argsort(view.ids)
    return view.name, view.ids[order].tolist(), view.corners_px[order].ravel().tolist()


def _contradicting(usable: Sequence[BoardView], kept: np.ndarray) -> list[DroppedView]:
    reason = "its corners contradict the other views under a robust fit"
    return [DroppedView(view.name, reason) for index, view in enumerate(usable) if index not in kept]


def _require_enough(observations: Sequence[Observation], dropped: Sequence[DroppedView], model: str) -> None:
    if len(observations) < MIN_VIEWS:
        reasons = sorted({view.reason for view in dropped})
        raise InputError(
            f"{len(observations)} of {len(observations) + len(dropped)} pictures can be used, "
            f"at least {MIN_VIEWS} are needed" + (f" ({'; '.join(reasons[:3])})" if reasons else ""),
            remedy="take more pictures of the board, tilted in different directions",
        )
    # auto compares up to the rational model, on four fifths of the views
    richest = LENS_MODELS["rational" if model == "auto" else model]
    measured = 2 * sum(len(view.pixels) for view in observations)
    if measured <= 2 * (len(richest.parameter_names) + 6 * len(observations)):
        raise InputError(
            f"{measured // 2} corners in {len(observations)} pictures are too few for a lens",
            remedy="take more pictures, with more of the board in view",
        )


def _solution(
    fit: LensFit,
    covariance: np.ndarray,
    usable: Sequence[BoardView],
    good: Sequence[Observation],
    dropped: Sequence[DroppedView],
    rms_px: float,
) -> LensSolution:
    bundle, lens, image_size = fit.bundle, fit.lens, usable[0].image_size
    camera = Camera(
        model=lens.camera_model,
        image_size=image_size,
        matrix=camera_matrix(bundle.intrinsics),
        distortion=bundle.intrinsics[4:],
        covariance=covariance,
        parameter_names=lens.parameter_names,
    )
    monotonic = is_monotonic(lens, bundle.intrinsics, image_size)
    chosen = next((candidate for candidate in fit.comparison if candidate.model == lens.name), None)
    pixels = np.concatenate([view.pixels for view in good])
    warnings = lens_warnings(chosen, lens.name, monotonic, bundle, covariance, pixels, image_size)
    return LensSolution(
        camera=camera,
        model=lens.name,
        rms_px=rms_px,
        rms_inliers_px=bundle.rms_px,
        views=_used(fit, usable),
        dropped=tuple(dropped),
        comparison=fit.comparison,
        monotonic=monotonic,
        board_flex=fit.flex,
        verdict=verdict(chosen, fit.comparison, fit.flex, warnings),
        warnings=warnings,
    )


def _used(fit: LensFit, usable: Sequence[BoardView]) -> tuple[UsedView, ...]:
    rms = fit.bundle.view_rms_px
    spread = 1.4826 * float(np.median(np.abs(rms - np.median(rms))))
    limit = np.median(rms) + _OUTLYING * spread
    return tuple(
        UsedView(
            name=usable[index].name,
            corners=int(mask.sum()),
            left_out=int((~mask).sum()),
            rms_px=float(error),
            outlying=bool(len(rms) > 4 and error > limit),
            T_camera_board=Pose.from_rotvec(pose[:3], pose[3:]),
            outlier_ids=tuple(usable[index].ids[~mask].tolist()),
        )
        for index, mask, error, pose in zip(fit.inliers.views, fit.inliers.masks, rms, fit.bundle.poses, strict=True)
    )
