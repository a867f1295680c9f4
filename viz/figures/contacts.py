"""Figures of all contacts: maps, forces across the antenna, friction cone (paper, Fig. 5), indentation."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from estimator.table.contacts import ContactTable
from vbaa_calib.geometry.covariance import variance_along
from viz.scene.readable import enlargement, thinned

from .drawing import Plot, limits, time_colours
from .settings import STYLE

if TYPE_CHECKING:
    from estimator.object.friction import Friction
    from estimator.object.surface import Surface


def contact_maps(contacts: ContactTable, surface: Surface | None, truth_m: np.ndarray) -> tuple[list[Plot], int]:
    """Three orthogonal views of located contacts with their ellipses, the object and true points (Q, 3), at one
    scale, mm.

    Also returns how many times larger ellipses are drawn, so that the usual one can be seen; 1 where it can.
    """
    drawn = 1e3 * np.concatenate([contacts.point_world_m, truth_m])
    middle = 0.5 * (drawn.min(axis=0) + drawn.max(axis=0))
    half = max(0.56 * float(np.ptp(drawn, axis=0).max()), 1.12)
    std_mm = 1e3 * np.sqrt(np.trace(contacts.covariance_world_m2, axis1=1, axis2=2))
    factor = enlargement(STYLE.side_px / half * std_mm, STYLE.visible_px)
    ends = middle[:, None] + half * np.array([-1.0, 1.0])
    return [
        _contact_map(contacts, surface, truth_m, ends, view, factor)
        for view in (("from above", 0, 1), ("from the side, along y", 0, 2), ("from the side, along x", 1, 2))
    ], factor


def _contact_map(
    contacts: ContactTable,
    surface: Surface | None,
    truth_m: np.ndarray,
    ends_mm: np.ndarray,
    view: tuple[str, int, int],
    factor: int,
) -> Plot:
    name, *pair = view
    x, y = ends_mm[pair]
    labels = (f"{'XYZ'[pair[0]]}, mm", f"{'XYZ'[pair[1]]}, mm")
    axes = Plot(name, (STYLE.side_px + 74, STYLE.side_px + 80), (62, 12, 34, 46), tuple(x), tuple(y), labels)
    if surface is not None:
        object_mm = 1e3 * surface.points_m[:, pair]
        triangles = object_mm[thinned(surface.triangles, STYLE.most_triangles)]
        a, b = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
        # all turn one way: together they fill their union
        triangles = np.where((a[:, 0] * b[:, 1] < a[:, 1] * b[:, 0])[:, None, None], triangles[:, ::-1], triangles)
        axes.paths(triangles, "object", fill=f"{STYLE.slate}40")
        axes.paths(object_mm[surface.lines[: STYLE.most_triangles]], "object", stroke=STYLE.slate, width=1.6)
    truth = 1e3 * thinned(truth_m, STYLE.most_points)[:, pair]
    arm = 2 * float(np.ptp(x)) / STYLE.side_px
    for diagonal in ([1, 1], [1, -1]):
        crosses = truth[:, None] + arm * np.array([[-1], [1]]) * diagonal
        axes.paths(crosses, "truth", stroke="#111827", width=0.8)
    points, covariance = 1e3 * contacts.point_world_m[:, pair], contacts.covariance_world_m2
    known = thinned(np.flatnonzero(np.isfinite(covariance).all(axis=(1, 2))), STYLE.most_ellipses)
    blocks = 1e6 * factor**2 * covariance[known][:, pair][:, :, pair]
    axes.ellipses(points[known], blocks, _picked(time_colours(contacts.time_s), known))
    drawn = thinned(np.arange(len(points)), STYLE.most_points)
    axes.dots_by_time(points[drawn], contacts.time_s[drawn])
    return axes


def forces_across(contacts: ContactTable) -> Plot:
    """f_z against f_y: each contact is the head of an arrow from the origin (paper, Fig. 5)."""
    whole = np.isfinite(contacts.force_y_N + contacts.force_z_N)
    force = 1e3 * np.stack([contacts.force_y_N, contacts.force_z_N], axis=1)[whole]
    std = 1e3 * np.stack([contacts.force_y_std_N, contacts.force_z_std_N], axis=1)[whole]
    time_s = contacts.time_s[whole]
    reach = 1.12 * max(float(np.abs(force).max(initial=0.0)), 1e-6)
    ends = (-reach, reach)
    axes = Plot("force across the antenna", STYLE.size, (90, 68, 70, 48), ends, ends, ("f_y, mN", "f_z, mN"))
    axes.level()
    axes.upright(0.0)
    drawn = thinned(np.arange(len(force)), STYLE.most_points)
    if len(drawn) <= STYLE.most_ellipses:
        tips = force[drawn]
        axes.paths(np.stack([0 * tips, tips], axis=1), "arrows", stroke=STYLE.soft, width=0.4)
    known = thinned(drawn[np.isfinite(std[drawn]).all(axis=1)], STYLE.most_ellipses)
    axes.ellipses(force[known], std[known, :, None] ** 2 * np.eye(2), _picked(time_colours(time_s), known))
    axes.dots_by_time(force[drawn], time_s[drawn])
    axes.dots(np.zeros(1), np.zeros(1), STYLE.ink)
    return axes


def friction_cone(friction: Friction, force_N: np.ndarray, true_mu: float = np.nan) -> Plot:
    """Force across antenna and normal against the force along the object's normal, with the cone tan α = μ.

    force_N : (P, 3) of the contacts that friction was estimated from. true_mu : NaN where it is not known.
    """
    size = 1e3 * np.linalg.norm(force_N, axis=1)
    normal, tangential = size * np.cos(friction.lateral_rad), size * np.sin(friction.lateral_rad)
    mu = friction.mu if friction.determined else np.nan
    known = np.isfinite(normal) & np.isfinite(tangential)
    furthest = 1.08 * max(float(normal[known].max(initial=0.0)), 1e-6)
    slope = max((m for m in (mu, *friction.interval, true_mu) if m < STYLE.steep), default=0.0)
    reach = 1.15 * max(float(np.abs(tangential[known]).max(initial=0.0)), 1.02 * slope * furthest, 0.05 * furthest)
    labels = ("force along the object's normal, mN", "force across it and the antenna, mN")
    axes = Plot("friction cone", STYLE.size, (70, 14, 52, 48), (0.0, furthest), (-reach, reach), labels)
    entries = _cone_lines(axes, mu, friction.interval, true_mu)
    axes.level()
    drawn = thinned(np.flatnonzero(known), STYLE.most_points)
    used_as = np.asarray(friction.used_as)[drawn]
    marks = []
    for here, words, colour, mark in (
        (~np.isin(used_as, ("sliding", "sticking")), "neither", STYLE.unused, "dot"),
        (used_as == "sticking", "sticks, or undecided", STYLE.sticking, "ring"),
        (used_as == "sliding", "slides", STYLE.sliding, "dot"),
    ):
        index = drawn[here]
        if len(index):
            _std_bars(axes, normal[index], tangential[index], (size * friction.lateral_std_rad)[index], colour)
            axes.dots(normal[index], tangential[index], colour)
            if mark == "ring":
                axes.dots(normal[index], tangential[index], "#ffffff", 2.6)
            marks.append((colour, words, mark))
    axes.legend([*marks, *entries])
    return axes


def _cone_lines(axes: Plot, mu: float, interval: np.ndarray, true_mu: float) -> list[tuple[str, str, str]]:
    """Draw the cone or its bounds, and the true one; returns the legend's entries."""
    x = np.array([0.0, axes.x[1]])
    bounds = [bound for bound in interval if 0 < bound < STYLE.steep]
    for sign in (-1.0, 1.0):
        if np.isfinite(mu):
            low, high = np.sort(sign * np.outer(interval, x), axis=0)
            axes.band(x, low, high, STYLE.teal, 0.25)
            axes.line(x, sign * mu * x, STYLE.teal, 1.8, name="cone")
        else:
            for bound in bounds:
                axes.line(x, sign * bound * x, STYLE.teal, 1.4, dashes=(1.5, 3))
        if np.isfinite(true_mu):
            axes.line(x, sign * true_mu * x, STYLE.amber, 1.4, "truth", dashes=(4, 3))
    entries = [(STYLE.amber, "truth", "dashes")] if np.isfinite(true_mu) else []
    if np.isfinite(mu):
        alpha, at = np.degrees(np.arctan(mu)), 0.42 * x[1]
        axes.write((at, mu * at + 0.05 * axes.y[1]), f"α = {alpha:.1f}°, μ = {mu:.3g}", "end", "strong")
        return [(STYLE.teal, "cone, 95 %", "band"), *entries]
    return [(STYLE.teal, "bound, 95 %", "dashes"), *entries] if bounds else entries


