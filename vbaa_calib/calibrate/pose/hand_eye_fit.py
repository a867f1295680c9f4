"""Maximum likelihood of a hand-eye calibration: corners, lens, and the errors of the robot's own poses.

p_camera = X⁻¹·G·E·Z·p_board where the arm holds the board, X⁻¹·E·G⁻¹·Z·p_board where it holds the camera: G is the
robot's reading, E the normal error of each view, a turn and a shift of the tool. Corners of one view share errors of
print, lens and detector, so that the board's poses may err more than the corners' scatter shows.

Deviations `std` are (3,) throughout: of the tool's turns, rad, and shifts, m, per axis, and the factor, 1 or more, on
the corners' own. They are estimated by restricted maximum likelihood (REML), with a penalty that keeps the robot's off
zero (Chung et al. 2013).

X and Z are solved for with the lens fixed; its covariance is in theirs and in the variances of the robot's errors. Of
each view's corners only the six numbers that its own pose can explain take part; the rest is noise, which was already
used where the lens was solved from the same corners.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment, minimize
from scipy.spatial.transform import Rotation
from scipy.special import chdtri, fdtri

from vbaa_calib.calibrate.lens.models import pose_slopes, projected
from vbaa_calib.camera import Camera
from vbaa_calib.core.least_squares import Rules, levenberg_marquardt, solve_scaled
from vbaa_calib.core.robust import radial_std, soft_l1_weights
from vbaa_calib.geometry import Pose
from vbaa_calib.geometry.independent_axes import independent_axes

from .settings import HandEyeSettings


def robot_world(
    known: Sequence[Pose], seen: Sequence[Pose], rounds: int = HandEyeSettings.absolute_rounds
) -> tuple[Pose, Pose]:
    """X and Z of X·seen = known·Z by IRLS of distances, so that a few wrong views do not count; one of `rounds` gives
    least squares. The rotations are by Kronecker products (Shah 2013), then the translations linear."""
    turned, rotations = (np.array([pose.rotation for pose in poses]) for poses in (known, seen))

    def turns(weights: np.ndarray) -> tuple[tuple[np.ndarray, np.ndarray], np.ndarray]:
        product = np.einsum("p,pji,pkl->iljk", weights, turned, rotations).reshape(9, 9)
        left, _, right = np.linalg.svd(product)
        X, Z = _nearest_rotation(right[0].reshape(3, 3)), _nearest_rotation(left[:, 0].reshape(3, 3))
        return (X, Z), np.linalg.norm(X @ rotations - turned @ Z, axis=(1, 2))

    X, Z = _least_absolute(turns, len(seen), HandEyeSettings.sharp_rad, rounds)
    right = np.array([pose.translation_m for pose in known]) - np.array([pose.translation_m for pose in seen]) @ X.T
    design = np.concatenate([np.broadcast_to(np.eye(3), turned.shape), -turned], axis=-1)

    def places(weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        root = np.sqrt(weights)[:, None]
        both = np.linalg.lstsq((design * root[..., None]).reshape(-1, 6), (right * root).ravel(), rcond=None)[0]
        return both, np.linalg.norm(design @ both - right, axis=1)

    both = _least_absolute(places, len(seen), HandEyeSettings.sharp_m, rounds)
    return Pose(X, both[:3]), Pose(Z, both[3:])


def _least_absolute(
    solve: Callable[[np.ndarray], tuple[Any, np.ndarray]], count: int, sharp: float, rounds: int
) -> Any:
    """Minimises the sum of misfits (P,), not of their squares, by IRLS."""
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
    """Start of the solve on which most views agree."""

    X: Pose  # as in `robot_world`
    Z: Pose
    distances_m: np.ndarray  # (V,) rms of the board's points, seen less predicted; of two poses of a view the nearer
    chosen: np.ndarray  # (V,) which of the two that is
    spread_m: float  # rms over the best views
    good: np.ndarray  # (V,) inliers


def consensus(
    known: Sequence[Pose], seen: Sequence[Sequence[Pose]], points_m: np.ndarray, subsets: int = HandEyeSettings.subsets
) -> Start:
    """The start that fits best by its better 60 % of the views, from all views and many small subsets
    of them; seen
    : of each view one or two poses of the board, points_m (K, 3)."""
    count, first = len(known), [poses[0] for poses in seen]
    good = max(min(count, HandEyeSettings.fewest_good), int(np.ceil(HandEyeSettings.good_share * count)))
    centred = points_m - points_m.mean(axis=0)
    shape = centred.T @ centred / len(centred)
    most = max(map(len, seen))
    every = [[poses[min(k, len(poses) - 1)] for poses in seen] for k in range(most)]
    rotations = np.array([[pose.rotation for pose in poses] for poses in every])
    middles = np.array([[pose @ points_m.mean(axis=0) for pose in poses] for poses in every])
    turned, placed = np.array([k.rotation for k in known]), np.array([k.translation_m for k in known])

    def judged(X: Pose, Z: Pose) -> Start:
        turn = X.rotation.T @ turned @ Z.rotation
        middle = ((turned @ (Z @ points_m.mean(axis=0))) + placed - X.translation_m) @ X.rotation
        off = turn - rotations
        squares = np.einsum("kvij,jl,kvil->kv", off, shape, off) + ((middle - middles) ** 2).sum(axis=-1)
        distances = np.sqrt(squares.min(axis=0))
        best = np.sort(distances)[:good]
        limit = 4.0 * max(float(best[-1]), 1e-9)
        return Start(X, Z, distances, squares.argmin(axis=0), float(np.sqrt(np.mean(best**2))), distances <= limit)

    def of(which: np.ndarray, chosen: np.ndarray, rounds: int) -> Start:
        poses = [seen[i][min(int(chosen[i]), len(seen[i]) - 1)] for i in which]
        return judged(*robot_world([known[i] for i in which], poses, rounds))

    none, rng = np.zeros(count, int), np.random.default_rng(0)
    starts = [judged(*robot_world(known, first)), judged(*robot_world(known, first, 1))]
    if count > HandEyeSettings.subset:
        starts += [of(rng.choice(count, HandEyeSettings.subset, replace=False), none, 1) for _ in range(subsets)]
    starts = sorted(starts, key=lambda start: start.spread_m)[:3]
    for _ in range(HandEyeSettings.concentrations):
        starts += [of(np.argsort(start.distances_m)[:good], start.chosen, 3) for start in starts[:3]]
        starts = sorted(starts, key=lambda start: start.spread_m)[:3]
    return starts[0]


def other_orders(known: Sequence[Pose], seen: Sequence[Pose], used: np.ndarray) -> dict[str, np.ndarray]:
    """How rows of poses may have been mixed up: of each view in use (V,) the row that would be its own, or −1.

    known : of all rows. seen : of the views in use, with their own rows `used` (V,). Shifted by one, reversed, and the
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


