"""The contacts: balls, force arrows, covariance ellipsoids, friction cones."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyvista as pv

from viz.scene.readable import enlargement, thinned
from viz.scene.scene import Scene

from .part import Part, along, arrow, ball, cone, stamp

MOST_BALLS, MOST_ARROWS, MOST_SPREADS, MOST_CONES = 2500, 100, 60, 16


def contact_parts(scene: Scene) -> list[Part]:
    """Contacts and what belongs to each, in the order of time: an instant shows those up to then."""
    contacts, (_, reach) = scene.contacts, scene.bounding_ball_m
    count = len(contacts.points_m)
    chosen = thinned(np.arange(count), MOST_BALLS)
    note = f"{len(chosen)} of {count}" if len(chosen) < count else ""
    size = 0.02 * reach * np.eye(3)
    sphere = ball(2 if len(chosen) <= 400 else 1)
    parts = [_stamped(scene, "contacts", chosen, sphere, size, note=note)]
    shown = np.flatnonzero(np.isin(contacts.row, scene.instants.row))
    if len(shown):
        parts.append(_stamped(scene, "now", shown, sphere, 1.9 * size, opacity=0.35))
    pushed = thinned(np.flatnonzero(contacts.size_mN > 0), MOST_ARROWS)
    if len(pushed):
        lengths = 0.45 * reach * contacts.size_mN[pushed] / contacts.size_mN[pushed].max()
        turns = along(contacts.force_N[pushed])
        parts.append(_stamped(scene, "forces", pushed, arrow(), lengths[:, None, None] * turns))
    return [*parts, *_spreads(scene, reach), *_cones(scene, reach)]


def _spreads(scene: Scene, reach: float) -> list[Part]:
    axes, std = scene.contacts.principal
    half = 2 * std
    known = np.flatnonzero(half[:, 2] > 0)
    if not len(known):
        return []
    factor = enlargement(half[known, 2], 0.04 * reach)
    chosen = thinned(known, MOST_SPREADS)
    # flat ones are given some thickness: a mesh without any has no normals
    half = np.maximum(half[chosen], 0.02 * half[chosen, 2:])
    note = f"{factor}x enlarged" if factor > 1 else ""
    linear = factor * axes[chosen] * half[:, None, :]
    return [_stamped(scene, "spread", chosen, ball(2), linear, opacity=0.22, note=note)]


def _cones(scene: Scene, reach: float) -> list[Part]:
    if scene.normals is None or scene.cone_rad is None:
        return []
    chosen = thinned(np.flatnonzero(np.isfinite(scene.normals).all(axis=1)), MOST_CONES)
    if not len(chosen):
        return []
    # steep cones are drawn shorter, for the rim to stay as near
    half = min(scene.cone_rad, 1.5)
    height = 0.42 * reach * np.cos(half)
    stretch = np.diag([height, height * np.tan(half), height * np.tan(half)])
    note = f"half angle {np.degrees(scene.cone_rad):.1f}°"
    return [_stamped(scene, "cones", chosen, cone(), along(scene.normals[chosen]) @ stretch, opacity=0.28, note=note)]


def _stamped(scene: Scene, name: str, chosen: np.ndarray, mesh: pv.PolyData, linear: np.ndarray, **look: Any) -> Part:
    """`mesh` at the chosen contacts; an instant shows those up to then, or of "now" only its own frame's."""
    rows, instants = scene.contacts.row[chosen], scene.instants.row
    last = np.searchsorted(rows, instants, side="right")
    first = np.searchsorted(rows, instants, side="left") if name == "now" else np.zeros_like(last)
    coloured = name in ("contacts", "forces")
    return Part(
        name,
        stamp(mesh, np.broadcast_to(linear, (len(chosen), 3, 3)), scene.contacts.points_m[chosen]),
        span=mesh.n_cells * np.column_stack([first, last]),
        history=name != "now",
        contact=chosen if coloured else None,
        painted=coloured,
        **look,
    )
