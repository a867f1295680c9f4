"""Corners of many views in one stack: their residuals and derivatives in one call of the projection."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from .lens_models import PROJECTIONS, LensModel

FLEX = 2
"""Numbers that describe a board that is not flat (`board_flex`)."""


@dataclass(frozen=True, eq=False)
class Observation:
    """Corners of one view: board points (N, 3) m and their pixels (N, 2).

    bend : (N, 2) how far each point rises along the board's z for a metre of each sagitta; a flat board has none.
    """

    points_m: np.ndarray
    pixels: np.ndarray
    bend: np.ndarray | None = None

    def picked(self, which: np.ndarray) -> Observation:
        """The corners of a mask or of indices."""
        bend = None if self.bend is None else self.bend[which]
        return Observation(self.points_m[which], self.pixels[which], bend)


@dataclass(frozen=True, eq=False)
class Stack:
    """All corners one after the other: view `i` has rows bounds[i] to bounds[i + 1]."""

    points_m: np.ndarray
    pixels: np.ndarray
    bend: np.ndarray
    view: np.ndarray
    bounds: np.ndarray

    @staticmethod
    def of(observations: Sequence[Observation]) -> Stack:
        counts = [len(view.pixels) for view in observations]
        return Stack(
            np.concatenate([view.points_m for view in observations]),
            np.concatenate([view.pixels for view in observations]),
            np.concatenate([np.zeros((len(v.pixels), FLEX)) if v.bend is None else v.bend for v in observations]),
            np.repeat(np.arange(len(counts)), counts),
            np.concatenate([[0], np.cumsum(counts)]),
        )


@dataclass(frozen=True, eq=False)
class State:
    """Where the descent is: what all views share (4 + k + 2,), and the poses (V, 6)."""

    shared: np.ndarray
    poses: np.ndarray

    def moved(self, shared: np.ndarray, poses: np.ndarray) -> State:
        """Poses turn about the board's origin by a rotation vector in the camera frame, and shift."""
        turned = Rotation.from_rotvec(poses[:, :3]) * Rotation.from_rotvec(self.poses[:, :3])
        return State(self.shared + shared, np.hstack([turned.as_rotvec(), self.poses[:, 3:] + poses[:, 3:]]))


def rows(model: LensModel, state: State, stack: Stack) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Residuals (N, 2) and their negative derivatives by what is shared (N, 2, 4 + k + 2) and the poses (N, 2, 6)."""
    intrinsics, sagittas = state.shared[:-FLEX], state.shared[-FLEX:]
    rotations = Rotation.from_rotvec(state.poses[:, :3]).as_matrix()[stack.view]
    rise = stack.bend @ sagittas
    turned = np.einsum("nij,nj->ni", rotations, stack.points_m) + rise[:, None] * rotations[:, :, 2]
    points = turned + state.poses[stack.view, 3:]
    pixels, by_intrinsics, by_pose = PROJECTIONS[model.camera_model](points, np.zeros(6), intrinsics)
    by_point = by_pose[:, 3:].reshape(-1, 2, 3)
    # gᵀ(ω × q) = ωᵀ(q × g)
    (x, y, z), (a, b, c) = turned.T[:, :, None], np.moveaxis(by_point, -1, 0)
    by_turn = np.stack([y * c - z * b, z * a - x * c, x * b - y * a], axis=-1)
    by_sagitta = (by_point @ rotations[:, :, 2:]) * stack.bend[:, None, :]
    by_shared = np.concatenate([by_intrinsics.reshape(len(points), 2, -1), by_sagitta], axis=-1)
    return stack.pixels - pixels, by_shared, np.concatenate([by_turn, by_point], axis=-1)
