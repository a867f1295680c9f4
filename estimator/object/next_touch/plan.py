"""The next touch: the one that decreases the expected variance of surface, friction or stiffness most."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from scipy.linalg import solve_triangular
from scipy.spatial import KDTree

from estimator.contact.common_errors import CommonErrors, noise_free_frames, shared_errors
from estimator.contact.settings import ContactSettings
from estimator.object.estimate import estimate_object
from estimator.object.friction import Friction
from estimator.object.next_touch.reach import TouchSettings
from estimator.object.surface.build import fitted
from estimator.object.surface.fit import SurfaceFit, fit
from estimator.object.surface.patches import LocalTouches, curve, height_field
from estimator.object.surface.solution import ShapeEquations, ShapeSolution, covariance, values_at, variance
from estimator.object.surface.touches import touches_of
from estimator.solver.linearised import linearised
from estimator.solver.rig_arrays import UNKNOWNS, RigArrays
from estimator.table.contacts import ContactTable, joint_angles
from vbaa_calib.core.arrays import gate
from vbaa_calib.core.errors import InputError
from vbaa_calib.rig import Rig

from .reach import RUNG, JointLimits, Reach, along_surface, carried, reachable

SURFACE, FRICTION, STIFFNESS = GOALS = ("surface", "friction", "stiffness")
UNITS = {SURFACE: "m", FRICTION: "", STIFFNESS: "m/N"}


@dataclass(frozen=True)
class NextTouch:
    """A touch to make next, and what it should tell."""

    goal: str  # of `GOALS`
    begin_rad: tuple[float, float]  # pan and tilt clear of the object
    touch_rad: tuple[float, float]  # where it should first be felt
    press_rad: tuple[float, float]  # pressed
    end_rad: tuple[float, float]  # where a stroke for the friction ends, else as pressed
    distance_m: float  # along the antenna, as it should come out when pressed
    force_N: float  # its size, likewise
    point_m: tuple[float, float, float]  # the contact in the world
    normal: tuple[float, float, float]  # the object's there
    # deviation of the goal now: of the surface, rms over where it was touched and can be, m; μ; compliance, m/N
    std: float
    std_after: float  # as it should be afterwards
    compared: int  # how many touches could be made

    def summary(self) -> dict[str, Any]:
        """As plain data."""
        return asdict(self)


@gate
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
        begin, touch, press, end, point, normal = (
            tuple(each[index].tolist())
            for each in (reach.begin_rad, reach.touch_rad, reach.joints_rad, self.end_rad, reach.point_m, reach.normal)
        )
        return NextTouch(
            goal=self.goal,
            begin_rad=begin,
            touch_rad=touch,
            press_rad=press,
            end_rad=end,
            distance_m=float(reach.unknowns[index, 0] * self.length_m),
            force_N=float(np.linalg.norm(reach.force_N[index])),
            point_m=point,
            normal=normal,
            std=self.std,
            std_after=float(self.std_after[index]),
            compared=int(np.isfinite(self.std_after).sum()),
        )


def touches_within(contacts: ContactTable, rig: Rig, goal: str = SURFACE, limits: JointLimits | None = None) -> Options:
    """All touches that `next_touch` compares; see there."""
    if goal not in GOALS:
        raise InputError(f"there is no goal {goal!r}", remedy=f"give one of {', '.join(GOALS)}")
    pan, tilt = joint_angles(rig.kinematics, contacts)
    limits = JointLimits.of(contacts, rig) if limits is None else limits
    arrays = RigArrays.from_rig(rig, contacts.assumed_friction_rad, drift=False)
    touches = touches_of(contacts, shared_errors(rig, contacts))
    found, _, known, _ = fitted(touches, rig.antenna.radius_at(touches.distance_m))
    if not known:
        raise InputError(
            "the contacts have no covariance: what a touch would add is not known",
            remedy="give contacts.csv as vbaa estimate writes it",
        )
    sound = ~(found.state.outlier | found.state.vague) & np.isfinite(pan + tilt)[touches.row]
    joints = np.column_stack([pan, tilt])[touches.row]
    with np.errstate(all="ignore"):  # what leaves the domain of the model is left out
        reach = reachable(found, arrays, np.flatnonzero(sound), joints, limits)
        seen = _offered(contacts, arrays, touches.row, reach) if len(reach) else None
    if seen is None or not len(seen.rows):
        raise InputError(
            "no touch within the joint limits stays on what is known of the surface",
            remedy="widen the limits, or touch the object once more close to where it was touched",
        )
    reach = reach.picked(seen.rows)
    end = reach.joints_rad
    if goal == FRICTION:
        rub = estimate_object(contacts, rig, events=False).friction
        std, after, end = _of_friction(found, arrays, reach, seen, rub)
    elif goal == STIFFNESS:
        found = fit(touches, rig.antenna.radius_at(touches.distance_m), found.patches, found.state, True)
        std, after = _of_stiffness(found, reach, seen)
    else:
        std, after = _of_surface(found, reach, seen)
    if not np.isfinite(after).any():
        raise InputError(
            f"no touch within the joint limits would tell anything of the {goal}",
            remedy="widen the limits" if goal != FRICTION else "touch the object beside where it was touched first",
        )
    return Options(goal, reach, end, std, after, arrays.length_m)


@dataclass(frozen=True, eq=False)
class _Offered:
    """How well B touches would be known."""

    rows: np.ndarray  # (B,) of those that were looked at
    shared: CommonErrors  # errors that they share with the contacts that were made
    force_N2: np.ndarray  # (B, 3, 3) own covariances, world
    angle_std_rad: np.ndarray  # (B,) of the friction angle
    friction_rad: float


def _offered(contacts: ContactTable, arrays: RigArrays, made: np.ndarray, reach: Reach) -> _Offered:
    """The touches that the estimator would locate, and how well."""
    empty = reach.frames(arrays)
    available = np.ones(len(reach)) * np.isfinite(contacts.moment_residual_Nm[made]).any()
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
    relative = ContactSettings.low_signal_relative * reach.unknowns[:, 0] * length
    limit = np.minimum(ContactSettings.low_signal * length, relative)
    located = np.isfinite(point).all(axis=(1, 2)) & (frames.usable.sum(axis=1) >= ContactSettings.fewest_points)
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


def _equations(found: SurfaceFit, index: int, reach: Reach, seen: _Offered, m: np.ndarray) -> ShapeEquations:
    """What the touches m (N,) would say of their patch; see `patches.height_field`."""
    one, give = found.patches[index], found.state.compliance_m_N
    frame, normal = one.frame, reach.normal[m]
    press = np.sum(reach.force_N[m] * normal, axis=1)
    local = (reach.point_m[m] - one.center_m) @ frame.T
    x = local[:, : one.dimensions]
    pressed = np.einsum("ni,nis->ns", normal, seen.shared.force_N[m])
    given = LocalTouches(
        point_m=local,
        tangent=reach.tangent[m] @ frame.T,
        own_m2=frame @ seen.shared.own_m2[m] @ frame.T,
        modes_m=frame @ (seen.shared.point_m[m] + give * normal[:, :, None] * pressed[:, None, :]),
        tangent_modes=frame @ seen.shared.tangent[m],
        yield_N=-press[:, None] * normal @ frame.T,
        slope=found.solution.mean(index, one.slope_rows(x)).reshape(2, len(m)).T,
        bend_per_m=np.zeros((len(m), 2, 2)),
        normal=normal @ frame.T,
        ignored=np.zeros(len(m), bool),
    )
    return height_field(given) if one.wide else curve(given)


def _seen(solution: ShapeSolution, index: int, new: ShapeEquations) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """M new equations beside those solved: (K, M) whitened against the old ones; their covariance (M, M) without
    the compliance's; what they see (M,) of the compliance beyond what the old ones predict, N."""
    model = solution.patches[index]
    modes = np.concatenate([each.equations.modes for each in solution.patches])
    old = new.modes @ modes.T + solution.seen_by(index, new.rows)
    half = solve_triangular(solution.lower, old.T, lower=True, check_finite=False)
    whole = covariance(new.rows, new.rows, model.prior) + new.noise + new.modes @ new.modes.T
    whole += np.diag((model.slack_rad * new.slack) ** 2)
    return half, whole - half.T @ half, new.force_N - old @ solution.lift


