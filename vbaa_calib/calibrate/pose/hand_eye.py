"""Hand-eye calibration: where the camera sits on a robot's arm, or stands in its base, from poses and board views.

X is the camera in what carries it (the tool, or the base), Z the board in the other: X·T_camera_board = K·Z, K the
robot's pose of the one in the other. A robot's pose is less certain than a corner, so the standard deviations of its
turns and shifts are part of the model:

p_camera = X⁻¹·G·E·Z·p_board where the arm holds the board, X⁻¹·E·G⁻¹·Z·p_board where it holds the camera: G is the
robot's reading, E the normal error of each view, a turn and a shift of the tool. Corners of one view share errors of
print, lens and detector, so that the board's poses may err more than the corners' scatter shows.

Standard deviations `std` are (3,) throughout: of the tool's turns, rad, and shifts, m, per axis, and the factor, 1 or
more, on the corners' own. They are estimated by restricted maximum likelihood (REML), with a penalty that keeps the
robot's off zero (Chung et al. 2013).

X and Z are solved for with the lens fixed; its covariance is in theirs and in the variances of the robot's errors. Of
each view's corners only the six numbers that its own pose can explain take part; the rest is noise, which was already
used where the lens was solved from the same corners.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from vbaa_calib.camera import Camera
from vbaa_calib.core.arrays import validate_arguments
from vbaa_calib.core.errors import InputError, SolveError
from vbaa_calib.core.least_squares import SOFT_L1, Rules, levenberg_marquardt, solve_scaled
from vbaa_calib.core.robust import chi_limit, radial_std
from vbaa_calib.detect.board.corners import BoardView, require_corners
from vbaa_calib.detect.board.view_quality import fixes_homography
from vbaa_calib.geometry import Pose
from vbaa_calib.geometry.covariance import independent_axes, largest_std

from .board_pose import SeenBoard, mirrored, require_size, start_poses, turn_between
from .settings import HandEyeSettings


def robot_world(
    known: Sequence[Pose], seen: Sequence[Pose], rounds: int = HandEyeSettings.absolute_rounds
) -> tuple[Pose, Pose]:
    """X and Z of X·seen = known·Z by iteratively reweighted least absolute distances, which is robust to a few wrong
    views; rounds = 1 gives least squares. The rotations come from Kronecker products (Shah 2013), then the
    translations are linear."""
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
    """Minimises the sum of the residual norms (P,) instead of their squares, by IRLS."""
    weights = np.ones(count)
    for _ in range(rounds):
        solution, misfit = solve(weights)
        weights = 1.0 / np.maximum(misfit, sharp)
    return solution


def _nearest_rotation(matrix: np.ndarray) -> np.ndarray:
    left, _, right = np.linalg.svd(matrix * np.sign(np.linalg.det(matrix)))
    return left @ right


@dataclass(frozen=True, eq=False)
class _Start:
    """Initial value of the solve, on which most views agree."""

    X: Pose  # as in `robot_world`
    Z: Pose
    distances_m: np.ndarray  # (V,) rms of the board's points, seen less predicted; of two poses of a view the nearer
    chosen: np.ndarray  # (V,) which of the two that is
    spread_m: float  # rms over the best views
    good: np.ndarray  # (V,) inliers


def _consensus(
    known: Sequence[Pose], seen: Sequence[Sequence[Pose]], points_m: np.ndarray, subsets: int = HandEyeSettings.subsets
) -> _Start:
    """The best initial value among those from all views and from many small subsets, judged by the better 60 % of the
    views.

    seen : of each view one or two poses of the board. points_m : (K, 3).
    """
    count, first = len(known), [poses[0] for poses in seen]
    good = max(min(count, HandEyeSettings.fewest_good), int(np.ceil(HandEyeSettings.good_share * count)))
    centred = points_m - points_m.mean(axis=0)
    shape = centred.T @ centred / len(centred)
    most = max(map(len, seen))
    every = [[poses[min(k, len(poses) - 1)] for poses in seen] for k in range(most)]
    rotations = np.array([[pose.rotation for pose in poses] for poses in every])
    middles = np.array([[pose @ points_m.mean(axis=0) for pose in poses] for poses in every])
    turned, placed = np.array([k.rotation for k in known]), np.array([k.translation_m for k in known])

    def judged(X: Pose, Z: Pose) -> _Start:
        turn = X.rotation.T @ turned @ Z.rotation
        middle = ((turned @ (Z @ points_m.mean(axis=0))) + placed - X.translation_m) @ X.rotation
        off = turn - rotations
        squares = np.einsum("kvij,jl,kvil->kv", off, shape, off) + ((middle - middles) ** 2).sum(axis=-1)
        distances = np.sqrt(squares.min(axis=0))
        best = np.sort(distances)[:good]
        limit = 4.0 * max(float(best[-1]), 1e-9)
        return _Start(X, Z, distances, squares.argmin(axis=0), float(np.sqrt(np.mean(best**2))), distances <= limit)

    def of(which: np.ndarray, chosen: np.ndarray, rounds: int) -> _Start:
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


def _other_orders(known: Sequence[Pose], seen: Sequence[Pose], used: np.ndarray) -> dict[str, np.ndarray]:
    """Candidate permutations of mixed-up pose rows: for each view in use (V,) the row that would be its own, or −1.

    known : of all rows. seen : of the views in use, with their own rows `used` (V,). Shifted by one, reversed, and the
    order in which the angles between the views' turns agree best, which do not depend on X and Z.
    """
    from scipy.optimize import linear_sum_assignment  # slow to load
    from scipy.spatial.transform import Rotation

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


_HandEyeState = tuple[Pose, ...]
"""What is solved for: X, Z, and each view's E."""


