"""Distances of seen points from predicted curves, against brute force and OpenCV."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.optimize import minimize_scalar

from vbaa_calib.antenna.shape import Curves, bend
from vbaa_calib.geometry import Pose
from vbaa_calib.rig.reprojection import ImageCurves, image_curves

from .rod_scenes import LENGTH_M, World, camera_pose

T_ANTENNA_CAMERA = camera_pose(0.5, 0.7)


def curves(forces_N: np.ndarray) -> Curves:
    """Bent antennas, one per lateral force (B, 2)."""
    count = len(forces_N)
    gravity = np.tile([0.0, -1.0, -9.7], (count, 1))
    parameters = np.tile(World(T_ANTENNA_CAMERA).parameters, (count, 1))
    return bend(parameters, LENGTH_M, gravity, np.full(count, 0.15), forces_N, sweeps=3)


def fine(image: ImageCurves, which: int = 0, count: int = 60_000) -> tuple[np.ndarray, np.ndarray]:
    """Arc lengths and points of one curve, finely."""
    s = np.linspace(0.0, LENGTH_M, count)
    return s, image.at(which, s)[0]


def distance(image: ImageCurves, which: int, point: np.ndarray) -> float:
    """Least distance of one point from one curve, by search."""
    s, points = fine(image, which, 600)
    near = s[((points - point) ** 2).sum(axis=1).argmin()]
    found = minimize_scalar(
        lambda at: float(np.linalg.norm(image.at(which, np.array([at]))[0][0] - point)),
        bounds=(max(near - 1e-3, 0.0), min(near + 1e-3, LENGTH_M)),
        method="bounded",
        options={"xatol": 1e-9},
    )
    return float(found.fun)


def beside(image: ImageCurves, s: np.ndarray, away: np.ndarray) -> np.ndarray:
    """(N, 2) points at arc lengths s, shifted along the normal."""
    point, slope = image.at(0, s)
    normal = np.stack([-slope[:, 1], slope[:, 0]], axis=1) / np.linalg.norm(slope, axis=1)[:, None]
    return point + away[:, None] * normal


def test_a_thick_antenna_is_seen_midway_between_its_edges() -> None:
    """These are where rays touch it: its surface's normal is square to them."""
    rng, turn, off = np.random.default_rng(4), np.linspace(0.0, 2.0 * np.pi, 200_001), list[tuple[float, float]]()
    while len(off) < 40:
        frame = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        if abs(frame[0, 2]) > 0.8:
            continue
        middle, radius, s = np.array([*rng.uniform(-0.05, 0.05, 2), 0.15]), 1.2e-3, np.linspace(0.0, 0.06, 41)[None]
        axis = middle + (s[..., None] - 0.03) * frame[0]
        curve = Curves(s, axis, np.broadcast_to(frame[0], axis.shape), np.zeros((1, 3)), np.zeros(1))
        thick = image_curves(replace(curve, radius_m=np.full_like(s, radius)), Pose(np.eye(3), np.zeros(3)))
        thin = image_curves(curve, Pose(np.eye(3), np.zeros(3)))
        normals = np.cos(turn)[:, None] * frame[1] + np.sin(turn)[:, None] * frame[2]
        edges = middle + radius * normals[np.flatnonzero(np.diff(np.sign(normals @ middle + radius)))]
        assert len(edges) == 2
        across = thin.slopes[0, 20, ::-1] * [-1.0, 1.0] / np.linalg.norm(thin.slopes[0, 20])
        expected, found = (edges[:, :2] / edges[:, 2:]).mean(axis=0) - thin.nodes[0, 20], thick.nodes - thin.nodes
        off.append((float(expected @ across), float(found[0, 20] @ across)))
    expected, found = np.array(off).T
    np.testing.assert_allclose(found, expected, rtol=0.01, atol=2e-7)
    assert np.abs(expected).max() > 1e-5