def _own(index: int, count: int, total: int) -> np.ndarray:
    """Equations of one touch among those of `count`: its point's, and its tangent's or its other coordinate's."""
    return np.arange(index, total, count)


def _of_surface(found: SurfaceFit, reach: Reach, seen: _Offered) -> tuple[float, np.ndarray]:
    """Deviation of the surface, rms over all targets, now and after each touch (A-optimal)."""
    solution = found.solution
    targets = places(found, reach)
    # of a line its course out of the object: where beside it the antenna touches is no shape
    height = (np.array([1.0]), np.array([0.0, 1.0]))
    rows = [values_at(x, height[x.shape[1] == 1]) for x in targets]
    halves, now = [], []
    for index, view in enumerate(rows):
        old = solution.seen_by(index, view)
        halves.append(solve_triangular(solution.lower, old.T, lower=True, check_finite=False))
        now.append(np.maximum(variance(view, solution.patches[index].prior) - np.sum(halves[-1] ** 2, axis=0), 0.0))
    count = sum(map(len, targets))
    whole = float(np.sum(np.concatenate(now)))
    after = np.full(len(reach), np.nan)
    for index in np.unique(reach.patch):
        m = np.flatnonzero(reach.patch == index)
        new = _equations(found, index, reach, seen, m)
        whitened, left, _ = _seen(solution, index, new)
        with_targets = [-half.T @ whitened for half in halves]
        with_targets[index] += covariance(rows[index], new.rows, solution.patches[index].prior)
        cross = np.concatenate(with_targets)
        for place, row in enumerate(m.tolist()):
            own = _own(place, len(m), len(new))
            lower = np.linalg.cholesky(left[np.ix_(own, own)])
            told = float(np.sum(solve_triangular(lower, cross[:, own].T, lower=True) ** 2))
            after[row] = np.sqrt(max(whole - told, 0.0) / count)
    return float(np.sqrt(whole / count)), after


