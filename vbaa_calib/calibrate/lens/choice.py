"""Choice of the lens model: the one of least expected error, unless a simpler one is not significantly worse."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vbaa_calib.calibrate.lens.board_shape import SHAPE, deformations
from vbaa_calib.calibrate.lens.bundle import CONVERGED, BoardCorners, Bundle, refine, rows
from vbaa_calib.calibrate.lens.models import LENS_MODELS, DistortionModel, camera_of, is_monotonic, pole_distance
from vbaa_calib.calibrate.lens.settings import LensSettings
from vbaa_calib.calibrate.lens.uncertainty import compensate, is_covered, pixel_grid, projection_jacobian
from vbaa_calib.camera import Camera
from vbaa_calib.core.least_squares import CHANCE_SCATTER, padded, without_own
from vbaa_calib.core.robust import chi_square_p
from vbaa_calib.detect.board.corners import BoardView
from vbaa_calib.rig.rig_file import can_hold

_NEAR = replace(CONVERGED, iterations=20, tolerance=1e-5)  # from a start that is all but the answer


@dataclass(frozen=True, eq=False)
class Information:
    """The reduced least-squares problem at a solution, in coordinates z (p,) in which all views and the prior of the
    board's shape together have unit information. It gives, to first order and without a new solve, the solution from
    any subset of the views."""

    half: np.ndarray  # (4 + k + 5, p) change of intrinsics and shape for a unit of each z
    blocks: np.ndarray  # (V, p, p) information of each view, its own pose eliminated
    gradients: np.ndarray  # (V, p) of each view
    squares: np.ndarray  # (V,) squared residuals of each view, px²
    # (V, p + 1, p + 1) triangular factors R of the views' own problems: RᵀR of the first p columns is the information,
    # then the residuals. Sums of information lose half the digits, stacked factors do not.
    roots: np.ndarray
    prior: np.ndarray  # (p, p) information of the penalty against folding, and of the board's shape
    prior_root: np.ndarray  # (m, p + 1) the shape's part of it as rows, then their residuals
    counts: np.ndarray  # (V,) corner coordinates of each view

    @property
    def covariance(self) -> np.ndarray:
        """(4 + k + 5, 4 + k + 5) covariance of lens and shape, scaled by the residual variance and by
        `view_scatter`."""
        return self.covariance_half @ self.covariance_half.T

    @property
    def covariance_half(self) -> np.ndarray:
        """(4 + k + 5, p) square root R of the covariance: R·Rᵀ."""
        return np.sqrt(self._variance) * self.view_scatter * self.half

    def covariance_with(self, other: Camera, camera: Camera, corners_px: np.ndarray) -> np.ndarray:
        """Covariance of the lens, allowing for another lens to be the true one: the change with which it best projects
        like the other, among the corners (N, 2), is added as one more error."""
        pixels = pixel_grid(camera.image_size).reshape(-1, 2)
        rays, valid = other.unproject(pixels)
        seen, inside = camera.project(rays)
        among = is_covered(pixels, corners_px) & valid & inside
        slopes = projection_jacobian(camera, seen[among]) @ self.covariance_half[:-SHAPE] / LensSettings.negligible_px
        slopes, off = slopes.reshape(-1, slopes.shape[-1]), (pixels - seen)[among].ravel() / LensSettings.negligible_px
        steps = np.linalg.solve(slopes.T @ slopes + np.eye(slopes.shape[-1]), slopes.T @ off)
        return self.covariance_half @ (np.eye(len(steps)) + np.outer(steps, steps)) @ self.covariance_half.T

    @property
    def left_out(self) -> np.ndarray:
        """(V, 4 + k + 5) first-order change of intrinsics and shape when each view is left out."""
        whole = self.blocks.sum(axis=0) + self.prior
        pairs = zip(self.blocks, self.gradients, strict=True)
        steps = [np.linalg.lstsq(whole - block, -gradient, rcond=1e-12)[0] for block, gradient in pairs]
        return np.array(steps) @ self.half.T

    @property
    def _variance(self) -> float:
        """Variance of the residuals per axis, px²."""
        freedom = self.counts.sum() - self.half.shape[1] - 6 * len(self.counts)
        return float(self.squares.sum()) / max(float(freedom), 1.0)

    @property
    def view_scatter(self) -> float:
        """Ratio, at least 1, of the scatter between views to what the noise of their corners explains, by their
        gradients (cluster-robust covariance): the corners of one picture share errors of motion, blur, and of the
        lens model."""
        expected = np.trace(self.blocks, axis1=1, axis2=2) - np.einsum("vij,vji->v", self.blocks, self.blocks)
        ratio = float((self.gradients**2).sum()) / max(self._variance * float(expected.sum()), 1e-300)
        return float(np.sqrt(max(ratio / CHANCE_SCATTER, 1.0)))


def information(bundle: Bundle, observations: Sequence[BoardCorners]) -> Information | None:
    """Information of the corners at the solution from them; None where the views leave a free parameter
    undetermined."""
    counts = np.array([view.pixels.size for view in observations])
    if counts.sum() <= bundle.directions.shape[1] + 6 * len(observations):
        return None
    residuals, by_shared, by_pose, bounds = rows(bundle, observations)
    weights = np.repeat([view.weight for view in observations], np.diff(bounds))[:, None]
    residuals, by_shared, by_pose = residuals * weights, by_shared * weights[..., None], by_pose * weights[..., None]
    reduced = without_own(by_shared @ bundle.directions, by_pose, bounds)
    prior, by_shape = bundle.prior_rows()
    size = reduced.shape[-1]
    jacobian = np.vstack([reduced.reshape(-1, size), by_shape @ bundle.directions])
    norms = np.linalg.norm(jacobian, axis=0)
    whole = np.linalg.norm((by_shared @ bundle.directions).reshape(-1, bundle.directions.shape[1]), axis=0)
    # what the poses explain but for rounding is open
    if not np.all(np.isfinite(norms)) or not np.all(norms > LensSettings.left_by_poses * whole):
        return None
    _, values, basis = np.linalg.svd(np.linalg.qr(jacobian / norms, mode="r"), full_matrices=False)
    if values[-1] < LensSettings.determined * values[0]:
        return None
    free = (basis.T / values) / norms[:, None]
    half = bundle.directions @ free
    by_view, own = reduced @ free, padded(residuals[..., None], bounds)
    roots = np.asarray(np.linalg.qr(np.concatenate([by_view, own], axis=-1), mode="r"))
    root = prior_rows = np.column_stack([by_shape @ half, prior])
    if bundle.unfolding is not None:
        steep = bundle.unfolding_rows()[1] @ half[:-SHAPE]
        root = np.vstack([root, np.pad(steep, ((0, 0), (0, 1)))])
    return Information(
        half=half,
        blocks=by_view.mT @ by_view,
        gradients=(by_view.mT @ own)[..., 0],
        squares=(own**2).sum(axis=(1, 2)),
        roots=np.pad(roots, ((0, 0), (0, size + 1 - roots.shape[1]), (0, 0))),
        prior=(root.T @ root)[:-1, :-1],
        prior_root=prior_rows,
        counts=counts,
    )


def _left_out_squares(bundle: Bundle, observations: Sequence[BoardCorners], known: Information) -> np.ndarray:
    """(V,) squared distances, px², of each view's corners from their projection by a lens fitted without that view's
    fold (a fifth of the views), with the view's pose solved for: five-fold cross-validation. The folds' lenses are
    one Gauss–Newton step from the solution over all views, or are solved anew where errors are much larger."""
    squares = known.squares.copy()
    for fold in _folds(len(squares)):
        rest = known.blocks[~fold].sum(axis=0) + known.prior
        step = np.linalg.lstsq(rest, -known.gradients[fold].sum(axis=0), rcond=1e-12)[0]
        squares[fold] += step @ known.blocks[fold] @ step - 2.0 * known.gradients[fold] @ step
    return (
        squares
        if squares.sum() <= LensSettings.solved_anew * known.squares.sum()
        else _solved_squares(bundle, observations)
    )


def _folds(views: int) -> list[np.ndarray]:
    """(V,) masks of the views that each cross-validation fold leaves out."""
    folds = min(LensSettings.folds, views)
    return [np.arange(views) % folds == fold for fold in range(folds)]


def _solved_squares(bundle: Bundle, observations: Sequence[BoardCorners]) -> np.ndarray:
    """(V,) squared distances as in `_left_out_squares`, with each fold's lens solved to convergence."""
    squares = np.zeros(len(observations))
    for fold in _folds(len(observations)):
        seen = [view for view, out in zip(observations, fold, strict=True) if not out]
        unseen = [view for view, out in zip(observations, fold, strict=True) if out]
        lens = refine(replace(bundle, poses=bundle.poses[~fold]), seen, _NEAR)
        tested = refine(replace(lens.poses_only, poses=bundle.poses[fold]), unseen, _NEAR)
        pairs = zip(unseen, tested.residuals_px, strict=True)
        squares[fold] = [view.weight**2 * np.sum(residual**2) for view, residual in pairs]
    return squares


