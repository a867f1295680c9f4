"""Starting values that reach the right minimum: several focal lengths, and richer lenses from simpler ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import cv2
import numpy as np

from .bundle import FLEX, Bundle, Observation, free_directions, refine
from .lens_models import LENS_MODELS, LensModel, camera_matrix

_FOCAL_PER_WIDTH = (0.35, 0.7, 1.4, 3.0, 8.0)
_TRIAL_ITERATIONS = 15
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
        known[model.name] = refine(
            model, near.intrinsics, near.poses, observations, directions, sagittas_m=sagittas
        )
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
    known[model.name] = min(found, key=lambda bundle: np.nan_to_num(bundle.rms_px, nan=np.inf))
    return known[model.name]


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
