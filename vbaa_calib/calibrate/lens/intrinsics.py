"""The lens from views of the board: outliers, board shape and lens model are determined together."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

from targets.board import Board, BoardPoints, corner_points
from vbaa_calib.camera import Camera
from vbaa_calib.core.errors import Diagnosis, InputError, Verdict
from vbaa_calib.core.robust import mad_std
from vbaa_calib.detect.board.corners import BoardView
from vbaa_calib.geometry import Pose

from .board_shape import SHAPE, BoardShape, ShapePrior
from .bundle import CONVERGED, BoardCorners, Bundle, polished, refine, residuals_px
from .choice import Assessed, Candidate, Information, assess, choose, information, observations_of
from .initialization import homography_start, reposed, rough_lens, unfolded
from .models import LENS_MODELS, DistortionModel, camera_of, is_monotonic
from .outliers import DroppedView, Inliers, fit_without_outliers, usable_views
from .settings import LensSettings
from .verdict import judged

_Compared = tuple[tuple[Candidate, ...], Camera | None]
_ROUGHLY = replace(CONVERGED, iterations=5, tolerance=1e-4)  # just enough to separate good corners from bad


@dataclass(frozen=True, eq=False)
class _UsedView:
    """A view that the lens was solved from."""

    name: str
    corners: int  # how many were used
    left_out: int  # how many outliers were not
    rms_px: float  # reprojection error
    outlying: bool  # beyond the median + 3.5 scaled MAD of all views, but kept
    T_camera_board: Pose
    outlier_ids: tuple[int, ...] = ()


@dataclass(frozen=True, eq=False)
class LensSolution:
    """A lens with its uncertainty, its verdict and the evidence for both.

    Attributes
    ----------
    camera : with the covariance of (fx, fy, cx, cy, distortion), poses and board marginalised, scaled by the residual
        variance.
    rms_px : over all corners of the views used, outliers too, as other tools report it. rms_inliers_px : without the
        outliers, which is what was minimised.
    outliers : for each view, in the order of the input, the ids (N,) of corners left out; all of a dropped view's.
    comparison : the lens models that `auto` compared, or the one that was chosen.
    board_shape : how the board differs from a flat print with square squares; always solved for, with a prior.
    monotonic : whether the lens maps the whole picture without folding. views, dropped : in the order of their names.
    verdict : by the solve alone; `lens_from_views.solve_lens` adds what the set of views shows.
    reasons : sentences: why this lens model, whether halves of the views agree, whether the board is flat.
    """

    camera: Camera
    model: str
    board_shape: BoardShape
    verdict: Verdict = field(default_factory=Verdict)
    reasons: tuple[str, ...] = ()
    rms_px: float = np.nan
    rms_inliers_px: float = np.nan
    views: tuple[_UsedView, ...] = ()
    outliers: tuple[np.ndarray, ...] = ()
    dropped: tuple[DroppedView, ...] = ()
    comparison: tuple[Candidate, ...] = ()
    monotonic: bool = True

    @property
    def board_points(self) -> np.ndarray:
        """(C, 3) m corners of the board's solved shape, in its frame."""
        return self.board_shape.points_m

    @property
    def chosen(self) -> Candidate | None:
        """The chosen lens model's row of the comparison; None where it was not compared."""
        return next((candidate for candidate in self.comparison if candidate.model == self.model), None)

    @property
    def trusted(self) -> bool:
        """Whether the verdict contains no diagnosis."""
        return not self.verdict.findings

    @property
    def grade(self) -> Literal["trusted", "look at", "do not use"]:
        """The verdict as a grade: "do not use" with a grave diagnosis, "look at" with any other, else "trusted"."""
        return "trusted" if self.trusted else "do not use" if self.exit_code else "look at"

    @property
    def exit_code(self) -> int:
        """Exit code of a verb that uses the lens: 1 where it must not be used, else 0."""
        return int(self.verdict.severity == "wrong")

    @property
    def headline(self) -> str:
        """The grade in a sentence."""
        return {
            "trusted": "This lens can be trusted.",
            "look at": "Look at the warnings before you trust this lens.",
            "do not use": f"Do not use this lens yet: {self.verdict.findings[0].words if not self.trusted else ''}.",
        }[self.grade]

    @property
    def words(self) -> str:
        """The headline and the reasons."""
        return " ".join([self.headline, *self.reasons])

    def with_diagnoses(self, found: Iterable[Diagnosis], reasons: Sequence[str] = ()) -> LensSolution:
        """The solution with further diagnoses in its verdict, and further reasons."""
        verdict = Verdict.of((*self.verdict.findings, *found))
        return replace(self, verdict=verdict, reasons=(*self.reasons, *reasons))

    def verdict_dict(self) -> dict[str, Any]:
        """The verdict's entries of camera.json and rig.json."""
        return {
            "verdict": self.words,
            "grade": self.grade,
            "trusted": self.trusted,
            "warnings": [str(one) for one in self.verdict.findings],
            "diagnoses": [one.to_dict() for one in self.verdict.findings],
        }


