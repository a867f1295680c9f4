"""Initialization: robust homographies, several focal lengths, simpler lenses first."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from vbaa_calib.core.least_squares import Rules
from vbaa_calib.geometry import Pose
from vbaa_calib.native import core

from .bundle import CONVERGED, BoardCorners, Bundle, of_views, refine, residuals_px
from .models import LENS_MODELS, DistortionModel, camera_of, division_like, is_monotonic, rational_like
from .settings import LensSettings


@lru_cache(maxsize=256)
def _picks(count: int) -> np.ndarray:
    """Indices (S, 4) of random samples of four corners out of `count`."""
    return np.ascontiguousarray(
        np.random.default_rng(0).random((LensSettings.homography_samples, count)).argsort(axis=1)[:, :4]
    )


def homography(points: np.ndarray, image: np.ndarray, division: float = 0.0) -> tuple[np.ndarray, float] | None:
    """Robust homography (3, 3) from points (N, 2) to their image (N, 2), and the noise per axis from the median
    residual; None without one.

    Least median of squares (Rousseeuw 1984), then least squares of the points that it fits. OpenCV's finds none on
    small boards: most of its samples have three points on a line, and it gives up.

    division : λ of the undistortion x / (1 + λr²) of the image, about its origin; the noise is the distorted image's.
    """
    known = np.isfinite(image).all(axis=1)
    if known.sum() < 4:
        return None
    if not known.all():
        points, image = points[known], image[known]
    points, image = (np.ascontiguousarray(each, float) for each in (points, image))
    found, noise = core.bundle.homography(points, image, _picks(len(points)), division)
    return (found, noise) if np.isfinite(noise) else None


def _board_poses(homographies: list[np.ndarray | None]) -> np.ndarray:
    """(V, 6) rotation vectors and translations of a board's plane, from its homographies (3, 3) to ideal image
    coordinates; in front of the camera where one is missing."""
    poses = np.tile([0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (len(homographies), 1))
    known = [view for view, found in enumerate(homographies) if found is not None]
    if known:
        every = np.array([homographies[view] for view in known])
        lengths = np.linalg.norm(every[:, :, :2], axis=1).sum(axis=1)
        every *= np.copysign(2.0 / np.maximum(lengths, 1e-300), every[:, 2, 2])[:, None, None]
        axes = np.stack([every[:, :, 0], every[:, :, 1], np.cross(every[:, :, 0], every[:, :, 1])], axis=2)
        vectors, _, others = np.linalg.svd(axes)
        vectors[:, :, 2] *= np.linalg.det(vectors @ others)[:, None]
        pairs = zip(vectors @ others, every[:, :, 2], strict=True)
        poses[known] = [Pose(rotation, shift).vector for rotation, shift in pairs]
    return poses


_TRIAL = replace(CONVERGED, iterations=15, tolerance=1e-3)
_FEW_STEPS = replace(_TRIAL, iterations=6)


def homography_start(observations: Sequence[BoardCorners], image_size: tuple[int, int]) -> tuple[float, float]:
    """Initial focal length (px or NaN), and division-model distortion λ of least median error, from the views' own
    homographies."""
    division, homographies = _undistorted_homographies(_thinned(observations), image_size)
    return _focal_length(homographies), division


def rough_lens(
    model: DistortionModel,
    observations: Sequence[BoardCorners],
    image_size: tuple[int, int],
    known: Mapping[str, Bundle] | None = None,
    start: tuple[float, float] | None = None,
) -> Bundle:
    """A robust solution with a flat board, a few steps from the minimum and insensitive to outliers. Starts from a
    simpler or richer lens in `known`, else from the homographies (`start`) and other focal lengths until two lead to
    the same solution; the one of least median residual is returned."""
    known = known or {}
    near = known.get(model.simpler or "")
    if near is not None:
        return _posed(_begun(model, near, image_size), observations, _TRIAL)
    richer = next((each for name, each in known.items() if model in _ladder(LENS_MODELS[name])), None)
    if richer is not None:
        intrinsics = richer.intrinsics[: 4 + model.distortion_count].copy()
        intrinsics[[4 + index for index in range(model.distortion_count) if index not in model.free]] = 0.0
        return _posed(Bundle.start(model, intrinsics, richer.poses), observations, _TRIAL)
    ladder = _ladder(model)[::-1]
    first = next((rung for rung in ladder if rung.free), model)
    bundle = _from_homographies(first, observations, image_size, *(start or homography_start(observations, image_size)))
    # through the simpler lenses: a rich lens from a cold start ends far from the minimum
    for rung in ladder[ladder.index(first) + 1 :]:
        bundle = _posed(_begun(rung, bundle, image_size), observations, _FEW_STEPS)
    return refine(bundle, observations, _TRIAL, robust=True)


def _begun(model: DistortionModel, simpler: Bundle, image_size: tuple[int, int]) -> Bundle:
    return Bundle.start(model, widened(simpler.model, simpler.intrinsics, model, image_size), simpler.poses)


def _from_homographies(
    model: DistortionModel,
    observations: Sequence[BoardCorners],
    image_size: tuple[int, int],
    focal_px: float,
    division: float,
) -> Bundle:
    """Initial bundle from homographies, with the first lens model of the ladder that has distortion, or with one
    without."""
    some = _thinned(observations)
    others = [ratio * max(image_size) for ratio in LensSettings.focal_per_width]
    tried: list[Bundle] = []
    for focal in [*([focal_px] if np.isfinite(focal_px) else []), *others]:
        start = _start(model, focal, division if focal == focal_px else 0.0, some, image_size)
        tried.append(_posed(start, some, _FEW_STEPS))
        scores = sorted(each.sigma_px for each in tried if _is_physical(each))
        if len(scores) > 1 and scores[1] < LensSettings.same_start * scores[0] + LensSettings.same_start_px:
            break
    # a mirrored solution (board behind the camera, negative focal length) can fit as well
    physical = [bundle for bundle in tried if _is_physical(bundle)] or tried
    best = min(physical, key=lambda bundle: np.nan_to_num(bundle.sigma_px, nan=np.inf))
    poses = robust_poses(model, best.intrinsics, observations)
    return _posed(replace(best, poses=poses), observations, _TRIAL)


def _thinned(observations: Sequence[BoardCorners]) -> list[BoardCorners]:
    """An evenly spaced subset of the views, and of the corners of each."""
    views = observations[:: -(-len(observations) // LensSettings.start_views)]
    return [
        view.picked(np.arange(0, len(view.pixels), -(-len(view.pixels) // LensSettings.start_corners)))
        for view in views
    ]


def _start(
    model: DistortionModel,
    focal: float,
    division: float,
    observations: Sequence[BoardCorners],
    image_size: tuple[int, int],
) -> Bundle:
    """Initial bundle from a focal length and division-model distortion about the picture's centre."""
    width, height = image_size
    reach = 0.5 * np.hypot(width, height) / focal
    division /= reach**2
    intrinsics = np.concatenate(
        [[focal, focal, (width - 1) / 2, (height - 1) / 2], division_like(model, division, reach)]
    )
    return Bundle.start(model, intrinsics, robust_poses(model, intrinsics, observations))