def _excess_in_errors(squares: np.ndarray, reference: np.ndarray) -> float:
    """Excess of squared errors (V,) over those of a reference, in standard errors of its mean over views."""
    excess = squares - reference
    standard_error = np.sqrt(len(excess)) * np.std(excess, ddof=1)
    return float(excess.sum() / standard_error) if standard_error > 0.0 else 0.0


def _compare_split_half(
    model: DistortionModel, intrinsics: np.ndarray, known: Information, image_size: tuple[int, int]
) -> tuple[float | None, float | None]:
    """Rms difference over the picture between the lenses of two halves of the views, in predicted standard
    deviations, and its p-value; None with under 6 views, or where a half does not determine the lens.

    The views go to the halves alternately; each half's lens is one Gauss–Newton step from that of all. The part of the
    difference that a rotation of the camera explains does not count, nor does the penalty against folding.
    """
    if len(known.squares) < LensSettings.halved_views:
        return None, None
    difference, covariance = np.zeros(known.half.shape[1]), np.zeros_like(known.prior)
    for first, sign in ((0, 1.0), (1, -1.0)):
        size = known.half.shape[1]
        # each half has half of the prior: together they are the whole problem
        own_rows = [known.roots[first::2].reshape(-1, size + 1), np.sqrt(0.5) * known.prior_root]
        _, factor = np.linalg.qr(np.vstack(own_rows))
        own, pull = factor[:size, :size], factor[:size, size]
        freedom = known.counts[first::2].sum() - size - 6 * len(known.counts[first::2])
        if freedom <= 0 or np.linalg.cond(own) > LensSettings.half_open:
            return None, None
        inverse = np.linalg.inv(own)
        variance = factor[size, size] ** 2 / freedom
        difference += sign * (inverse @ pull)
        covariance += variance * known.view_scatter**2 * (inverse @ inverse.T)
    camera, pixels = camera_of(model, intrinsics, image_size), pixel_grid(image_size, LensSettings.grid)
    jacobian = compensate(camera, pixels, projection_jacobian(camera, pixels)) @ known.half[:-SHAPE]
    jacobian = jacobian[np.isfinite(jacobian).all(axis=(-1, -2))]
    if not len(jacobian):
        return None, None
    predicted = np.trace(jacobian @ covariance @ np.swapaxes(jacobian, -1, -2), axis1=-2, axis2=-1)
    seen = jacobian / np.sqrt(predicted * len(jacobian))[:, None, None]
    form = np.einsum("nki,nkj->ij", seen, seen)
    square = float(difference @ form @ difference)
    # a sum of squares of unequal share, by the chi-squared law with its mean, which is 1, and its variance
    freedom = 1.0 / float(np.sum((form @ covariance) * (form @ covariance).T))
    return float(np.sqrt(square)), chi_square_p(square * freedom, freedom)


