"""Linearisation of many contacts at once: predictions and derivatives, without a fit."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from vbaa_calib.antenna.rungs import RUNGS, curves
from vbaa_calib.antenna.shape import Curves
from vbaa_calib.native import core

from .frames import Frames
from .rig_arrays import ANTENNA, UNKNOWNS, RigArrays


class LinearisedFrames(NamedTuple):
    """B linearised contacts, in K = 4 + R unknowns and rig steps.

    Attributes
    ----------
    tangents : (B, 3, M) of the nodes, antenna frame.
    point_force : (B, 6) contact point, m, and force, N, antenna frame. columns : (B, 6, K) their derivatives.
    residual : (B, 3 or 7) of the readings, in deviations. readings : (B, 3 or 7, K) derivatives of the prediction.
    information, side, prior : (B, K, K), (B, K), (B, K) normal equations about the contacts, and the prior's part of
        their diagonal.
    excess : (B,) Σψ²/Σw of the points' Huber ψ and weights, about 1 where they scatter as their deviations say.
    """

    tangents: np.ndarray
    point_force: np.ndarray
    columns: np.ndarray
    residual: np.ndarray
    readings: np.ndarray
    information: np.ndarray
    side: np.ndarray
    prior: np.ndarray
    excess: np.ndarray


def linearised(frames: Frames, rung: str, unknowns: np.ndarray) -> LinearisedFrames:
    """The frames linearised at unknowns (B, 4), with the rig as calibrated."""
    count, size = len(frames), UNKNOWNS + frames.rig_arrays.steps
    read = len(frames.rig_arrays.std)
    shapes = ((3, core.solver.NODES), (6,), (6, size), (read,), (read, size), (size, size), (size,), (size,), ())
    found = LinearisedFrames(*(np.empty((count, *shape)) for shape in shapes))
    rig, at = frames.rig_arrays.core, np.ascontiguousarray(unknowns, float)
    core.solver.linearise(rig, frames, RUNGS.index(rung), at, found)
    return found


def edge_on(rig_arrays: RigArrays, unknowns: np.ndarray) -> np.ndarray:
    """(B,) angle, rad, between the deformation plane 𝒟 of unknowns (B, 4) and the ray to the contact; at 0 the
    antenna looks straight however it bends."""
    return np.asarray(core.solver.edge_on(rig_arrays.core, np.ascontiguousarray(unknowns, float)))


def bend(frames: Frames, rung: str, unknowns: np.ndarray, steps: np.ndarray | None = None) -> Curves:
    """B·K antenna shapes for unknowns (B, K, 4). steps : (B, K, 9) added to the antenna's parameters."""
    rig_arrays, grid = frames.rig_arrays, unknowns.shape[:2]
    parameters = rig_arrays.rig.antenna.parameters + (0.0 if steps is None else steps)
    flat = unknowns.reshape(-1, UNKNOWNS)
    return curves(
        rung,
        np.broadcast_to(parameters, (*grid, ANTENNA)).reshape(-1, ANTENNA),
        rig_arrays.length_m,
        np.broadcast_to(frames.gravity_m_s2[:, None], (*grid, 3)).reshape(-1, 3),
        flat[:, 0] * rig_arrays.length_m,
        flat[:, 1:3] * rig_arrays.force_unit_N,
        flat[:, 3] * rig_arrays.friction_rad,
        rig_arrays.rig.antenna.taper,
    )


def rigs_of(rig_arrays: RigArrays, all_axes: bool = False) -> tuple[Any, ...]:
    """The core's rigs for usual frames (`solve`), for all, for rough minima, and without errors."""
    usual, every, rough = _by_information(rig_arrays)
    return (every if all_axes else usual).core, every.core, rough.core, rig_arrays.exact.core


