"""The lens from views of the board."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from targets.board import BoardSpec
from targets.charuco import corner_points

from ..camera import Camera
from ..detect.corners import BoardView
from ..errors import InputError
from ..geometry import Pose
from .bundle import Bundle, Observation, free_directions, lens_covariance
from .lens_choice import Candidate, choose_lens
from .lens_models import LENS_MODELS, LensModel, camera_matrix, is_monotonic
from .lens_start import fit_lens
from .view_screening import DroppedView, usable_views, without_gross_errors

MIN_CORNERS = 6
MIN_VIEWS = 3
_OUTLYING = 3.5
_VAGUE_FOCAL = 0.02
_ROUNDS = 5


@dataclass(frozen=True, eq=False)
class UsedView:
    """A view the lens rests on.

    Attributes
    ----------
    name : of the picture. corners : how many were used. left_out : how many were grossly wrong and were not.
    rms_px : reprojection error. outlying : it stands out (median + 3.5 scaled MAD), but was kept.
    T_camera_board : pose of the board.
    """

    name: str
    corners: int
    left_out: int
    rms_px: float
    outlying: bool
    T_camera_board: Pose


@dataclass(frozen=True, eq=False)
class LensSolution:
    """A lens with its uncertainty and the evidence.

    Attributes
    ----------
    camera : with the covariance of (fx, fy, cx, cy, distortion), poses marginalised, scaled by the residual variance.
    model : name of the lens model. rms_px : recomputed from the parameters returned, over all corners used.
    comparison : what `auto` compared; empty when the model was given.
    monotonic : whether the lens maps the whole picture without folding.
    warnings : what the user ought to know, in words.
    """

    camera: Camera
    model: str
    rms_px: float
    views: tuple[UsedView, ...]
    dropped: tuple[DroppedView, ...]
    comparison: tuple[Candidate, ...]
    monotonic: bool
    warnings: tuple[str, ...]


def solve_intrinsics(
    views: Sequence[BoardView],
    spec: BoardSpec,
    model: str = "auto",
    min_corners: int = MIN_CORNERS,
    square_pixels: bool = False,
) -> LensSolution:
    """Solve for the lens, the poses of all views with it.

    Views with fewer than `min_corners` corners, or whose corners fix no homography, are dropped. A view whose error is
    over 5 times the median view's, or a corner over 20 standard deviations, under a robust fit is dropped as gross;
    milder outliers are kept and flagged.

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
    usable, dropped = usable_views(views, spec, min_corners)
    points = corner_points(spec)
    observations = [Observation(points[view.ids], view.corners_px) for view in usable]
    for _ in range(_ROUNDS):
        _require_enough(usable, dropped, model, observations)
        lens, comparison, bundle = _fit(observations, usable[0].image_size, model, square_pixels)
        kept, cleaned = without_gross_errors(lens, bundle, observations, min_corners, square_pixels)
        if cleaned is None:
            break
        dropped += [
            DroppedView(view.name, "its error is over 5 times the median view's under a robust fit")
            for view, keep in zip(usable, kept, strict=True)
            if not keep
        ]
        usable = [view for view, keep in zip(usable, kept, strict=True) if keep]
        observations = cleaned
    covariance = lens_covariance(lens, bundle, observations, free_directions(lens, square_pixels))
    if covariance is None:
        raise InputError(
            f"the pictures leave the {lens.name} lens open",
            remedy="add views of the board tilted in different directions, or choose a simpler --model",
        )
    return _solution(lens, bundle, covariance, usable, dropped, comparison)


def _require_enough(
    usable: Sequence[BoardView],
    dropped: Sequence[DroppedView],
    model: str,
    observations: Sequence[Observation],
) -> None:
    if len(usable) < MIN_VIEWS:
        reasons = sorted({view.reason for view in dropped})
        raise InputError(
            f"{len(usable)} of {len(usable) + len(dropped)} pictures can be used, at least {MIN_VIEWS} are needed"
            + (f" ({'; '.join(reasons[:3])})" if reasons else ""),
            remedy="take more pictures of the board, tilted in different directions",
        )
    # auto compares up to the rational model, on four fifths of the views
    richest = LENS_MODELS["rational" if model == "auto" else model]
    measured = 2 * sum(len(view.pixels) for view in observations)
    if measured <= 2 * (len(richest.parameter_names) + 6 * len(usable)):
        raise InputError(
            f"{measured // 2} corners in {len(usable)} pictures are too few for a lens",
            remedy="take more pictures, with more of the board in view",
        )


def _fit(
    observations: Sequence[Observation], image_size: tuple[int, int], model: str, square_pixels: bool
) -> tuple[LensModel, tuple[Candidate, ...], Bundle]:
    known: dict[str, Bundle] = {}
    comparison: tuple[Candidate, ...] = ()
    if model == "auto":
        lens, comparison = choose_lens(observations, image_size, square_pixels, known)
    else:
        lens = LENS_MODELS[model]
    return lens, comparison, fit_lens(lens, observations, image_size, square_pixels, known)


def _solution(
    lens: LensModel,
    bundle: Bundle,
    covariance: np.ndarray,
    usable: Sequence[BoardView],
    dropped: Sequence[DroppedView],
    comparison: tuple[Candidate, ...],
) -> LensSolution:
    image_size = usable[0].image_size
    rms = bundle.view_rms_px
    spread = 1.4826 * float(np.median(np.abs(rms - np.median(rms))))
    views = tuple(
        UsedView(
            view.name,
            len(residual),
            len(view.ids) - len(residual),
            float(error),
            bool(len(rms) > 4 and error > np.median(rms) + _OUTLYING * spread),
            Pose.from_rotvec(pose[:3], pose[3:]),
        )
        for view, residual, error, pose in zip(usable, bundle.residuals_px, rms, bundle.poses, strict=True)
    )
    intrinsics = bundle.intrinsics
    camera = Camera(
        model=lens.camera_model,
        image_size=image_size,
        matrix=camera_matrix(intrinsics),
        distortion=intrinsics[4:],
        covariance=covariance,
        parameter_names=lens.parameter_names,
    )
    monotonic = is_monotonic(lens, intrinsics, image_size)
    warnings = _warnings(lens, bundle, covariance, monotonic, usable)
    return LensSolution(camera, lens.name, bundle.rms_px, views, tuple(dropped), comparison, monotonic, warnings)


def _warnings(
    lens: LensModel, bundle: Bundle, covariance: np.ndarray, monotonic: bool, usable: Sequence[BoardView]
) -> tuple[str, ...]:
    warnings = []
    if not monotonic:
        warnings.append(
            f"the {lens.name} lens folds inside the picture: directions near its border are not to be trusted"
        )
    focal_std = np.sqrt(np.diag(covariance)[:2]) / bundle.intrinsics[:2]
    if focal_std.max() > _VAGUE_FOCAL:
        warnings.append(
            f"the focal length is known to {100 * focal_std.max():.1f} % only: "
            "add views of the board tilted by 30 to 45 degrees"
        )
    share = _covered_share(usable)
    if share < 0.5:
        warnings.append(
            f"the corners cover {100 * share:.0f} % of the picture: add views with the board near its border"
        )
    return tuple(warnings)


def _covered_share(usable: Sequence[BoardView]) -> float:
    """Share of an 8 x 6 grid over the picture in which a corner was seen."""
    pixels = np.concatenate([view.corners_px for view in usable])
    cells = np.clip((pixels + 0.5) / np.array(usable[0].image_size) * (8, 6), 0, (7, 5)).astype(int)
    return len(np.unique(cells, axis=0)) / 48
