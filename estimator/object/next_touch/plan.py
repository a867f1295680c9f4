"""Which touch tells most of surface, friction or stiffness: the expected decrease of the posterior variance."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from scipy.linalg import solve_triangular
from scipy.spatial import KDTree

from estimator.contact.common_errors import CommonErrors, noise_free_frames, shared_errors
from estimator.contact.status import FEWEST_POINTS, LOW_SIGNAL, LOW_SIGNAL_RELATIVE
from estimator.object.estimate import ObjectEstimate, estimate_object
from estimator.object.surface.build import fitted
from estimator.object.surface.fit import Fit, fit
from estimator.object.surface.patches import LocalTouches, curve, height_field
from estimator.object.surface.solution import Equations, Solution, covariance, pairs, variance
from estimator.object.surface.touches import touches_of
from estimator.solver.linearised import linearised
from estimator.solver.rig_arrays import UNKNOWNS, RigArrays
from estimator.table.contacts import ContactTable, joint_angles
from vbaa_calib.core.errors import InputError
from vbaa_calib.rig import Rig

from .reach import RUNG, JointLimits, Reach, along_surface, reachable

SURFACE, FRICTION, STIFFNESS = GOALS = ("surface", "friction", "stiffness")
UNITS = {SURFACE: "m", FRICTION: "", STIFFNESS: "m/N"}
_TARGETS, _AROUND, _CELLS = 400, 0.15, 24
"""Places at which the surface is to be known: so many, up to this part of a patch's extent beyond its touches."""
_FRAMES = 10
"""Of a stroke: so many frames' own errors average out."""
_UNKNOWN_MU, _LIKELY_MU, _WIDE = 0.5, 0.3, 1.96


@dataclass(frozen=True)
class NextTouch:
    """A touch to make next, and what it should tell.

    Attributes
    ----------
    goal : of `GOALS`. begin_rad, touch_rad, press_rad, end_rad : pan and tilt, rad: clear of the object; where it
        should first be felt; pressed; and where a stroke for the friction ends, else as pressed.
    distance_m, force_N : along the antenna, and the size of the force, as they should come out when pressed.
    point_m, normal : the contact in the world and the object's normal there.
    std, std_after : deviation of the goal now and as it should be afterwards: of the surface, rms over what was touched
        and a rim around it, m; of μ; of the compliance, m/N.
    compared : how many touches could be made.
    """

    goal: str
    begin_rad: tuple[float, float]
    touch_rad: tuple[float, float]
    press_rad: tuple[float, float]
    end_rad: tuple[float, float]
    distance_m: float
    force_N: float
    point_m: tuple[float, float, float]
    normal: tuple[float, float, float]
    std: float
    std_after: float
    compared: int

    def summary(self) -> dict[str, Any]:
        """As plain data."""
        return asdict(self)


def next_touch(contacts: ContactTable, rig: Rig, goal: str = SURFACE, limits: JointLimits | None = None) -> NextTouch:
    """The touch after which surface, friction or stiffness should be known best.

    contacts : of one object that stands still; refined ones with the updated rig tell more. goal : of `GOALS`.
    limits : of the joints; by default the angles of the recording.

    Raises
    ------
    InputError : contacts without a touch to go by; a goal that is none of these; no touch within the limits stays on
        what is known of the surface.
    """
    options = touches_within(contacts, rig, goal, limits)
    return options.chosen(int(np.nanargmin(options.std_after)))


@dataclass(frozen=True, eq=False)
class Options:
    """Touches that can be made, and the deviation (B,) that the goal should have after each; NaN where it is none."""

    goal: str
    reach: Reach
    end_rad: np.ndarray
    std: float
    std_after: np.ndarray
    length_m: float

    def chosen(self, index: int) -> NextTouch:
        """One of them in plain numbers."""
        reach = self.reach
        pair = [tuple(each[index].tolist()) for each in (reach.begin_rad, reach.touch_rad, reach.joints_rad)]
        return NextTouch(
            self.goal,
            *(*pair, tuple(self.end_rad[index].tolist())),
            float(reach.unknowns[index, 0] * self.length_m),
            float(np.linalg.norm(reach.force_N[index])),
            tuple(reach.point_m[index].tolist()),
            tuple(reach.normal[index].tolist()),
            self.std,
            float(self.std_after[index]),
            int(np.isfinite(self.std_after).sum()),
        )


