"""Colours and viewing direction of a scene, shared by `viz.parts` and `viz.figures`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from .scene import Scene

OBJECT, INK = "#0d9488", "#1f2937"
LOOK = {
    "contacts": (OBJECT, "contact, on the antenna's centreline"),
    "framewise": ("#64748b", "the same contact, frame by frame"),
    "forces": (OBJECT, "force on the antenna"),
    "now": ("#111827", "contact at this time"),
    "spread": ("#0ea5e9", "ellipsoid of 2 std"),
    "cones": ("#7c3aed", "friction cone"),
    "object": (OBJECT, "reconstructed surface"),
    "truth": ("#c9b791", "true object"),
    "antenna": ("#1b2430", "antenna at this time"),
    "free": ("#8a94a3", "antenna without the object"),
    "ghosts": ("#9aa7b8", "antenna at other times"),
    "plane": ("#3b82f6", "plane C"),
    "camera": ("#b45309", "camera and its picture"),
    "grid": ("#aab4c2", "level grid"),
}
"""Name of a part → its colour and what it is called in legends."""


def view_direction(scene: Scene, height: float, liking: float) -> np.ndarray:
    """(3,) unit vector to the viewer: from above, and from the side on which the touched surface and the forces are
    seen best.

    liking : weight of looking at the antenna from its side.
    """
    angle = np.radians(np.arange(0, 360, 10))
    views = np.column_stack([np.cos(angle), np.sin(angle), np.full(len(angle), height)])
    views /= np.linalg.norm(views, axis=1, keepdims=True)
    score = np.zeros(len(views))
    size = np.linalg.norm(scene.contacts.force_N, axis=1, keepdims=True)
    known = np.nan_to_num(size[:, 0]) > 0
    if known.any():
        facing = (scene.contacts.force_N[known] / size[known]) @ views.T
        # seen from outside, yet not along the arrows
        score += (np.clip(facing, -0.2, 0.6) + 0.5 * np.sqrt(1 - np.minimum(facing**2, 1.0))).mean(axis=0)
    if scene.rig is not None:
        forward = scene.rig.poses[np.isfinite(scene.rig.poses[:, 0, 0])][:, :2, 0].mean(axis=0)
        forward /= max(float(np.linalg.norm(forward)), 1e-12)
        sideways = views[:, :2] @ np.array([forward[1], -forward[0]])
        # the clamp on the left is how the paper draws it
        score += liking * np.abs(sideways) + 0.15 * sideways
    return views[int(np.argmax(score))]


def along(axis: np.ndarray) -> np.ndarray:
    """(K, 3, 3) rotations with the first column along axis (K, 3), which is not zero."""
    first = axis / np.linalg.norm(axis, axis=1, keepdims=True)
    # what is farthest from parallel to the axis
    helper = np.eye(3)[np.abs(first).argmin(axis=1)]
    second = np.cross(first, helper)
    second /= np.linalg.norm(second, axis=1, keepdims=True)
    return np.stack([first, second, np.cross(first, second)], axis=2)
