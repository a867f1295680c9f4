"""Touches of objects whose shape is known, with errors of a known covariance: their own, and common ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from estimator.object.surface import Touches
from vbaa_calib.simulate.scene.objects import Bump, TouchObject

RADIUS_M = 4e-4
"""Of the antenna."""
CENTRE = np.array([0.16, 0.05, 0.0])
ALONG_M, ACROSS_M, TANGENT_RAD = 4e-4, 5e-5, 3e-4
"""Deviations of a contact's own error along the antenna and across it, and of its tangent."""
UP = np.array([0.0, 0.0, 1.0])
CYLINDER = TouchObject("cylinder", CENTRE, UP, 0.015, 0.05)
SPHERE = TouchObject("sphere", CENTRE, UP, 0.02, 0.05)
KNIFE = TouchObject("knife_edge", CENTRE, np.array([0.0, 0.6, 0.8]), 1e-3, 0.05, wedge_world=np.array([0.0, 0.8, -0.6]))


def _bump(along: float, up: float, height_m: float) -> Bump:
    way = np.array([along, -1.0, up])
    return Bump(way / np.linalg.norm(way), height_m, 9e-3)


FREEFORM = TouchObject(
    "freeform",
    CENTRE,
    UP,
    0.03,
    0.05,
    bumps=(_bump(0.3, 0.2, 3e-3), _bump(-0.4, -0.1, 2e-3), _bump(0.1, -0.5, -1.5e-3)),
)


def on_object(obj: TouchObject, near_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points (N, 3) of the surface near some, and outward normals (N, 3) there."""
    points = near_m
    for _ in range(12):
        distance, normal = obj.signed_distance(points)
        points = points - distance[:, None] * normal
    return points, obj.signed_distance(points + 1e-6 * normal)[1]


def spread_touches(
    obj: TouchObject, count: int, rng: np.random.Generator, *, compliance_m_N: float = 0.0, common: bool = True
) -> Touches:
    """Touches without errors, spread over the side that faces −y; forces from 5 to 60 mN along the normal."""
    side = 0.6 * obj.radius_m
    tall = 0.03 if obj.shape == "cylinder" else side
    near = np.column_stack(
        [rng.uniform(-side, side, count), np.full(count, -obj.radius_m), rng.uniform(-tall, tall, count)]
    )
    points, normal = on_object(obj, CENTRE + near)
    lean = np.array([1.0, 0.1, 0.0]) + 0.1 * rng.standard_normal((count, 3))
    return touches_at(points, normal, lean, rng.uniform(0.005, 0.06, count), compliance_m_N, common)


def edge_touches(count: int, rng: np.random.Generator, *, compliance_m_N: float = 0.0) -> Touches:
    """Along the knife's edge, the antenna pivoting about it by ± 0.15 rad."""
    turn = rng.uniform(-0.15, 0.15, count)
    axis, into = KNIFE.axis_world, KNIFE.wedge_world
    normal = -np.cos(turn)[:, None] * into + np.sin(turn)[:, None] * np.cross(axis, into)
    points = CENTRE + KNIFE.radius_m * normal + np.linspace(-0.03, 0.03, count)[:, None] * axis
    lean = np.cross(axis, normal) + 0.2 * axis
    return touches_at(points, normal, lean, rng.uniform(0.005, 0.06, count), compliance_m_N, True)


def touches_at(
    points_m: np.ndarray,
    normal: np.ndarray,
    lean: np.ndarray,
    press_N: np.ndarray,
    compliance_m_N: float = 0.0,
    common: bool = True,
) -> Touches:
    """Without errors: an antenna that leans this way (N, 3), pressed with these forces (N,).

    The common errors are the rig's position and attitude, and its stiffness, which moves forces and points together.
    """
    tangent = lean - np.sum(lean * normal, axis=1, keepdims=True) * normal
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    force, index = press_N[:, None] * normal, np.arange(len(points_m))
    centre = points_m + (RADIUS_M - compliance_m_N * press_N)[:, None] * normal
    modes, forces, tangents = (np.zeros((len(index), 3, 7 if common else 0)) for _ in range(3))
    if common:
        for axis in range(3):
            turn = 1e-3 * np.eye(3)[axis]
            modes[:, axis, axis] = 1e-4
            modes[:, :, 3 + axis], tangents[:, :, 3 + axis] = np.cross(turn, centre), np.cross(turn, tangent)
            forces[:, :, 3 + axis] = np.cross(turn, force)
        forces[:, :, 6] = 0.02 * force
        modes[:, :, 6] = 5e-4 * tangent + 1.5e-3 * force
    return Touches(
        point_m=centre,
        force_N=force,
        tangent=tangent,
        distance_m=np.full(len(index), 0.17),
        own_m2=ALONG_M**2 * tangent[:, :, None] * tangent[:, None, :] + ACROSS_M**2 * np.eye(3),
        modes_m=modes,
        force_modes_N=forces,
        tangent_modes=tangents,
        frame=index,
        row=index,
    )


def drawn(true: Touches, rng: np.random.Generator) -> Touches:
    """The same with errors. Where the distance comes out too long, the force comes out too small."""
    half = np.linalg.cholesky(true.own_m2 + 1e-24 * np.eye(3))
    own = np.einsum("pij,pj->pi", half, rng.standard_normal(true.point_m.shape))
    common = rng.standard_normal(true.modes_m.shape[2])
    tangent = true.tangent + true.tangent_modes @ common + TANGENT_RAD * rng.standard_normal(true.tangent.shape)
    longer = np.nan_to_num(np.sum(own * true.tangent, axis=1))
    return replace(
        true,
        point_m=true.point_m + own + true.modes_m @ common,
        force_N=true.force_N * (1 - 2 * longer / true.distance_m)[:, None] + true.force_modes_N @ common,
        tangent=tangent / np.linalg.norm(tangent, axis=1, keepdims=True),
        distance_m=true.distance_m + longer,
    )


def angles_rad(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """(N,) between unit vectors (N, 3)."""
    return np.arccos(np.clip(np.sum(first * second, axis=1), -1.0, 1.0))