def solve_intrinsics(
    views: Sequence[BoardView],
    board: Board | BoardPoints,
    model: str = "auto",
    min_corners: int = LensSettings.min_corners,
    square_pixels: bool = False,
) -> LensSolution:
    """Solve for the lens, the poses of all views, the outliers and the board's shape.

    Views with fewer than `min_corners` corners, or with corners that fix no homography, are dropped, and those of which
    most corners are wrong. Other outlier corners are left out; noisy views weigh less.

    model : "auto" or a name in `LENS_MODELS`. square_pixels : hold fx = fy.

    Raises InputError for fewer than 3 usable views, views that leave a parameter of the lens open, an unknown model.
    """
    if model not in ("auto", *LENS_MODELS):
        raise InputError(f"there is no lens model {model!r}", remedy=f"take auto, {', '.join(LENS_MODELS)}")

    def rank(view: BoardView) -> tuple[object, ...]:
        """Sort key of a view: its name, or without one its corners."""
        return view.name, view.ids.tolist(), view.corners_px.ravel().tolist()

    # held-out views, halves and the corners that starts are compared by are dealt out in turn: the lens must not
    # depend on the order of views and corners given
    views, nominal_m = [view.picked(np.argsort(view.ids)) for view in views], corner_points(board)
    usable, dropped = usable_views(sorted(views, key=rank), nominal_m, min_corners)
    observations = observations_of(usable, nominal_m)
    _require_enough(observations, dropped, model)
    options = _LensOptions(usable[0].image_size, ShapePrior.of(board), model, min_corners, square_pixels)
    inliers, rough, warm = _screened(observations, options)
    _require_enough(inliers.of(observations), [*dropped, *_contradicting(usable, inliers.views)], model)
    bundle, inliers, (comparison, other), known = _decided(inliers, rough, warm, observations, options)
    good, lens = inliers.of(observations), bundle.model
    dropped += _contradicting(usable, inliers.views)
    _require_enough(good, dropped, model)
    if known is None:
        raise InputError(
            f"the pictures leave the {lens.name} lens open",
            remedy="add views of the board tilted in different directions, or choose a simpler --lens-model",
        )
    covariance, seen = known.covariance, [view.pixels for view in good]
    camera = camera_of(lens, bundle.intrinsics, options.image_size)
    if other is not None:
        covariance = known.covariance_with(other, camera, np.concatenate(seen))
    camera = replace(camera, covariance=covariance[:-SHAPE, :-SHAPE])
    monotonic = is_monotonic(lens, bundle.intrinsics, options.image_size)
    shape = BoardShape.solved(nominal_m, bundle.shape, covariance)
    scatter = known.view_scatter
    whole = [observations[index] for index in inliers.views]
    squares = np.sum(np.concatenate(residuals_px(bundle, whole)) ** 2, axis=1)
    used = _used(bundle, inliers, usable)
    left_out = {id(usable[index]): one.outlier_ids for index, one in zip(inliers.views, used, strict=True)}
    solution = LensSolution(
        camera=camera,
        model=lens.name,
        rms_px=float(np.sqrt(squares.mean())),
        rms_inliers_px=bundle.rms_px,
        views=used,
        outliers=tuple(np.array(left_out.get(id(view), view.ids), int) for view in views),
        dropped=tuple(dropped),
        comparison=comparison,
        monotonic=monotonic,
        board_shape=shape,
    )
    return judged(solution, seen, scatter)


def _contradicting(usable: Sequence[BoardView], kept: np.ndarray) -> list[DroppedView]:
    reason = "its corners contradict the other views under a robust fit"
    return [DroppedView(view.name, reason) for index, view in enumerate(usable) if index not in kept]


