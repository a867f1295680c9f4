"""The lens from views of the board."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from targets.board import BoardSpec
from vbaa_calib.camera import Camera
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.robust import mad_std
from vbaa_calib.detect.board.corners import BoardView
from vbaa_calib.geometry import Pose

from .board_flex import BoardFlex, observations_of
from .bundle import FLEX, Observation, residuals_px
from .initialization import LensOptions
from .models import LENS_MODELS, camera_of, is_monotonic
from .outliers import DroppedView, usable_views
from .solve import Candidate, LensFit, decide, screen

_VAGUE_FOCAL = 0.02
_COVERED = 0.5


def _verdict(
    chosen: Candidate | None, comparison: Sequence[Candidate], flex: BoardFlex, warnings: Sequence[str]
) -> str:
    """Two to five sentences: is the lens to be trusted, why this model, do halves agree, is the board flat."""
    sentences = ["Look at the warnings before you trust this lens." if warnings else "This lens can be trusted."]
    if chosen is not None:
        sentences += [_why(chosen, comparison), _split_half_words(chosen)]
    bent = f"{1e3 * flex.sagittas_m[0]:+.2f} mm along x, {1e3 * flex.sagittas_m[1]:+.2f} mm along y"
    sentences.append(
        f"The board is bent ({bent}); the lens was solved with that." if flex.used else "The board counts as flat."
    )
    return " ".join(sentences)


def _why(chosen: Candidate, comparison: Sequence[Candidate]) -> str:
    if len(comparison) < 2:
        return (
            f"The lens model {chosen.model} was given; it misses views that it has not seen by "
            f"{chosen.held_out_rms_px:.3f} px rms."
        )
    best = min(comparison, key=lambda candidate: candidate.held_out_rms_px)
    if best.model == chosen.model:
        return f"{chosen.model} predicts views that it has not seen best of all ({chosen.held_out_rms_px:.3f} px rms)."
    errors = f"{chosen.held_out_rms_px:.3f} px rms against {best.held_out_rms_px:.3f} px"
    if not best.monotonic:
        return f"{chosen.model} was taken ({errors}) since {best.model} folds inside the picture."
    if not best.split_half_agrees:
        return f"{chosen.model} was taken ({errors}) since {best.model} differs between halves of the views."
    return f"{chosen.model} is the simplest that predicts unseen views as well as {best.model} does ({errors})."


def _split_half_words(chosen: Candidate) -> str:
    if chosen.halves is None:
        return "There are too few views to compare halves of them."
    agree = "agree within their uncertainty" if chosen.split_half_agrees else "differ by more than their uncertainty"
    return f"Two halves of the views {agree} ({chosen.halves:.1f} predicted deviations)."


def _warnings(
    chosen: Candidate | None, name: str, camera: Camera, monotonic: bool, pixels: np.ndarray
) -> tuple[str, ...]:
    """Folds, disagreement, a vague focal length, poor coverage. pixels : (N, 2) all good corners."""
    warnings = []
    if not monotonic:
        warnings.append(f"the {name} lens folds inside the picture: directions near its border are not to be trusted")
    if chosen is not None and not chosen.split_half_agrees:
        warnings.append(
            f"two halves of the views give lenses that differ by {chosen.halves:.1f} times what is predicted: "
            "the uncertainty is larger than stated by about as much"
        )
    assert camera.covariance is not None
    focal_std = np.sqrt(np.diag(camera.covariance)[:2]) / camera.parameters[:2]
    if focal_std.max() > _VAGUE_FOCAL:
        warnings.append(
            f"the focal length is known to {100 * focal_std.max():.1f} % only: "
            "add views of the board tilted by 30 to 45 degrees"
        )
    share = _covered_share(pixels, camera.image_size)
    if share < _COVERED:
        warnings.append(
            f"the corners cover {100 * share:.0f} % of the picture: add views with the board near its border"
        )
    return tuple(warnings)


def _covered_share(pixels: np.ndarray, image_size: tuple[int, int]) -> float:
    """Share of an 8 x 6 grid over the picture in which a corner was seen."""
    cells = np.clip((pixels + 0.5) / np.array(image_size) * (8, 6), 0, (7, 5)).astype(int)
    return len(np.unique(cells, axis=0)) / 48


MIN_CORNERS = 6
_MIN_VIEWS = 3
_OUTLYING = 3.5


@dataclass(frozen=True, eq=False)
class UsedView:
    """A view the lens rests on.

    corners : how many were used. left_out : how many are outliers and were not, outlier_ids their corner ids.
    rms_px : reprojection error. outlying : it stands out (median + 3.5 scaled MAD), but was kept.
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
    rms_px : recomputed from the parameters returned, over all corners of the views used, outliers too: what other tools
        call RMS. rms_inliers_px : without the outliers, which is what was minimised.
    comparison : the lens models that were assessed: all that `auto` compared, or the one that was given.
    monotonic : whether the lens maps the whole picture without folding. views, dropped : in the order of their names.
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

    model : "auto" or a name in `LENS_MODELS`. square_pixels : hold fx = fy.

    Raises InputError for fewer than 3 usable views, views that leave a parameter of the lens open, an unknown model.
    """
    if model != "auto" and model not in LENS_MODELS:
        raise InputError(f"there is no lens model {model!r}", remedy=f"take auto, {', '.join(LENS_MODELS)}")
    # held-out views and halves are dealt out in turn: the lens must not depend on the order in which views were listed
    usable, dropped = usable_views(sorted(views, key=_rank), spec, min_corners)
    observations = observations_of(usable, spec)
    _require_enough(observations, dropped, model)
    options = LensOptions(usable[0].image_size, model, min_corners, square_pixels)
    start = screen(observations, options)
    _require_enough(start.inliers.of(observations), [*dropped, *_contradicting(usable, start.inliers.views)], model)
    fit = decide(start, observations, options)
    dropped += _contradicting(usable, fit.inliers.views)
    _require_enough(fit.inliers.of(observations), dropped, model)
    bundle, lens = fit.bundle, fit.bundle.model
    if fit.information is None:
        raise InputError(
            f"the pictures leave the {lens.name} lens open",
            remedy="add views of the board tilted in different directions, or choose a simpler --model",
        )
    camera = camera_of(lens, bundle.intrinsics, options.image_size)
    camera = replace(camera, covariance=fit.information.covariance[:-FLEX, :-FLEX])
    monotonic = is_monotonic(lens, bundle.intrinsics, options.image_size)
    chosen = next((candidate for candidate in fit.comparison if candidate.model == lens.name), None)
    good, whole = fit.inliers.of(observations), [observations[index] for index in fit.inliers.views]
    warnings = _warnings(chosen, lens.name, camera, monotonic, np.concatenate([view.pixels for view in good]))
    squares = np.sum(np.concatenate(residuals_px(bundle, whole)) ** 2, axis=1)
    return LensSolution(
        camera=camera,
        model=lens.name,
        rms_px=float(np.sqrt(squares.mean())),
        rms_inliers_px=bundle.rms_px,
        views=_used(fit, usable),
        dropped=tuple(dropped),
        comparison=fit.comparison,
        monotonic=monotonic,
        board_flex=fit.flex,
        verdict=_verdict(chosen, fit.comparison, fit.flex, warnings),
        warnings=warnings,
    )


def _rank(view: BoardView) -> tuple[object, ...]:
    """By name; views without one by their corners."""
    order = np.argsort(view.ids)
    return view.name, view.ids[order].tolist(), view.corners_px[order].ravel().tolist()


def _contradicting(usable: Sequence[BoardView], kept: np.ndarray) -> list[DroppedView]:
    reason = "its corners contradict the other views under a robust fit"
    return [DroppedView(view.name, reason) for index, view in enumerate(usable) if index not in kept]


def _require_enough(observations: Sequence[Observation], dropped: Sequence[DroppedView], model: str) -> None:
    if len(observations) < _MIN_VIEWS:
        reasons = sorted({view.reason for view in dropped})
        raise InputError(
            f"{len(observations)} of {len(observations) + len(dropped)} pictures can be used, "
            f"at least {_MIN_VIEWS} are needed" + (f" ({'; '.join(reasons[:3])})" if reasons else ""),
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


def _used(fit: LensFit, usable: Sequence[BoardView]) -> tuple[UsedView, ...]:
    rms = fit.bundle.view_rms_px
    limit = np.median(rms) + _OUTLYING * mad_std(rms - np.median(rms))
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
