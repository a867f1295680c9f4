"""Friction and stiffness as pictures: forces in the friction cone (paper, Fig. 5), and how far the object gave way."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from viz.plots.marks import INK, SOFT, Entry, area, bars, dots, legend, line, rings, words
from viz.plots.svg import Axes, span

from .map import spread_out

SLIDES, STICKS, UNUSED, CONE, TRUE = "#0072b2", "#c2410c", "#94a3b8", "#0f766e", "#b45309"
MOST = 1500
STEEP = 1.5
"""A bound on μ beyond this is not worth the room to draw it."""
_WIDTH, _HEIGHT = 480.0, 440.0


@dataclass(frozen=True, eq=False)
class ConeData:
    """What the cone's picture needs.

    Attributes
    ----------
    normal_N, tangential_N, tangential_std_N : (P,) parts of the force along the object's normal and across antenna and
        normal, signed.
    used_as : (P,) "sliding", "sticking" or anything else for what said nothing of μ.
    mu : coefficient of friction, NaN where it cannot be told.
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


@dataclass(frozen=True, eq=False)
class YieldData:
    """What the stiffness' picture needs.

    Attributes
    ----------
    force_N, yield_m, std_m : (P,) normal force, how far the surface gave way, and its standard deviation.
    compliance_m_N, compliance_std_m_N : slope of the line; NaN where it cannot be told.
    true_compliance_m_N : NaN where it is not known.
    """

    force_N: np.ndarray
    yield_m: np.ndarray
    std_m: np.ndarray
    compliance_m_N: float
    compliance_std_m_N: float
    true_compliance_m_N: float = np.nan


def cone(data: ConeData) -> str:
    """Tangential over normal force of every contact, within the cone tan α = μ."""
    normal, tangential, std = (1e3 * x for x in (data.normal_N, data.tangential_N, data.tangential_std_N))
    known = np.isfinite(normal) & np.isfinite(tangential)
    furthest = 1.08 * max(float(normal[known].max(initial=0.0)), 1e-6)
    slope = max((m for m in (data.mu, *data.interval, data.true_mu) if m < STEEP), default=0.0)
    reach = 1.15 * max(float(np.abs(tangential[known]).max(initial=0.0)), 1.02 * slope * furthest, 0.05 * furthest)
    axes = Axes((0.0, furthest), (-reach, reach), _WIDTH, _HEIGHT, 70.0, 14.0, 52.0, 48.0)
    title = "friction cone"
    parts = axes.frame(title, "force along the object's normal, mN", "force across it and the antenna, mN")
    parts += _cone(axes, data)
    parts.append(line(axes, np.array([0.0, furthest]), np.zeros(2), SOFT, 1.0))
    shown = np.flatnonzero(known)
    shown = shown[spread_out(len(shown), MOST)]
    kinds: list[tuple[str, str, np.ndarray, Callable[..., str], str]] = [
        ("neither", UNUSED, shown[~np.isin(data.used_as[shown], ("sliding", "sticking"))], dots, "dot"),
        ("sticks, or undecided", STICKS, shown[data.used_as[shown] == "sticking"], rings, "ring"),
        ("slides", SLIDES, shown[data.used_as[shown] == "sliding"], dots, "dot"),
    ]
    entries = []
    for name, colour, index, draw, mark in kinds:
        if len(index):
            told = index[np.isfinite(std[index])]
            low, high = (tangential[told] + sign * 2 * std[told] for sign in (-1, 1))
            parts.append(bars(axes, normal[told], low, high, colour, 0.7))
            parts.append(draw(axes, normal[index], tangential[index], colour))
            entries.append(Entry(colour, name, mark))
    if np.isfinite(data.mu):
        entries.append(Entry(CONE, "cone, 95 %", "band"))
    elif any(0 < bound < STEEP for bound in data.interval):
        entries.append(Entry(CONE, "bound, 95 %", "dashes"))
    if np.isfinite(data.true_mu):
        entries.append(Entry(TRUE, "truth", "dashes"))
    return axes.drawing([*parts, legend(axes, entries)], title)