_SHARED = 12  # columns of X's tangent and of Z's
_STD_LOGS = np.log([(1e-7, 1.0), (1e-7, 1.0), (1.0, 1e9)])  # between them the deviations are sought


@dataclass(frozen=True, eq=False)
class ViewCorners:
    """One view's corners, or points of a board as its measured pose puts them."""

    points_m: np.ndarray  # (N, 3) board frame
    pixels: np.ndarray  # (N, 2), or without a camera (N, 3) m in its frame
    weights: np.ndarray  # (N,) on residuals

    def linearised(self, camera: Camera | None, T_camera_board: Pose) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Weighted residuals (2N,) px, observed less predicted, and derivatives of what is predicted by the pose's
        tangent (2N, 6) and by the lens (2N, 4 + k); without a camera (3N,) m, (3N, 6) and (3N, 0)."""
        lever = self.points_m @ T_camera_board.rotation.T
        pixels = lever + T_camera_board.translation_m
        by_point, by_lens = np.broadcast_to(np.eye(3), (len(lever), 3, 3)), np.zeros((len(lever), 3, 0))
        if camera is not None:
            pixels, by_point, by_lens = projected(camera, pixels)
        residuals = (self.pixels - pixels) * self.weights[:, None]
        weighted, by_lens = (
            (slopes * self.weights[:, None, None]).reshape(residuals.size, -1)
            for slopes in (pose_slopes(by_point, lever), by_lens)
        )
        return residuals.ravel(), weighted, by_lens

    def posed(self, camera: Camera, start: Pose) -> tuple[Pose, np.ndarray]:
        """The pose by IRLS (soft L1) from a start, and the residuals' lengths (N,) px there."""
        pose = start
        for _ in range(HandEyeSettings.reweightings):
            residuals, by_pose, _ = self.linearised(camera, pose)
            distances = np.linalg.norm(residuals.reshape(-1, 2), axis=1)
            weights = soft_l1_weights(distances, HandEyeSettings.soft * max(radial_std(distances), 1e-9)).repeat(2)
            weighted = by_pose * weights[:, None]
            step = solve_scaled(weighted.T @ by_pose, weighted.T @ residuals)
            pose = pose.retract(step)
            if np.abs(by_pose @ step).max() < HandEyeSettings.standstill_px:
                break
        return pose, np.linalg.norm(self.linearised(camera, pose)[0].reshape(-1, 2), axis=1)


