"""Bundle adjustment of one lens, one board and many board poses (Schur complement over the views)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from types import SimpleNamespace

import numpy as np

from vbaa_calib.core.arrays import Rows
from vbaa_calib.core.least_squares import Rules
from vbaa_calib.core.robust import radial_std
from vbaa_calib.native import core

from .board_shape import SHAPE, ShapePrior
from .models import DistortionModel
from .settings import LensSettings

CONVERGED = Rules(300, 1e-8, may_rise_share=1e-13, damping=1e-3, growth=8.0, after_failure=0.0)
"""Enough for decisions; `polished` for what is reported."""


@dataclass(frozen=True, eq=False)
class BoardCorners(Rows):
    """Detected corners of one view, with their board points."""

    points_m: np.ndarray  # (N, 3) board frame
    pixels: np.ndarray  # (N, 2)
    deformation: np.ndarray | None = None  # (N, 3, 5) how each point moves with the board's shape (`deformations`)
    weight: float = 1.0  # of its residuals; less than 1 for a noisy view


def _corners_of(observations: Sequence[BoardCorners]) -> SimpleNamespace:
    """All views' corners as the core reads them, concatenated. bounds : (V + 1,), view v has corners bounds[v] to
    bounds[v + 1]."""
    counts = [len(view.pixels) for view in observations]
    rigid = [np.zeros((len(v.pixels), 3, SHAPE)) if v.deformation is None else v.deformation for v in observations]
    return SimpleNamespace(
        points_m=np.concatenate([view.points_m for view in observations], dtype=float),
        deformation=np.concatenate(rigid),
        pixels=np.concatenate([view.pixels for view in observations], dtype=float),
        weights=np.repeat(np.array([view.weight for view in observations], float), counts),
        bounds=np.concatenate([[0], np.cumsum(counts)]),
    )


def rows(bundle: Bundle, observations: Sequence[BoardCorners]) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Residuals (N, 2) px of all corners, negative derivatives by intrinsics and shape (N, 2, 4 + k + 5) and by the
    poses' tangents (N, 2, 6, `Pose.retract`), and bounds (V + 1,): view v has rows bounds[v] to bounds[v + 1]."""
    corners = _corners_of(observations)
    residuals, slopes = core.bundle.corner_rows(bundle.state, corners)
    return residuals, slopes[..., :-6], slopes[..., -6:], corners.bounds


@dataclass(frozen=True, eq=False)
class Bundle:
    """A lens with the board poses of its views: an initial value or a solution."""

    model: DistortionModel
    intrinsics: np.ndarray  # (4 + k,) fx, fy, cx, cy, distortion
    poses: np.ndarray  # (V, 6) rotation vector rad and translation m, T_camera_board of each view
    directions: np.ndarray  # (4 + k + 5, p) from `free_directions`: what is solved for besides the poses
    residuals_px: tuple[np.ndarray, ...] = ()  # per view (N, 2), observed minus projected; none at a start
    shape: np.ndarray = field(default_factory=lambda: np.zeros(SHAPE))  # (5,) of the board (`BoardShape`)
    prior: ShapePrior | None = None  # of the shape, where that is solved for
    noise_px: float = LensSettings.usual_noise_px  # of a corner per axis; the prior's weight
    # the penalty against folding, where it was needed: least slope in the picture of the distorted radius by the ideal
    # one (fisheye: by the angle), cost, px², of a slope of zero at one of the radii checked, and the picture's size, px
    unfolding: tuple[float, float, tuple[int, int]] | None = None

    @staticmethod
    def start(model: DistortionModel, intrinsics: np.ndarray, poses: np.ndarray) -> Bundle:
        """Initial bundle: lens and poses as they are, the board flat."""
        return Bundle(model, intrinsics, poses, free_directions(model))

    @property
    def poses_only(self) -> Bundle:
        """The bundle with the poses as its only unknowns."""
        return replace(self, directions=self.directions[:, :0])

    def freed(self, square_pixels: bool, prior: ShapePrior | None = None) -> Bundle:
        """The bundle with free intrinsics, and a free board shape where it has a prior."""
        free = free_directions(self.model, square_pixels, prior is not None)
        shape = np.zeros(SHAPE) if prior is None else self.shape
        noise_px = max(self.sigma_px, LensSettings.least_noise_px) if self.residuals_px else self.noise_px
        intrinsics = self.intrinsics.copy()
        if square_pixels:
            intrinsics[:2] = intrinsics[:2].mean()
        return replace(self, intrinsics=intrinsics, directions=free, shape=shape, prior=prior, noise_px=noise_px)

    @property
    def state(self) -> SimpleNamespace:
        """Lens, shape and poses, as the compiled core takes them."""
        lens, shape, poses = (np.array(part, float) for part in (self.intrinsics, self.shape, self.poses))
        return SimpleNamespace(fisheye=self.model.is_fisheye, lens=lens, shape=shape, poses=poses)

    @property
    def priors(self) -> SimpleNamespace:
        """Prior of the board's shape and penalty on a folding lens, as the compiled core takes them; zeros where there
        is none. stiffness_px : residual of a slope of zero at one of the radii checked."""
        (least_slope, weight_px2, (width, height)), none = self.unfolding or (0.0, 0.0, (0, 0)), np.zeros(SHAPE)
        mean, std = (none, none) if self.prior is None else (self.prior.mean, self.prior.std)
        return SimpleNamespace(
            mean=np.array(mean, float),
            std=np.array(std, float),
            noise_px=0.0 if self.prior is None else float(self.noise_px),
            least_slope=least_slope,
            stiffness_px=float(np.sqrt(weight_px2)),
            width=width,
            height=height,
            tail=LensSettings.shape_tail,
        )

    def unfolding_rows(self) -> tuple[np.ndarray, np.ndarray]:
        """Penalty residuals (m,) px at radii where the radial curve's slope is too small, and their negative
        derivatives (m, 4 + k)."""
        lacking, by_lens = core.bundle.unfolding_rows(self.state.lens, self.model.is_fisheye, self.priors)
        return lacking, by_lens

    def prior_rows(self) -> tuple[np.ndarray, np.ndarray]:
        """Residuals (m,) px of the shape's prior as IRLS uses them, and their negative derivatives (m, 4 + k + 5)."""
        size = len(self.intrinsics)
        if self.prior is None:
            return np.zeros(0), np.zeros((0, size + SHAPE))
        residuals, slopes = self.prior.rows(self.shape)
        return self.noise_px * residuals, self.noise_px * np.pad(np.diag(slopes), ((0, 0), (size, 0)))

    @property
    def rms_px(self) -> float:
        """Root mean square distance between observed and projected corners, over all corners."""
        return float(np.sqrt(np.mean(np.sum(np.concatenate(self.residuals_px) ** 2, axis=1))))

    @property
    def view_rms_px(self) -> np.ndarray:
        """(V,) root mean square distance between observed and projected corners of each view."""
        return np.array([np.sqrt(np.mean(np.sum(r**2, axis=1))) for r in self.residuals_px])

    @property
    def sigma_px(self) -> float:
        """Robust noise per axis, px, from the median residual."""
        return radial_std(np.linalg.norm(np.concatenate(self.residuals_px), axis=1))


