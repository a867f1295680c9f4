"""Starting values that reach the right minimum: several focal lengths, and richer lenses from simpler ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import cv2
import numpy as np

from .bundle import FLEX, Bundle, Observation, free_directions, refine
from .models import LENS_MODELS, LensModel, Unfolding, camera_matrix, is_monotonic, rational_like

_FOCAL_PER_WIDTH = (0.35, 0.7, 1.4, 3.0, 8.0)
_TRIAL_ITERATIONS = 15
_STEP_ITERATIONS = 6
_ROUGHLY = 1e-3
_PLAUSIBLE_PER_WIDTH = 1e-3
_LEAST_SLOPES = (0.1, 0.2, 0.35)
_CLOSELY = 1e-5
_STIFF = 1e4
_UNFOLDING_MAY_COST = 0.01
_UNFOLDING_DEVIATIONS = 20.0
_UNFOLDING_ITERATIONS = 15


def fit_lens(
    model: LensModel,
    observations: Sequence[Observation],
    image_size: tuple[int, int],
    square_pixels: bool = False,
    flex: bool = False,
    warm: Mapping[str, Bundle] | None = None,
) -> Bundle:
    """The best solution of one lens model, from the start that needs the least luck first.

    flex : solve for the board's sagittas too.
    warm : solutions by model name for nearly the same corners; where there is one it is the only start.
    """
    directions = free_directions(model, square_pixels, flex)
    near = (warm or {}).get(model.name)
    if near is None:
        near = rough_lens(model, observations, image_size, square_pixels, warm)
    sagittas = near.sagittas_m if flex else np.zeros(FLEX)
    return refine(model, near.intrinsics, near.poses, observations, directions, sagittas_m=sagittas)


def rough_lens(
    model: LensModel,
    observations: Sequence[Observation],
    image_size: tuple[int, int],
    square_pixels: bool = False,
    known: Mapping[str, Bundle] | None = None,
) -> Bundle:
    """A solution of a flat board that needs only a few more steps, outliers and all.

    The focal length in closed form comes first. Where the median corner is left over a thousandth of the picture's
    width off, focal lengths from wide to long are tried as well, and the best by the median corner, for half of the
    corners may be wrong, is taken.

    known : solutions of simpler lenses, by name, to start from.
    """
    simpler = (known or {}).get(model.simpler or "")
    if simpler is not None:
        directions, start = free_directions(model, square_pixels), widened(simpler.intrinsics, model, image_size)
        return refine(
            model, start, simpler.poses, observations, directions, iterations=_TRIAL_ITERATIONS, tolerance=_ROUGHLY
        )
    tried: list[Bundle] = []
    for focal in _focal_starts(observations, image_size):
        bundle = _climbed(model, focal, observations, image_size, square_pixels)
        # a mirrored solution (board behind the camera, negative focal length) can fit as well
        if _is_physical(bundle) and bundle.sigma_px < _PLAUSIBLE_PER_WIDTH * max(image_size):
            return bundle
        tried.append(bundle)
    physical = [bundle for bundle in tried if _is_physical(bundle)] or tried
    return min(physical, key=lambda bundle: np.nan_to_num(bundle.sigma_px, nan=np.inf))


def _climbed(
    model: LensModel,
    focal_px: float,
    observations: Sequence[Observation],
    image_size: tuple[int, int],
    square_pixels: bool,
) -> Bundle:
    """From one focal length through the simpler lenses: a rich lens from a cold start ends far from the minimum."""
    intrinsics = np.array([focal_px, focal_px, (image_size[0] - 1) / 2, (image_size[1] - 1) / 2])
    bundle = Bundle(intrinsics, start_poses(intrinsics, observations), ())
    for rung in reversed(_ladder(model)):
        start = widened(bundle.intrinsics, rung, image_size)
        iterations = _TRIAL_ITERATIONS if rung is model else _STEP_ITERATIONS
        directions = free_directions(rung, square_pixels)
        bundle = refine(rung, start, bundle.poses, observations, directions, iterations=iterations, tolerance=_ROUGHLY)
    return bundle


def _ladder(model: LensModel) -> list[LensModel]:
    """The model and those that lead to it, the simplest last."""
    ladder = [model]
    while (below := ladder[-1].simpler) is not None:
        ladder.append(LENS_MODELS[below])
    return ladder


def unfolded(
    model: LensModel,
    bundle: Bundle,
    observations: Sequence[Observation],
    directions: np.ndarray,
    image_size: tuple[int, int],
) -> Bundle:
    """A solution that does not fold inside the picture, where the corners leave room for one; the given one otherwise.

    Beyond the corners a rich lens is held by nothing, and often folds there. Keeping up the slope of its radial curve
    as far as the picture's corner takes that away and leaves the rest to the corners. At most 1 % of the squared
    residuals is paid for it, or what 20 parameters would explain by chance: a lens that must pay more is wrong.
    """
    if not np.isfinite(bundle.rms_px) or is_monotonic(model, bundle.intrinsics, image_size):
        return bundle
    count = sum(len(view.pixels) for view in observations)
    share = max(_UNFOLDING_MAY_COST, _UNFOLDING_DEVIATIONS / (2 * count))
    at_most = np.sqrt(1.0 + share) * bundle.rms_px
    starts = [(bundle.intrinsics, bundle.poses)]
    if len(_ladder(model)) > 1 and _ladder(model)[-1].camera_model != model.camera_model:
        # a pole inside the picture is not left by small steps
        smooth = rough_lens(_ladder(model)[-1], observations, image_size)
        starts.insert(0, (widened(smooth.intrinsics, model, image_size), smooth.poses))
    for slope in _LEAST_SLOPES:
        for start in starts:
            trial = refine(
                model,
                *start,
                observations,
                directions,
                iterations=_UNFOLDING_ITERATIONS,
                sagittas_m=bundle.sagittas_m,
                unfolding=Unfolding(slope, _STIFF * bundle.sigma_px**2, image_size),
                tolerance=_CLOSELY,
            )
            if trial.rms_px <= at_most and is_monotonic(model, trial.intrinsics, image_size):
                return trial
    return bundle


def widened(intrinsics: np.ndarray, model: LensModel, image_size: tuple[int, int]) -> np.ndarray:
    """(4 + k,) start of a lens model from the solution of the next simpler one."""
    wide = np.zeros(4 + model.distortion_count)
    before = LENS_MODELS.get(model.simpler or "")
    if before is not None and before.camera_model != model.camera_model:
        alike = rational_like(before, intrinsics, image_size)
        intrinsics = intrinsics[:4] if alike is None else alike
    wide[: len(intrinsics)] = intrinsics
    return wide


def start_poses(intrinsics: np.ndarray, observations: Sequence[Observation]) -> np.ndarray:
    """(V, 6) poses of the views under a pinhole with these focal lengths, distortion ignored."""
    matrix, poses = camera_matrix(intrinsics), []
    for view in observations:
        _, rotvec, translation = cv2.solvePnP(view.points_m, view.pixels, matrix, None)
        poses.append(np.concatenate([rotvec.ravel(), translation.ravel()]))
    return np.array(poses)


def _focal_starts(observations: Sequence[Observation], image_size: tuple[int, int]) -> list[float]:
    starts = [ratio * max(image_size) for ratio in _FOCAL_PER_WIDTH]
    points = [view.points_m.astype(np.float32) for view in observations]
    pixels = [view.pixels.astype(np.float32) for view in observations]
    try:
        closed_form = float(cv2.initCameraMatrix2D(points, pixels, image_size, 0)[0, 0])
    except cv2.error:
        return starts
    usable = np.isfinite(closed_form) and 0.1 * max(image_size) < closed_form < 50 * max(image_size)
    return [closed_form, *starts] if usable else starts


def _is_physical(bundle: Bundle) -> bool:
    return bool(np.all(bundle.intrinsics[:2] > 0.0) and np.all(bundle.poses[:, 5] > 0.0))