@lru_cache(maxsize=8)
def _by_information(
    rig_arrays: RigArrays, unseen: float = 0.05, rough: float = 50.0
) -> tuple[RigArrays, RigArrays, RigArrays]:
    """The rig with its errors in fewer axes, with all, and with few. The axes are in the order of what frames of an
    antenna as large as the picture, with a point a pixel, know about them.

    unseen, rough : information about a step of unit deviation, at most, along the axes that are left out: they cannot
        be distinguished from zero, or hardly move a rough minimum.
    """
    shared, others = rig_arrays.axes.shape[1], UNKNOWNS + rig_arrays.line.size

    def columns(axes: int) -> int:
        """The axes as the core stores them, in whole SIMD vectors."""
        return int(-(-(others + axes) // core.solver.LANES) * core.solver.LANES)

    if columns(shared) == columns(0):
        return rig_arrays, rig_arrays, rig_arrays
    frames, unknowns = _typical(rig_arrays)
    found = _information_of_axes(linearised(frames, RUNGS[-1], unknowns), shared)
    axes = np.linalg.eigh(found.mean(axis=0))[1][:, ::-1]
    most = np.einsum("bij,ik,jk->bk", found, axes, axes, optimize=True).max(axis=0)

    def with_axes(least: float) -> RigArrays:
        needed = max(np.flatnonzero(most > least).tolist(), default=-1) + 1
        kept = min(columns(needed) - others, shared)
        return replace(rig_arrays, axes=np.ascontiguousarray(rig_arrays.axes @ axes[:, :kept]))

    usual, every, few = with_axes(unseen), with_axes(-np.inf), with_axes(rough)
    if usual.steps < every.steps:
        usual = replace(usual, most_information=float((1.0 / frames.covariance[0, :, 0]).sum()))
    elif rig_arrays.rig.others:  # its axes are in the order of the cameras
        return rig_arrays, rig_arrays, rig_arrays
    else:
        usual = every
    return usual, every, few


def _information_of_axes(there: LinearisedFrames, shared: int) -> np.ndarray:
    """(B, R, R) information of frames on the steps along R axes, by points and readings, with the contact unknown."""
    # full weight for the readings, which these frames do not have
    less = 1.0 - core.solver.HUBER / np.maximum(np.abs(there.residual), core.solver.HUBER)
    information = there.information + np.swapaxes(there.readings, 1, 2) @ (less[..., None] * there.readings)
    touch = there.columns
    variance = ((touch @ np.linalg.inv(information)) * touch).sum(axis=-1, keepdims=True)
    touch = (touch / np.sqrt(np.maximum(variance, 1e-30)))[..., UNKNOWNS : UNKNOWNS + shared]
    own = slice(UNKNOWNS, UNKNOWNS + shared)
    return np.asarray(information[:, own, own] - np.eye(shared) + np.swapaxes(touch, 1, 2) @ touch)


def _typical(rig_arrays: RigArrays) -> tuple[Frames, np.ndarray]:
    """Frames of contacts all over the antenna under gravity from all sides, and their unknowns (B, 4)."""
    rig = rig_arrays.rig
    tried = (0.25, 0.5, 0.75, 1.0), (0.05, 0.2), 2.0 * np.pi * np.arange(3) / 3
    # the distance, the tip's deflection, both in antenna lengths, and the force's direction
    distance, tip, turn = (each.ravel() for each in np.meshgrid(*tried))
    # the tip's small deflection by a unit force, in antenna lengths
    force = tip / (rig_arrays.unit_load * distance**2 * (3.0 - distance) / 6.0)
    unknowns = np.stack([distance, force * np.cos(turn), force * np.sin(turn), 0.0 * force], axis=1)
    count, read = len(unknowns), len(rig_arrays.std)
    sides = np.concatenate([np.eye(3), -np.eye(3)]) * float(np.linalg.norm(rig.gravity_world_m_s2))
    seen = [one.T_antenna_camera.inverse() for one in rig.cameras.values()]
    size = len(seen) * core.solver.NODES
    camera = np.tile(np.repeat(np.arange(len(seen)), core.solver.NODES), (count, 1))
    std = [one.image.noise_px / np.sqrt(np.prod(np.diag(one.camera.matrix)[:2])) for one in rig.cameras.values()]
    shares = [core.solver.NODES / max(one.camera.image_size) for one in rig.cameras.values()]
    variance = (np.array(std) ** 2 * np.array(shares))[camera][..., None] * np.array([1.0, 0.0, 1.0])
    ends = np.zeros((count, 2)), np.tile([1.0, 0.0, 1.0], (count, 1))
    nothing = np.zeros((count, read)), *ends, np.ones((count, read)), sides[np.arange(count) % len(sides)]
    empty = Frames(
        rig_arrays, np.zeros((count, size, 2)), variance, np.ones((count, size)), *nothing, camera, camera[:, 0].copy()
    )
    nodes_m = bend(empty, RUNGS[-1], unknowns[:, None]).points_m
    places = np.concatenate([each @ nodes_m for each in seen], axis=1)
    usable = places[..., 2] > 0.0
    points = np.where(usable[..., None], places[..., :2] / np.where(usable, places[..., 2], 1.0)[..., None], 0.0)
    return replace(empty, points=np.ascontiguousarray(points), usable=usable * 1.0), unknowns


class FreeAntennas(NamedTuple):
    """Frames as the free antenna: normal equations (B, R, R), (B, R) of the rig's steps with its prior, and an upper
    bound (B,) on the gain by a force."""

    information: np.ndarray
    side: np.ndarray
    gain: np.ndarray


def free_antennas(frames: Frames, steps: np.ndarray | None = None, farthest_std: float = np.inf) -> FreeAntennas:
    """Frames linearised as the free antenna at rig steps (B, R), by default zero. An end farther off than
    `farthest_std` standard deviations, the rig's included, is something else's and not used."""
    count, size, rig = len(frames), frames.rig_arrays.steps, frames.rig_arrays
    found = FreeAntennas(np.empty((count, size, size)), np.empty((count, size)), np.empty(count))
    at = np.zeros((count, size)) if steps is None else np.ascontiguousarray(steps, float)
    core.solver.free_antennas(rig.core, frames, at, farthest_std, found)
    return found