_HandEyeState = tuple[Pose, ...]
"""What is solved for: X, Z, and each view's E."""


class _HandEyeRows(NamedTuple):
    """A state, and per view the six numbers that its corners determine, in units of their noise."""

    state: _HandEyeState
    residuals: np.ndarray  # (V, 6) at the state
    # (V, 6, 12 + K) by the tangents of X and Z, and by K independent steps of the lens of unit deviation
    by_shared: np.ndarray
    by_error: np.ndarray  # (V, 6, 6) by the tool's turn and shift
    by_pose: np.ndarray  # (V, 6, 6) by the board's pose
    errors: np.ndarray  # (V, 6) turns and shifts at the state
    cost: float  # of all corners and the robot, the lens fixed

    def normal(self, std: np.ndarray) -> _Normal:
        """The normal equations of X, Z and lens, the robot's errors eliminated."""
        # what would be seen of a robot without errors
        left = self.residuals + np.einsum("vij,vj->vi", self.by_error, self.errors)
        V = std[2] ** 2 * np.eye(6) + (self.by_error * std[:2].repeat(3) ** 2) @ np.swapaxes(self.by_error, 1, 2)
        root = np.linalg.inv(np.linalg.cholesky(V))
        rows = root @ np.concatenate([self.by_shared, left[..., None]], axis=-1)
        product = np.einsum("vki,vkj->ij", rows, rows)
        A = product[:-1, :-1] + np.diag(np.arange(len(product) - 1) >= _SHARED).astype(float)
        spread = -2.0 * float(np.log(np.diagonal(root, axis1=1, axis2=2)).sum())
        return _Normal(A, product[:-1, -1], float(product[-1, -1]), left, V, spread)


class _Normal(NamedTuple):
    """A·step = b, and the squares at no step. left : (V, 6), V : (V, 6, 6) its covariance, and the sum of its log
    determinants.
    """

    A: np.ndarray
    b: np.ndarray
    square: float
    left: np.ndarray
    V: np.ndarray
    log_determinant: float


@dataclass(frozen=True, eq=False)
class HandEyeSolution:
    """Minimum of a hand-eye problem. log_std : (3,) deviations of the logarithms of `std`."""

    rows: _HandEyeRows
    std: np.ndarray
    log_std: np.ndarray

    @property
    def state(self) -> _HandEyeState:
        return self.rows.state

    def covariance_for(self, std: np.ndarray) -> np.ndarray:
        """Covariance (12, 12) of the tangents of X and Z at standard deviations `std`, the lens' uncertainty
        included."""
        A = self.rows.normal(std).A
        own = solve_scaled(A[:_SHARED, :_SHARED], np.eye(_SHARED))
        by_lens = own @ A[:_SHARED, _SHARED:]
        return own + by_lens @ by_lens.T

    @cached_property
    def freedom(self) -> float:
        """Degrees of freedom of the covariance: the robot's variance is estimated from these few views."""
        own, variance = self.covariance_for(self.std), 0.0
        for which, log_std in zip(np.eye(3), self.log_std, strict=True):
            more = self.covariance_for(self.std * np.exp(HandEyeSettings.std_step * which)) - own
            share = float(np.trace(solve_scaled(own, more))) / (2.0 * HandEyeSettings.std_step * _SHARED)
            variance += max(share, 0.0) ** HandEyeSettings.freedom_power * (2.0 * min(log_std, 1.0)) ** 2
        return max(2.0 / max(variance, 1e-9), HandEyeSettings.fewest_freedom)

    @property
    def covariance(self) -> np.ndarray:
        """Covariance (12, 12) of the tangents, inflated by the ratio of the 95 % quantiles of Fisher's F and χ²."""
        return self.covariance_for(self.std) * 6.0 * fdtri(6, self.freedom, 0.95) / chdtri(6, 0.05)


