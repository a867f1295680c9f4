"""How far the antenna's seen points lie from a predicted curve, in whitened units along the curve's normal.

Pixels are undistorted once per frame, with their covariance; every comparison after that is a pinhole's, whatever the
lens.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vbaa_calib.antenna.shape import Curves
from vbaa_calib.camera import Camera
from vbaa_calib.core.arrays import Rows
from vbaa_calib.core.compiled import kernel
from vbaa_calib.geometry import Pose

_FOOT_STEPS = 2
"""Newton steps from the nearest node to the foot: each squares an error of a few hundredths of the nodes' spacing."""


@dataclass(frozen=True, eq=False)
class SeenPoints(Rows):
    """The antenna's points (N, 2) of one picture, normalized (on the plane one unit before the camera).

    covariance : (N, 2, 2) of each point, from its standard deviation across the antenna in pixels.
    by_lens : (N, 2, P) how the points move with the P parameters of the lens; None where the lens counts as exact.
    """

    points: np.ndarray
    covariance: np.ndarray
    by_lens: np.ndarray | None = None

    def with_lens_moved(self, step: np.ndarray) -> SeenPoints:
        """The same pixels through a lens whose parameters are a small step (P,) away."""
        return self if self.by_lens is None else replace(self, points=self.points + self.by_lens @ step)