def _undistorted_homographies(
    observations: Sequence[BoardCorners], image_size: tuple[int, int]
) -> tuple[float, list[np.ndarray]]:
    """Division-model distortion λ, and homographies (3, 3) from board points to undistorted pixels about the picture's
    centre."""
    centre, radius = (np.array(image_size) - 1) / 2, 0.5 * float(np.hypot(*image_size))
    found: list[tuple[float, float, list[np.ndarray]]] = []
    for division in LensSettings.divisions:
        every = [homography(v.points_m[:, :2], v.pixels - centre, division / radius**2) for v in observations]
        fits = [fit for fit in every if fit is not None]
        score = (
            float(np.mean(np.log(np.array([noise for _, noise in fits]) + LensSettings.same_start_px)))
            if fits
            else np.inf
        )
        found.append((score, division, [matrix for matrix, _ in fits]))
    _, division, homographies = min(found, key=lambda each: each[0])
    return division, homographies


def _focal_length(homographies: Sequence[np.ndarray]) -> float:
    """Focal length, px, by the weighted median over homographies to pixels relative to the principal point; NaN
    without one."""
    # the columns of K⁻¹H are orthogonal and as long as each other (Zhang 2000): a / f² = b
    rows = []
    for each in homographies:
        first, second = each[:, 0], each[:, 1]
        scale = np.linalg.norm(first) * np.linalg.norm(second)
        if scale > 0.0:
            rows.append(np.array([first[:2] @ second[:2], -first[2] * second[2]]) / scale)
            rows.append(
                np.array([first[:2] @ first[:2] - second[:2] @ second[:2], second[2] ** 2 - first[2] ** 2]) / scale
            )
    a, b = np.array(rows).reshape(-1, 2).T
    known = np.abs(a) > 0.0
    if not known.any():
        return np.nan
    order = np.argsort(b[known] / a[known])
    weight = np.cumsum(np.abs(a[known])[order])
    inverse_square = (b[known] / a[known])[order][np.searchsorted(weight, 0.5 * weight[-1])]
    return float(1.0 / np.sqrt(inverse_square)) if inverse_square > 0.0 else np.nan


