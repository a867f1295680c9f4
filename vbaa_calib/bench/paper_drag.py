"""Fig. 5's scene: the antenna pressed against a knife edge with friction, then dragged along it and back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..rig import Rig
from ..synth.touch import Touch, touch
from .paper_rig import Pictures, free_shape, taken
from .paper_sensing import knife_edge
from .rod_of_rig import rod_of

NORMAL_DEG, DISTANCE_M, EDGE_RADIUS_M = 20.0, 0.15, 1e-3
PRESSED_RAD, DRAGGED_RAD = np.radians(4.0), np.radians(4.0)
APPROACH, LEG = 24, 16
"""Frames of the press, and of each of the two legs."""


@dataclass(frozen=True, eq=False)
class Dragged:
    """One true antenna over one edge, B frames.

    Attributes
    ----------
    rotation : (B, 3, 3) R_world_antenna; pan_rad, tilt_rad (B,). point_m : (B, 3) true contacts, world.
    """

    touched: Pictures
    free: Pictures
    pan_rad: np.ndarray
    tilt_rad: np.ndarray
    rotation: np.ndarray
    point_m: np.ndarray


def joints() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pan and tilt (B,), and the part (B,) of each frame: 0 press, 1 there, 2 back."""
    press = np.linspace(-0.15, 1.0, APPROACH) * PRESSED_RAD
    there = np.linspace(-1.0, 1.0, LEG) * DRAGGED_RAD
    along = np.concatenate([np.full(APPROACH, there[0]), there, there[::-1][1:]])
    against = np.concatenate([press, np.full(2 * LEG - 1, PRESSED_RAD)])
    cos, sin = np.cos(np.radians(NORMAL_DEG)), np.sin(np.radians(NORMAL_DEG))
    part = np.repeat([0, 1, 2], [APPROACH, LEG, LEG - 1])
    return cos * against - sin * along, sin * against + cos * along, part


def dragged(true: Rig, friction: float, slip_scale_m: float | None = None) -> Dragged:
    """The antenna pressed along the edge's normal, then carried along the edge and back.

    `slip_scale_m` asks for the simulator's simpler friction (`synth.touch`), which is faster.
    """
    pan, tilt, _ = joints()
    start = free_shape(true, true.gravity_world_m_s2[None])
    at = np.array([np.interp(DISTANCE_M, start.arclength_m[0], start.points_m[0, :, axis]) for axis in range(3)])
    radius = 0.5 * true.antenna.diameter_m
    obj = knife_edge(NORMAL_DEG, at, radius, radius_m=EDGE_RADIUS_M, friction=friction)
    poses = [true.kinematics.T_world_antenna(float(p), float(t)) for p, t in zip(pan, tilt, strict=True)]
    found: Touch = touch(rod_of(true), radius, obj, poses, true.gravity_world_m_s2, slip_scale_m=slip_scale_m)
    rotation = np.stack([pose.rotation for pose in poses])
    free = free_shape(true, true.gravity_world_m_s2 @ rotation)
    point = np.array([pose @ contact for pose, contact in zip(poses, found.contact_antenna_m, strict=True)])
    return Dragged(taken(true, found.shape), taken(true, free), pan, tilt, rotation, point)