class _HandEyeRows(NamedTuple):
    """A linearisation point, and per view the six whitened numbers that its corners determine."""

    state: _HandEyeState
    residuals: np.ndarray  # (V, 6) at the state
    # (V, 6, 12 + K) by the tangents of X and Z, and by K independent steps of the lens of unit deviation
    by_shared: np.ndarray
    by_error: np.ndarray  # (V, 6, 6) by the tool's turn and shift
    by_pose: np.ndarray  # (V, 6, 6) by the board's pose
    errors: np.ndarray  # (V, 6) turns and shifts at the state
    cost: float  # of all corners and the robot, the lens fixed

    def normal(self, std: np.ndarray) -> tuple[np.ndarray, np.ndarray, float, np.ndarray, np.ndarray, float]:
        """The normal equations A·step = b of X, Z and lens, with the robot's errors eliminated, and the sum of squares
        at step 0; residuals (V, 6), their covariances (V, 6, 6), and the sum of their log determinants."""
        # what would be seen of a robot without errors
        unadjusted = self.residuals + np.einsum("vij,vj->vi", self.by_error, self.errors)
        V = std[2] ** 2 * np.eye(6) + (self.by_error * std[:2].repeat(3) ** 2) @ np.swapaxes(self.by_error, 1, 2)
        root = np.linalg.inv(np.linalg.cholesky(V))
        rows = root @ np.concatenate([self.by_shared, unadjusted[..., None]], axis=-1)
        product = np.einsum("vki,vkj->ij", rows, rows)
        A = product[:-1, :-1] + np.diag(np.arange(len(product) - 1) >= _SHARED).astype(float)
        spread = -2.0 * float(np.log(np.diagonal(root, axis1=1, axis2=2)).sum())
        return A, product[:-1, -1], float(product[-1, -1]), unadjusted, V, spread


@dataclass(frozen=True, eq=False)
class _HandEyeSolution:
    """Minimum of a hand-eye problem. log_std : (3,) standard deviations of the logarithms of `std`."""

    rows: _HandEyeRows
    std: np.ndarray
    log_std: np.ndarray

    @property
    def state(self) -> _HandEyeState:
        return self.rows.state

    def covariance_for(self, std: np.ndarray) -> np.ndarray:
        """Covariance (12, 12) of the tangents of X and Z for the standard deviations `std`, with the lens's
        uncertainty."""
        A = self.rows.normal(std)[0]
        own = solve_scaled(A[:_SHARED, :_SHARED], np.eye(_SHARED))
        by_lens = own @ A[:_SHARED, _SHARED:]
        return own + by_lens @ by_lens.T

    @cached_property
    def freedom(self) -> float:
        """Degrees of freedom of the covariance, finite because the robot's variance is estimated from these few
        views."""
        own, variance = self.covariance_for(self.std), 0.0
        for which, log_std in zip(np.eye(3), self.log_std, strict=True):
            more = self.covariance_for(self.std * np.exp(HandEyeSettings.std_step * which)) - own
            share = float(np.trace(solve_scaled(own, more))) / (2.0 * HandEyeSettings.std_step * _SHARED)
            variance += max(share, 0.0) ** HandEyeSettings.freedom_power * (2.0 * min(log_std, 1.0)) ** 2
        return max(2.0 / max(variance, 1e-9), HandEyeSettings.fewest_freedom)

    @property
    def covariance(self) -> np.ndarray:
        """Covariance (12, 12) of the tangents, inflated by the ratio of the 95 % quantiles of the F and χ²
        distributions."""
        from scipy.special import fdtri  # slow to load

        return self.covariance_for(self.std) * 6.0 * fdtri(6, self.freedom, 0.95) / chi_limit(0.05, 6) ** 2


_Misfits = tuple[np.ndarray, np.ndarray, np.ndarray, dict[str, np.ndarray]]
"""Difference of each view's board pose by its own corners from that by the robot's readings: (V,) turn of the board,
rad, (V,) distance of its centre, m, (V,) their square, normalised, with six degrees of freedom, and by "corners",
"lens" and "robot" the predicted variance (V, 2), rad² and m²."""