def robust_poses(model: DistortionModel, intrinsics: np.ndarray, observations: Sequence[BoardCorners]) -> np.ndarray:
    """(V, 6) board poses of the views under a lens, each from a robust homography of its corners."""
    pixels = np.concatenate([view.pixels for view in observations])
    bounds = np.cumsum([0, *(len(view.pixels) for view in observations)])
    size = np.ceil(pixels.max(axis=0)).astype(int) + 1
    rays, valid = camera_of(model, intrinsics, (int(size[0]), int(size[1]))).unproject(pixels)
    seen = valid & (rays[:, 2] > LensSettings.least_ray_z)
    image = np.where(seen[:, None], rays[:, :2] / np.where(seen, rays[:, 2], 1.0)[:, None], np.nan)
    fits = [homography(v.points_m[:, :2], own) for v, own in zip(observations, of_views(image, bounds), strict=True)]
    return _board_poses([None if fit is None else fit[0] for fit in fits])


def _posed(start: Bundle, observations: Sequence[BoardCorners], rules: Rules) -> Bundle:
    """Refines robustly, after reinitialising the poses of views with a large median residual: refining does not
    recover them."""
    return reposed(refine(start, observations, rules, robust=True), observations, rules)


def reposed(bundle: Bundle, observations: Sequence[BoardCorners], rules: Rules = _FEW_STEPS) -> Bundle:
    """A robust solution in which the poses of views with a large median residual have been reinitialised."""
    median = np.array([np.median(np.linalg.norm(each, axis=1)) for each in bundle.residuals_px])
    bad = np.flatnonzero(median > LensSettings.wrong_pose * np.median(median)).tolist()
    if not bad:
        return bundle
    some = [observations[index] for index in bad]
    poses = bundle.poses.copy()
    poses[bad] = robust_poses(bundle.model, bundle.intrinsics, some)
    trial = residuals_px(replace(bundle, poses=poses[bad]), some)
    better = np.array([np.median(np.linalg.norm(each, axis=1)) for each in trial]) < median[bad]
    if not better.any():
        return bundle
    worse = np.array(bad)[~better]
    poses[worse] = bundle.poses[worse]
    return refine(replace(bundle, poses=poses), observations, rules, robust=True)


def _is_physical(bundle: Bundle) -> bool:
    return bool(np.all(bundle.intrinsics[:2] > 0.0) and np.median(bundle.poses[:, 5]) > 0.0)


def _ladder(model: DistortionModel) -> list[DistortionModel]:
    """The lens model and its simpler predecessors, the simplest last."""
    return [model, *([] if model.simpler is None else _ladder(LENS_MODELS[model.simpler]))]


def unfolded(
    bundle: Bundle,
    observations: Sequence[BoardCorners],
    image_size: tuple[int, int],
    known: Mapping[str, Bundle] | None = None,
) -> Bundle:
    """A solution with a lens that does not fold inside the picture, where the corners allow one; otherwise the same
    solution.

    A penalty keeps up the slope of the radial curve as far as the picture's corner. It may cost 1 % of the squared
    residuals, or what 20 parameters would explain by chance: a lens that needs more is wrong.
    """
    model = bundle.model
    if not np.isfinite(bundle.rms_px) or is_monotonic(model, bundle.intrinsics, image_size):
        return bundle
    count = sum(len(view.pixels) for view in observations)
    share = max(LensSettings.unfolding_may_cost, LensSettings.unfolding_chance / (2 * count))
    at_most = np.sqrt(1.0 + share) * bundle.rms_px
    starts, simplest = [bundle], _ladder(model)[-1]
    if simplest.camera_model != model.camera_model:
        # small steps do not leave a pole inside the picture
        smooth = (known or {}).get(simplest.name) or rough_lens(simplest, observations, image_size)
        wide = widened(smooth.model, smooth.intrinsics, model, image_size)
        starts.insert(0, replace(bundle, intrinsics=wide, poses=smooth.poses))
    for slope in LensSettings.unfolding_slopes:
        unfolding = slope, LensSettings.unfolding_weight * bundle.sigma_px**2, image_size
        for start in starts:
            rules = replace(CONVERGED, iterations=15, tolerance=1e-5)
            trial = refine(replace(start, unfolding=unfolding), observations, rules)
            if trial.rms_px <= at_most and is_monotonic(model, trial.intrinsics, image_size):
                return trial
    return bundle


def widened(
    simpler: DistortionModel, intrinsics: np.ndarray, model: DistortionModel, image_size: tuple[int, int]
) -> np.ndarray:
    """(4 + k,) initial intrinsics of a lens model from the solution of a simpler one on its ladder."""
    wide = np.zeros(4 + model.distortion_count)
    if simpler.camera_model != model.camera_model:
        alike = rational_like(simpler, intrinsics, image_size)
        intrinsics = intrinsics[:4] if alike is None else alike
    wide[: len(intrinsics)] = intrinsics
    return wide
