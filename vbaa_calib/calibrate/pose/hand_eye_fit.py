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

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize
from scipy.special import chdtri, fdtri

from vbaa_calib.calibrate.lens.models import pose_slopes, projected
from vbaa_calib.camera import Camera
from vbaa_calib.core.least_squares import Rules, levenberg_marquardt, solve_scaled
from vbaa_calib.core.robust import radial_std, soft_l1_weights
from vbaa_calib.geometry import Pose
from vbaa_calib.geometry.independent_axes import independent_axes

_SHARED = 12  # columns of X's tangent and of Z's
_RULES = Rules(60, tolerance=1e-12, takes_last=True, may_rise_share=1e-9)
_STD_LOGS = np.log([(1e-7, 1.0), (1e-7, 1.0), (1.0, 1e9)])  # between them the deviations are sought
_STARTS = (1e-5, 1e-4, 1e-3, 1e-2)
_ROUNDS, _SAME = 8, 1e-3
_REWEIGHTINGS, _SOFT_PER_SIGMA, _STANDSTILL_PX = 10, 1.5, 1e-3
_DIFFERENCE, _LEAST_FREEDOM, _SHARED_DOUBT = 0.05, 3.0, 1.5
"""Between 1, where each direction has a variance of its own, and 2, where all have the same part of each."""


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
        for _ in range(_REWEIGHTINGS):
            residuals, by_pose, _ = self.linearised(camera, pose)
            distances = np.linalg.norm(residuals.reshape(-1, 2), axis=1)
            weights = soft_l1_weights(distances, _SOFT_PER_SIGMA * max(radial_std(distances), 1e-9)).repeat(2)
            weighted = by_pose * weights[:, None]
            step = solve_scaled(weighted.T @ by_pose, weighted.T @ residuals)
            pose = pose.retract(step)
            if np.abs(by_pose @ step).max() < _STANDSTILL_PX:
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
    """A minimum. log_std : (3,) deviations of the logarithms of `std`."""

    rows: _HandEyeRows
    std: np.ndarray
    log_std: np.ndarray

    @property
    def state(self) -> _HandEyeState:
        return self.rows.state

    def covariance_for(self, std: np.ndarray) -> np.ndarray:
        """(12, 12) of X's and Z's tangents, with the lens'."""
        A = self.rows.normal(std).A
        own = solve_scaled(A[:_SHARED, :_SHARED], np.eye(_SHARED))
        by_lens = own @ A[:_SHARED, _SHARED:]
        return own + by_lens @ by_lens.T

    @cached_property
    def freedom(self) -> float:
        """Degrees of freedom of the covariance: the robot's variance is estimated from these few views."""
        own, variance = self.covariance_for(self.std), 0.0
        for which, log_std in zip(np.eye(3), self.log_std, strict=True):
            more = self.covariance_for(self.std * np.exp(_DIFFERENCE * which)) - own
            share = float(np.trace(solve_scaled(own, more))) / (2.0 * _DIFFERENCE * _SHARED)
            variance += max(share, 0.0) ** _SHARED_DOUBT * (2.0 * min(log_std, 1.0)) ** 2
        return max(2.0 / max(variance, 1e-9), _LEAST_FREEDOM)

    @property
    def covariance(self) -> np.ndarray:
        """(12, 12) inflated by the ratio of the 95 % quantiles of Fisher's F and χ²."""
        return self.covariance_for(self.std) * 6.0 * fdtri(6, self.freedom, 0.95) / chdtri(6, 0.05)


@dataclass(frozen=True, eq=False)
class Misfits:
    """Where the board is by a view's own corners, less where the robot's readings put it."""

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
        """With the views of a mask (V,) alone."""
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
        """The rows at a state, and the cost there."""
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
        """At the least cost."""
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

        return levenberg_marquardt(self.linearised(state, std), step, moved, _RULES).at

    def solved(self, state: _HandEyeState, std: np.ndarray) -> HandEyeSolution:
        """The minimum, with the deviations re-estimated from the residuals (REML)."""
        starts = [std, *(np.array([turn, shift, 1.0]) for turn in _STARTS for shift in _STARTS)]
        for _ in range(_ROUNDS):
            rows, before = self._descended(state, std), std
            std, log_std = _deviations(rows, starts)
            starts = [std]
            state = rows.state
            if np.abs(np.log(std / before)).max() < _SAME:
                break
        return HandEyeSolution(self._descended(state, std), std, log_std)

    def board_scale(self, solved: HandEyeSolution) -> tuple[float, float]:
        """By what part the board is larger than stated, if the robot measures right, and its deviation."""
        # a larger board that is seen alike is as much further away
        further = np.array([np.append(np.zeros(3), pose.translation_m) for pose in self.predicted(solved.state)])
        column = -np.einsum("vij,vj->vi", solved.rows.by_pose, further)[..., None]
        # beside the lens' steps; its prior deviation of one constrains nothing
        rows = solved.rows._replace(by_shared=np.concatenate([solved.rows.by_shared, column], axis=-1))
        normal = rows.normal(solved.std)
        inverse = solve_scaled(normal.A, np.eye(len(normal.A)))
        return float((inverse @ normal.b)[-1]), float(np.sqrt(inverse[-1, -1]))

    def misfits(self, solved: HandEyeSolution, seen: Sequence[Pose], kept: np.ndarray, centre_m: np.ndarray) -> Misfits:
        """Of all views, whose corners alone show the board at the poses `seen`, by a solution over those kept (V,)."""
        state = self.start(*solved.state[:2])
        rows, std = self.linearised(state, solved.std), solved.std
        tangents = np.array([own.tangent_from(said) for own, said in zip(seen, self.predicted(state), strict=True)])
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
        shown = [part @ np.linalg.inv(rows.by_pose) for part in (turn, centre)]
        parts = {
            name: np.stack([np.einsum("vij,vjk,vik->v", part, one, part) for part in shown], axis=1)
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
    steps = _DIFFERENCE * np.eye(3)
    second = [
        [
            (badness(found + a + b) - badness(found + a - b) - badness(found - a + b) + badness(found - a - b))
            for b in steps
        ]
        for a in steps
    ]
    spread = np.linalg.pinv(np.array(second) / (4.0 * _DIFFERENCE**2), hermitian=True)
    return np.exp(np.clip(found, *_STD_LOGS.T)), np.sqrt(np.clip(np.diag(spread), 0.0, None))