@dataclass(frozen=True, eq=False)
class Candidate:
    """One lens model's results in the comparison."""

    model: str
    free_parameters: int  # of the lens, focal lengths and principal point included
    rms_px: float  # over the corners it was fitted to
    held_out_rms_px: float  # over views that only had their poses fitted
    monotonic: bool  # whether it maps the whole picture without folding, once it has converged
    halves: float | None = None  # as `_compare_split_half` gives them
    halves_p_value: float | None = None
    expected_error_px: float | None = None  # as `_expected_errors_px` gives it; None for a single model
    passed_over: str = ""  # why it was not chosen, where that is not its expected error

    @property
    def split_half_agrees(self) -> bool:
        """Whether the two halves differ by no more than predicted, or cannot be compared."""
        return self.halves_p_value is None or self.halves_p_value >= LensSettings.halves_agree


def assess(
    bundle: Bundle, observations: Sequence[BoardCorners], image_size: tuple[int, int], known: Information
) -> tuple[Candidate, np.ndarray]:
    """One lens model's row of the comparison, and its cross-validated squared errors (V,) px² by view."""
    squares = _left_out_squares(bundle, observations, known)
    free = int(np.any(bundle.directions[:-SHAPE] != 0.0, axis=0).sum())
    monotonic = is_monotonic(bundle.model, bundle.intrinsics, image_size)
    halves = _compare_split_half(bundle.model, bundle.intrinsics, known, image_size)
    left_out_px = float(np.sqrt(squares.sum() / sum(view.weight**2 * len(view.pixels) for view in observations)))
    return Candidate(bundle.model.name, free, bundle.rms_px, left_out_px, monotonic, *halves), squares