@dataclass(frozen=True, eq=False)
class Misfits:
    """Disagreement of each view: the board's pose by its own corners, less that by the robot's readings."""

    turn_rad: np.ndarray  # (V,) of the board
    distance_m: np.ndarray  # (V,) of its centre
    squares: np.ndarray  # (V,) normalised, six degrees of freedom
    parts: dict[str, np.ndarray]  # "corners", "lens", "robot" → (V, 2) predicted variance, rad² and m²


@dataclass(frozen=True, eq=False)
class HandEyeProblem:
    """V views, the robot's readings of the tool in its base, the camera (None: the board's poses were measured), the
    noise of a corner's coordinate in px (m), and whether the arm holds the camera.
    """

    views: tuple[ViewCorners, ...]
    readings: tuple[Pose, ...]
    camera: Camera | None
    noise_px: float
    in_hand: bool

    def picked(self, which: np.ndarray) -> HandEyeProblem:
        """The same problem with the views of a mask (V,) alone."""
        chosen = np.flatnonzero(which)
        return replace(
            self, views=tuple(self.views[i] for i in chosen), readings=tuple(self.readings[i] for i in chosen)
        )

    @property
    def _lens_axes(self) -> np.ndarray:
        """(4 + k, K) steps of the lens that vary independently by one deviation."""
        if self.camera is None or self.camera.covariance is None:
            return np.zeros((0 if self.camera is None else len(self.camera.parameters), 0))
        axes = independent_axes(self.camera.covariance)
        return axes[:, np.any(axes != 0.0, axis=0)]

    def start(self, X: Pose, Z: Pose) -> _HandEyeState:
        """The state without robot errors."""
        return (X, Z, *(Pose.identity(),) * len(self.views))

    def predicted(self, state: _HandEyeState) -> list[Pose]:
        """T_camera_board of each view."""
        X, Z, *errors = state
        back, both = X.inverse(), zip(self.readings, errors, strict=True)
        return [back @ E @ G.inverse() @ Z if self.in_hand else back @ G @ E @ Z for G, E in both]

    def _tangents(self, state: _HandEyeState, T_camera_board: Pose, view: int) -> np.ndarray:
        """(6, 18) the tangent of a view's board pose by those of X, Z and E."""
        (X, Z, *errors), G = state, self.readings[view]
        E = errors[view]
        R_camera_base = X.rotation.T
        # rotation through which the camera sees what E moves, and the lever about which
        through, inner = (R_camera_base, G.inverse() @ Z) if self.in_hand else (R_camera_base @ G.rotation, Z)
        lever = through @ E.rotation @ inner.translation_m
        R_camera_Z = T_camera_board.rotation @ Z.rotation.T
        found = np.zeros((6, 18))
        found[:3, 0:3] = found[3:, 3:6] = -R_camera_base
        found[3:, 0:3] = _crossed(T_camera_board.translation_m) @ R_camera_base
        found[:3, 6:9] = found[3:, 9:12] = R_camera_Z
        found[:3, 12:15] = found[3:, 15:] = through
        found[3:, 12:15] = -_crossed(lever) @ through
        return found

    def linearised(self, state: _HandEyeState, std: np.ndarray) -> _HandEyeRows:
        """Linearises the problem at a state: rows of each view, and the cost."""
        axes, squares, each = self._lens_axes, 0.0, []
        for index, (view, pose) in enumerate(zip(self.views, self.predicted(state), strict=True)):
            residuals, tangents, by_lens = (part / self.noise_px for part in view.linearised(self.camera, pose))
            basis, factor = np.linalg.qr(tangents)
            own, slopes = basis.T @ residuals, factor @ self._tangents(state, pose, index)
            squares += float(residuals @ residuals) / std[2] ** 2
            shared = np.hstack([slopes[:, :_SHARED], basis.T @ by_lens @ axes])
            each.append((own, shared, slopes[:, _SHARED:], factor))
        own, by_shared, by_error, by_pose = (np.array(parts) for parts in zip(*each, strict=True))
        errors = np.array([E.vector for E in state[2:]])
        squares += float(((errors / std[:2].repeat(3)) ** 2).sum())
        return _HandEyeRows(state, own, by_shared, by_error, by_pose, errors, 0.5 * squares)

    def _descended(self, state: _HandEyeState, std: np.ndarray) -> _HandEyeRows:
        """Minimises the cost at standard deviations `std`."""
        variance = std[:2].repeat(3) ** 2

        def step(at: _HandEyeRows, damping: float) -> tuple[np.ndarray, float]:
            normal = at.normal(std)
            A, b = normal.A[:_SHARED, :_SHARED], normal.b[:_SHARED]
            move = solve_scaled(A, b, damping)
            left = normal.left - at.by_shared[..., :_SHARED] @ move
            errors = variance * np.einsum("vji,vj->vi", at.by_error, np.linalg.solve(normal.V, left[..., None])[..., 0])
            own = errors - at.errors
            promise = 0.5 * float(2.0 * b @ move - move @ A @ move + (own**2 / variance).sum())
            return np.concatenate([move, own.ravel()]), promise

        def moved(at: _HandEyeRows, move: np.ndarray) -> _HandEyeRows:
            steps = move.reshape(-1, 6)
            return self.linearised(tuple(pose.retract(own) for pose, own in zip(at.state, steps, strict=True)), std)

        rules = Rules(60, tolerance=1e-12, takes_last=True, may_rise_share=1e-9)
        return levenberg_marquardt(self.linearised(state, std), step, moved, rules).at

    def solved(self, state: _HandEyeState, std: np.ndarray) -> HandEyeSolution:
        """Solves for state and standard deviations by turns, the latter from the residuals (REML)."""
        starts = [
            std,
            *(
                np.array([turn, shift, 1.0])
                for turn in HandEyeSettings.std_starts
                for shift in HandEyeSettings.std_starts
            ),
        ]
        for _ in range(HandEyeSettings.variance_rounds):
            rows, before = self._descended(state, std), std
            std, log_std = _deviations(rows, starts)
            starts = [std]
            state = rows.state
            if np.abs(np.log(std / before)).max() < HandEyeSettings.variance_change:
                break
        return HandEyeSolution(self._descended(state, std), std, log_std)

    def board_scale(self, solved: HandEyeSolution) -> tuple[float, float]:
        """Relative excess of the board's size over the stated one, by the robot's lengths, and its standard
        deviation."""
        # a larger board that is seen alike is as much further away
        further = np.array([np.append(np.zeros(3), pose.translation_m) for pose in self.predicted(solved.state)])
        column = -np.einsum("vij,vj->vi", solved.rows.by_pose, further)[..., None]
        # beside the lens' steps; its prior deviation of one constrains nothing
        rows = solved.rows._replace(by_shared=np.concatenate([solved.rows.by_shared, column], axis=-1))
        normal = rows.normal(solved.std)
        inverse = solve_scaled(normal.A, np.eye(len(normal.A)))
        return float((inverse @ normal.b)[-1]), float(np.sqrt(inverse[-1, -1]))

    def misfits(self, solved: HandEyeSolution, seen: Sequence[Pose], kept: np.ndarray, centre_m: np.ndarray) -> Misfits:
        """Misfits of all views, the board at poses `seen` by their corners alone, by a solution over those kept
        (V,)."""
        state = self.start(*solved.state[:2])
        rows, std = self.linearised(state, solved.std), solved.std
        tangents = np.array(
            [own.tangent_from(predicted) for own, predicted in zip(seen, self.predicted(state), strict=True)]
        )
        V, fit = rows.normal(std).V, solved.rows.normal(std)
        # judged for the lens that fits the robot best: shared errors must not hide a single one
        inverse = solve_scaled(fit.A, np.eye(len(fit.A)))
        off = np.einsum("vij,vj->vi", rows.by_pose, tangents) - rows.by_shared @ (inverse @ fit.b)
        of_shared = rows.by_shared @ inverse @ np.swapaxes(rows.by_shared, 1, 2)
        # a kept view has pulled the solution towards itself
        values, axes = np.linalg.eigh(V + np.where(kept, -1.0, 1.0)[:, None, None] * of_shared)
        squares = (np.einsum("vji,vj->vi", axes, off) ** 2 / np.maximum(values, 1e-9)).sum(axis=1)

        robot = (rows.by_error * std[:2].repeat(3) ** 2) @ np.swapaxes(rows.by_error, 1, 2)
        fixed, of_lens = rows.by_shared[..., :_SHARED], rows.by_shared[..., _SHARED:]
        own = solve_scaled(fit.A[:_SHARED, :_SHARED], np.eye(_SHARED))
        taken = own @ np.swapaxes(fixed, 1, 2) @ np.linalg.inv(V) * kept[:, None, None]
        # a turn moves the board's centre, too
        levers = np.array([_crossed(pose.rotation @ centre_m) for pose in seen])
        turn, unit = np.broadcast_to(np.eye(3, 6), (len(seen), 3, 6)), np.broadcast_to(np.eye(3), levers.shape)
        centre = np.concatenate([-levers, unit], axis=-1)

        def left(one: np.ndarray) -> np.ndarray:
            """(V, 6, 6) what the solution leaves of errors (V, 6, 6) that the views do not share."""
            through = fixed @ taken @ one
            both = np.einsum("vij,vjk,vlk->il", taken, one, taken)
            return one - through - np.swapaxes(through, 1, 2) + fixed @ both @ np.swapaxes(fixed, 1, 2)

        common = of_lens - fixed @ np.einsum("vij,vjk->ik", taken, of_lens)
        sources = {
            "corners": left(np.broadcast_to(std[2] ** 2 * np.eye(6), V.shape)),
            "lens": common @ np.swapaxes(common, 1, 2),
            "robot": left(robot),
        }
        slopes = [part @ np.linalg.inv(rows.by_pose) for part in (turn, centre)]
        parts = {
            name: np.stack([np.einsum("vij,vjk,vik->v", part, one, part) for part in slopes], axis=1)
            for name, one in sources.items()
        }
        shift = np.einsum("vij,vj->vi", centre, tangents)
        return Misfits(np.linalg.norm(tangents[:, :3], axis=1), np.linalg.norm(shift, axis=1), squares, parts)


