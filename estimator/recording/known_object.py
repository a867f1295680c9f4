"""Equations of contacts with an object at a known place: they determine the rig's errors."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from vbaa_calib.antenna.nodes import CONTACT

from .settings import RefineSettings

if TYPE_CHECKING:
    from estimator.solver.linearised import LinearisedFrames
    from vbaa_calib.session import KnownObject


def known_equations(
    known: KnownObject,
    found: LinearisedFrames,
    columns: np.ndarray,
    place: tuple[np.ndarray, np.ndarray],
    antenna_radius_m: float,
    shift: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Information (B, K, K) and side (B, K) that contacts on a straight pin or edge give.

    With a the object's direction, t the antenna's tangent and n ∝ ± a × t, the contact point lies at (r + r_antenna)·n
    from the object's axis, whichever way it slid along it. Of the two equations across a, the one along t determines
    the contact distance.

    columns : (B, 6, K) derivatives of point and force; the last three are by the object's own place. place : rotations
    (B, 3, 3) and translations (B, 3) of the antenna frame. shift : (3,) of the object's place, in deviations.
    """
    rotation, translation = place
    point, force = found.point_force[:, :3], found.point_force[:, 3:]
    world = np.einsum("bij,bj->bi", rotation, point) + translation
    tangent, force = (np.einsum("bij,bj->bi", rotation, each) for each in (found.tangents[:, :, CONTACT], force))
    normal = np.cross(known.direction, tangent)
    size = np.linalg.norm(normal, axis=1, keepdims=True)
    normal = normal / np.where(size > 1e-6, size, np.nan)
    normal *= np.where(np.sum(normal * force, axis=1, keepdims=True) < 0.0, -1.0, 1.0)
    off = world - known.position_m - known.std_m * shift - np.nan_to_num((known.radius_m + antenna_radius_m) * normal)
    across = np.linalg.svd(known.direction[None])[2][1:]
    rows = across @ rotation @ columns[:, :3]
    rows[:, :, -3:] -= known.std_m * across
    rows /= RefineSettings.object_round_m
    return np.swapaxes(rows, 1, 2) @ rows, -np.einsum(
        "bqk,bq->bk", rows, off @ across.T / RefineSettings.object_round_m
    )