@dataclass(frozen=True, eq=False)
class ImageCurves(Rows):
    """K predicted curves of one frame: nodes (K, M, 2) in normalized coordinates, slopes by arc length, s (K, M)."""

    arclength_m: np.ndarray
    nodes: np.ndarray
    slopes: np.ndarray

    def at(self, which: int, arclength_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Points and derivatives (N, 2) of one curve at arc lengths (N,), by cubic Hermite between the nodes."""
        return _interpolated(arclength_m, self.arclength_m[which], self.nodes[which], self.slopes[which])


def see(camera: Camera, points_px: np.ndarray, sigma_px: np.ndarray, with_lens: bool = False) -> SeenPoints:
    """Undistort (N, 2) pixels with standard deviations (N,); points where the lens has no inverse are left out.

    Their dependence on the lens comes with them where asked for, or where the camera knows its own covariance.
    """
    return see_each(camera, [(points_px, sigma_px)], with_lens)[0]


def see_each(
    camera: Camera, pictures: Sequence[tuple[np.ndarray, np.ndarray]], with_lens: bool = False
) -> list[SeenPoints]:
    """`see` of several pictures' points and deviations."""
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
    """Project B curves, through one camera pose, or through several in turn."""
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
    return ImageCurves(curves.arclength_m, nodes, (tangents[..., :2] - nodes * tangents[..., 2:]) / depth)


def feet(seen: SeenPoints, curves: ImageCurves) -> np.ndarray:
    """(N,) arc lengths of the points of the first curve nearest to the seen points."""
    return _feet(seen.points, curves.arclength_m[0], curves.nodes[0], curves.slopes[0])


def whitened_residuals(seen: SeenPoints, curves: ImageCurves) -> np.ndarray:
    """(N, K): the seen points' distances from each of K nearby curves along the first one's normal, over their std.

    All curves are compared at the arc lengths of the feet on the first, which to first order is the distance itself
    (the foot is where it is stationary). Points beyond an end of the curve get the distance from its tangent there.
    """
    return _whitened(seen.points, seen.covariance, curves.arclength_m, curves.nodes, curves.slopes)[0]


def whitened_with_lens(seen: SeenPoints, curves: ImageCurves) -> tuple[np.ndarray, np.ndarray]:
    """`whitened_residuals` (N, K), and how those from the first curve move with the lens' parameters (N, P).

    P is 0 where the lens counts as exact.
    """
    residuals, unit = _whitened(seen.points, seen.covariance, curves.arclength_m, curves.nodes, curves.slopes)
    if seen.by_lens is None:
        return residuals, np.zeros((len(seen), 0))
    return residuals, (unit[:, None] @ seen.by_lens)[:, 0]


@kernel
def _whitened(
    seen: np.ndarray, covariance: np.ndarray, nodes_s: np.ndarray, nodes: np.ndarray, slopes: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """`whitened_residuals`, and the normals (N, 2) at the feet over the deviations along them."""
    foot = _feet(seen, nodes_s[0], nodes[0], slopes[0])
    _, along = _interpolated(foot, nodes_s[0], nodes[0], slopes[0])
    units, residuals = np.empty((len(seen), 2)), np.empty((len(seen), len(nodes)))
    for n in range(len(seen)):
        x, y = along[n]
        own = covariance[n]
        deviation = np.sqrt(own[0, 0] * y**2 - (own[0, 1] + own[1, 0]) * x * y + own[1, 1] * x**2)
        units[n, 0], units[n, 1] = -y / deviation, x / deviation
    for k in range(len(nodes)):
        points, _ = _interpolated(foot, nodes_s[k], nodes[k], slopes[k])
        for n in range(len(seen)):
            off_x, off_y = seen[n, 0] - points[n, 0], seen[n, 1] - points[n, 1]
            residuals[n, k] = off_x * units[n, 0] + off_y * units[n, 1]
    return residuals, units


@kernel
def _feet(seen: np.ndarray, nodes_s: np.ndarray, nodes: np.ndarray, slopes: np.ndarray) -> np.ndarray:
    """`feet` on a curve with nodes (M, 2) at arc lengths (M,) and slopes (M, 2)."""
    found = np.empty(len(seen))
    for n in range(len(seen)):
        u, v = seen[n]
        nearest, least = 0, np.inf
        for i in range(len(nodes)):
            square = (nodes[i, 0] - u) ** 2 + (nodes[i, 1] - v) ** 2
            if square < least:
                nearest, least = i, square
        s = nodes_s[nearest]
        for _ in range(_FOOT_STEPS):
            x, y, along_x, along_y = _on_curve(s, nodes_s, nodes, slopes)
            s += ((u - x) * along_x + (v - y) * along_y) / (along_x**2 + along_y**2)
            s = min(max(s, nodes_s[0]), nodes_s[-1])
        found[n] = s
    return found


@kernel
def _interpolated(
    arclength_m: np.ndarray, nodes_s: np.ndarray, nodes: np.ndarray, slopes: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    points, along = np.empty((len(arclength_m), 2)), np.empty((len(arclength_m), 2))
    for n, s in enumerate(arclength_m):
        points[n, 0], points[n, 1], along[n, 0], along[n, 1] = _on_curve(s, nodes_s, nodes, slopes)
    return points, along


@kernel
def _on_curve(
    s: float, nodes_s: np.ndarray, nodes: np.ndarray, slopes: np.ndarray
) -> tuple[float, float, float, float]:
    """Point and derivative of a curve at an arc length, by cubic Hermite between the nodes."""
    left = min(max(int(np.searchsorted(nodes_s, s, side="right")) - 1, 0), len(nodes_s) - 2)
    span = nodes_s[left + 1] - nodes_s[left]
    t = (s - nodes_s[left]) / span
    x, along_x = _hermite(t, nodes[left, 0], nodes[left + 1, 0], span * slopes[left, 0], span * slopes[left + 1, 0])
    y, along_y = _hermite(t, nodes[left, 1], nodes[left + 1, 1], span * slopes[left, 1], span * slopes[left + 1, 1])
    return x, y, along_x / span, along_y / span


@kernel
def _hermite(t: float, p0: float, p1: float, d0: float, d1: float) -> tuple[float, float]:
    a, b = 2.0 * (p0 - p1) + d0 + d1, 3.0 * (p1 - p0) - 2.0 * d0 - d1
    return ((a * t + b) * t + d0) * t + p0, (3.0 * a * t + 2.0 * b) * t + d0


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


def with_slopes_on_curves(seen: Sequence[SeenPoints], camera: Camera, images: ImageCurves) -> list[SeenPoints]:
    """The points of F pictures with their slopes by the lens taken at their feet on F predicted curves.

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
    """With slopes by the lens (N, 2, P) where those are known."""
    assert seen.by_lens is not None
    known = np.isfinite(slopes).all(axis=(-1, -2), keepdims=True)
    return replace(seen, by_lens=np.where(known, slopes, seen.by_lens))
