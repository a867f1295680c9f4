"""The way of the antenna's base in several strokes, and how clear of the object the free antenna is along it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from vbaa_calib.antenna.rod import RodShape, sample_shape, solve_rod
from vbaa_calib.core.errors import SolveError
from vbaa_calib.geometry import Pose
from vbaa_calib.simulate.scene.objects import WEDGES

from .holding import Bases, Setting

STEP_M = 4e-3
"""How far the free antenna may be carried in one step. Against steps of half a millimetre on a cylinder, μ = 0.3:
the contact's place within 0.3 µm, friction's direction within 0.5° but for the frame of landing, N within 0.5 %."""
MOST_STEPS = 100
_FINE = 24
_CLEAR_M = 2e-3
_DOUBLINGS = 8

Place = tuple[Bases, np.ndarray]
"""Bases, and the free antenna's nodes (B, N, 3) in their frames."""


@dataclass(frozen=True, eq=False)
class Path:
    """B strokes of T frames: the bases (B·T, row by row) and the free antenna's shape in each, antenna frame.

    Attributes
    ----------
    points_m : (B, T, N, 3) nodes of the free antenna. arclength_m : (N,) theirs.
    gravity_world_m_s2 : (3,).
    """

    rotation: np.ndarray
    origin_m: np.ndarray
    points_m: np.ndarray
    arclength_m: np.ndarray
    gravity_world_m_s2: np.ndarray

    def at(self, frame: int, share: float) -> Place:
        """Bases and free nodes (B, N, 3) a share of the way from the frame before to a frame."""
        bases = between(self._bases(frame - 1), self._bases(frame), share, self.gravity_world_m_s2)
        return bases, self.points_m[:, frame - 1] * (1.0 - share) + self.points_m[:, frame] * share

    def _bases(self, frame: int) -> Bases:
        rotation = self.rotation[:, frame]
        return Bases(rotation, self.origin_m[:, frame], self.gravity_world_m_s2 @ rotation)

    def ways(self, frame: int) -> np.ndarray:
        """(B,) how far the free antenna is carried from the frame before to a frame, where that is furthest."""
        ends = [self._bases(i).world(self.points_m[:, i]) for i in (frame - 1, frame)]
        return np.asarray(np.linalg.norm(ends[1] - ends[0], axis=-1).max(axis=1))


def between(start: Bases, end: Bases, share: float, gravity_world_m_s2: np.ndarray) -> Bases:
    """Bases a share of the way from one to another."""
    turn = Rotation.from_matrix(end.rotation @ np.swapaxes(start.rotation, 1, 2)).as_rotvec()
    rotation = Rotation.from_rotvec(share * turn).as_matrix() @ start.rotation
    return Bases(rotation, start.origin_m + share * (end.origin_m - start.origin_m), gravity_world_m_s2 @ rotation)


def refused(count: int, stroke: int, frame: int, reason: str) -> SolveError:
    """The error that names frame and, of several, stroke."""
    return SolveError(f"{f'stroke {stroke}, ' if count > 1 else ''}frame {frame}: {reason}")


def path_of(setting: Setting, strokes: Sequence[Sequence[Pose]], gravity_world_m_s2: np.ndarray) -> Path:
    """Of strokes of poses, with one frame before the first, in which no stroke touches."""
    most = max(len(poses) for poses in strokes)
    filled = [[*poses, *[poses[-1]] * (most - len(poses))] for poses in strokes]
    rotation = np.array([[pose.rotation for pose in poses[:1] + poses] for poses in filled])
    origin = np.array([[pose.translation_m for pose in poses[:1] + poses] for poses in filled])
    gravity = (np.asarray(gravity_world_m_s2, float) @ rotation).reshape(-1, 3)
    middle = np.full(len(gravity), setting.rod.length_m / 2)
    shape = solve_rod(setting.rod, gravity, middle, np.zeros_like(gravity))
    points = shape.points_m.reshape(*rotation.shape[:2], -1, 3)
    path = Path(rotation, origin, points, shape.arclength_m[0], np.asarray(gravity_world_m_s2, float))
    _draw_back(setting, path)
    return path


def _draw_back(setting: Setting, path: Path) -> None:
    """Move the frame before the first out of the object, for strokes that begin in contact."""
    gap, _, _, normal = gaps(setting, *path.at(1, 1.0), path.arclength_m)
    outward = -setting.object.wedge_world if setting.object.shape in WEDGES else normal
    away = np.where(gap < 0.0, _CLEAR_M - gap, 0.0)
    home = path.origin_m[:, 0].copy()
    for _ in range(_DOUBLINGS):
        path.origin_m[:, 0] = home + away[:, None] * outward
        inside = gaps(setting, *path.at(1, 0.0), path.arclength_m)[0] < 0.0
        if not inside.any():
            return
        away = np.where(inside, 2.0 * away, away)
    raise refused(len(gap), int(np.argmax(inside)), 0, "the antenna begins inside the object")


def gaps(
    setting: Setting, bases: Bases, points_m: np.ndarray, arclength_m: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """How clear (B,) the free antenna is of the object, at which arc length (B,), point and normal (B, 3) in the world.

    Where the nearest point lies beyond the object's ends or is the clamp, it counts as clear.
    """
    rows = np.arange(len(points_m))
    nearest = setting.object.rough_distance(bases.world(points_m)).argmin(axis=1)
    low = arclength_m[np.maximum(nearest - 1, 0)]
    high = arclength_m[np.minimum(nearest + 1, len(arclength_m) - 1)]
    fine = low[:, None] + (high - low)[:, None] * np.linspace(0.0, 1.0, _FINE)
    close = bases.world(interpolated(points_m, arclength_m, fine))
    distance, normal = setting.object.signed_distance(close)
    best = distance.argmin(axis=1)
    gap = distance[rows, best] - setting.antenna_radius_m
    passes = ~setting.object.within(close[rows, best]) | (fine[rows, best] < 0.01 * setting.rod.length_m)
    return np.where(passes, np.abs(gap) + _CLEAR_M, gap), fine[rows, best], close[rows, best], normal[rows, best]


def interpolated(points_m: np.ndarray, arclength_m: np.ndarray, at_m: np.ndarray) -> np.ndarray:
    """(B, K, 3) points at arc lengths (B, K) by a smooth curve through nodes (B, N, 3)."""
    tangents = np.gradient(points_m, arclength_m, axis=1)
    tangents /= np.linalg.norm(tangents, axis=-1, keepdims=True)
    nodes = np.broadcast_to(arclength_m, points_m.shape[:2])
    return sample_shape(RodShape(nodes, points_m, tangents, np.empty(0)), at_m)[0]
