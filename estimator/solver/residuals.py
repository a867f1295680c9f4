"""Residuals of points across predicted curves, and their weighted sums over the curves' nodes."""

from __future__ import annotations

from dataclasses import dataclass

from vbaa_calib.core.arrays import Array, arange_like, namespace, take_rows

from .curves import LAST, dot, evaluate_cubics, flat_rows
from .frames import Frames
from .prediction import Prediction
from .rows import select

_EVERY, _FOOT_STEPS = 4, 2
"""A foot is searched from the nearest of every fourth node by Newton steps; later each iteration adds one."""


@dataclass(frozen=True, eq=False)
class PointResiduals:
    """How far B·N points lie off their predicted curves.

    Attributes
    ----------
    foot_m : (B, N) arc length of the nearest point of the curve.
    node, share : (B, N) the node before it, and the part of the way to the next one.
    distance : (B, N) from the curve, along its normal.
    precision : (B, N) one over the variance of that; 0 for a missing point.
    """

    foot_m: Array
    node: Array
    share: Array
    distance: Array
    precision: Array

    def subsample(self, index: Array) -> PointResiduals:
        """Some of each frame's points, by index (B, W)."""
        return select(self, (arange_like(index, len(index))[:, None], index))

    def interpolate(self, nodes: Array) -> Array:
        """Values on the nodes (B, M) at the feet (B, N)."""
        flat, row = nodes.reshape(-1, 1), flat_rows(self.node, nodes.shape[1])
        first = take_rows(flat, row).reshape(self.share.shape)
        return first + self.share * (take_rows(flat, row + 1).reshape(self.share.shape) - first)


@dataclass(frozen=True, eq=False)
class NodeSums:
    """Weighted sums of points over pairs of neighbouring nodes: a tridiagonal information matrix and its right side.

    For values c on the nodes, linear between them: Σ w c² = Σ diagonal·c² + 2 Σ off_diagonal·c·c₊₁, Σ w c·r = Σ load·c.

    Attributes
    ----------
    diagonal, load : (B, M). off_diagonal : (B, M − 1).
    """

    diagonal: Array
    off_diagonal: Array
    load: Array

    def times(self, columns: Array) -> Array:
        """The tridiagonal matrix times columns (B, M, K)."""
        result = self.diagonal[..., None] * columns
        result[:, :-1] += self.off_diagonal[..., None] * columns[:, 1:]
        result[:, 1:] += self.off_diagonal[..., None] * columns[:, :-1]
        return result


def nearest_feet(frames: Frames, prediction: Prediction) -> Array:
    """(B, N) arc lengths of the points of the curves nearest to the seen ones, searched globally."""
    xp = namespace(prediction.nodes)
    some = prediction.nodes[:, ::_EVERY]
    away_u = frames.points[..., :1] - some[:, None, :, 0]
    away_v = frames.points[..., 1:] - some[:, None, :, 1]
    nearest = xp.argmin(away_u * away_u + away_v * away_v, -1)
    foot = prediction.arclength(_EVERY * nearest + 0.0 * frames.points[..., 0])
    for _ in range(_FOOT_STEPS):
        foot = point_residuals(frames, prediction, foot).foot_m
    return foot


def residuals_along_chord(frames: Frames, prediction: Prediction) -> PointResiduals:
    """Residuals from curves that are nearly straight, such as the free antenna's: feet by the chord in perspective."""
    xp = namespace(prediction.nodes)
    start, chord = prediction.nodes[:, :1], prediction.nodes[:, -1:] - prediction.nodes[:, :1]
    near, far = prediction.depth[:, 0], prediction.depth[:, -1]
    seen = xp.clip(dot(frames.points - start, chord) / dot(chord, chord), 0.0, 1.0)
    return point_residuals(frames, prediction, seen * near / (far - (far - near) * seen) * prediction.length_m)


def point_residuals(frames: Frames, prediction: Prediction, foot_m: Array) -> PointResiduals:
    """Residuals of the frames' points, from feet (B, N) near the right ones.

    The curve is taken as its parabola at the given feet: what is left of a foot's error e then counts as e³.
    """
    xp = namespace(foot_m)
    node, share, width = prediction.locate(foot_m)
    (u, u1, u2), (v, v1, v2) = evaluate_cubics(prediction.cubics, flat_rows(node, LAST + 1), share)
    seen_u, seen_v = frames.points[..., 0] - u, frames.points[..., 1] - v
    square = u1 * u1 + v1 * v1
    ahead = (seen_u * u1 + seen_v * v1) / square
    longest = xp.clip(ahead, -1.0, 1.0)
    distance = seen_v * u1 - seen_u * v1 - 0.5 * (v2 * u1 - u2 * v1) * longest * longest
    a, b, c = frames.covariance
    variance = a * v1 * v1 - 2.0 * b * u1 * v1 + c * u1 * u1  # the normal is (−v′, u′)/√(u′² + v′²)
    foot = foot_m + ahead * width
    # a prediction that left the domain of the model is rejected by its cost, not here
    foot = xp.clip(xp.nan_to_num(foot, nan=0.0), 0.0, prediction.length_m)
    return PointResiduals(foot, node, share, distance / xp.sqrt(square), frames.usable * square / variance)


def node_sums(points: PointResiduals, weights: Array, residuals: Array, count: int) -> NodeSums:
    """Sums over the intervals between `count` nodes, for weights and residuals (B, N)."""
    xp = namespace(weights)
    batch = len(weights)
    row, share, size = flat_rows(points.node, count), points.share, batch * count

    def added(values: Array) -> Array:
        return xp.bincount(row, values.reshape(-1), size).reshape(batch, count)

    weighted = weights * share
    plain, first, second = added(weights), added(weighted), added(weighted * share)
    pulled = weights * residuals
    load, load_first = added(pulled), added(pulled * share)
    # an interval's sums belong to the node before it, in part to the one after
    diagonal = plain - 2.0 * first + second
    diagonal[:, 1:] += second[:, :-1]
    loads = load - load_first
    loads[:, 1:] += load_first[:, :-1]
    return NodeSums(diagonal, (first - second)[:, :-1], loads)