@dataclass(frozen=True, eq=False)
class _HandEyeProblem:
    """A hand-eye problem: V views, the robot's readings of the tool in its base, the camera (None: the board's poses
    were measured), the noise of a corner's coordinate in px (m), and whether the arm holds the camera."""

    views: tuple[SeenBoard, ...]
    readings: tuple[Pose, ...]
    camera: Camera | None
    noise_px: float
    in_hand: bool

    def picked(self, which: np.ndarray) -> _HandEyeProblem:
        """The problem with only the views of a mask (V,)."""
        chosen = np.flatnonzero(which)
        return replace(
            self, views=tuple(self.views[i] for i in chosen), readings=tuple(self.readings[i] for i in chosen)
        )

    @property
    def _lens_axes(self) -> np.ndarray:
        """(4 + k, K) independent directions of the lens's covariance, one standard deviation long."""
        if self.camera is None or self.camera.covariance is None:
            return np.zeros((0 if self.camera is None else len(self.camera.parameters), 0))
        axes = independent_axes(self.camera.covariance)
        return axes[:, np.any(axes != 0.0, axis=0)]

    def start(self, X: Pose, Z: Pose) -> _HandEyeState:
        """The initial state, without robot errors."""
        return (X, Z, *(Pose.identity(),) * len(self.views))

    def predicted(self, state: _HandEyeState) -> list[Pose]:
        """Predicted T_camera_board of each view."""
        X, Z, *errors = state
        back, both = X.inverse(), zip(self.readings, errors, strict=True)
        return [back @ E @ G.inverse() @ Z if self.in_hand else back @ G @ E @ Z for G, E in both]

    def _tangents(self, state: _HandEyeState, T_camera_board: Pose, view: int) -> np.ndarray:
        """(6, 18) derivatives of a view's board pose (tangent) by the tangents of X, Z and E."""
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
        """Each view's rows at a state, and the cost."""
        axes, squares, each = self._lens_axes, 0.0, []
        for index, (view, pose) in enumerate(zip(self.views, self.predicted(state), strict=True)):
            residuals, tangents, by_lens = (
                part / self.noise_px for part in (-view.residual(pose), *view.derivatives(pose))
            )
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
            A, b, _, unadjusted, V, _ = at.normal(std)
            A, b = A[:_SHARED, :_SHARED], b[:_SHARED]
            move = solve_scaled(A, b, damping)
            unadjusted = unadjusted - at.by_shared[..., :_SHARED] @ move
            errors = variance * np.einsum("vji,vj->vi", at.by_error, np.linalg.solve(V, unadjusted[..., None])[..., 0])
            own = errors - at.errors
            promise = 0.5 * float(2.0 * b @ move - move @ A @ move + (own**2 / variance).sum())
            return np.concatenate([move, own.ravel()]), promise

        def moved(at: _HandEyeRows, move: np.ndarray) -> _HandEyeRows:
            steps = move.reshape(-1, 6)
            return self.linearised(tuple(pose.retract(own) for pose, own in zip(at.state, steps, strict=True)), std)

        rules = Rules(60, tolerance=1e-12, takes_last=True, may_rise_share=1e-9)
        return levenberg_marquardt(self.linearised(state, std), step, moved, rules)[0]

    def solved(self, state: _HandEyeState, std: np.ndarray) -> _HandEyeSolution:
        """Solves for state and standard deviations in turn, the latter from the residuals (REML)."""
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
        return _HandEyeSolution(self._descended(state, std), std, log_std)

    def board_scale(self, solved: _HandEyeSolution) -> tuple[float, float]:
        """Relative excess of the board's size over the stated one by the robot's translations, with its standard
        deviation."""
        # a larger board that is seen alike is as much further away
        further = np.array([np.append(np.zeros(3), pose.translation_m) for pose in self.predicted(solved.state)])
        column = -np.einsum("vij,vj->vi", solved.rows.by_pose, further)[..., None]
        # next to the lens's steps; its prior deviation of one constrains nothing
        rows = solved.rows._replace(by_shared=np.concatenate([solved.rows.by_shared, column], axis=-1))
        A, b, *_ = rows.normal(solved.std)
        inverse = solve_scaled(A, np.eye(len(A)))
        return float((inverse @ b)[-1]), float(np.sqrt(inverse[-1, -1]))

    def misfits(
        self, solved: _HandEyeSolution, seen: Sequence[Pose], kept: np.ndarray, centre_m: np.ndarray
    ) -> _Misfits:
        """Misfits of all views relative to a solution from the views `kept` (V,). seen : the board poses by each
        view's own corners."""
        state = self.start(*solved.state[:2])
        rows, std = self.linearised(state, solved.std), solved.std
        tangents = np.array(
            [own.tangent_from(predicted) for own, predicted in zip(seen, self.predicted(state), strict=True)]
        )
        V, (A, b, *_) = rows.normal(std)[4], solved.rows.normal(std)
        # judged for the lens that fits the robot best: shared errors must not hide a single one
        inverse = solve_scaled(A, np.eye(len(A)))
        off = np.einsum("vij,vj->vi", rows.by_pose, tangents) - rows.by_shared @ (inverse @ b)
        of_shared = rows.by_shared @ inverse @ np.swapaxes(rows.by_shared, 1, 2)
        # a kept view has pulled the solution towards itself
        values, axes = np.linalg.eigh(V + np.where(kept, -1.0, 1.0)[:, None, None] * of_shared)
        squares = (np.einsum("vji,vj->vi", axes, off) ** 2 / np.maximum(values, 1e-9)).sum(axis=1)

        robot = (rows.by_error * std[:2].repeat(3) ** 2) @ np.swapaxes(rows.by_error, 1, 2)
        fixed, of_lens = rows.by_shared[..., :_SHARED], rows.by_shared[..., _SHARED:]
        own = solve_scaled(A[:_SHARED, :_SHARED], np.eye(_SHARED))
        taken = own @ np.swapaxes(fixed, 1, 2) @ np.linalg.inv(V) * kept[:, None, None]
        # a turn moves the board's centre, too
        levers = np.array([_crossed(pose.rotation @ centre_m) for pose in seen])
        turn, unit = np.broadcast_to(np.eye(3, 6), (len(seen), 3, 6)), np.broadcast_to(np.eye(3), levers.shape)
        centre = np.concatenate([-levers, unit], axis=-1)

        def left(one: np.ndarray) -> np.ndarray:
            """(V, 6, 6) covariance of the residuals, from errors (V, 6, 6) that are independent between views."""
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
        return np.linalg.norm(tangents[:, :3], axis=1), np.linalg.norm(shift, axis=1), squares, parts


