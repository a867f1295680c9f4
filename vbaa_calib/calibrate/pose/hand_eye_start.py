"""Robot-world/hand-eye calibration X·seen = known·Z in closed form, robust by random subsets."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.spatial.transform import Rotation

from vbaa_calib.geometry import Pose

_ROUNDS, _SHARP_RAD, _SHARP_M = 20, 0.01, 1e-3
_GOOD_SHARE, _LEAST_GOOD = 0.6, 4  # part of the views that a start must explain; others may be wrong
_SUBSETS, _SUBSET, _CONCENTRATIONS, _SEED = 40, 4, 3, 0


def robot_world(known: Sequence[Pose], seen: Sequence[Pose], rounds: int = _ROUNDS) -> tuple[Pose, Pose]:
    """X and Z of X·seen = known·Z by IRLS of distances, so that a few wrong views do not count; one of `rounds` gives
    least squares. The rotations are by Kronecker products (Shah 2013), then the translations linear."""
    turned, looked = (np.array([pose.rotation for pose in poses]) for poses in (known, seen))

    def turns(weights: np.ndarray) -> tuple[tuple[np.ndarray, np.ndarray], np.ndarray]:
        product = np.einsum("p,pji,pkl->iljk", weights, turned, looked).reshape(9, 9)
        left, _, right = np.linalg.svd(product)
        X, Z = _nearest_rotation(right[0].reshape(3, 3)), _nearest_rotation(left[:, 0].reshape(3, 3))
        return (X, Z), np.linalg.norm(X @ looked - turned @ Z, axis=(1, 2))

    X, Z = _least_absolute(turns, len(seen), _SHARP_RAD, rounds)
    right = np.array([pose.translation_m for pose in known]) - np.array([pose.translation_m for pose in seen]) @ X.T
    design = np.concatenate([np.broadcast_to(np.eye(3), turned.shape), -turned], axis=-1)

    def places(weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        root = np.sqrt(weights)[:, None]
        both = np.linalg.lstsq((design * root[..., None]).reshape(-1, 6), (right * root).ravel(), rcond=None)[0]
        return both, np.linalg.norm(design @ both - right, axis=1)

    both = _least_absolute(places, len(seen), _SHARP_M, rounds)
    return Pose(X, both[:3]), Pose(Z, both[3:])


def _least_absolute(
    solve: Callable[[np.ndarray], tuple[Any, np.ndarray]], count: int, sharp: float, rounds: int
) -> Any:
    """The solution of least sum of misfits (P,), not of their squares, by IRLS."""
    weights = np.ones(count)
    for _ in range(rounds):
        solution, misfit = solve(weights)
        weights = 1.0 / np.maximum(misfit, sharp)
    return solution


def _nearest_rotation(matrix: np.ndarray) -> np.ndarray:
    left, _, right = np.linalg.svd(matrix * np.sign(np.linalg.det(matrix)))
    return left @ right


@dataclass(frozen=True, eq=False)
class Start:
    """A consensus of most views."""

    X: Pose  # as in `robot_world`
    Z: Pose
    distances_m: np.ndarray  # (V,) rms of the board's points, seen less predicted; of two poses of a view the nearer
    chosen: np.ndarray  # (V,) which of the two that is
    spread_m: float  # rms over the best views
    good: np.ndarray  # (V,) inliers


def consensus(
    known: Sequence[Pose], seen: Sequence[Sequence[Pose]], points_m: np.ndarray, subsets: int = _SUBSETS
) -> Start:
    """The start whose better 60 % of at least three views fit best, from all views and many small subsets of them; seen
    : of each view one or two poses of the board, points_m (K, 3)."""
    count, first = len(known), [poses[0] for poses in seen]
    good = max(min(count, _LEAST_GOOD), int(np.ceil(_GOOD_SHARE * count)))
    centred = points_m - points_m.mean(axis=0)
    shape = centred.T @ centred / len(centred)
    most = max(map(len, seen))
    every = [[poses[min(k, len(poses) - 1)] for poses in seen] for k in range(most)]
    looked = np.array([[pose.rotation for pose in poses] for poses in every])
    middles = np.array([[pose @ points_m.mean(axis=0) for pose in poses] for poses in every])
    turned, placed = np.array([k.rotation for k in known]), np.array([k.translation_m for k in known])

    def judged(X: Pose, Z: Pose) -> Start:
        turn = X.rotation.T @ turned @ Z.rotation
        middle = ((turned @ (Z @ points_m.mean(axis=0))) + placed - X.translation_m) @ X.rotation
        off = turn - looked
        squares = np.einsum("kvij,jl,kvil->kv", off, shape, off) + ((middle - middles) ** 2).sum(axis=-1)
        distances = np.sqrt(squares.min(axis=0))
        best = np.sort(distances)[:good]
        limit = 4.0 * max(float(best[-1]), 1e-9)
        return Start(X, Z, distances, squares.argmin(axis=0), float(np.sqrt(np.mean(best**2))), distances <= limit)

    def of(which: np.ndarray, chosen: np.ndarray, rounds: int) -> Start:
        poses = [seen[i][min(int(chosen[i]), len(seen[i]) - 1)] for i in which]
        return judged(*robot_world([known[i] for i in which], poses, rounds))

    none, rng = np.zeros(count, int), np.random.default_rng(_SEED)
    starts = [judged(*robot_world(known, first)), judged(*robot_world(known, first, 1))]
    if count > _SUBSET:
        starts += [of(rng.choice(count, _SUBSET, replace=False), none, 1) for _ in range(subsets)]
    starts = sorted(starts, key=lambda start: start.spread_m)[:3]
    for _ in range(_CONCENTRATIONS):
        starts += [of(np.argsort(start.distances_m)[:good], start.chosen, 3) for start in starts[:3]]
        starts = sorted(starts, key=lambda start: start.spread_m)[:3]
    return starts[0]


def other_orders(known: Sequence[Pose], seen: Sequence[Pose], used: np.ndarray) -> dict[str, np.ndarray]:
    """How rows of poses may have been mixed up: of each view in use (V,) the row that would be its own, or −1.

    known : of all rows. seen : of the views in use, whose own rows are `used` (V,). Shifted by one, reversed, and the
    order in which the angles between the views' turns agree best, which do not depend on X and Z.
    """
    count = len(known)
    orders = {
        "are shifted by one: each row belongs to the view after it": used - 1,
        "are shifted by one: each row belongs to the view before it": np.where(used + 1 < count, used + 1, -1),
        "stand in reversed order": count - 1 - used,
    }
    profiles = []
    for poses in ([known[i] for i in used], seen):
        turns = Rotation.from_matrix(np.array([pose.rotation for pose in poses]))
        profiles.append(np.sort([(turns * one.inv()).magnitude() for one in turns], axis=1))
    cost = np.linalg.norm(profiles[1][:, None] - profiles[0][None], axis=-1)
    orders["stand in another order"] = used[linear_sum_assignment(cost)[1]]
    return orders
