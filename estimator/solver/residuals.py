"""Seen points held against predicted curves, and their sums over the curves' nodes.

Along a curve everything is measured in nodes: q = 3.4 is four tenths of the way from node 3 to node 4.
"""

from __future__ import annotations

from dataclasses import dataclass

from vbaa_calib.core.arrays import Array, as_index, counted, namespace, taken

from .curves import INNER, LAST, cubic, dot, spacing
from .frames import Frames
from .prediction import View

EVERY, FOOT_STEPS = 4, 2
"""A foot is looked for from the nearest of every fourth node, by Newton's steps; later each iteration adds one."""


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

    def picked(self, which: Array) -> Match:
        """Some of the frames, by index or mask."""
        return Match(*(values[which] for values in vars(self).values()))

    def thinned(self, places: Array) -> Match:
        """Some of each frame's points, by their places (B, W)."""
        rows = counted(places, len(places))[:, None]
        return self.picked((rows, places))

    def between(self, nodes: Array) -> Array:
        """Values on the nodes (B, M) at the feet (B, N)."""
        flat, row = nodes.reshape(-1, 1), rows(self.left, nodes.shape[1])
        first = taken(flat, row).reshape(self.share.shape)
        return first + self.share * (taken(flat, row + 1).reshape(self.share.shape) - first)


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
    foot = arclength(view, EVERY * nearest + 0.0 * frames.points[..., 0])
    for _ in range(FOOT_STEPS):
        foot = match(frames, view, foot).foot_m
    return foot


def along_chord(frames: Frames, view: View) -> Match:
    """Hold the points against curves that are nearly straight, such as the free antenna's.

    Feet are then near where points lie along the straight line from clamp to tip, seen in perspective.
    """
    xp = namespace(view.nodes)
    start, chord = view.nodes[:, :1], view.nodes[:, -1:] - view.nodes[:, :1]
    near, far = view.depth[:, 0], view.depth[:, -1]
    seen = xp.clip(dot(frames.points - start, chord) / dot(chord, chord), 0.0, 1.0)
    return match(frames, view, seen * near / (far - (far - near) * seen) * view.length_m)


def match(frames: Frames, view: View, foot_m: Array) -> Match:
    """Hold the frames' points against a view, from feet (B, N) near the right ones.

    The curve is taken as its parabola at the given feet: what is left of a foot's error e then counts as e³.
    """
    xp = namespace(foot_m)
    left, share, width = between_nodes(view, foot_m)
    (u, u1, u2), (v, v1, v2) = cubic(view.cubics, rows(left, LAST + 1), share)
    seen_u, seen_v = frames.points[..., 0] - u, frames.points[..., 1] - v
    square = u1 * u1 + v1 * v1
    ahead = (seen_u * u1 + seen_v * v1) / square
    longest = xp.clip(ahead, -1.0, 1.0)
    distance = seen_v * u1 - seen_u * v1 - 0.5 * (v2 * u1 - u2 * v1) * longest * longest
    a, b, c = frames.covariance
    # the normal is (−v′, u′)/√(u′² + v′²)
    variance = a * v1 * v1 - 2.0 * b * u1 * v1 + c * u1 * u1
    foot = foot_m + ahead * width
    # a view that left the domain of the model is rejected by its cost, not here
    foot = xp.clip(xp.nan_to_num(foot, nan=0.0), 0.0, view.length_m)
    return Match(foot, left, share, distance / xp.sqrt(square), frames.usable * square / variance)


def sums(found: Match, weights: Array, residuals: Array, count: int) -> Sums:
    """Sums over the intervals between `count` nodes, for weights and residuals (B, N)."""
    xp = namespace(weights)
    batch = len(weights)
    row, share, size = rows(found.left, count), found.share, batch * count

    def added(values: Array) -> Array:
        return xp.bincount(row, values.reshape(-1), size).reshape(batch, count)

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


def between_nodes(view: View, foot_m: Array) -> tuple[Array, Array, Array]:
    """The node before each arc length (B, N), the part of the way to the next one, and the interval's width.

    Nodes are equally spaced on either side of the contact.
    """
    xp = namespace(foot_m)
    contact, inner, outer = spacing(view.contact_m, view.length_m)
    beyond = xp.clip(foot_m - contact, 0.0, None)
    along = (foot_m - beyond) / inner + beyond / outer
    node = xp.floor(xp.clip(xp.nan_to_num(along, nan=0.0), 0.0, LAST - 1e-6))
    width = inner + (outer - inner) * xp.clip(node - (INNER - 1.0), 0.0, 1.0)
    return as_index(node), along - node, width


def rows(node: Array, count: int) -> Array:
    """(B·N,) places of nodes (B, N) in arrays (B·count, ...)."""
    xp = namespace(node)
    return (node + (count * xp.cumsum(xp.ones_like(node[:, :1]), 0) - count)).reshape(-1)


def arclength(view: View, node: Array) -> Array:
    """Arc lengths (B, N) in m of places given in nodes."""
    _, inner, outer = spacing(view.contact_m, view.length_m)
    past = namespace(node).clip(node - INNER, 0.0, None)
    return (node - past) * inner + past * outer