def indentation(
    surface: Surface, contacts: ContactTable, radius_m: np.ndarray | float, true_compliance_m_N: float = np.nan
) -> Plot:
    """Indentation against normal force of the surface's touches, with the fitted line.

    contacts : the table's rows of the touches. radius_m : of the antenna there. true_compliance_m_N : NaN if not known.
    """
    normal, soft = surface.touched_normal, surface.compliance
    force = 1e3 * (contacts.force_world_N * normal).sum(axis=1)
    inside = 1e3 * (((surface.touched_m - contacts.point_world_m) * normal).sum(axis=1) + radius_m)
    variance = variance_along(contacts.covariance_world_m2, normal)
    std = 1e3 * np.sqrt(np.clip(variance, 0.0, None))
    known = thinned(np.flatnonzero(np.isfinite(force) & np.isfinite(inside)), STYLE.most_points)
    force, inside, std = force[known], inside[known], std[known]
    usual = float(np.nanmedian(std)) if np.isfinite(std).any() else 0.0
    spread = 2 * np.where(np.isfinite(std), np.minimum(std, 3 * usual), 0.0)
    x = np.array([0.0, 1.08 * max(float(force.max(initial=0.0)), 1e-6)])
    ends = limits(inside - spread, inside + spread, [0.0])
    labels = ("force along the object's normal, mN", "indentation, mm")
    axes = Plot("indentation of the object", STYLE.size, (70, 14, 52, 48), (0.0, x[1]), ends, labels)
    axes.level()
    entries = [(STYLE.sliding, "contact ± 2 std", "dot")]
    # m/N are mm/mN
    if soft.determined and np.isfinite(soft.compliance_m_N):
        if np.isfinite(soft.std_m_N):
            low, high = (soft.compliance_m_N + sign * 2 * soft.std_m_N for sign in (-1, 1))
            axes.band(x, low * x, high * x, STYLE.teal, 0.25)
        axes.line(x, soft.compliance_m_N * x, STYLE.teal, 1.8, name="fit")
        entries.append((STYLE.teal, "fit ± 2 std", "band"))
    if np.isfinite(true_compliance_m_N):
        axes.line(x, true_compliance_m_N * x, STYLE.amber, 1.4, "truth", dashes=(4, 3))
        entries.append((STYLE.amber, "truth", "dashes"))
    _std_bars(axes, force, inside, std, STYLE.sliding)
    axes.dots(force, inside, STYLE.sliding)
    axes.legend(entries)
    return axes


def _std_bars(axes: Plot, x: np.ndarray, y: np.ndarray, std: np.ndarray, colour: str) -> None:
    known = np.isfinite(std)
    axes.bars(x[known], (y - 2 * std)[known], (y + 2 * std)[known], colour, 0.7)


def _picked(values: Sequence[str], index: np.ndarray) -> list[str]:
    return [values[one] for one in index.tolist()]
