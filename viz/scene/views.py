"""Points of view: the whole rig, and what was touched close up, each from the side that shows most."""

from __future__ import annotations

import numpy as np
import pyvista as pv

from .scene import Scene


def look_at_all(plotter: pv.Plotter, scene: Scene) -> None:
    """The whole rig, from beside and above, on the side that was touched."""
    plotter.view_vector(_view_direction(scene, height=0.75, liking=0.8), viewup=(0, 0, 1))
    camera = plotter.camera
    focus = np.array(camera.focal_point)
    camera.position = focus + (np.array(camera.position) - focus) / 1.15
    plotter.reset_camera_clipping_range()


def look_at_contacts(plotter: pv.Plotter, scene: Scene, *, parallel: bool = True) -> float:
    """What was touched, close up, in parallel projection or in perspective. Returns half the height it shows, m."""
    centre, radius = scene.bounding_ball_m
    half = 1.3 * radius
    away = half / np.tan(np.radians(15))
    direction = _view_direction(scene, height=0.45, liking=0.35)
    plotter.camera_position = [centre + away * direction, centre, (0.0, 0.0, 1.0)]
    plotter.camera.view_angle = 30
    if parallel:
        plotter.enable_parallel_projection()
        plotter.camera.parallel_scale = half
    plotter.reset_camera_clipping_range()
    return half


def _view_direction(scene: Scene, height: float, liking: float) -> np.ndarray:
    """(3,) towards the viewer: from the side of the touched surface that shows it and its forces best, and from above.

    `liking` is how much to stay beside the antenna, on either side.
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
        beside = views[:, :2] @ np.array([forward[1], -forward[0]])
        # the clamp on the left is how the paper draws it
        score += liking * np.abs(beside) + 0.15 * beside
    return views[int(np.argmax(score))]