def _crossed(vector: np.ndarray) -> np.ndarray:
    """(3, 3) [v]× of a vector (3,): [v]× w = v × w."""
    return np.cross(vector, np.eye(3)).T


def _deviations(rows: _HandEyeRows, starts: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """(3,) REML standard deviations, and those of their logarithms; several initial values are tried because the
    likelihood has flat stretches."""

    from scipy.optimize import minimize  # slow to load

    def badness(logs: np.ndarray) -> float:
        inside = np.clip(logs, *_STD_LOGS.T)
        A, b, square, _, _, log_determinant = rows.normal(np.exp(inside))
        least = square - float(b @ solve_scaled(A, b))
        unit = np.sqrt(np.maximum(np.diag(A), 1e-30))
        determinant = np.linalg.slogdet(A / np.outer(unit, unit))[1] + 2.0 * np.log(unit).sum()
        outside = 1e3 * float(np.abs(logs - inside).sum())
        return 0.5 * (log_determinant + determinant + least) - float(inside[:2].sum()) + outside

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


@dataclass(frozen=True, eq=False)
class _SeenView:
    """A view's good corners, the one or two board poses that fit them, the better one's sum of squares (px²), and the
    number of outliers; or the reason why the view is not used."""

    name: str
    reason: str = ""
    corners: SeenBoard | None = None
    poses: tuple[Pose, ...] = ()
    square: float = 0.0
    left_out: int = 0


def _seen_view(view: BoardView, points: np.ndarray, camera: Camera) -> _SeenView:
    """Good corners and possible board poses of one view. Raises InputError for another picture size, or for corners
    that are not of this board."""
    require_size(view.image_size, camera, view.name)
    ids, pixels = np.asarray(view.ids), np.asarray(view.corners_px, float)
    require_corners(ids, pixels, len(points), view.name)
    if len(ids) < HandEyeSettings.fewest_corners:
        return _SeenView(view.name, f"{len(ids)} corners, at least {HandEyeSettings.fewest_corners} are needed")
    rays, valid = camera.unproject(pixels)
    seen = valid & (rays[:, 2] > 0.05)
    flat = np.where([True, True, False], points[ids], 0.0)
    if seen.sum() < HandEyeSettings.fewest_corners or not fixes_homography(flat[seen, :2]):
        return _SeenView(view.name, "its corners lie (nearly) on a line, or the lens does not see them")
    try:
        starts = start_poses(flat[seen], rays[seen, :2] / rays[seen, 2:])
    except SolveError as error:
        return _SeenView(view.name, str(error))
    every = SeenBoard(camera, points[ids[seen]], pixels[seen], _weights(view, seen))
    if len(starts) == 1:
        starts.append(mirrored(starts[0], every.points))
    found = [_posed(every, start) for start in starts]
    pose, distances = min(found, key=lambda one: float(np.minimum(one[1], 10.0 * np.median(one[1])).sum()))
    inlying = distances <= max(HandEyeSettings.outlier * radial_std(distances), HandEyeSettings.outlier_px)
    if inlying.sum() < HandEyeSettings.fewest_corners or not fixes_homography(every.points[inlying, :2]):
        return _SeenView(view.name, "no pose of the board explains its corners")
    corners = every.picked(inlying)
    best, distances = _posed(corners, pose)
    poses, square = [best], float((distances**2).sum())
    other, _ = max(found, key=lambda one: turn_between(one[0], best))
    second, off = _posed(corners, other)
    ahead = second.translation_m[2] > 0.0 and turn_between(second, best) > HandEyeSettings.same_pose_rad
    if ahead and float((off**2).sum()) < HandEyeSettings.second_pose**2 * square:
        poses.append(second)
    return _SeenView(view.name, "", corners, tuple(poses), square, len(ids) - int(inlying.sum()))


def _posed(corners: SeenBoard, start: Pose) -> tuple[Pose, np.ndarray]:
    """The board's pose by soft L1 losses in units of the corners' own scatter, from an initial pose, and the
    residuals' lengths (N,) px there."""

    def distances(pose: Pose) -> np.ndarray:
        return np.linalg.norm(corners.residual(pose).reshape(-1, 2), axis=1)

    pose = corners.refined(start, SOFT_L1)
    scale = HandEyeSettings.soft * max(radial_std(distances(pose)), 1e-9)
    pose = replace(corners, weights=corners.weights / scale).refined(pose, SOFT_L1)
    return pose, distances(pose)


def _weights(view: BoardView, seen: np.ndarray) -> np.ndarray:
    """Weights (N,) of the corners' residuals: below 1 for corners less certain than the median one."""
    if view.covariance_px2 is None:
        return np.ones(int(seen.sum()))
    variance = np.trace(view.covariance_px2[seen], axis1=1, axis2=2)
    middle = max(float(np.median(variance)), 1e-12)
    # besides the picture's noise all corners have errors of print, blur and lens
    return np.sqrt(2.0 * middle / (variance + middle))


_TURN_MORE = "add views with the hand turned by 20° and more about a second axis, at right angles to the first"


@dataclass(frozen=True, eq=False)
class HandEyeView:
    """A view and its disagreement with the robot's readings.

    distance_m, turn_rad : disagreement of the board's centre and turn, by its corners alone, with the robot's pose; NaN
    where not used. reason : why the view counts as an outlier or was not used; empty for a good one.
    """

    name: str
    corners: int
    left_out: int
    distance_m: float
    turn_rad: float
    reason: str = ""


@dataclass(frozen=True, eq=False)
class HandEye:
    """Result of a hand-eye calibration.

    Attributes
    ----------
    mount : "hand": the arm carries the camera; "fixed": it carries the board, and the camera stands next to it.
    camera_pose : T_tool_camera, or T_base_camera where the camera is fixed. board_pose : T_base_board, or T_tool_board.
    covariance : (12, 12) of their tangents (`Pose.retract`), camera first; with the lens' covariance and the
        uncertainty of the robot's variance, so that χ² regions of 95 % hold 95 % also with few views.
    robot_std : (2,) standard deviation per axis of the tool's turns, rad, and shifts, m, against the robot's readings.
    robot_log_std : (2,) of their logarithms.
    rms : (2,) disagreement of the good views, turns rad and the board's centre m.
    parts : "corners", "lens", "robot" → (2,) predicted contribution of each to `rms`; only "robot" where poses were
        measured.
    board_scale : relative excess of the board's size over the stated one, if the robot's lengths are right, and its
        standard deviation.
    noise_px : standard deviation of a corner's coordinate, by the scatter of a view's corners, or more where the
        board's poses scatter more; None where the input was the board's poses, with errors that count as the robot's.
    """

    mount: str
    camera_pose: Pose
    board_pose: Pose
    covariance: np.ndarray
    robot_std: np.ndarray
    robot_log_std: np.ndarray
    rms: np.ndarray
    parts: Mapping[str, np.ndarray]
    board_scale: tuple[float, float]
    noise_px: float | None
    views: tuple[HandEyeView, ...]

    @property
    def outliers(self) -> tuple[str, ...]:
        """Names of the views that the others contradict or that could not be used."""
        return tuple(view.name for view in self.views if view.reason)

    @property
    def robot_share(self) -> np.ndarray:
        """(2,) share of the robot's errors in the predicted variance of the disagreement: of rotations, of
        distances."""
        return self.parts["robot"] ** 2 / np.sum([part**2 for part in self.parts.values()], axis=0)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings, in words: few views, a board of another size, many contradicting views."""
        used = len(self.views) - len(self.outliers)
        larger, by = self.board_scale
        contradicted = sum(bool(view.reason) and view.distance_m == view.distance_m for view in self.views)
        rules = (
            (
                used < HandEyeSettings.few_to_judge,
                f"{used} views hardly show which of them are wrong: ten to twenty are good",
            ),
            (
                abs(larger) > HandEyeSettings.scale_significant * by,
                f"measured by the robot the board is {100 * larger:.2f} ± {100 * by:.2f} % larger than "
                "described, and the camera's distance is off by as much: measure the print",
            ),
            (
                contradicted > HandEyeSettings.many * (used + contradicted),
                f"{contradicted} views contradict the others: look at them",
            ),
        )
        return tuple(words for holds, words in rules if holds)

    def antenna_on_arm(self, T_antenna_camera: Pose, covariance: np.ndarray) -> tuple[Pose, np.ndarray]:
        """T_tool_antenna (a session's `T_actuator_antenna` on this arm) and its covariance (6, 6).

        T_antenna_camera : of the rig, with its covariance (6, 6); its errors count as independent of these.
        Raises InputError where the camera is not on the arm.
        """
        if self.mount != "hand":
            raise InputError("the camera is not on the arm", remedy="camera and antenna ride together: take mount hand")
        found = self.camera_pose @ T_antenna_camera.inverse()
        R, t = found.rotation, T_antenna_camera.translation_m
        by_camera, by_rig = np.eye(6), -np.kron(np.eye(2), R)
        by_camera[3:, :3] = _crossed(R @ t)
        by_rig[3:, :3] = -R @ _crossed(t)
        spread = by_camera @ self.covariance[:6, :6] @ by_camera.T + by_rig @ covariance @ by_rig.T
        return found, spread

    def to_dict(self) -> dict[str, Any]:
        """The document handeye.json."""
        carrier, other = ("tool", "base") if self.mount == "hand" else ("base", "tool")
        std = np.sqrt(np.diag(self.covariance))
        poses = {f"T_{carrier}_camera": (self.camera_pose, std[:6]), f"T_{other}_board": (self.board_pose, std[6:])}
        return {
            "schema": "vbaa.handeye/1",
            "mount": self.mount,
            **{
                name: pose.to_dict() | {"translation_std_m": own[3:].tolist(), "rotation_std_rad": own[:3].tolist()}
                for name, (pose, own) in poses.items()
            },
            "covariance": self.covariance.tolist(),
            "robot": _two("std", self.robot_std)
            | {
                "translation_relative_std": float(self.robot_log_std[1]),
                "rotation_relative_std": float(self.robot_log_std[0]),
                "translation_share": float(self.robot_share[1]),
                "rotation_share": float(self.robot_share[0]),
            },
            "disagreement": _two("rms", self.rms) | {f"from_{name}": _two("rms", p) for name, p in self.parts.items()},
            "board_scale": {"larger_by": self.board_scale[0], "std": self.board_scale[1]},
            "noise_px": self.noise_px,
            "warnings": list(self.warnings),
            "views": [
                {name: None if value != value else value for name, value in asdict(view).items()} for view in self.views
            ],
        }


def _two(what: str, turn_and_shift: np.ndarray) -> dict[str, Any]:
    turn, shift = turn_and_shift.tolist()
    return {f"translation_{what}_m": shift, f"rotation_{what}_rad": turn}


@validate_arguments
def solve_hand_eye(
    views: Sequence[BoardView | tuple[str, Pose]],
    robot_poses: Sequence[Pose],
    board_points: np.ndarray | None = None,
    camera: Camera | None = None,
    mount: str = "hand",
    readings: Mapping[str, Sequence[Pose]] | None = None,
) -> HandEye:
    """Solve for the camera's pose on the arm, or next to it, and the board's.

    views : the board in each picture; grossly wrong corners are left out. Or name and pose T_camera_board of each, by
    whatever means they were measured (A·X = X·B, A·X = Z·B): then neither points nor camera are needed.
    robot_poses : T_base_tool of each, in the same order.
    board_points : (K, 3) m, by corner id, as the lens solve has found them.
    mount : "hand" or "fixed", as in `HandEye`.
    readings : other ways to read the poses, by the mistake that they stand for ("are in degrees"), to name a mistake.

    Raises InputError for views and poses that are not of equal number, fewer than three views that can be used, an arm
    that turned about one axis only or not at all, poses that fit far better read in another way, or do not fit.
    """
    if mount not in ("hand", "fixed"):
        raise InputError(f"the mount is {mount!r}", remedy="take one of hand, fixed")
    if len(views) != len(robot_poses):
        raise InputError(
            f"there are {len(views)} views and {len(robot_poses)} robot poses", remedy="give one pose for each view"
        )
    measured = [view for view in views if isinstance(view, tuple)]
    if measured:
        camera = None
        points, seen = _seen_poses(measured, len(views))
    else:
        points, seen = _seen_corners([view for view in views if not isinstance(view, tuple)], board_points, camera)
    used = np.array([index for index, one in enumerate(seen) if not one.reason], int)
    if len(used) < HandEyeSettings.fewest_views:
        reasons = sorted({one.reason for one in seen if one.reason})
        raise InputError(
            f"{len(used)} of {len(views)} views can be used, at least {HandEyeSettings.fewest_views} are needed"
            + (f" ({'; '.join(reasons[:3])})" if reasons else ""),
            remedy="add views with the hand turned about two axes; ten to twenty are good",
        )
    good = [seen[i] for i in used]
    rows = [_checked_pose(pose, f"robot pose {index}") for index, pose in enumerate(robot_poses)]
    poses = [rows[i] for i in used]
    _refuse_one_axis(poses)  # and again without outliers
    start = _start(rows, used, good, points, mount == "hand", (readings or {}, camera is None))
    corners = tuple(one.corners for one in good if one.corners is not None)
    freedom = sum(one.pixels.size - 6 for one in corners)
    noise_px = float(np.sqrt(sum(one.square for one in good) / freedom))
    problem = _HandEyeProblem(
        corners, tuple(poses), camera, max(noise_px, HandEyeSettings.rounding_px), mount == "hand"
    )
    chosen = [one.poses[min(k, len(one.poses) - 1)] for one, k in zip(good, start.chosen.tolist(), strict=True)]
    solved, kept, off = _consistent(problem, start, chosen, points.mean(axis=0))
    in_it = [pose for pose, good_one in zip(poses, kept, strict=True) if good_one]
    _refuse_loose(solved, in_it, float(np.median([_distance_m(pose, camera is None) for pose in chosen])))
    return _result(solved, kept, off, problem, seen)


def _distance_m(pose: Pose, measured: bool) -> float:
    """Distance of the board from the camera: along the optical axis, or for a measured pose the length of its
    translation."""
    return float(np.linalg.norm(pose.translation_m) if measured else pose.translation_m[2])


def _seen_corners(
    views: Sequence[BoardView], board_points: np.ndarray | None, camera: Camera | None
) -> tuple[np.ndarray, list[_SeenView]]:
    if board_points is None or camera is None:
        raise InputError("corners need the board's points and a camera", remedy="give both, or poses T_camera_board")
    points = _checked_points(board_points)
    return points, [_seen_view(view, points, camera) for view in views]


def _seen_poses(views: Sequence[tuple[str, Pose]], count: int) -> tuple[np.ndarray, list[_SeenView]]:
    """Artificial board points about the origin, a tenth of the board's distance in size, and the views of them."""
    if len(views) < count:
        raise InputError("views are partly poses and partly corners", remedy="give one kind")
    poses = [(name, _checked_pose(pose, f"view {name}")) for name, pose in views]
    size_m = max(
        HandEyeSettings.point_share * float(np.median([_distance_m(pose, True) for _, pose in poses])),
        HandEyeSettings.least_size_m,
    )
    points = size_m * np.vstack([np.eye(3), -np.eye(3)])
    ones = np.ones(len(points))
    return points, [_SeenView(name, "", SeenBoard(None, points, pose @ points, ones), (pose,)) for name, pose in poses]


def _checked_points(board_points: np.ndarray) -> np.ndarray:
    points = np.asarray(board_points, float)
    if (
        points.ndim != 2
        or points.shape[1] != 3
        or len(points) < HandEyeSettings.fewest_corners
        or not np.isfinite(points).all()
    ):
        raise InputError(
            f"the board's points have the shape {points.shape}, or are not finite",
            remedy="give them as (K, 3) metres, by corner id",
        )
    return points


def _checked_pose(pose: Pose, name: str) -> Pose:
    rotation, place = np.asarray(pose.rotation, float), np.asarray(pose.translation_m, float)
    fits = rotation.shape == (3, 3) and place.shape == (3,) and np.isfinite(rotation).all() and np.isfinite(place).all()
    if not fits or np.abs(rotation @ rotation.T - np.eye(3)).max() > 1e-3 or np.linalg.det(rotation) < 0.0:
        raise InputError(f"{name} is no valid pose", remedy="give a rotation matrix, and metres")
    return Pose(_nearest_rotation(rotation), place)


def _turns(poses: Sequence[Pose]) -> tuple[np.ndarray, np.ndarray]:
    """(3,) rms rotations of the tool about their principal axes, rad, largest first, and the axes (3, 3) in the tool
    frame."""
    from scipy.spatial.transform import Rotation  # slow to load

    turns = Rotation.from_matrix(np.array([pose.rotation for pose in poses]))
    middle = turns[int(np.argmin([(turns * one.inv()).magnitude().sum() for one in turns]))]
    vectors = (middle.inv() * turns).as_rotvec()
    _, values, axes = np.linalg.svd(np.vstack([vectors, np.zeros((3, 3))]), full_matrices=False)
    return values / np.sqrt(len(vectors)), axes


def _refuse_one_axis(poses: Sequence[Pose]) -> None:
    (most, second, _), axes = _turns(poses)
    if most < HandEyeSettings.least_turn_rad:
        raise InputError(
            f"the hand only shifted, turning by {np.degrees(most):.2g}° rms, which leaves the camera's place open",
            remedy=_TURN_MORE.replace("a second axis, at right angles to the first", "two axes"),
        )
    if second < HandEyeSettings.least_turn_rad:
        axis = ", ".join(f"{part:+.2f}" for part in axes[0])
        raise InputError(
            f"all turns of the hand are about one axis, ({axis}) in the tool's frame: the camera's place along it "
            "stays open",
            remedy=_TURN_MORE,
        )


def _start(
    rows: list[Pose],
    used: np.ndarray,
    seen: Sequence[_SeenView],
    points: np.ndarray,
    in_hand: bool,
    how: tuple[Mapping[str, Sequence[Pose]], bool],
) -> _Start:
    """An initial value from all rows of poses, of which `used` (V,) belong to the views. Raises InputError where the
    rows fit far better when read otherwise (another unit, order or inverse), or do not fit at all.

    how : other readings of the rows, and whether the board's poses were measured.
    """
    readings, measured = how
    detected = [one.poses for one in seen]

    def known(tools: Sequence[Pose]) -> list[Pose]:
        return [pose.inverse() for pose in tools] if in_hand else list(tools)

    best = _consensus(known([rows[i] for i in used]), detected, points)
    reach = float(np.median([_distance_m(one.poses[0], measured) for one in seen]))
    if best.spread_m <= HandEyeSettings.well_explained * reach:
        return best
    # X and Z exchanged, these are the same
    inverted = ", or the views' are of the camera in the board" if measured else ""
    tables = {
        f"are inverted, or the mount is the other{inverted}": [pose.inverse() for pose in rows],
        "are in millimetres": [Pose(pose.rotation, 1e-3 * pose.translation_m) for pose in rows],
        "are in kilometres": [Pose(pose.rotation, 1e3 * pose.translation_m) for pose in rows],
        **readings,
    }
    others = {
        words: [(table[i], own) for i, own in zip(used, detected, strict=True)] for words, table in tables.items()
    }
    for words, order in _other_orders(known(rows), [one[0] for one in detected], used).items():
        pairs = [(rows[i], own) for i, own in zip(order, detected, strict=True) if i >= 0]
        if not np.array_equal(order, used) and len(pairs) > HandEyeSettings.fewest_views:
            others[words] = pairs
    spreads = {
        words: _consensus(
            known([tool for tool, _ in pairs]), [own for _, own in pairs], points, HandEyeSettings.few_subsets
        ).spread_m
        for words, pairs in others.items()
    }
    # another order may be the same as a shift, but for the views at the ends
    words = next(one for one, spread in spreads.items() if spread <= 2.0 * min(spreads.values()))
    better = HandEyeSettings.better_of_few if len(used) < HandEyeSettings.few else HandEyeSettings.far_better
    if better * spreads[words] < best.spread_m and spreads[words] <= HandEyeSettings.explained * reach:
        raise InputError(
            f"the robot's poses fit to {1e3 * best.spread_m:.3g} mm as they stand, and to "
            f"{1e3 * spreads[words]:.2g} mm if they {words}",
            remedy="give poses of the tool in the base, in metres, one for each view in its order, and the right mount",
        )
    if best.spread_m > HandEyeSettings.explained * reach:
        raise InputError(
            f"the robot's poses do not explain the views: the better part of them misses the board by "
            f"{1e3 * best.spread_m:.0f} mm",
            remedy="is each the pose at its picture, of the tool in the base, and what the tool carries fixed to it?",
        )
    return best


def _consistent(
    problem: _HandEyeProblem, start: _Start, seen: Sequence[Pose], centre_m: np.ndarray
) -> tuple[_HandEyeSolution, np.ndarray, _Misfits]:
    """Solves from the views that agree; returns the solution, the mask (V,) of these views, and the misfit of every
    view."""
    from scipy.special import fdtri  # slow to load

    kept, X, Z = start.good, start.X, start.Z
    std = np.array([max(start.spread_m, 1e-6), max(start.spread_m, 1e-6), 1.0])
    for _ in range(HandEyeSettings.outlier_rounds):
        part = problem.picked(kept)
        _refuse_one_axis(part.readings)
        solved = part.solved(part.start(X, Z), std)
        (X, Z, *_), std = solved.state, solved.std
        off = problem.misfits(solved, seen, kept, centre_m)
        # outliers still in it make the robot look worse than it is; among few views that cannot be seen
        scale = float(np.median(off[2]) / chi_limit(0.5, 6) ** 2)
        scale = max(scale, 1.0) if len(seen) < HandEyeSettings.few_to_judge else scale
        before, kept = kept, off[2] <= scale * 6.0 * fdtri(6, solved.freedom, 1.0 - HandEyeSettings.outlier_chance)
        if np.array_equal(kept, before) or kept.sum() < max(HandEyeSettings.fewest_views, 0.5 * len(kept)):
            break
    return solved, before, off


def _refuse_loose(found: _HandEyeSolution, tools: Sequence[Pose], reach_m: float) -> None:
    of_camera = found.covariance[:6, :6]
    turn, place = (float(largest_std(part)) for part in (of_camera[:3, :3], of_camera[3:, 3:]))
    if turn > HandEyeSettings.loose_rad or place > HandEyeSettings.loose_share * reach_m:
        second = np.degrees(_turns(tools)[0][1])
        raise InputError(
            f"the views leave the camera's pose open to {turn:.2g} rad and {1e3 * place:.2g} mm; the hand turned by "
            f"{second:.2g}° rms about the second axis",
            remedy=_TURN_MORE
            if second < HandEyeSettings.turned_well_deg
            else "add views, the board large in them and the robot at rest",
        )


def _result(
    solved: _HandEyeSolution, kept: np.ndarray, off: _Misfits, problem: _HandEyeProblem, seen: Sequence[_SeenView]
) -> HandEye:
    (turn_rad, distance_m, _, parts), views, index = off, [], 0
    for one in seen:
        if one.corners is None:
            views.append(HandEyeView(one.name, 0, 0, np.nan, np.nan, one.reason))
            continue
        reason = "" if kept[index] else "its robot pose contradicts the others"
        count = 0 if problem.camera is None else len(one.corners.pixels)
        distance, turn = float(distance_m[index]), float(turn_rad[index])
        views.append(HandEyeView(one.name, count, one.left_out, distance, turn, reason))
        index += 1
    return HandEye(
        mount="hand" if problem.in_hand else "fixed",
        camera_pose=solved.state[0],
        board_pose=solved.state[1],
        covariance=solved.covariance,
        robot_std=solved.std[:2],
        robot_log_std=solved.log_std[:2],
        rms=np.sqrt([np.mean(turn_rad[kept] ** 2), np.mean(distance_m[kept] ** 2)]),
        parts={
            name: np.sqrt(part[kept].mean(axis=0))
            for name, part in parts.items()
            if problem.camera is not None or name == "robot"
        },
        board_scale=problem.picked(kept).board_scale(solved),
        noise_px=None if problem.camera is None else problem.noise_px * solved.std[2],
        views=tuple(views),
    )
