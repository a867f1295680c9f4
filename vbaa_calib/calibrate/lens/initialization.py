"""Starting values that reach the right minimum: several focal lengths, and richer lenses from simpler ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from .bundle import CONVERGED, Bundle, Observation, refine
from .models import LENS_MODELS, LensModel, Unfolding, camera_matrix, is_monotonic, rational_like

_FOCAL_PER_WIDTH = (0.35, 0.7, 1.4, 3.0, 8.0)
_TRIAL = replace(CONVERGED, iterations=15, tolerance=1e-3)
_FEW_STEPS = replace(_TRIAL, iterations=6)
_UNFOLDING = replace(CONVERGED, iterations=15, tolerance=1e-5)
_PLAUSIBLE_PER_WIDTH = 1e-3
_LEAST_SLOPES, _STIFF = (0.1, 0.2, 0.35), 1e4
_UNFOLDING_MAY_COST, _UNFOLDING_DEVIATIONS = 0.01, 20.0


@dataclass(frozen=True)
class LensOptions:
    """The options of a lens solve: picture (width, height) px, "auto" or a name in `LENS_MODELS`, the fewest corners
    of a view, and whether fx = fy."""

    image_size: tuple[int, int]
    model: str = "auto"
    min_corners: int = 6
    square_pixels: bool = False


def fit_lens(
    model: LensModel,
    observations: Sequence[Observation],
    options: LensOptions,
    flex: bool = False,
    warm: Mapping[str, Bundle] | None = None,
) -> Bundle:
    """The best solution of a lens model, with sagittas or without, from `warm` (by name) where it has one."""
    near = (warm or {}).get(model.name)
    if near is None:
        near = rough_lens(model, observations, options, warm)
    start = replace(near, residuals_px=(), unfolding=None)
    return refine(start.freed(options.square_pixels, flex), observations)


def rough_lens(
    model: LensModel,
    observations: Sequence[Observation],
    options: LensOptions,
    known: Mapping[str, Bundle] | None = None,
) -> Bundle:
    """A solution of a flat board that needs only a few more steps, outliers and all.

    The focal length in closed form comes first. Where the median corner is left over a thousandth of the picture's
    width off, focal lengths from wide to long are tried as well, and the best by the median corner, for half of the
    corners may be wrong, is taken.

    known : solutions of simpler lenses, by name, to start from.
    """
    (width, height), square = options.image_size, options.square_pixels

    def begun(rung: LensModel, intrinsics: np.ndarray, poses: np.ndarray) -> Bundle:
        return Bundle.start(rung, widened(intrinsics, rung, options.image_size), poses, square)

    simpler = (known or {}).get(model.simpler or "")
    if simpler is not None:
        return refine(begun(model, simpler.intrinsics, simpler.poses), observations, _TRIAL)
    tried: list[Bundle] = []
    for focal in _focal_starts(observations, options.image_size):
        intrinsics = np.array([focal, focal, (width - 1) / 2, (height - 1) / 2])
        poses = start_poses(intrinsics, observations)
        # through the simpler lenses: a rich lens from a cold start ends far from the minimum
        for rung in reversed(_ladder(model)):
            bundle = refine(begun(rung, intrinsics, poses), observations, _TRIAL if rung is model else _FEW_STEPS)
            intrinsics, poses = bundle.intrinsics, bundle.poses
        # a mirrored solution (board behind the camera, negative focal length) can fit as well
        if _is_physical(bundle) and bundle.sigma_px < _PLAUSIBLE_PER_WIDTH * max(width, height):
            return bundle
        tried.append(bundle)
    physical = [bundle for bundle in tried if _is_physical(bundle)] or tried
    return min(physical, key=lambda bundle: np.nan_to_num(bundle.sigma_px, nan=np.inf))


def _focal_starts(observations: Sequence[Observation], image_size: tuple[int, int]) -> list[float]:
    size, starts = max(image_size), [ratio * max(image_size) for ratio in _FOCAL_PER_WIDTH]
    points = [view.points_m.astype(np.float32) for view in observations]
    pixels = [view.pixels.astype(np.float32) for view in observations]
    try:
        closed_form = float(cv2.initCameraMatrix2D(points, pixels, image_size, 0)[0, 0])
    except cv2.error:
        return starts
    usable = np.isfinite(closed_form) and 0.1 * size < closed_form < 50 * size
    return [closed_form, *starts] if usable else starts


def _is_physical(bundle: Bundle) -> bool:
    return bool(np.all(bundle.intrinsics[:2] > 0.0) and np.all(bundle.poses[:, 5] > 0.0))


def _ladder(model: LensModel) -> list[LensModel]:
    """The model and those that lead to it, the simplest last."""
    return [model, *([] if model.simpler is None else _ladder(LENS_MODELS[model.simpler]))]


def unfolded(bundle: Bundle, observations: Sequence[Observation], image_size: tuple[int, int]) -> Bundle:
    """A solution that does not fold inside the picture, where the corners leave room for one; the given one otherwise.

    Beyond the corners nothing constrains a rich lens, and often it folds there. Keeping up the slope of its radial
    curve as far as the picture's corner takes that away and leaves the rest to the corners. At most 1 % of the squared
    residuals is paid for it, or what 20 parameters would explain by chance: a lens that must pay more is wrong.
    """
    model = bundle.model
    if not np.isfinite(bundle.rms_px) or is_monotonic(model, bundle.intrinsics, image_size):
        return bundle
    count = sum(len(view.pixels) for view in observations)
    share = max(_UNFOLDING_MAY_COST, _UNFOLDING_DEVIATIONS / (2 * count))
    at_most = np.sqrt(1.0 + share) * bundle.rms_px
    starts, simplest = [bundle], _ladder(model)[-1]
    if simplest.camera_model != model.camera_model:
        # a pole inside the picture is not left by small steps
        smooth = rough_lens(simplest, observations, LensOptions(image_size))
        wide = widened(smooth.intrinsics, model, image_size)
        starts.insert(0, replace(bundle, intrinsics=wide, poses=smooth.poses))
    for slope in _LEAST_SLOPES:
        unfolding = Unfolding(slope, _STIFF * bundle.sigma_px**2, image_size)
        for start in starts:
            trial = refine(replace(start, unfolding=unfolding), observations, _UNFOLDING)
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
