"""How far the antenna's seen points lie from a predicted curve, in whitened units along the curve's normal.

Pixels are undistorted once per frame, with their covariance; every comparison after that is a pinhole's, whatever the
lens.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from vbaa_calib.antenna.shape import Curves
from vbaa_calib.camera import Camera
from vbaa_calib.geometry import Pose

_FOOT_STEPS = 2
"""Newton steps from the nearest node to the foot: each squares an error of a few hundredths of the nodes' spacing."""


@dataclass(frozen=True, eq=False)
class SeenPoints:
    """The antenna's points (N, 2) of one picture, normalized (on the plane one unit before the camera).

    covariance : (N, 2, 2) of each point, from its standard deviation across the antenna in pixels.
    by_lens : (N, 2, P) how the points move with the P parameters of the lens; None where the lens counts as exact.
    """

    points: np.ndarray
    covariance: np.ndarray
    by_lens: np.ndarray | None = None

    def __len__(self) -> int:
        return len(self.points)

    def picked(self, which: np.ndarray) -> SeenPoints:
        """Some of the points, by index or mask."""
        by_lens = None if self.by_lens is None else self.by_lens[which]
        return SeenPoints(self.points[which], self.covariance[which], by_lens)

    def with_lens_moved(self, step: np.ndarray) -> SeenPoints:
        """The same pixels through a lens whose parameters are a small step (P,) away."""
        return self if self.by_lens is None else replace(self, points=self.points + self.by_lens @ step)