def free_directions(model: DistortionModel, square_pixels: bool = False, shape: bool = False) -> np.ndarray:
    """Directions (4 + k + 5, p) in which the unknowns vary: intrinsics (fx and fy together with square pixels), then
    the board's shape."""
    size = 4 + model.distortion_count
    unit = np.eye(size + SHAPE)
    rest = [2, 3, *(4 + index for index in model.free), *(range(size, size + SHAPE) if shape else ())]
    focal = unit[:, :1] + unit[:, 1:2] if square_pixels else unit[:, :2]
    return np.hstack([focal, unit[:, rest]])


def refine(
    start: Bundle, observations: Sequence[BoardCorners], rules: Rules = CONVERGED, robust: bool = False
) -> Bundle:
    """Minimises the reprojection error by Levenberg–Marquardt. robust : whether by Cauchy's loss, which bounds the
    influence of outliers."""
    corners, directions = _corners_of(observations), start.directions
    # each number of lens and shape is part of one unknown, or kept
    column = np.where(directions.any(axis=1), directions.argmax(axis=1) if directions.size else 0, -1)
    lens, shape, poses, residuals = core.bundle.descend(start.state, corners, column, start.priors, rules, robust)
    return replace(start, intrinsics=lens, shape=shape, poses=poses, residuals_px=of_views(residuals, corners.bounds))


def of_views(values: np.ndarray, bounds: np.ndarray) -> tuple[np.ndarray, ...]:
    """Per view its rows of values (N, ...): view v has rows bounds[v] to bounds[v + 1]."""
    return tuple(values[first:last] for first, last in pairwise(bounds.tolist()))


def polished(bundle: Bundle, observations: Sequence[BoardCorners]) -> Bundle:
    """Refines a solution to a millionth of its standard deviations, so that results do not depend on where the
    iteration stopped."""
    sizes = sum(view.pixels.size for view in observations) - bundle.directions.shape[1] - 6 * len(observations)
    return refine(
        bundle, observations, replace(CONVERGED, iterations=30, damping=1e-8, tolerance=1e-6**2 / max(sizes, 1))
    )


def residuals_px(bundle: Bundle, observations: Sequence[BoardCorners]) -> tuple[np.ndarray, ...]:
    """Per view (N, 2) residuals px, observed minus projected, for corners of the bundle's views."""
    residuals, _, _, bounds = rows(bundle, observations)
    return of_views(residuals, bounds)