def _cone(axes: Axes, data: ConeData) -> list[str]:
    parts: list[str] = []
    for sign in (-1.0, 1.0):
        if np.isfinite(data.mu):
            low, high = data.interval
            rim = np.array([0.0, sign * high * axes.x[1], sign * low * axes.x[1]])
            parts.append(area(axes, np.array([0.0, axes.x[1], axes.x[1]]), rim, CONE, 0.25))
            parts.append(_ray(axes, sign * data.mu, CONE, 1.8))
        else:
            bounds = [bound for bound in data.interval if 0 < bound < STEEP]
            parts += [_ray(axes, sign * bound, CONE, 1.4, "2 4") for bound in bounds]
        if np.isfinite(data.true_mu):
            parts.append(_ray(axes, sign * data.true_mu, TRUE, 1.4, "6 4"))
    if np.isfinite(data.mu):
        at = 0.42 * axes.x[1]
        alpha = np.degrees(np.arctan(data.mu))
        parts.append(words(axes, at, data.mu * at + 0.04 * axes.y[1], f"α = {alpha:.1f}°, μ = {data.mu:.3g}", "end"))
    return parts


def _ray(axes: Axes, slope: float, colour: str, width: float, dashes: str = "") -> str:
    return line(axes, np.array([0.0, axes.x[1]]), np.array([0.0, slope * axes.x[1]]), colour, width, dashes)


def yields(data: YieldData) -> str:
    """How far the surface gave way over the normal force, with the fitted line."""
    force, given, std = 1e3 * data.force_N, 1e3 * data.yield_m, 1e3 * data.std_m
    known = np.flatnonzero(np.isfinite(force) & np.isfinite(given))
    known = known[spread_out(len(known), MOST)]
    force, given, std = force[known], given[known], std[known]
    furthest = 1.08 * max(float(force.max(initial=0.0)), 1e-6)
    usual = float(np.nanmedian(std)) if np.isfinite(std).any() else 0.0
    spread = 2 * np.where(np.isfinite(std), np.minimum(std, 3 * usual), 0.0)
    axes = Axes((0.0, furthest), span(np.concatenate([given - spread, given + spread, [0.0]])))
    axes = Axes(axes.x, axes.y, _WIDTH, _HEIGHT, 70.0, 14.0, 52.0, 48.0)
    title = "how the object gives way"
    parts = axes.frame(title, "force along the object's normal, mN", "indentation, mm")
    parts.append(line(axes, np.array([0.0, furthest]), np.zeros(2), SOFT, 1.0))
    entries = [Entry(SLIDES, "contact ± 2 std")]
    if np.isfinite(data.compliance_m_N):
        ends = np.array([0.0, furthest])
        slope, own = data.compliance_m_N, 2 * data.compliance_std_m_N
        rim = np.array([0.0, (slope + own) * furthest, (slope - own) * furthest])
        if np.isfinite(own):
            parts.append(area(axes, np.array([0.0, furthest, furthest]), rim, CONE, 0.25))
        parts.append(line(axes, ends, slope * ends, CONE, 1.8))
        entries.append(Entry(CONE, "fit ± 2 std", "band"))
    if np.isfinite(data.true_compliance_m_N):
        ends = np.array([0.0, furthest])
        parts.append(line(axes, ends, data.true_compliance_m_N * ends, TRUE, 1.4, "6 4"))
        entries.append(Entry(TRUE, "truth", "dashes"))
    told = np.isfinite(std)
    parts.append(bars(axes, force[told], (given - 2 * std)[told], (given + 2 * std)[told], SLIDES, 0.7))
    parts.append(dots(axes, force, given, SLIDES))
    return axes.drawing([*parts, legend(axes, entries)], title)


__all__ = ["INK", "ConeData", "YieldData", "cone", "yields"]
