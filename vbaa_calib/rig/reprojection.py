"""Whitened distances of the antenna's detected points from a predicted curve, along the curve's normal.

Pixels are undistorted once per frame, with their covariance; after that every comparison is a pinhole camera's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vbaa_calib.antenna.shape import Curves
from vbaa_calib.camera import Camera
from vbaa_calib.core.arrays import Rows
from vbaa_calib.geometry import Pose
from vbaa_calib.native import core


@dataclass(frozen=True, eq=False)
class SeenPoints(Rows):
    """The antenna's detected points (N, 2) in one picture, normalized (on the plane one unit before the camera).

    covariance : (N, 2, 2) of each point, from its standard deviation across the antenna in pixels.
    by_lens : (N, 2, P) how the points move with the P parameters of the lens; None where the lens counts as exact.
    """

    points: np.ndarray
    covariance: np.ndarray
    by_lens: np.ndarray | None = None

    def with_lens_moved(self, step: np.ndarray) -> SeenPoints:
        """The same pixels through a lens with its parameters changed by a small step (P,)."""
        return self if self.by_lens is None else replace(self, points=self.points + self.by_lens @ step)


@dataclass(frozen=True, eq=False)
class ImageCurves(Rows):
    """K predicted curves of one frame: nodes (K, M, 2) in normalized coordinates, their derivatives by arc length,
    arc lengths (K, M)."""

    arclength_m: np.ndarray
    nodes: np.ndarray
    slopes: np.ndarray

    def at(self, which: int, arclength_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Points and derivatives (N, 2) of one curve at arc lengths (N,), by cubic Hermite between the nodes."""
        points, along = core.lens.interpolate(*self._arrays_from(which), np.array(arclength_m, float))
        return points, along

    def _arrays_from(self, first: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Arc lengths, nodes and derivatives of the curves from `first` on, for the core."""
        s, nodes, slopes = (np.ascontiguousarray(each[first:], float) for each in vars(self).values())
        return s, nodes, slopes


def see(camera: Camera, points_px: np.ndarray, sigma_px: np.ndarray, with_lens: bool = False) -> SeenPoints:
    """Undistorted points of (N, 2) pixels with standard deviations (N,), without those at which the lens has no
    inverse.

    Their dependence on the lens comes with them where asked for, or where the camera knows its own covariance.
    """
    return see_each(camera, [(points_px, sigma_px)], with_lens)[0]


def see_each(
    camera: Camera, pictures: Sequence[tuple[np.ndarray, np.ndarray]], with_lens: bool = False
) -> list[SeenPoints]:
    """`see` for the points of several pictures."""
    if not pictures:
        return []
    points_px, sigma_px = zip(*pictures, strict=True)
    points, jacobian, valid = camera.normalized_with_slopes(np.concatenate(points_px))
    covariance = np.concatenate(sigma_px)[:, None, None] ** 2 * jacobian @ np.swapaxes(jacobian, -1, -2)
    valid &= np.isfinite(covariance).all(axis=(-1, -2))
    by_lens = camera.lens_slopes_at(points) if with_lens or camera.covariance is not None else None
    every, ends = SeenPoints(points, covariance, by_lens), np.cumsum([len(own) for own in points_px])
    return [every.picked(which[valid[which]]) for which in np.split(np.arange(len(points)), ends[:-1])]


def image_curves(curves: Curves, T_camera_antenna: Sequence[Pose] | Pose) -> ImageCurves:
    """Projections of B curves through one camera pose, or each through its own.

    Of a round antenna the middle between its edges is seen. These are tangent to rays from the camera, so that it lies
    off the axis by the square of radius over distance, where the plane through camera and tangent is off the optical
    axis.
    """
    if isinstance(T_camera_antenna, Pose):
        rotation, translation = T_camera_antenna.rotation[None], T_camera_antenna.translation_m[None]
    else:
        turns = len(curves.points_m) // len(T_camera_antenna)
        rotation = np.tile([pose.rotation for pose in T_camera_antenna], (turns, 1, 1))
        translation = np.tile([pose.translation_m for pose in T_camera_antenna], (turns, 1))
    points = curves.points_m @ np.swapaxes(rotation, -1, -2) + translation[:, None]
    tangents = curves.tangents @ np.swapaxes(rotation, -1, -2)
    depth = points[..., 2:]
    nodes = points[..., :2] / depth
    slopes = (tangents[..., :2] - nodes * tangents[..., 2:]) / depth
    if curves.radius_m is not None:
        # of the plane through tangent and camera: (slope, 0) × (node, 1)
        across = np.stack([slopes[..., 1], -slopes[..., 0]], axis=-1)
        ahead = slopes[..., :1] * nodes[..., 1:] - slopes[..., 1:] * nodes[..., :1]
        size = np.sqrt(across[..., :1] ** 2 + across[..., 1:] ** 2 + ahead**2)
        with np.errstate(invalid="ignore"):  # where the antenna points at the camera
            across, ahead = across / size, ahead / size
        off = (curves.radius_m[..., None] / depth) ** 2 * ahead
        nodes = nodes + off * (nodes * ahead - across)
    return ImageCurves(curves.arclength_m, nodes, slopes)


def feet(seen: SeenPoints, curves: ImageCurves) -> np.ndarray:
    """(N,) arc lengths on the first curve nearest to the detected points."""
    found: np.ndarray = core.lens.feet(*curves._arrays_from(), seen.points)
    return found


def whitened_residuals(seen: SeenPoints, curves: ImageCurves) -> np.ndarray:
    """(N, K) distances of the detected points from each of K nearby curves along the first one's normal, over their
    standard deviations.

    All curves are compared at the arc lengths of the feet on the first, which to first order is the distance itself
    (the foot is where it is stationary). Points beyond an end of the curve get the distance from its tangent there.
    """
    return _whitened(seen, curves)[0]


def _whitened(seen: SeenPoints, curves: ImageCurves) -> tuple[np.ndarray, np.ndarray]:
    """`whitened_residuals`, and the normals (N, 2) at the feet divided by the standard deviations along them."""
    points, covariance = (np.ascontiguousarray(each, float) for each in (seen.points, seen.covariance))
    residuals, normals = core.lens.whitened(*curves._arrays_from(), points, covariance)
    return residuals, normals


def whitened_with_lens(seen: SeenPoints, curves: ImageCurves) -> tuple[np.ndarray, np.ndarray]:
    """`whitened_residuals` (N, K), and the derivatives (N, P) of those from the first curve by the lens's
    parameters.

    P is 0 where the lens counts as exact.
    """
    residuals, unit = _whitened(seen, curves)
    if seen.by_lens is None:
        return residuals, np.zeros((len(seen), 0))
    return residuals, (unit[:, None] @ seen.by_lens)[:, 0]


def whitened_along(end: SeenPoints, curves: ImageCurves) -> tuple[np.ndarray, np.ndarray, float]:
    """(1, K) distance of a detected end (one point) beyond the ends of K curves, along the first, over its standard
    deviation.

    With its slopes by the parameters of the lens (1, P), and by the curve's length, per m.
    """
    tip, slope = curves.nodes[:, -1], curves.slopes[0, -1]
    stretch = float(np.hypot(*slope))
    tangent = slope / stretch
    unit = tangent / np.sqrt(tangent @ end.covariance[0] @ tangent)
    by_lens = np.zeros((1, 0)) if end.by_lens is None else unit[None] @ end.by_lens[0]
    return ((end.points[0] - tip) @ unit)[None], by_lens, -stretch * float(np.hypot(*unit))


def with_slopes_on_curves(seen: Sequence[SeenPoints], camera: Camera, images: ImageCurves) -> list[SeenPoints]:
    """The points of F pictures with their derivatives by the lens evaluated at their feet on F predicted curves.

    Slopes taken where a point was seen carry its noise. Over thousands of points that does not average out: it rewards
    a lens that shrinks the noise, and draws it many standard deviations away.
    """
    if not seen or seen[0].by_lens is None:
        return list(seen)
    own = [images.picked(slice(index, index + 1)) for index in range(len(seen))]
    on_curve = [image.at(0, feet(one, image))[0] for one, image in zip(seen, own, strict=True)]
    every = np.split(camera.lens_slopes_at(np.concatenate(on_curve)), np.cumsum([len(one) for one in seen])[:-1])
    return [_with_slopes(one, slopes) for one, slopes in zip(seen, every, strict=True)]


def _with_slopes(seen: SeenPoints, slopes: np.ndarray) -> SeenPoints:
    """The points with derivatives (N, 2, P) by the lens, unchanged where these are not finite."""
    assert seen.by_lens is not None
    known = np.isfinite(slopes).all(axis=(-1, -2), keepdims=True)
    return replace(seen, by_lens=np.where(known, slopes, seen.by_lens))
