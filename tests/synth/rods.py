"""Rods and directions for the tests of contacts, and what a touch looks like in the world."""

from __future__ import annotations

import numpy as np

from vbaa_calib.antenna.rod import Rod, sample_shape
from vbaa_calib.geometry import Pose
from vbaa_calib.simulate.contact.stick_slip import Bases
from vbaa_calib.simulate.contact.touch import Touch

L, EI, RADIUS = 0.24, 3.9e-3, 4e-4
WEIGHT, NONE = np.array([0.0, 0.0, -9.80665]), np.zeros(3)
X, Y, Z = np.eye(3)


def bare_rod() -> Rod:
    """Straight and weightless."""
    return Rod(L, EI, 3e-3, 0.0)


def real_rod() -> Rod:
    """Heavy, bowed and clamped askew."""
    clamp = Pose.from_rotvec(np.array([0.0, 0.02, -0.03]), np.array([0.001, 0.0, -0.001]))
    return Rod(L, EI, 3e-3, 0.004, clamp, np.array([0.2, -0.1]))


def in_world(poses: list[Pose], result: Touch) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Contact points, tangents and forces (B, 3) in the world frame."""
    bases, at = Bases.of(poses), np.nan_to_num(result.contact_m, nan=L / 2)[:, None]
    tangent = sample_shape(result.shape, at)[1][:, 0]
    tangent, force = (np.einsum("bij,bj->bi", bases.rotation, v) for v in (tangent, result.force_antenna_N))
    return bases.world(result.contact_antenna_m), tangent, force