def _crossed(vector: np.ndarray) -> np.ndarray:
    """(3, 3) [v]× of a vector (3,): [v]× w = v × w."""
    return np.cross(vector, np.eye(3)).T


def _deviations(rows: _HandEyeRows, starts: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """(3,) deviations, and those of their logarithms; the best start is taken, for there are flat stretches."""

    def badness(logs: np.ndarray) -> float:
        inside = np.clip(logs, *_STD_LOGS.T)
        normal = rows.normal(np.exp(inside))
        least = normal.square - float(normal.b @ solve_scaled(normal.A, normal.b))
        unit = np.sqrt(np.maximum(np.diag(normal.A), 1e-30))
        determinant = np.linalg.slogdet(normal.A / np.outer(unit, unit))[1] + 2.0 * np.log(unit).sum()
        outside = 1e3 * float(np.abs(logs - inside).sum())
        return 0.5 * (normal.log_determinant + determinant + least) - float(inside[:2].sum()) + outside

    best = min(np.log(starts), key=badness)
    options = {"xatol": 1e-3, "fatol": 1e-6, "maxiter": 150}
    found = minimize(badness, best, method="Nelder-Mead", options=options).x
    steps = HandEyeSettings.std_step * np.eye(3)
    second = [
        [
            (badness(found + a + b) - badness(found + a - b) - badness(found - a + b) + badness(found - a - b))
            for b in steps
        ]
        for a in steps
    ]
    spread = np.linalg.pinv(np.array(second) / (4.0 * HandEyeSettings.std_step**2), hermitian=True)
    return np.exp(np.clip(found, *_STD_LOGS.T)), np.sqrt(np.clip(np.diag(spread), 0.0, None))