@dataclass(frozen=True, eq=False)
class ImageCurves:
    """K predicted curves of one frame: nodes (K, M, 2) in normalized coordinates, slopes by arc length, s (K, M)."""

    arclength_m: np.ndarray
    nodes: np.ndarray
    slopes: np.ndarray

    def at(self, which: int, arclength_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Points and derivatives (N, 2) of one curve at arc lengths (N,), by cubic Hermite between the nodes."""
        nodes_s = self.arclength_m[which]
        left = np.clip(np.searchsorted(nodes_s, arclength_m, side="right") - 1, 0, len(nodes_s) - 2)
        span = nodes_s[left + 1] - nodes_s[left]
        t = ((arclength_m - nodes_s[left]) / span)[:, None]
        p0, p1 = self.nodes[which, left], self.nodes[which, left + 1]
        d0, d1 = self.slopes[which, left] * span[:, None], self.slopes[which, left + 1] * span[:, None]
        a, b = 2 * (p0 - p1) + d0 + d1, 3 * (p1 - p0) - 2 * d0 - d1
        return ((a * t + b) * t + d0) * t + p0, ((3 * a * t + 2 * b) * t + d0) / span[:, None]


def see(camera: Camera, points_px: np.ndarray, sigma_px: np.ndarray, with_lens: bool = False) -> SeenPoints:
    """Undistort (N, 2) pixels with standard deviations (N,); points where the lens has no inverse are left out.

    Their dependence on the lens comes with them where asked for, or where the camera knows its own covariance.
    """
    points, jacobian, valid = camera.normalized_with_slopes(points_px)
    covariance = sigma_px[:, None, None] ** 2 * jacobian @ np.swapaxes(jacobian, -1, -2)
    valid &= np.isfinite(covariance).all(axis=(-1, -2))
    by_lens = camera.lens_slopes_at(points) if with_lens or camera.covariance is not None else None
    return SeenPoints(points, covariance, by_lens).picked(valid)


def image_curves(curves: Curves, T_camera_antenna: Sequence[Pose] | Pose) -> ImageCurves:
    """Project B curves, through one camera pose or one each."""
    if isinstance(T_camera_antenna, Pose):
        rotation, translation = T_camera_antenna.rotation[None], T_camera_antenna.translation_m[None]
    else:
        rotation = np.stack([pose.rotation for pose in T_camera_antenna])
        translation = np.stack([pose.translation_m for pose in T_camera_antenna])
    points = curves.points_m @ np.swapaxes(rotation, -1, -2) + translation[:, None]
    tangents = curves.tangents @ np.swapaxes(rotation, -1, -2)
    depth = points[..., 2:]
    nodes = points[..., :2] / depth
    return ImageCurves(curves.arclength_m, nodes, (tangents[..., :2] - nodes * tangents[..., 2:]) / depth)


def feet(seen: SeenPoints, curves: ImageCurves) -> np.ndarray:
    """(N,) arc lengths of the points of the first curve nearest to the seen points."""
    nodes, nodes_s = curves.nodes[0], curves.arclength_m[0]
    foot = nodes_s[cKDTree(nodes).query(seen.points)[1]]
    for _ in range(_FOOT_STEPS):
        point, slope = curves.at(0, foot)
        foot = foot + ((seen.points - point) * slope).sum(axis=1) / (slope**2).sum(axis=1)
        foot = np.clip(foot, nodes_s[0], nodes_s[-1])
    return foot


def whitened_residuals(seen: SeenPoints, curves: ImageCurves) -> np.ndarray:
    """(N, K): the seen points' distances from each of K nearby curves along the first one's normal, over their std.

    All curves are compared at the arc lengths of the feet on the first, which to first order is the distance itself
    (the foot is where it is stationary). Points beyond an end of the curve get the distance from its tangent there.
    """
    return whitened_with_lens(seen, curves)[0]


def whitened_with_lens(seen: SeenPoints, curves: ImageCurves) -> tuple[np.ndarray, np.ndarray]:
    """`whitened_residuals` (N, K), and how those from the first curve move with the lens' parameters (N, P).

    P is 0 where the lens counts as exact.
    """
    foot = feet(seen, curves)
    point, slope = curves.at(0, foot)
    normal = np.stack([-slope[:, 1], slope[:, 0]], axis=1) / np.hypot(slope[:, 0], slope[:, 1])[:, None]
    unit = normal / np.sqrt(np.einsum("ni,nij,nj->n", normal, seen.covariance, normal))[:, None]
    columns = [point] + [curves.at(which, foot)[0] for which in range(1, len(curves.nodes))]
    residuals = np.stack([((seen.points - column) * unit).sum(axis=1) for column in columns], axis=1)
    if seen.by_lens is None:
        return residuals, np.zeros((len(seen), 0))
    return residuals, np.einsum("ni,nip->np", unit, seen.by_lens)


def whitened_along(end: SeenPoints, curves: ImageCurves) -> tuple[np.ndarray, np.ndarray, float]:
    """How far a seen end (one point) lies beyond the ends of K curves, along the first, over its deviation: (1, K).

    With its slopes by the parameters of the lens (1, P), and by the curve's length, per m.
    """
    tip, slope = curves.nodes[:, -1], curves.slopes[0, -1]
    stretch = float(np.hypot(*slope))
    tangent = slope / stretch
    unit = tangent / np.sqrt(tangent @ end.covariance[0] @ tangent)
    by_lens = np.zeros((1, 0)) if end.by_lens is None else unit[None] @ end.by_lens[0]
    return ((end.points[0] - tip) @ unit)[None], by_lens, -stretch * float(np.hypot(*unit))


def with_slopes_on_curve(seen: SeenPoints, camera: Camera, image: ImageCurves) -> SeenPoints:
    """The points with their slopes by the lens taken at their feet on the first predicted curve.

    Slopes taken where a point was seen carry its noise. Over thousands of points that does not average out: it rewards
    a lens that shrinks the noise, and draws it many standard deviations away.
    """
    if seen.by_lens is None:
        return seen
    on_curve = image.at(0, feet(seen, image))[0]
    slopes = camera.lens_slopes_at(on_curve)
    known = np.isfinite(slopes).all(axis=(-1, -2), keepdims=True)
    return replace(seen, by_lens=np.where(known, slopes, seen.by_lens))
