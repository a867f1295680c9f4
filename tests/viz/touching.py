"""Contact tables as a perfect estimator with honest noise would leave them, for objects whose shape is known."""

from __future__ import annotations

import numpy as np

from estimator.table.contacts import ContactRow
from vbaa_calib.geometry import Kinematics

ANTENNA_RADIUS_M = 0.0004
LEAN_RAD = 0.04
"""How far the clamp has turned past the contact: the antenna is bent by about this much."""


def cylinder(angle_rad: np.ndarray, height_m: np.ndarray, radius_m: float = 0.015) -> tuple[np.ndarray, np.ndarray]:
    """Points (N, 3) and outward normals (N, 3) on an upright cylinder beside the antenna; angle 0 faces the clamp."""
    normals = np.stack([-np.cos(angle_rad), -np.sin(angle_rad), np.zeros_like(angle_rad)], axis=1)
    return np.array([0.16, 0.05, 0.0]) + radius_m * normals + np.outer(height_m, [0.0, 0.0, 1.0]), normals


def touch(
    surface_m: np.ndarray,
    normals: np.ndarray,
    rng: np.random.Generator,
    *,
    std_along_m: float = 1e-3,
    std_across_m: float = 1e-4,
    kinematics: Kinematics | None = None,
) -> list[ContactRow]:
    """One row per point, noise along the antenna `std_along_m` and across it `std_across_m`, covariances to match."""
    kinematics = kinematics or Kinematics()
    rows = []
    for frame, (point, normal) in enumerate(zip(surface_m, normals, strict=True)):
        centre = point + ANTENNA_RADIUS_M * normal
        reach = centre - kinematics.position_world_m
        pose = kinematics.T_world_antenna(
            np.arctan2(reach[1], reach[0]) + LEAN_RAD, np.arcsin(reach[2] / np.linalg.norm(reach))
        )
        std = np.array([std_along_m, std_across_m, std_across_m])
        noisy = pose.inverse() @ centre + std * rng.standard_normal(3)
        force_world = (0.05 + 0.03 * np.sin(0.3 * frame)) * normal
        force = pose.rotation.T @ force_world
        rows.append(
            ContactRow(
                frame=frame,
                time_s=frame / 30,
                status="ok",
                in_contact=True,
                model="rod",
                distance_m=float(noisy[0]),
                distance_std_m=std_along_m,
                force_y_N=float(force[1]),
                force_y_std_N=0.001,
                force_z_N=float(force[2]),
                force_z_std_N=0.002,
                deflection_y_m=float(noisy[1]),
                deflection_z_m=float(noisy[2]),
                point_antenna_m=noisy,
                point_world_m=pose @ noisy,
                covariance_world_m2=pose.rotation @ np.diag(std**2) @ pose.rotation.T,
                force_world_N=force_world,
                moment_residual_Nm=1e-5 * float(rng.standard_normal()),
            )
        )
    return rows