def places(found: SurfaceFit, reach: Reach) -> list[np.ndarray]:
    """Of each patch (N, 1) or (N, 2), where it was touched and where it can be."""
    result = []
    for index, one in enumerate(found.patches):
        more = (reach.point_m[reach.patch == index] - one.center_m) @ one.frame.T
        x = np.concatenate([found.local(one), more])[:, : one.dimensions]
        result.append(x[np.unique(np.linspace(0, len(x) - 1, TouchSettings.targets).astype(int))])
    return result


def _of_stiffness(found: SurfaceFit, reach: Reach, seen: _Offered) -> tuple[float, np.ndarray]:
    """Deviation of the compliance, now and after each touch."""
    after = np.full(len(reach), np.nan)
    information = 1.0 / found.solution.variance if found.solution.variance > 0.0 else 0.0
    for index in np.unique(reach.patch):
        m = np.flatnonzero(reach.patch == index)
        new = _equations(found, index, reach, seen, m)
        _, left, compliance_N = _seen(found.solution, index, new)
        for place, row in enumerate(m.tolist()):
            own = _own(place, len(m), len(new))
            pulled = compliance_N[own]
            told = pulled @ np.linalg.solve(left[np.ix_(own, own)], pulled)
            after[row] = 1.0 / np.sqrt(information + told)
    return float(np.sqrt(1.0 / information)) if information else float("inf"), after


def _of_friction(
    found: SurfaceFit, arrays: RigArrays, reach: Reach, seen: _Offered, rub: Friction
) -> tuple[float, np.ndarray, np.ndarray]:
    """Deviation of μ, now and after a stroke along the surface from each touch, and where that ends. μ shows across the
    antenna by the force and the shape's normal, along it by the friction angle."""
    low, high = rub.interval
    if rub.determined:
        mu, std = rub.mu, rub.std
    elif np.isfinite(high):
        mu, std = 0.5 * (max(low, 0.0) + high), max((high - max(low, 0.0)) / (2.0 * TouchSettings.interval_std), 0.0)
    else:
        mu, std = TouchSettings.likely_mu, TouchSettings.unknown_mu
    to, steps = along_surface(reach)
    end = reach.joints_rad[to]
    across, along = _slip(arrays, reach, end)
    lateral = _lateral(reach)
    size2 = np.sum(reach.force_N**2, axis=1)
    own = np.einsum("ni,nij,nj->n", lateral, seen.force_N2, lateral) / size2
    common = np.sum(np.einsum("ni,nis->ns", lateral, seen.shared.force_N) ** 2, axis=1) / size2
    turned = np.full(len(reach), np.nan)
    for index, one in enumerate(found.patches):
        m = reach.patch == index
        if m.any():
            nearest = one.members[KDTree(found.touches.point_m[one.members]).query(reach.point_m[m])[1]]
            turned[m] = np.einsum("ni,nij,nj->n", lateral[m], found.normals.covariance[nearest], lateral[m])
    alone = np.maximum(1.0 / seen.angle_std_rad**2 - 1.0 / seen.friction_rad**2, 0.0)
    by_force = (across / (1.0 + (mu * across) ** 2)) ** 2 / (
        (own / TouchSettings.frames_a_step + turned) / np.maximum(steps, 1) + common
    )
    by_angle = (along / (1.0 + (mu * along) ** 2)) ** 2 * alone * steps
    after = 1.0 / np.sqrt(1.0 / std**2 + by_force + by_angle)
    return float(std), np.where((steps > 0) & (by_force + by_angle > 0.0), after, np.nan), end


def _lateral(reach: Reach) -> np.ndarray:
    """(B, 3) unit, across the antenna on the surface."""
    lateral = np.cross(reach.normal, reach.tangent)
    return lateral / np.linalg.norm(lateral, axis=1, keepdims=True)


def _slip(arrays: RigArrays, reach: Reach, end_rad: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit direction (B,), (B,) across and along the antenna in which it slides on its way to other joint angles."""
    moved = carried(arrays, reach.joints_rad, end_rad, reach.point_m)
    across, along = (np.sum(moved * side, axis=1) for side in (_lateral(reach), reach.tangent))
    size = np.maximum(np.hypot(across, along), 1e-12)
    return across / size, along / size
