"""Points of view: the whole rig, and what was touched close up, each from the side that shows most."""

from __future__ import annotations

import numpy as np
import pyvista as pv

from .scene import Scene


def look_at_all(plotter: pv.Plotter, scene: Scene) -> None:
    """The whole rig, from beside and above, on the side that was touched."""
    direction = view_direction(scene, height=0.75, prefer=_beside(scene))
    plotter.view_vector(direction, viewup=(0, 0, 1))
    camera = plotter.camera
    focus = np.array(camera.focal_point)
    camera.position = focus + (np.array(camera.position) - focus) / 1.15
    plotter.reset_camera_clipping_range()


def look_at_contacts(plotter: pv.Plotter, scene: Scene, *, parallel: bool = True) -> float:
    """What was touched, close up, in parallel projection or in perspective. Returns half the height it shows, m."""
    centre, radius = scene.bounding_ball_m
    half = 1.3 * radius
    away = half / np.tan(np.radians(15))
    direction = view_direction(scene, height=0.45, prefer=_beside(scene), liking=0.35)
    plotter.camera_position = [centre + away * direction, centre, (0.0, 0.0, 1.0)]
    plotter.camera.view_angle = 30
    if parallel:
        plotter.enable_parallel_projection()
        plotter.camera.parallel_scale = half
    plotter.reset_camera_clipping_range()
    return half


def view_direction(scene: Scene, height: float, prefer: np.ndarray | None = None, liking: float = 0.8) -> np.ndarray:
    """(3,) towards the viewer: from the side of the touched surface that shows it and its forces best, and from above.

    `prefer` (2,) is a direction in the level plane to stay near to, on either side; `liking` is how much.
    """
    force = scene.contacts.force_N
    known = np.isfinite(force).all(axis=1) & (np.linalg.norm(force, axis=1) > 0)
    angle = np.radians(np.arange(0, 360, 10))
    views = np.column_stack([np.cos(angle), np.sin(angle), np.full(len(angle), height)])
    views /= np.linalg.norm(views, axis=1, keepdims=True)
    score = np.zeros(len(views))
    if known.any():
        outward = force[known] / np.linalg.norm(force[known], axis=1, keepdims=True)
        facing = outward @ views.T
        # seen from outside, yet not along the arrows
        score += (np.clip(facing, -0.2, 0.6) + 0.5 * np.sqrt(1 - np.minimum(facing**2, 1.0))).mean(axis=0)
    if prefer is not None:
        score += liking * np.abs(views[:, :2] @ prefer)
    if scene.rig is not None:
        # the clamp on the left is how the paper draws it
        away = _forward(scene)
        score += 0.15 * (views[:, :2] @ np.array([away[1], -away[0]]))
    return views[int(np.argmax(score))]


def _forward(scene: Scene) -> np.ndarray:
    """(2,) where the antenna points, in the level plane."""
    assert scene.rig is not None
    first = scene.rig.poses[np.isfinite(scene.rig.poses[:, 0, 0])][:, :2, 0].mean(axis=0)
    return first / max(float(np.linalg.norm(first)), 1e-12)


def _beside(scene: Scene) -> np.ndarray | None:
    if scene.rig is None:
        return None
    forward = _forward(scene)
    return np.array([forward[1], -forward[0]])