def observations_of(views: Sequence[BoardView], nominal_m: np.ndarray) -> list[BoardCorners]:
    """The corners of views, with their board points from those of the board (C, 3)."""
    moved = deformations(nominal_m)
    return [BoardCorners(nominal_m[view.ids], view.corners_px, moved[view.ids]) for view in views]


def kept_observations(
    views: Sequence[BoardView], outlier_ids: Sequence[Sequence[int]], nominal_m: np.ndarray
) -> list[BoardCorners]:
    """`observations_of` without the outliers of each view."""
    every = zip(observations_of(views, nominal_m), views, outlier_ids, strict=True)
    return [observation.picked(~np.isin(view.ids, ids)) for observation, view, ids in every]


@dataclass(frozen=True, eq=False)
class Assessed:
    """A lens model's solution, to be compared with others from the same V views."""

    candidate: Candidate
    camera: Camera  # with its covariance
    squares_px2: np.ndarray  # (V,) left-out squared errors by view
    left_out: np.ndarray  # (V, 4 + k) change of the camera's parameters without each view

    @property
    def has_far_poles(self) -> bool:
        """Whether the lens has no pole near the picture, see `models.pole_distance`."""
        camera, model = self.camera, LENS_MODELS[self.candidate.model]
        return pole_distance(model, camera.parameters, camera.image_size) >= LensSettings.least_pole_distance


def choose(solutions: Sequence[Assessed], corners_px: np.ndarray) -> tuple[str, tuple[Candidate, ...], Camera]:
    """Name of the lens model to use, the comparison, and the lens that would be chosen if further parameters cost
    nothing, or the decentred one where that is the chosen one. corners_px : (N, 2) of all views.

    1. Models are wrong if their error on left-out views exceeds the least one by 10 %, or significantly (over views) by
       0.5 %.
    2. Of the others the one of least expected error over the picture is taken, bias and noise together
       (`_expected_errors_px`).
    3. A simpler one is preferred if left-out views fit it as well, or if its expected error is larger by no more than
       35 % and than the difference's standard error (by jackknife over views).
    4. A lens without decentring must be 15 % better than opencv4, which has it.

    Models beyond the bounds of rig.json are not taken. One that folds inside the picture is taken only if all others
    are 10 % worse on left-out views; one with halves that disagree, or with a pole near the picture, only if all others
    are 0.5 % worse.
    """
    every = {one.candidate.model: one for one in solutions}
    reasons: dict[str, str] = {}

    def preferred(names: Sequence[str], good: Sequence[str], may_cost: float, why: str) -> Sequence[str]:
        """The good candidates, or all where the good ones cost too much; notes the reason `why` the others are not
        chosen."""
        least = min(every[name].candidate.held_out_rms_px for name in names)
        if all(every[name].candidate.held_out_rms_px > may_cost * least for name in good):
            return names
        reasons.update({name: why for name in names if name not in good})
        return good

    sound = (
        (lambda one: can_hold(one.camera), np.inf, "has coefficients beyond the bounds of rig.json"),
        (lambda one: one.candidate.monotonic, LensSettings.monotonic_may_cost, "folds inside the picture"),
        (
            lambda one: one.candidate.split_half_agrees,
            LensSettings.agreement_may_cost,
            "differs between halves of the views",
        ),
        (lambda one: one.has_far_poles, LensSettings.far_pole_may_cost, "has a pole near the picture"),
    )
    names: Sequence[str] = list(every)
    for is_sound, may_cost, why in sound:
        names = preferred(names, [name for name in names if is_sound(every[name])], may_cost, why)
    best = min(names, key=lambda name: every[name].candidate.held_out_rms_px)

    def is_good(name: str) -> bool:
        ratio = every[name].candidate.held_out_rms_px / every[best].candidate.held_out_rms_px
        uncertain = _excess_in_errors(every[name].squares_px2, every[best].squares_px2) <= LensSettings.excess
        return ratio <= LensSettings.negligible_cost or (ratio <= LensSettings.most_cost and uncertain)

    good = [name for name in names if is_good(name)]
    names = preferred(names, good, np.inf, "misses left-out views by clearly more")
    cameras = {name: one.camera for name, one in every.items()}
    off_px = _expected_errors_px(cameras, best, corners_px, {name: one.left_out for name, one in every.items()})
    expected_px = {name: float(off_px[name][0]) for name in every}
    free = {name: one.candidate.free_parameters for name, one in every.items()}

    def is_no_worse(name: str, richer: str) -> bool:
        ratios = np.log(off_px[name] / off_px[richer])
        standard_error = np.sqrt((len(ratios) - 2) * np.var(ratios[1:]))
        as_small = ratios[0] <= min(LensSettings.better_by * standard_error, np.log(LensSettings.most_larger))
        return bool(as_small or every[name].squares_px2.sum() <= every[richer].squares_px2.sum())

    least = min(names, key=expected_px.__getitem__)
    simpler = [name for name in names if free[name] < free[least] and is_no_worse(name, least)]
    chosen = min([*simpler, least], key=lambda name: (free[name], expected_px[name]))
    # every lens is a little decentred: a model without it must be clearly better
    if chosen in ("none", "radial", "fisheye") and "opencv4" in names:
        ratio = expected_px["opencv4"] / expected_px[chosen]
        as_good = ratio <= 1.0 or "opencv4" in (*simpler, least)
        chosen = "opencv4" if as_good and ratio < LensSettings.centred_may_cost else chosen
        least = "opencv4" if least == chosen else least
    for name in names:
        if name != chosen and expected_px[name] <= expected_px[chosen]:
            richer = "is richer, and better by no more than the difference's own error"
            reasons[name] = richer if free[name] > free[chosen] else "has no decentring, and is not clearly better"
    rows = [
        replace(one.candidate, expected_error_px=expected_px[name], passed_over=reasons.get(name, ""))
        for name, one in every.items()
    ]
    return chosen, tuple(rows), cameras[least]


