"""Figures of the contacts together: maps, forces across the antenna, friction cone (paper, Fig. 5), indentation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes

from viz.scene.readable import enlargement, thinned

from .drawing import (
    AMBER,
    INK,
    SLATE,
    SOFT,
    TEAL,
    band,
    bars,
    dots,
    dots_by_time,
    ellipses,
    legend,
    limits,
    new_axes,
    paths,
    style,
    time_colours,
)

VIEWS = (("from above", 0, 1), ("from the side, along y", 0, 2), ("from the side, along x", 1, 2))
"""Name, and which world axes run to the right and up."""
MOST_ELLIPSES, MOST_POINTS, MOST_TRIANGLES = 300, 1500, 3000
SIDE_PX, SEEN_PX = 276.0, 5.0
"""Ellipses whose usual radius is smaller than `SEEN_PX` are drawn larger, and the key says how much."""
OBJECT = SLATE
SLIDING, STICKING, UNUSED = "#0072b2", "#c2410c", "#94a3b8"
STEEP = 1.5
"""A bound on μ beyond this is not worth the room to draw it."""
_SIZE = (480.0, 440.0)


@dataclass(frozen=True, eq=False)
class MapData:
    """What a map shows, world frame.

    Attributes
    ----------
    points_m : (P, 3) contacts on the antenna's centreline. covariance_m2 : (P, 3, 3), NaN where it is not known.
    time_s : (P,) of each.
    surface_m : (V, 3) of the reconstructed object; lines (E, 2) and triangles (T, 3) into it.
    truth_m : (Q, 3) true contact points; Q is 0 where they are not known.
    """

    points_m: np.ndarray
    covariance_m2: np.ndarray
    time_s: np.ndarray
    surface_m: np.ndarray
    lines: np.ndarray
    triangles: np.ndarray
    truth_m: np.ndarray

    @property
    def ends_mm(self) -> np.ndarray:
        """(3, 2) limits of each world axis, all equally long."""
        shown = 1e3 * np.concatenate([self.points_m, self.truth_m])
        middle, half = 0.5 * (shown.min(axis=0) + shown.max(axis=0)), 0.56 * float(np.ptp(shown, axis=0).max())
        return middle[:, None] + max(half, 1.12) * np.array([-1.0, 1.0])

    @property
    def enlargement(self) -> int:
        """How many times larger ellipses are drawn, so that the usual one can be seen; 1 where it can."""
        pixels_per_m = 1e3 * SIDE_PX / float(np.ptp(self.ends_mm[0]))
        return enlargement(2 * pixels_per_m * np.sqrt(np.trace(self.covariance_m2, axis1=1, axis2=2)), SEEN_PX)


@style
def contact_map(data: MapData, view: tuple[str, int, int]) -> Axes:
    """One of `VIEWS` of the contacts with their ellipses, the object and the truth, in millimetres."""
    name, *pair = view
    x, y = data.ends_mm[pair]
    labels = (f"{'XYZ'[pair[0]]}, mm", f"{'XYZ'[pair[1]]}, mm")
    axes = new_axes(name, (SIDE_PX + 74, SIDE_PX + 80), (62, 12, 34, 46), tuple(x), tuple(y), labels)
    object_mm = 1e3 * data.surface_m[:, pair]
    triangles = object_mm[thinned(data.triangles, MOST_TRIANGLES)]
    a, b = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    # all turn one way: together they fill their union
    triangles = np.where((a[:, 0] * b[:, 1] < a[:, 1] * b[:, 0])[:, None, None], triangles[:, ::-1], triangles)
    paths(axes, triangles, closed=True, fc=OBJECT, ec="none", alpha=0.25, label="object")
    paths(axes, object_mm[data.lines[:MOST_TRIANGLES]], ec=OBJECT, lw=1.6, label="object")
    truth = 1e3 * thinned(data.truth_m, MOST_POINTS)[:, pair]
    arm = 2 * float(np.ptp(x)) / SIDE_PX
    for diagonal in ([1, 1], [1, -1]):
        crosses = truth[:, None] + arm * np.array([[-1], [1]]) * diagonal
        paths(axes, crosses, ec="#111827", lw=0.8, label="truth")
    known = thinned(np.flatnonzero(np.isfinite(data.covariance_m2).all(axis=(1, 2))), MOST_ELLIPSES)
    blocks = 1e6 * data.enlargement**2 * data.covariance_m2[known][:, pair][:, :, pair]
    ellipses(axes, 1e3 * data.points_m[known][:, pair], blocks, time_colours(data.time_s)[known])
    shown = thinned(np.arange(len(data.points_m)), MOST_POINTS)
    dots_by_time(axes, 1e3 * data.points_m[shown][:, pair], data.time_s[shown])
    return axes


@style
def forces_across(force_mN: np.ndarray, std_mN: np.ndarray, time_s: np.ndarray) -> Axes:
    """f_z over f_y, each contact an arrow's head from the origin (paper, Fig. 5).

    Parameters
    ----------
    force_mN, std_mN : (P, 2) y and z in the antenna frame; std NaN where it is not known. time_s : (P,).
    """
    reach = 1.12 * max(float(np.abs(force_mN).max(initial=0.0)), 1e-6)
    ends = (-reach, reach)
    axes = new_axes("force across the antenna", _SIZE, (90, 68, 70, 48), ends, ends, ("f_y, mN", "f_z, mN"))
    axes.axhline(0, color=SOFT, lw=1)
    axes.axvline(0, color=SOFT, lw=1)
    shown = thinned(np.arange(len(force_mN)), MOST_POINTS)
    if len(shown) <= MOST_ELLIPSES:
        tips = force_mN[shown]
        paths(axes, np.stack([0 * tips, tips], axis=1), ec=SOFT, lw=0.4, label="arrows")
    known = thinned(shown[np.isfinite(std_mN[shown]).all(axis=1)], MOST_ELLIPSES)
    ellipses(axes, force_mN[known], std_mN[known, :, None] ** 2 * np.eye(2), time_colours(time_s)[known])
    dots_by_time(axes, force_mN[shown], time_s[shown])
    dots(axes, np.zeros(1), np.zeros(1), INK)
    return axes


@dataclass(frozen=True, eq=False)
class ConeData:
    """Forces in the friction cone.

    Attributes
    ----------
    normal_N, tangential_N, tangential_std_N : (P,) parts of the force along the object's normal and across antenna and
        normal, signed.
    used_as : (P,) "sliding", "sticking" or anything else for what said nothing of μ.
    mu : coefficient of friction, NaN where it is undetermined.
    interval : of 95 %; without μ the bounds that there are, 0 and inf for none.
    true_mu : NaN where it is not known.
    """

    normal_N: np.ndarray
    tangential_N: np.ndarray
    tangential_std_N: np.ndarray
    used_as: np.ndarray
    mu: float
    interval: tuple[float, float]
    true_mu: float = np.nan


@style
def friction_cone(data: ConeData) -> Axes:
    """Tangential over normal force of every contact, within the cone tan α = μ."""
    normal, tangential, std = (1e3 * x for x in (data.normal_N, data.tangential_N, data.tangential_std_N))
    known = np.isfinite(normal) & np.isfinite(tangential)
    furthest = 1.08 * max(float(normal[known].max(initial=0.0)), 1e-6)
    slope = max((m for m in (data.mu, *data.interval, data.true_mu) if m < STEEP), default=0.0)
    reach = 1.15 * max(float(np.abs(tangential[known]).max(initial=0.0)), 1.02 * slope * furthest, 0.05 * furthest)
    labels = ("force along the object's normal, mN", "force across it and the antenna, mN")
    axes = new_axes("friction cone", _SIZE, (70, 14, 52, 48), (0.0, furthest), (-reach, reach), labels)
    entries = _cone_lines(axes, data)
    axes.axhline(0, color=SOFT, lw=1)
    shown = thinned(np.flatnonzero(known), MOST_POINTS)
    kinds = np.where(np.isin(data.used_as[shown], ("sliding", "sticking")), data.used_as[shown], "neither")
    marks = []
    for kind, words, colour, mark in (
        ("neither", "neither", UNUSED, "dot"),
        ("sticking", "sticks, or undecided", STICKING, "ring"),
        ("sliding", "slides", SLIDING, "dot"),
    ):
        index = shown[kinds == kind]
        if len(index):
            _std_bars(axes, normal[index], tangential[index], std[index], colour)
            dots(axes, normal[index], tangential[index], colour)
            if mark == "ring":
                dots(axes, normal[index], tangential[index], "white", 2.6)
            marks.append((colour, words, mark))
    legend(axes, [*marks, *entries])
    return axes


def _cone_lines(axes: Axes, data: ConeData) -> list[tuple[str, str, str]]:
    """The cone or its bounds, and the true one; the legend's entries."""
    x = np.array([0.0, axes.get_xlim()[1]])
    bounds = [bound for bound in data.interval if 0 < bound < STEEP]
    entries = []
    for sign in (-1.0, 1.0):
        if np.isfinite(data.mu):
            low, high = np.sort(sign * np.outer(data.interval, x), axis=0)
            band(axes, x, low, high, TEAL, 0.25)
            axes.plot(x, sign * data.mu * x, color=TEAL, lw=1.8)
        else:
            for bound in bounds:
                axes.plot(x, sign * bound * x, color=TEAL, lw=1.4, ls=(0, (1.5, 3)))
        if np.isfinite(data.true_mu):
            axes.plot(x, sign * data.true_mu * x, color=AMBER, lw=1.4, ls=(0, (4, 3)))
    if np.isfinite(data.mu):
        alpha, at = np.degrees(np.arctan(data.mu)), 0.42 * x[1]
        words = f"α = {alpha:.1f}°, μ = {data.mu:.3g}"
        axes.text(at, data.mu * at + 0.05 * axes.get_ylim()[1], words, ha="right", weight="bold")
        entries.append((TEAL, "cone, 95 %", "band"))
    elif bounds:
        entries.append((TEAL, "bound, 95 %", "dashes"))
    if np.isfinite(data.true_mu):
        entries.append((AMBER, "truth", "dashes"))
    return entries


