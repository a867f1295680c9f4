"""Antennas as curves in the picture: cantilevers under a point force, with what perspective and lens make of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

STEP_PX = 0.4
"""Spacing of a path's points."""


@dataclass(frozen=True)
class Bend:
    """How an antenna lies in the picture.

    Attributes
    ----------
    clamp_px : (u, v) of the clamp.
    heading_rad : direction at the clamp, from u towards v.
    length_px : of the whole antenna.
    turn_rad : by how much its direction changes in all.
    contact : where the force acts, as a fraction of the length.
    force_angle_rad : angle of the force to the clamp's normal.
    sag : bow of the free antenna, its sagitta as a fraction of the length.
    shorter : foreshortening along the heading by leaving the plane, 1 for none.
    """

    clamp_px: tuple[float, float]
    heading_rad: float
    length_px: float
    turn_rad: float = 0.0
    contact: float = 0.7
    force_angle_rad: float = 0.0
    sag: float = 0.0
    shorter: float = 1.0


def _cantilever(turn_rad: float, contact: float, force_angle_rad: float, count: int) -> np.ndarray:
    """(count,) direction along a cantilever of length one: an elastica whose moment is force times lever arm."""
    share = np.linspace(0.0, 1.0, count)
    touched = share <= contact
    heading = turn_rad * np.where(touched, 1.0 - (1.0 - share / contact) ** 2, 1.0)
    force = np.array([-np.sin(force_angle_rad), np.cos(force_angle_rad)])
    for _ in range(25):
        points = np.cumsum(np.stack([np.cos(heading), np.sin(heading)], axis=1), axis=0) / count
        arm = points[touched][-1] - points
        curvature = np.where(touched, np.maximum(arm @ np.array([force[1], -force[0]]), 0.0), 0.0)
        turned = np.cumsum(curvature)
        heading = 0.5 * heading + 0.5 * turn_rad * turned / max(turned[-1], 1e-12)
    return heading


def path_px(bend: Bend) -> np.ndarray:
    """(K, 2) the antenna from clamp to tip, a point every `STEP_PX`."""
    count = max(int(bend.length_px / STEP_PX), 20)
    share = np.linspace(0.0, 1.0, count)
    heading = _cantilever(bend.turn_rad, bend.contact, bend.force_angle_rad, count) + 4.0 * bend.sag * share
    step = bend.length_px / (count - 1) * np.stack([bend.shorter * np.cos(heading), np.sin(heading)], axis=1)
    local = np.concatenate([np.zeros((1, 2)), np.cumsum(step[:-1], axis=0)])
    cos, sin = np.cos(bend.heading_rad), np.sin(bend.heading_rad)
    return np.array(bend.clamp_px) + local @ np.array([[cos, sin], [-sin, cos]])


def normals(path: np.ndarray) -> np.ndarray:
    """(K, 2) unit normals of a dense path."""
    along = np.gradient(path, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    return np.stack([-along[:, 1], along[:, 0]], axis=1)


def aside_px(path: np.ndarray, points_px: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(N,) signed distance of points from a dense path, and the index (N,) of the nearest point of the path."""
    from scipy.spatial import cKDTree

    nearest = cKDTree(path).query(points_px)[1] if len(points_px) else np.empty(0, int)
    offset = points_px - path[nearest]
    across = normals(path)[nearest]
    signed = (offset * across).sum(axis=1)
    past = np.abs((offset * across[:, ::-1] * [1.0, -1.0]).sum(axis=1)) > 2.0
    # beyond an end of the path the distance across means nothing
    return np.where(past, np.hypot(*offset.T), signed), nearest