def touches_within(contacts: ContactTable, rig: Rig, goal: str = SURFACE, limits: JointLimits | None = None) -> Options:
    """All touches that `next_touch` compares; see there."""
    if goal not in GOALS:
        raise InputError(f"there is no goal {goal!r}", remedy=f"give one of {', '.join(GOALS)}")
    pan, tilt = joint_angles(rig.kinematics, contacts)
    if limits is None:
        limits = JointLimits(_ends(pan), _ends(tilt))
    arrays = RigArrays.from_rig(rig, contacts.assumed_friction_rad, drift=False)
    touches = touches_of(contacts, shared_errors(rig, contacts))
    found, _, known, _ = fitted(touches, 0.5 * rig.antenna.diameter_m)
    if not known:
        raise InputError(
            "the contacts have no covariance: what a touch would add is not known",
            remedy="give contacts.csv as vbaa estimate writes it",
        )
    sound = ~(found.state.outlier | found.state.vague) & np.isfinite(pan + tilt)[touches.row]
    joints = np.column_stack([pan, tilt])[touches.row]
    with np.errstate(all="ignore"):  # what leaves the domain of the model is left out
        reach = reachable(found, arrays, np.flatnonzero(sound), joints, limits)
        offered = _offered(contacts, arrays, touches.row, reach)
    reach, seen = reach.picked(offered.rows), offered
    if not len(reach):
        raise InputError(
            "no touch within the joint limits stays on what is known of the surface",
            remedy="widen the limits, or touch the object once more close to where it was touched",
        )
    end = reach.joints_rad
    if goal == FRICTION:
        felt = estimate_object(contacts, rig, events=False)
        std, after, end = _of_friction(found, reach, seen, felt)
    elif goal == STIFFNESS:
        found = fit(touches, 0.5 * rig.antenna.diameter_m, found.patches, found.state, True)
        std, after = _of_stiffness(found, reach, seen)
    else:
        std, after = _of_surface(found, reach, seen)
    if not np.isfinite(after).any():
        raise InputError(
            f"no touch within the joint limits would tell anything of the {goal}",
            remedy="widen the limits" if goal != FRICTION else "touch the object beside where it was touched first",
        )
    return Options(goal, reach, end, std, after, arrays.length_m)


def _ends(angles: np.ndarray) -> tuple[float, float]:
    return float(np.nanmin(angles)), float(np.nanmax(angles))


@dataclass(frozen=True, eq=False)
class _Offered:
    """What B touches would be known like: rows (B,) of those that were looked at, errors that they share with the
    contacts that were made, own covariances (B, 3, 3) of points and forces, world, friction angle's deviation (B,)."""

    rows: np.ndarray
    shared: CommonErrors
    force_N2: np.ndarray
    angle_std_rad: np.ndarray
    friction_rad: float


def _offered(contacts: ContactTable, arrays: RigArrays, made: np.ndarray, reach: Reach) -> _Offered:
    """The touches that the estimator would locate, and how well."""
    empty = reach.frames(arrays)
    available = np.ones((len(reach), 2)) * (arrays.gain != 0.0) * np.isfinite(contacts.moment_residual_Nm[made]).any()
    frames = noise_free_frames(empty, RUNG, reach.unknowns, available, point_per_px=True)
    there = linearised(frames, RUNG, reach.unknowns)
    length = arrays.length_m
    own = np.linalg.inv(there.information[:, :UNKNOWNS, :UNKNOWNS])
    distance_std = length * np.sqrt(np.linalg.inv(there.information)[:, 0, 0])
    friction = own[:, :, 3:] @ own[:, 3:]  # is common: neighbours rub alike
    columns, part = there.columns[:, :, :UNKNOWNS], own - friction
    rotation, translation = arrays.rig.kinematics.world_antenna(*reach.joints_rad.T)
    point, force = (
        rotation @ columns[:, each] @ part @ np.swapaxes(rotation @ columns[:, each], 1, 2)
        for each in (slice(0, 3), slice(3, 6))
    )
    limit = np.minimum(LOW_SIGNAL * length, LOW_SIGNAL_RELATIVE * reach.unknowns[:, 0] * length)
    located = np.isfinite(point).all(axis=(1, 2)) & (frames.usable.sum(axis=1) >= FEWEST_POINTS)
    rows = np.flatnonzero(located & (distance_std < limit))
    table = contacts.picked(np.full(len(rows), made[0]))
    kept = reach.picked(rows)
    antenna = np.einsum("bji,bj->bi", rotation[rows], kept.force_N)
    table = replace(
        table,
        status=np.full(len(rows), "ok"),
        pan_rad=kept.joints_rad[:, 0],
        tilt_rad=kept.joints_rad[:, 1],
        distance_m=kept.unknowns[:, 0] * length,
        distance_std_m=distance_std[rows],
        force_y_N=antenna[:, 1],
        force_z_N=antenna[:, 2],
        friction_angle_rad=np.zeros(len(rows)),
        point_world_m=kept.point_m,
        point_antenna_m=np.einsum("bji,bj->bi", rotation[rows], kept.point_m - translation[rows]),
        covariance_world_m2=point[rows],
    )
    shared = shared_errors(arrays.rig, table, arrays.friction_rad)
    shared = replace(shared, own_m2=point[rows])
    return _Offered(rows, shared, force[rows], arrays.friction_rad * np.sqrt(own[rows, 3, 3]), arrays.friction_rad)


