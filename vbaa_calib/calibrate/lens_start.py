"""Starting values that reach the right minimum: several focal lengths, and richer lenses from simpler ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import cv2
import numpy as np

from .bundle import Bundle, free_directions, refine
from .corner_stack import FLEX, Observation
from .lens_models import LENS_MODELS, LensModel, camera_matrix, is_monotonic

_FOCAL_PER_WIDTH = (0.35, 0.7, 1.4, 3.0, 8.0)
_TRIAL_ITERATIONS = 15
_PULLS = 10.0 ** np.arange(-4, 5)
_UNFOLDING_MAY_COST = 1.005
_UNFOLDING_ITERATIONS = 40
_FROM_FOCALS = ("none", "radial", "fisheye")


def fit_lens(
    model: LensModel,
    observations: Sequence[Observation],
    image_size: tuple[int, int],
    square_pixels: bool = False,
    known: dict[str, Bundle] | None = None,
    flex: bool = False,
    warm: Mapping[str, Bundle] | None = None,
) -> Bundle:
    """The best solution of one lens model over all starts.

    known : solutions by model name; used as starts, and filled with those found on the way.
    flex : solve for the board's sagittas too.
    warm : solutions by model name for nearly the same corners; where there is one it is the only start.
    """
    known = {} if known is None else known
    if model.name in known:
        return known[model.name]
    directions = free_directions(model, square_pixels, flex)
    if warm and model.name in warm:
        near = warm[model.name]
        sagittas = near.sagittas_m if flex else np.zeros(FLEX)
        found = [refine(model, near.intrinsics, near.poses, observations, directions, sagittas_m=sagittas)]
        known[model.name] = unfolded(model, found[0], observations, directions, image_size)
        return known[model.name]
    starts = []
    if model.simpler is not None:
        simpler = fit_lens(LENS_MODELS[model.simpler], observations, image_size, square_pixels, known, flex, warm)
        starts.append((_widened(simpler.intrinsics, model), simpler.poses))
    if model.name in _FROM_FOCALS:
        for focal in _focal_starts(observations, image_size):
            intrinsics = np.zeros(4 + model.distortion_count)
            intrinsics[:4] = focal, focal, (image_size[0] - 1) / 2, (image_size[1] - 1) / 2
            starts.append((intrinsics, start_poses(intrinsics, observations)))
    tried = [refine(model, *start, observations, directions, iterations=_TRIAL_ITERATIONS) for start in starts]
    # a mirrored solution (board behind the camera, negative focal length) can fit as well
    tried = [bundle for bundle in tried if _is_physical(bundle)] or tried
    # by the median corner: half of them may be wrong
    tried.sort(key=lambda bundle: np.nan_to_num(bundle.sigma_px, nan=np.inf))
    found = [
        refine(model, start.intrinsics, start.poses, observations, directions, sagittas_m=start.sagittas_m)
        for start in tried[:2]
    ]
    best = min(found, key=lambda bundle: np.nan_to_num(bundle.rms_px, nan=np.inf))
    known[model.name] = unfolded(model, best, observations, directions, image_size)
    return known[model.name]


def unfolded(
    model: LensModel,
    bundle: Bundle,
    observations: Sequence[Observation],
    directions: np.ndarray,
    image_size: tuple[int, int],
) -> Bundle:
    """A solution that does not fold inside the picture, where the corners leave room for one; the given one otherwise.

    Beyond the corners a rich lens is held by nothing, and often folds there. A pull of its coefficients towards zero,
    as weak as will do, holds what the corners leave open and moves the rest by less than they can tell: at most 0.5 %
    of the residual is paid for it.
    """
    if not np.isfinite(bundle.rms_px) or is_monotonic(model, bundle.intrinsics, image_size):
        return bundle
    at_most = _UNFOLDING_MAY_COST * bundle.rms_px
    for pull in _PULLS:
        trial = refine(
            model,
            bundle.intrinsics,
            bundle.poses,
            observations,
            directions,
            iterations=_UNFOLDING_ITERATIONS,
            sagittas_m=bundle.sagittas_m,
            shrink_px2=pull * bundle.rms_px**2,
        )
        if trial.rms_px > at_most:
            break
        if is_monotonic(model, trial.intrinsics, image_size):
            return trial
    return bundle


def start_poses(intrinsics: np.ndarray, observations: Sequence[Observation]) -> np.ndarray:
    """(V, 6) poses of the views under a pinhole with these focal lengths, distortion ignored."""
    matrix, poses = camera_matrix(intrinsics), []
    for view in observations:
        _, rotvec, translation = cv2.solvePnP(view.points_m, view.pixels, matrix, None)
        poses.append(np.concatenate([rotvec.ravel(), translation.ravel()]))
    return np.array(poses)


def _widened(intrinsics: np.ndarray, model: LensModel) -> np.ndarray:
    wide = np.zeros(4 + model.distortion_count)
    shared = 4 if model.camera_model == "fisheye" else len(intrinsics)
    wide[:shared] = intrinsics[:shared]
    return wide


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
