"""Seen points held against predicted curves, and their sums over the curves' nodes."""

from __future__ import annotations

from dataclasses import dataclass

from vbaa_calib.antenna.nodes import NODES_BEYOND, NODES_TO_CONTACT
from vbaa_calib.arrays import Array, as_index, namespace

from .frames import Frames
from .view import View, dot

EVERY, FOOT_STEPS = 4, 2
"""A foot is looked for from the nearest of every fourth node, by Newton's steps; later each iteration adds one."""
INNER = NODES_TO_CONTACT - 1


@dataclass(frozen=True, eq=False)
class Match:
    """Where B·N seen points lie on, and off, their predicted curves.

    Attributes
    ----------
    foot_m : (B, N) arc length of the nearest point of the curve.
    left, share : (B, N) the node before it, and the part of the way to the next one.
    distance : (B, N) from the curve, along its normal.
    precision : (B, N) one over the variance of that; 0 for a missing point.
    """

    foot_m: Array
    left: Array
    share: Array
    distance: Array
    precision: Array

    def between(self, nodes: Array) -> Array:
        """Values on the nodes (B, M) at the feet (B, N)."""
        first = rows(nodes[..., None], self.left)[..., 0]
        return first + self.share * (rows(nodes[..., None], self.left + 1)[..., 0] - first)


@dataclass(frozen=True, eq=False)
class Sums:
    """Weighted sums of points over pairs of neighbouring nodes.

    For values c on the nodes, linear between them, Σ w c² = Σ diagonal·c² + 2 Σ beside·c·c₊₁, and Σ w c·r = Σ load·c.

    Attributes
    ----------
    diagonal, load : (B, M). beside : (B, M − 1).
    """

    diagonal: Array
    beside: Array
    load: Array

    def times(self, columns: Array) -> Array:
        """The tridiagonal matrix times columns (B, M, K)."""
        result = self.diagonal[..., None] * columns
        result[:, :-1] += self.beside[..., None] * columns[:, 1:]
        result[:, 1:] += self.beside[..., None] * columns[:, :-1]
        return result


def nearest_feet(frames: Frames, view: View) -> Array:
    """(B, N) arc lengths of the points of the curves nearest to the seen ones, from nothing."""
    xp = namespace(view.nodes)
    some = view.nodes[:, ::EVERY]
    away_u = frames.points[..., :1] - some[:, None, :, 0]
    away_v = frames.points[..., 1:] - some[:, None, :, 1]
    nearest = xp.argmin(away_u * away_u + away_v * away_v, -1)
    foot = node_arclength(view, EVERY * nearest)
    for _ in range(FOOT_STEPS):
        foot = _better(frames, view, foot)
    return foot


def match(frames: Frames, view: View, foot_m: Array) -> Match:
    """Hold the frames' points against a view, from feet (B, N) near the right ones."""
    xp = namespace(foot_m)
    foot = _better(frames, view, foot_m)
    left, share, width = interval(view, foot)
    point, slope = hermite(view.nodes, view.slopes, left, share, width)
    normal = _unit_normal(slope)
    away = frames.points - point
    distance = dot(away, normal)
    u, v = normal[..., 0], normal[..., 1]
    spread = frames.covariance
    variance = spread[..., 0] * u * u + 2.0 * spread[..., 1] * u * v + spread[..., 2] * v * v
    precision = xp.where(frames.usable, 1.0 / variance, xp.zeros_like(variance))
    return Match(foot, left, share, distance, precision)


def sums(found: Match, weights: Array, residuals: Array, count: int) -> Sums:
    """Sums over the intervals between `count` nodes, for weights and residuals (B, N)."""
    xp = namespace(weights)
    batch = len(weights)
    index = (found.left + _row_starts(found.left, count)).reshape(-1)
    share, size = found.share, batch * count

    def added(values: Array) -> Array:
        return xp.bincount(index, values.reshape(-1), size).reshape(batch, count)

    weighted = weights * share
    plain, first, second = added(weights), added(weighted), added(weighted * share)
    pulled = weights * residuals
    load, load_first = added(pulled), added(pulled * share)
    # every interval's sums belong to the node before it, in part to the one after
    diagonal = plain - 2.0 * first + second
    diagonal[:, 1:] += second[:, :-1]
    loads = load - load_first
    loads[:, 1:] += load_first[:, :-1]
    return Sums(diagonal, (first - second)[:, :-1], loads)


def rows(values: Array, index: Array) -> Array:
    """(B, N, C): rows of values (B, M, C) by index (B, N)."""
    batch, count, width = values.shape
    return values.reshape(batch * count, width)[index + _row_starts(index, count)]


def _row_starts(index: Array, count: int) -> Array:
    xp = namespace(index)
    return xp.cumsum(xp.ones_like(index[:, :1]), 0) * count - count


def _better(frames: Frames, view: View, foot: Array) -> Array:
    """Feet (B, N) after one of Newton's steps, on the curve."""
    left, share, width = interval(view, foot)
    point, slope = hermite(view.nodes, view.slopes, left, share, width)
    ahead = dot(frames.points - point, slope) / dot(slope, slope)
    xp = namespace(foot)
    better = foot + ahead
    # a view that left the domain of the model is rejected by its cost, not here
    return xp.clip(xp.where(xp.isfinite(better), better, xp.zeros_like(foot)), 0.0, view.length_m)


def interval(view: View, foot: Array) -> tuple[Array, Array, Array]:
    """Node before each foot (B, N), the part of the way to the next, and the interval's width: nodes are equally
    spaced on either side of the contact."""
    xp = namespace(foot)
    contact = view.contact_m[:, None]
    inner, outer = contact / INNER, xp.clip(view.length_m - contact, 1e-6 * view.length_m, None) / NODES_BEYOND
    before = foot < contact
    width = xp.where(before, inner, outer)
    along = xp.where(before, foot, foot - contact) / width
    last = xp.where(before, xp.full_like(foot, INNER - 1.0), xp.full_like(foot, NODES_BEYOND - 1.0))
    node = xp.minimum(xp.floor(along), last)
    index = xp.clip(xp.where(before, node, node + INNER), 0.0, INNER + NODES_BEYOND - 1.0)
    return as_index(xp.where(xp.isfinite(index), index, xp.zeros_like(index))), along - node, width


def node_arclength(view: View, node: Array) -> Array:
    """Arc lengths (B, N) of nodes."""
    xp = namespace(view.nodes)
    contact = view.contact_m[:, None]
    past = xp.clip(node - INNER, 0, None)
    return (node - past) * (contact / INNER) + past * ((view.length_m - contact) / NODES_BEYOND)


def hermite(values: Array, slopes: Array, left: Array, share: Array, width: Array) -> tuple[Array, Array]:
    """Values (B, M, C) and slopes by arc length on the nodes, cubic between them: both at (B, N)."""
    xp, size = namespace(share), values.shape[-1]
    both = xp.concat([values, slopes], -1)
    before, after = rows(both, left), rows(both, left + 1)
    t, width = share[..., None], width[..., None]
    p0, d0, p1, d1 = before[..., :size], before[..., size:] * width, after[..., :size], after[..., size:] * width
    gap = p0 - p1
    a, b = 2.0 * gap + d0 + d1, -3.0 * gap - 2.0 * d0 - d1
    return ((a * t + b) * t + d0) * t + p0, ((3.0 * a * t + 2.0 * b) * t + d0) / width


def _unit_normal(slope: Array) -> Array:
    xp = namespace(slope)
    normal = xp.stack([-slope[..., 1], slope[..., 0]], -1)
    return normal / xp.hypot(slope[..., 0], slope[..., 1])[..., None]