def _require_enough(observations: Sequence[BoardCorners], dropped: Sequence[DroppedView], model: str) -> None:
    if len(observations) < LensSettings.min_views:
        reasons = sorted({view.reason for view in dropped})
        raise InputError(
            f"{len(observations)} of {len(observations) + len(dropped)} pictures can be used, "
            f"at least {LensSettings.min_views} are needed" + (f" ({'; '.join(reasons[:3])})" if reasons else ""),
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


@dataclass(frozen=True)
class _LensOptions:
    """Options of a lens solve. image_size : (width, height) px. prior : of the board's shape. model : "auto" or a name
    in `LENS_MODELS`."""

    image_size: tuple[int, int]
    prior: ShapePrior
    model: str
    min_corners: int
    square_pixels: bool


def _screened(
    observations: Sequence[BoardCorners], options: _LensOptions
) -> tuple[Inliers, Bundle, Mapping[str, Bundle]]:
    """The good corners, by the chosen lens model or, for "auto", by the one of `screening` with the least median
    residual; its solution from them, and solutions of other models as initial values."""
    known: dict[str, Bundle] = {}
    robust, start = {}, homography_start(observations, options.image_size)
    for name in ("opencv4", *LensSettings.screening) if options.model == "auto" else (options.model,):
        known[name] = rough_lens(LENS_MODELS[name], observations, options.image_size, known, start)
        if name in LensSettings.screening or name == options.model:
            free = known[name].freed(options.square_pixels, options.prior)
            robust[name] = reposed(refine(free, observations, _ROUGHLY, robust=True), observations)
    best = min(robust, key=lambda name: robust[name].sigma_px)
    inliers, bundle = fit_without_outliers(robust[best], observations, options.min_corners)
    return inliers, bundle, _posed(known | robust, inliers.views)


def _posed(fits: Mapping[str, Bundle], views: np.ndarray) -> Mapping[str, Bundle]:
    return {name: replace(fit, poses=fit.poses[views]) for name, fit in fits.items()}


def _decided(
    inliers: Inliers,
    bundle: Bundle,
    warm: Mapping[str, Bundle],
    observations: Sequence[BoardCorners],
    options: _LensOptions,
    folding: tuple[str, ...] = (),
) -> tuple[Bundle, Inliers, _Compared, Information | None]:
    """Alternates between choosing the lens model and the outliers until neither changes. Returns the lens from the
    good corners with one pose for each good view, what it was compared with, and the information, None where a
    parameter is undetermined.

    A lens that "auto" chose, and that folds once it has converged, is compared again as one of those that fold.
    """
    compared: _Compared = (), None
    decided: tuple[str, int] | None = None
    for _ in range(LensSettings.rounds):
        good = inliers.of(observations)
        now = (bundle.model.name, sum(len(view.pixels) for view in good))
        if decided == now:
            break
        if options.model == "auto":
            bundle, compared = _choose_lens(good, options, warm, folding)
        else:
            bundle = _fit_lens(bundle.model, good, options, {bundle.model.name: bundle})
        decided = (bundle.model.name, now[1])
        whole = [observations[index] for index in inliers.views]
        within, bundle = fit_without_outliers(bundle, whole, options.min_corners, inliers.masks)
        inliers = Inliers(inliers.views[within.views], within.masks, within.weights)
        warm = _posed(warm, within.views)
    good = inliers.of(observations)
    bundle = unfolded(bundle, good, options.image_size)
    for _ in range(LensSettings.rounds):
        # the prior is weighed by the noise that is left
        bundle = polished(bundle.freed(options.square_pixels, options.prior), good)
    name, sound = bundle.model.name, is_monotonic(bundle.model, bundle.intrinsics, options.image_size)
    if not sound and options.model == "auto" and name not in folding:
        return _decided(inliers, bundle, warm, observations, options, (*folding, name))
    known = information(bundle, good)
    if options.model != "auto" and known is not None:
        compared = (assess(bundle, good, options.image_size, known)[0],), None
    return bundle, inliers, compared, known


def _fit_lens(
    model: DistortionModel, observations: Sequence[BoardCorners], options: _LensOptions, warm: Mapping[str, Bundle]
) -> Bundle:
    """The solution of one lens model and the board's shape, from the initial value in `warm` (by name) if there is
    one."""
    near = warm.get(model.name)
    if near is None:
        near = rough_lens(model, observations, options.image_size, warm)
    start = replace(near, unfolding=None).freed(options.square_pixels, options.prior)
    return refine(refine(start, observations, _ROUGHLY).freed(options.square_pixels, options.prior), observations)


def _choose_lens(
    observations: Sequence[BoardCorners], options: _LensOptions, warm: Mapping[str, Bundle], folding: Sequence[str]
) -> tuple[Bundle, _Compared]:
    """The solution of the lens model that `choose` selects, and what it was compared with.

    warm : initial solutions by model name. folding : names of models that fold in the end. Models with
    an open parameter are left out.
    """
    fits: dict[str, Bundle] = {}
    assessed = []
    for name in LensSettings.candidates:
        bundle = _fit_lens(LENS_MODELS[name], observations, options, {**fits, **warm})
        fits[name] = bundle = unfolded(bundle, observations, options.image_size, fits)
        known = information(bundle, observations)
        if known is not None:
            candidate, squares = assess(bundle, observations, options.image_size, known)
            candidate = replace(candidate, monotonic=candidate.monotonic and name not in folding)
            camera = camera_of(bundle.model, bundle.intrinsics, options.image_size)
            camera = replace(camera, covariance=known.covariance[:-SHAPE, :-SHAPE])
            assessed.append(Assessed(candidate, camera, squares, known.left_out[:, :-SHAPE]))
    if not assessed:
        return fits[LensSettings.candidates[0]], ((), None)
    chosen, comparison, other = choose(assessed, np.concatenate([view.pixels for view in observations]))
    return fits[chosen], (comparison, other)


def _used(bundle: Bundle, inliers: Inliers, usable: Sequence[BoardView]) -> tuple[_UsedView, ...]:
    rms = bundle.view_rms_px
    limit = np.median(rms) + LensSettings.outlying * mad_std(rms - np.median(rms))
    return tuple(
        _UsedView(
            name=usable[index].name,
            corners=int(mask.sum()),
            left_out=int((~mask).sum()),
            rms_px=float(error),
            outlying=bool(len(rms) > 4 and error > limit),
            T_camera_board=Pose.from_rotvec(pose[:3], pose[3:]),
            outlier_ids=tuple(usable[index].ids[~mask].tolist()),
        )
        for index, mask, error, pose in zip(inliers.views, inliers.masks, rms, bundle.poses, strict=True)
    )