@dataclass(frozen=True, eq=False)
class IndentationData:
    """How far the object gave way.

    Attributes
    ----------
    force_N, indentation_m, std_m : (P,) normal force, indentation, and its standard deviation.
    compliance_m_N, compliance_std_m_N : slope of the line; NaN where it is undetermined.
    true_compliance_m_N : NaN where it is not known.
    """

    force_N: np.ndarray
    indentation_m: np.ndarray
    std_m: np.ndarray
    compliance_m_N: float
    compliance_std_m_N: float
    true_compliance_m_N: float = np.nan


@style
def indentation(data: IndentationData) -> Axes:
    """Indentation over the normal force, with the fitted line."""
    force, inside, std = 1e3 * data.force_N, 1e3 * data.indentation_m, 1e3 * data.std_m
    known = thinned(np.flatnonzero(np.isfinite(force) & np.isfinite(inside)), MOST_POINTS)
    force, inside, std = force[known], inside[known], std[known]
    usual = float(np.nanmedian(std)) if np.isfinite(std).any() else 0.0
    spread = 2 * np.where(np.isfinite(std), np.minimum(std, 3 * usual), 0.0)
    x = np.array([0.0, 1.08 * max(float(force.max(initial=0.0)), 1e-6)])
    ends = limits(inside - spread, inside + spread, [0.0])
    labels = ("force along the object's normal, mN", "indentation, mm")
    axes = new_axes("indentation of the object", _SIZE, (70, 14, 52, 48), (0.0, x[1]), ends, labels)
    axes.axhline(0, color=SOFT, lw=1)
    entries = [(SLIDING, "contact ± 2 std", "dot")]
    # m/N are mm/mN
    if np.isfinite(data.compliance_m_N):
        if np.isfinite(data.compliance_std_m_N):
            low, high = (data.compliance_m_N + sign * 2 * data.compliance_std_m_N for sign in (-1, 1))
            band(axes, x, low * x, high * x, TEAL, 0.25)
        axes.plot(x, data.compliance_m_N * x, color=TEAL, lw=1.8, label="fit")
        entries.append((TEAL, "fit ± 2 std", "band"))
    if np.isfinite(data.true_compliance_m_N):
        axes.plot(x, data.true_compliance_m_N * x, color=AMBER, lw=1.4, ls=(0, (4, 3)))
        entries.append((AMBER, "truth", "dashes"))
    _std_bars(axes, force, inside, std, SLIDING)
    dots(axes, force, inside, SLIDING)
    legend(axes, entries)
    return axes


def _std_bars(axes: Axes, x: np.ndarray, y: np.ndarray, std: np.ndarray, colour: str) -> None:
    known = np.isfinite(std)
    bars(axes, x[known], (y - 2 * std)[known], (y + 2 * std)[known], colour, 0.7)