def _equations(found: Fit, index: int, reach: Reach, seen: _Offered, m: np.ndarray) -> Equations:
    """What the touches m (N,) would say of their patch; see `patches.height_field`."""
    one, radius_and_give = found.patches[index], found.state.compliance_m_N
    frame, normal = one.frame, reach.normal[m]
    press = np.sum(reach.force_N[m] * normal, axis=1)
    local = (reach.point_m[m] - one.center_m) @ frame.T
    x = local[:, : one.dimensions]
    pressed = np.einsum("ni,nis->ns", normal, seen.shared.force_N[m])
    given = LocalTouches(
        point_m=local,
        tangent=reach.tangent[m] @ frame.T,
        own_m2=frame @ seen.shared.own_m2[m] @ frame.T,
        modes_m=frame @ (seen.shared.point_m[m] + radius_and_give * normal[:, :, None] * pressed[:, None, :]),
        tangent_modes=frame @ seen.shared.tangent[m],
        yield_N=-press[:, None] * normal @ frame.T,
        slope=found.solution.mean(index, one.slope_rows(x)).reshape(2, len(m)).T,
        bend_per_m=np.zeros((len(m), 2, 2)),
        normal=normal @ frame.T,
        ignored=np.zeros(len(m), bool),
    )
    return height_field(given) if one.wide else curve(given)


@dataclass(frozen=True, eq=False)
class _Seen:
    """New equations (M,) against those that are solved: whitened (K, M), and their covariance (M, M) without compliance;
    what is seen (M,) of the compliance beyond what the old ones predict."""

    equations: Equations
    half: np.ndarray
    covariance: np.ndarray
    compliance_N: np.ndarray


def _seen(solution: Solution, index: int, new: Equations) -> _Seen:
    model = solution.patches[index]
    modes = np.concatenate([each.equations.modes for each in solution.patches])
    old = new.modes @ modes.T
    begin = solution.start[index]
    old[:, begin : begin + len(model.equations)] += model.seen_by(new.rows)
    half = solve_triangular(solution.lower, old.T, lower=True, check_finite=False)
    whole = covariance(pairs(new.rows, new.rows), model.prior) + new.noise + new.modes @ new.modes.T
    whole += np.diag((model.slack_rad * new.slack) ** 2)
    return _Seen(new, half, whole - half.T @ half, new.force_N - old @ solution.lift)


def _own(index: int, count: int, total: int) -> np.ndarray:
    """Equations of one touch among those of `count`: its point's, and its tangent's or its other coordinate's."""
    return np.arange(index, total, count)


def _of_surface(found: Fit, reach: Reach, seen: _Offered) -> tuple[float, np.ndarray]:
    """Deviation of the surface, rms over all targets, now and after each touch (A-optimal)."""
    solution = found.solution
    targets = [_targets(found, index) for index in range(len(found.patches))]
    rows = [one.value_rows(x) for one, x in zip(found.patches, targets, strict=True)]
    halves, now = [], []
    for index, view in enumerate(rows):
        old = np.zeros((len(view), len(solution.weights)))
        begin = solution.start[index]
        old[:, begin : begin + len(solution.patches[index].equations)] = solution.patches[index].seen_by(view)
        halves.append(solve_triangular(solution.lower, old.T, lower=True, check_finite=False))
        now.append(np.maximum(variance(view, solution.patches[index].prior) - np.sum(halves[-1] ** 2, axis=0), 0.0))
    count = sum(map(len, targets))
    whole = float(np.sum(np.concatenate(now)))
    after = np.full(len(reach), np.nan)
    for index in np.unique(reach.patch):
        m = np.flatnonzero(reach.patch == index)
        new = _seen(solution, index, _equations(found, index, reach, seen, m))
        size = len(new.equations)
        with_targets = [-half.T @ new.half for half in halves]
        with_targets[index] += covariance(pairs(rows[index], new.equations.rows), solution.patches[index].prior)
        cross = np.concatenate(with_targets)
        for place, row in enumerate(m.tolist()):
            own = _own(place, len(m), size)
            lower = np.linalg.cholesky(new.covariance[np.ix_(own, own)])
            told = float(np.sum(solve_triangular(lower, cross[:, own].T, lower=True) ** 2))
            after[row] = np.sqrt(max(whole - told, 0.0) / count)
    return float(np.sqrt(whole / count)), after


