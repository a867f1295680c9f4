"""The solver's derivatives, normal equations and deviations against NumPy: dense curves, every point by itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg
from scipy.interpolate import CubicHermiteSpline
from scipy.spatial import cKDTree

from benchmarks.estimator.setup import Setup
from estimator.solver.frames import Frames
from estimator.solver.ladder import solve
from estimator.solver.linearised import bend, linearised
from vbaa_calib.antenna.nodes import aligned_arclength
from vbaa_calib.core.robust import huber_weights

from .contact_scenes import frames_of, rubbed

FRICTION_RAD, STEP = 0.2, 1e-4
CONTACTS, SLOPES_DEG = [0.35, 0.6, 0.85], [4.0, 12.0, 25.0]


def touched(lens: str, exact: bool = True, outliers: bool = True) -> tuple[Frames, np.ndarray]:
    """Three frames with noise, perhaps a few points that are far off, and unknowns (3, 4) somewhat off the truth."""
    rng = np.random.default_rng(0)
    rig = Setup(lens=lens, real=True, exact=False).rig()
    rig = replace(rig, antenna=replace(rig.antenna, diameter_m=1e-5))  # so thin that its axis is seen
    given = rubbed(rig, CONTACTS, SLOPES_DEG, 0.05).noisy(rng)
    given.points_px[:, 5::17] += [1.5, -1.0] if outliers else 0.0
    frames = frames_of(given, FRICTION_RAD, exact)
    force = given.touches.push_N / frames.rig_arrays.force_unit_N
    unknowns = np.column_stack([CONTACTS, force, np.full(3, 0.4)])
    return frames, unknowns * [1.002, 1.01, 0.99, 1.0]


def off_curve(frames: Frames, rung: str, unknowns: np.ndarray) -> np.ndarray:
    """(B, N) of the points off the curve that unknowns predict, along its normal, in the ideal picture."""
    rig, length_m = frames.rig_arrays.rig, frames.rig_arrays.length_m
    curves = bend(frames, rung, unknowns[:, None])
    nodes, dense = aligned_arclength(unknowns[:, 0] * length_m, length_m), np.linspace(0.0, length_m, 20_001)
    off = np.empty(frames.points.shape[:2])
    for b, points in enumerate(frames.points):
        along = CubicHermiteSpline(nodes[b], curves.points_m[b], curves.tangents[b])(dense)
        seen = rig.T_antenna_camera.inverse() @ along
        picture = seen[:, :2] / seen[:, 2:]
        foot = np.clip(cKDTree(picture).query(points)[1], 1, len(dense) - 2)
        direction = picture[foot + 1] - picture[foot - 1]
        normal = np.column_stack([-direction[:, 1], direction[:, 0]]) / np.linalg.norm(direction, axis=1)[:, None]
        off[b] = ((points - picture[foot]) * normal).sum(axis=-1)
    return off


def normals(frames: Frames, rung: str, unknowns: np.ndarray, off: np.ndarray) -> np.ndarray:
    """(B, N, 2) of the curve's picture where the points are nearest, which are so far off it."""
    moved = [replace(frames, points=frames.points + 1e-7 * axis) for axis in np.eye(2)]
    return np.stack([(off_curve(there, rung, unknowns) - off) / 1e-7 for there in moved], axis=-1)


def differences(frames: Frames, rung: str, unknowns: np.ndarray, of: str) -> np.ndarray:
    """(B, ..., 4) central differences, by the unknowns, of what `Linearised` gives."""
    found: list[np.ndarray] = []
    for step in STEP * np.eye(4):
        after, before = (linearised(frames, rung, unknowns + sign * step) for sign in (1, -1))
        found.append((getattr(after, of) - getattr(before, of)) / (2 * STEP))
    return np.stack(found, axis=-1)


@pytest.mark.parametrize("rung", ["linear", "elastica", "rod"])
def test_derivatives_by_the_unknowns_are_differences(rung: str) -> None:
    frames, unknowns = touched("brown", exact=False)
    here = linearised(frames, rung, unknowns)
    for of, columns, sign in (("point_force", here.columns, 1), ("residual", here.readings, -1)):
        expected = sign * differences(frames, rung, unknowns, of)
        if rung == "linear" and of == "point_force":
            expected[:, 4:] = here.columns[:, 4:, :4]  # friction turns the force to first order only
        size = np.abs(expected).max(axis=-1, keepdims=True) + 1e-12
        assert (np.abs(columns[..., :4] - expected) < 5e-3 * size).all(), of


@pytest.mark.parametrize("lens", ["brown", "fisheye"])
@pytest.mark.parametrize("rung", ["paper", "rod"])
def test_normal_equations_are_sums_over_points(lens: str, rung: str) -> None:
    """Distances to a dense curve, differentiated by differences, weighted by Huber."""
    frames, unknowns = touched(lens)
    here = linearised(frames, rung, unknowns)
    off = off_curve(frames, rung, unknowns)
    moved = [[off_curve(frames, rung, unknowns + sign * step) for sign in (-1, 1)] for step in STEP * np.eye(4)]
    slopes = np.stack([before - after for before, after in moved], axis=-1) / (2 * STEP)
    across = normals(frames, rung, unknowns, off)
    for b in range(len(unknowns)):
        (xx, xy, yy), (u, v) = frames.covariance[b].T, across[b].T
        variance = xx * u * u + 2.0 * xy * u * v + yy * v * v
        weight = huber_weights(off[b] / np.sqrt(variance)) / variance
        readings, weights = here.readings[b], huber_weights(here.residual[b])
        information = (slopes[b].T * weight) @ slopes[b] + (readings.T * weights) @ readings + np.diag(here.prior[b])
        side = slopes[b].T @ (weight * off[b]) + readings.T @ (weights * here.residual[b]) - here.prior[b] * unknowns[b]
        scale = np.sqrt(np.diag(information))
        assert (np.abs(here.information[b] - information) < 2e-3 * np.outer(scale, scale)).all()
        assert (np.abs(here.side[b] - side) < 2e-3 * (np.abs(side) + scale)).all()


def test_deviations_are_those_of_the_inverted_information() -> None:
    frames, _ = touched("brown", outliers=False)
    found = solve(frames, "rod")
    here = linearised(frames, "rod", found.unknowns)
    for std, information in zip(found.std, here.information, strict=True):
        np.testing.assert_allclose(std, np.sqrt(np.diag(scipy.linalg.inv(information))), rtol=1e-3)
