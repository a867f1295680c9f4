"""The lens from views of a board: views that contradict the others are removed, and the set of views is diagnosed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from targets.board import Board, BoardPoints, corner_points
from vbaa_calib.calibrate.lens.choice import observations_of
from vbaa_calib.core.errors import Diagnosis, InputError
from vbaa_calib.detect.board.corners import BoardView
from vbaa_calib.diagnose.boards import ViewSet, view_set_diagnoses

from .lens.bundle import Bundle, refine
from .lens.initialization import reposed, robust_poses
from .lens.intrinsics import LensSolution, solve_intrinsics
from .lens.models import LENS_MODELS
from .lens.outliers import DroppedView, usable_views
from .lens.settings import LensSettings


def solve_lens(
    views: Sequence[BoardView],
    spec: Board | BoardPoints,
    model: str = "auto",
    min_corners: int = LensSettings.min_corners,
    square_pixels: bool = False,
) -> LensSolution:
    """`solve_intrinsics` without the views that contradict the others, provided they are few; its verdict includes
    `view_set_diagnoses`. views : in the order of capture.

    A view contradicts the others where its corners miss the lens by far more than theirs, or its own focal length or
    centre differs. No view is left out where many contradict, or where the first or the last ones agree on another
    focal length: then the lens was changed.
    """
    left_out = list[DroppedView]()
    usable = usable_views(views, corner_points(spec), min_corners)[0]
    most = max(1, int(LensSettings.most_left_out * len(usable))) if len(usable) >= LensSettings.fewest_views else 0
    whole = solution = solve_intrinsics(views, spec, model, min_corners, square_pixels)
    contradicting = _unused(usable, solution)
    while len(contradicting) <= most and (outlier := _outlier_view(views, solution, spec)) is not None:
        names = {outlier.name, *(one.name for one in left_out)}
        try:
            solution = solve_intrinsics(
                [view for view in views if view.name not in names], spec, model, min_corners, square_pixels
            )
        except InputError:
            break
        left_out.append(outlier)
        contradicting = _unused(usable, solution)
    found = _changed_at_an_end(usable, contradicting, solution, spec)
    if found is None and len(contradicting) > most > 0:
        few = ", ".join(contradicting[:3]) + (", …" if len(contradicting) > 3 else "")
        words = f"{len(contradicting)} of {len(usable)} pictures contradict the others: {few}"
        found = Diagnosis("views_contradict", words, "see that they are of this camera and board, or take them anew")
    if found is not None or len(left_out) > most:
        solution, left_out = whole, []
    diagnoses = view_set_diagnoses(views, solution, spec)
    if found is not None and found.name not in {one.name for one in diagnoses}:
        diagnoses.append(found)
    if not left_out:
        return solution.with_diagnoses(diagnoses)
    words = "; ".join(f"{one.name} was left out: {one.reason}" for one in left_out)
    names, outliers = {one.name for one in left_out}, iter(solution.outliers)
    return replace(
        solution.with_diagnoses(diagnoses, [f"{words}."]),
        outliers=tuple(view.ids if view.name in names else next(outliers) for view in views),
        dropped=tuple(sorted((*solution.dropped, *left_out), key=lambda one: one.name)),
    )


def _unused(usable: Sequence[BoardView], solution: LensSolution) -> list[str]:
    """Names of usable views that a solution does not use."""
    used = {view.name for view in solution.views}
    return [view.name for view in usable if view.name not in used]


def _outlier_view(views: Sequence[BoardView], solution: LensSolution, spec: Board | BoardPoints) -> DroppedView | None:
    """The view that contradicts the others most, with the diagnosis; None without one, or where views share names."""
    if len({view.name for view in views}) < len(views):
        return None
    # a pose takes up the errors of three corners
    noise_px = np.array([view.rms_px * np.sqrt(view.corners / max(view.corners - 3, 1)) for view in solution.views])
    worst = solution.views[int(noise_px.argmax())]
    if noise_px.max() > max(LensSettings.view_noise * float(np.median(noise_px)), LensSettings.least_px):
        usual = float(np.median([view.rms_px for view in solution.views]))
        words = f"its corners miss the lens by {worst.rms_px:.2f} px rms, those of the median view by {usual:.2f} px"
        return DroppedView(worst.name, words)
    linear = ViewSet.of(views, solution, spec)
    if linear is None:
        return None
    for parameter, name, scale, unit in (
        (ViewSet.FOCAL, "focal length", 100.0, "%"),
        (ViewSet.CENTRE_X, "centre", 1.0, "px in x"),
        (ViewSet.CENTRE_Y, "centre", 1.0, "px in y"),
    ):
        change = linear.clearest(parameter)
        if change is not None and change.pattern == "single":
            by = f"{scale * change.size:+.2f} ± {scale * change.std:.2f} {unit}"
            words = f"its {name} differs from the other pictures' by {by}"
            return DroppedView(linear.names[change.first], words)
    return _bending_view(views, solution, spec) if len(solution.views) >= LensSettings.fewest_views else None


def _bending_view(views: Sequence[BoardView], solution: LensSolution, spec: Board | BoardPoints) -> DroppedView | None:
    """The single view, among a few contradicting ones, without which the others agree far better; None otherwise."""
    scattered = any(one.name == "views_scatter" for one in solution.verdict.findings)
    if not scattered or len(solution.views) > LensSettings.solved_without:
        return None
    names, square = [view.name for view in solution.views], bool(np.ptp(solution.camera.parameters[:2]) == 0.0)
    used = [view for view in views if view.name in names]
    rms_px = {}
    for name in names:
        try:
            without = solve_intrinsics(
                [view for view in used if view.name != name], spec, solution.model, 0, square_pixels=square
            )
        except InputError:
            return None
        rms_px[name] = without.rms_inliers_px / solution.rms_inliers_px
    least, second = sorted(rms_px, key=rms_px.__getitem__)[:2]
    if rms_px[least] > LensSettings.halved or rms_px[second] < LensSettings.unchanged:
        return None
    there, rest = solution.rms_inliers_px, rms_px[least] * solution.rms_inliers_px
    return DroppedView(least, f"without it the other pictures agree to {rest:.2f} px rms, with it to {there:.2f} px")


def _changed_at_an_end(
    usable: Sequence[BoardView], contradicting: Sequence[str], solution: LensSolution, spec: Board | BoardPoints
) -> Diagnosis | None:
    """The diagnosis of a changed lens, where the first or the last views (two or more) contradict the others but fit it
    with another focal length and principal point: a change so large that the robust fit drops them."""
    out = [view.name in contradicting for view in usable]
    first, last = (out.index(False), out[::-1].index(False)) if not all(out) else (0, 0)
    model, count = LENS_MODELS[solution.model], len(usable)
    for start, end, edge in ((0, first, first), (count - last, count, count - last)):
        if end - start < 2:
            continue
        observations = observations_of(usable[start:end], corner_points(spec))
        intrinsics = solution.camera.parameters
        bundle = Bundle.start(model, intrinsics, robust_poses(model, intrinsics, observations))
        bundle = replace(bundle, directions=bundle.directions[:, :4], shape=solution.board_shape.parameters)
        bundle = reposed(refine(bundle, observations, robust=True), observations)
        by = float(bundle.intrinsics[0] / intrinsics[0]) - 1.0
        agree = bundle.sigma_px <= max(LensSettings.view_noise * solution.rms_inliers_px, LensSettings.least_px)
        if agree and abs(by) > LensSettings.changed_by:
            before, after = usable[edge - 1].name, usable[edge].name
            words = f"the focal length changes between {before} and {after} by {100 * by:+.1f} %"
            remedy = "keep the pictures on one side only, or take all again with autofocus and zoom switched off"
            return Diagnosis("focus_changed", words, remedy, "wrong")
    return None