def _targets(found: Fit, index: int) -> np.ndarray:
    """Places (N, 1) or (N, 2) of a patch: where it was touched, and a rim around."""
    local = found.local(found.patches[index])
    x = local[:, : found.patches[index].dimensions]
    low, high = x.min(axis=0), x.max(axis=0)
    rim = _AROUND * float(np.linalg.norm(high - low))
    axes = [np.linspace(a - rim, b + rim, _CELLS if x.shape[1] == 2 else _TARGETS // 8) for a, b in zip(low, high, strict=True)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, x.shape[1])
    near = grid[KDTree(x).query(grid)[0] <= rim]
    return near if len(near) <= _TARGETS else near[np.random.default_rng(0).choice(len(near), _TARGETS, replace=False)]


def _of_stiffness(found: Fit, reach: Reach, seen: _Offered) -> tuple[float, np.ndarray]:
    """Deviation of the compliance, now and after each touch."""
    after = np.full(len(reach), np.nan)
    information = 1.0 / found.solution.variance if found.solution.variance > 0.0 else 0.0
    for index in np.unique(reach.patch):
        m = np.flatnonzero(reach.patch == index)
        new = _seen(found.solution, index, _equations(found, index, reach, seen, m))
        for place, row in enumerate(m.tolist()):
            own = _own(place, len(m), len(new.equations))
            pulled = new.compliance_N[own]
            told = pulled @ np.linalg.solve(new.covariance[np.ix_(own, own)], pulled)
            after[row] = 1.0 / np.sqrt(information + told)
    return float(np.sqrt(1.0 / information)) if information else float("inf"), after


def _of_friction(
    found: Fit, reach: Reach, seen: _Offered, felt: ObjectEstimate
) -> tuple[float, np.ndarray, np.ndarray]:
    """Deviation of μ, now and after a stroke from each touch one step along the surface, and where that ends.

    A touch that slides tells μ by the angle between force and normal: across the antenna by the force's direction and
    the shape's normal, along it by the friction angle that the frames see themselves.
    """
    rub = felt.friction
    low, high = rub.interval
    if rub.determined:
        mu, std = rub.mu, rub.std
    elif np.isfinite(high):
        mu, std = 0.5 * (max(low, 0.0) + high), max((high - max(low, 0.0)) / (2.0 * _WIDE), 0.0)
    else:
        mu, std = _LIKELY_MU, _UNKNOWN_MU
    to = along_surface(reach)
    after = np.full(len(reach), np.nan)
    end = np.where((to >= 0)[:, None], reach.joints_rad[to], reach.joints_rad)
    for index in np.unique(reach.patch[to >= 0]):
        one = found.patches[index]
        m = np.flatnonzero((reach.patch == index) & (to >= 0))
        if not one.wide:
            continue  # across a line the normal is not known
        normal, tangent = reach.normal[m], reach.tangent[m]
        lateral = np.cross(normal, tangent)
        lateral = lateral / np.linalg.norm(lateral, axis=1, keepdims=True)
        slip = reach.point_m[to[m]] - reach.point_m[m]
        slip = slip - np.sum(slip * normal, axis=1, keepdims=True) * normal
        across, along = (np.sum(slip * side, axis=1) / np.linalg.norm(slip, axis=1) for side in (lateral, tangent))
        size = np.linalg.norm(reach.force_N[m], axis=1)
        own = np.einsum("ni,nij,nj->n", lateral, seen.force_N2[m], lateral) / size**2
        common = np.sum(np.einsum("ni,nis->ns", lateral, seen.shared.force_N[m]) ** 2, axis=1) / size**2
        local = (reach.point_m[m] - one.center_m) @ one.frame.T
        joint = found.solution.joint([(index, one.slope_rows(local[:, :2]))])
        each = np.arange(len(m))[:, None] + [0, len(m)]
        side = lateral @ one.frame[:2].T
        turned = np.einsum("ni,nij,nj->n", side, joint[each[:, :, None], each[:, None, :]], side)
        by_force = (own / _FRAMES + common + turned) * ((1.0 + (mu * across) ** 2) / np.maximum(np.abs(across), 1e-6)) ** 2
        angle = seen.angle_std_rad[m]
        alone = 1.0 / np.maximum(1.0 / angle**2 - 1.0 / seen.friction_rad**2, 1e-9)
        by_angle = alone * ((1.0 + (mu * along) ** 2) / np.maximum(np.abs(along), 1e-6)) ** 2
        after[m] = 1.0 / np.sqrt(1.0 / std**2 + 1.0 / by_force + 1.0 / by_angle)
    return float(std), after, end