def _expected_errors_px(
    cameras: Mapping[str, Camera], reference: str, corners_px: np.ndarray, left_out: Mapping[str, np.ndarray]
) -> dict[str, np.ndarray]:
    """Expected errors (1 + V,) px of the lens from all views and of the lens with each view left out, by the focused
    information criterion (Claeskens & Hjort 2003): variance plus squared bias, where the bias is estimated by the
    difference from the reference less twice the mean that noise causes.

    cameras : by name, from the same corners (N, 2), with covariances. reference : one without bias. left_out : by how
    much the parameters (V, 4 + k) change without each view. The part that a rotation of the camera explains among the
    corners does not count. The mean over the picture is geometric: an error beyond the corners counts, but does not
    outweigh all others.
    """
    pixels = pixel_grid(cameras[reference].image_size).reshape(-1, 2)
    among = is_covered(pixels, corners_px)
    rays, valid = cameras[reference].unproject(pixels)
    variances, squares, moved = {}, {}, {}
    for name in sorted(cameras, key=lambda one: one != reference):
        seen, inside = cameras[name].project(rays)
        # a pixel that a lens does not see is one that it gets wrong
        wrong = ~(valid & inside)
        slopes = np.concatenate([projection_jacobian(cameras[name], seen), (seen - pixels)[..., None]], axis=-1)
        reduced = compensate(cameras[name], seen, slopes, among & ~wrong)
        jacobian, apart = reduced[..., :-1], reduced[..., -1:]
        moved[name] = jacobian @ left_out[name].T
        apart = np.concatenate([apart, apart + moved[name] - moved[reference]], axis=-1)
        carried = jacobian @ cameras[name].covariance @ np.swapaxes(jacobian, -1, -2)
        variances[name] = np.where(wrong, np.inf, np.trace(carried, axis1=-2, axis2=-1))[:, None]
        squares[name] = np.where(wrong[:, None], LensSettings.unseen_px**2, np.sum(apart**2, axis=1))
    expected = {}
    for name, variance in variances.items():
        with np.errstate(invalid="ignore"):
            noise = np.clip(np.nan_to_num(variances[reference] - variance), 0.0, None)
        square = np.nan_to_num(np.minimum(variance, LensSettings.unseen_px**2), nan=LensSettings.unseen_px**2)
        square = square + np.clip(
            np.nan_to_num(squares[name], nan=LensSettings.unseen_px**2) - LensSettings.chance_bias * noise, 0.0, None
        )
        expected[name] = np.exp(0.5 * np.mean(np.log(np.maximum(square, LensSettings.least_error_px**2)), axis=0))
    return expected
