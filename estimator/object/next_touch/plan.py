"""The next touch: the one that decreases the expected variance of surface, friction or stiffness most.

Joint angles are chosen, not places: a straight wire touches a body along its outline seen from the clamp. At known
angles the frictionless rod lies tangent on the surface's posterior mean: three equations for distance and force.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from scipy.linalg import solve_triangular
from scipy.spatial import KDTree

from estimator.contact.common_errors import CommonErrors, empty_frames, noise_free_frames, shared_errors
from estimator.contact.settings import ContactSettings
from estimator.object.estimate import estimate_object
from estimator.object.friction import Friction
from estimator.object.surface.build import fitted, surely_known_m
from estimator.object.surface.fit import SurfaceFit, fit
from estimator.object.surface.patches import LocalTouches, curve, height_field
from estimator.object.surface.solution import ShapeEquations, ShapeSolution, covariance, values_at, variance
from estimator.object.surface.touches import touches_of
from estimator.solver.frames import Frames
from estimator.solver.linearised import bend, linearised
from estimator.solver.rig_arrays import UNKNOWNS, RigArrays
from estimator.table.contacts import ContactTable, joint_angles
from vbaa_calib.antenna.rungs import REFERENCE
from vbaa_calib.antenna.shape import CONTACT, Curves
from vbaa_calib.core.arrays import Rows, spread_evenly, validate_arguments
from vbaa_calib.core.errors import InputError
from vbaa_calib.geometry.covariance import variance_along
from vbaa_calib.rig import Antenna, Rig


@dataclass(frozen=True)
class _TouchSettings:
    """Settings of the search for the next touch."""

    most_steps: int = 15  # of Newton's method for a touch
    longest_step: float = 0.25  # in antenna lengths
    difference_step: float = 1e-4  # of its slopes
    converged: float = 1e-4  # misfit at which it ends
    swept_share: float = 0.12  # step along the surface over its patch's extent
    farthest_step_rad: float = 0.06  # longest step along the surface
    nearest: float = 0.1  # in antenna lengths: nearer it is stiff
    farthest: float = 0.97  # farther its end slips off
    place_m: float = 0.01  # what a radian counts as, next to metres of a curve's foot
    axis_step_rad: float = 1e-4  # of derivatives by joint angles
    clear_m: float = 5e-3  # distance from the surface at which a touch begins, besides three standard deviations
    nearest_other_m: float = 1e-3  # no other part of the object may be nearer to the antenna
    targets: int = 400  # places of a patch at which the surface is to be known
    frames_a_step: int = 4  # of a stroke, whose own errors average out
    unknown_mu: float = 0.5  # largest μ of an object whose friction is unknown
    likely_mu: float = 0.3  # its expected μ
    interval_std: float = 1.96  # standard deviations of a 95 % interval
    rows: int = 36  # contacts that strokes are tried from
    # of the antenna at the contact, one after the other, up to the one of the touch
    slopes_deg: tuple[float, float, float] = (4.0, 8.0, 14.0)


@dataclass(frozen=True)
class JointLimits:
    """Lowest and highest joint angles, rad."""

    pan_rad: tuple[float, float]
    tilt_rad: tuple[float, float]

    @staticmethod
    def of(table: ContactTable, rig: Rig) -> JointLimits:
        """The range of a recording's joint angles."""
        pan, tilt = joint_angles(rig.kinematics, table)
        if not np.isfinite(pan + tilt).any():
            raise InputError("no frame has its joint angles", remedy="give contacts.csv as vbaa estimate writes it")
        low, high = (reach(np.stack([pan, tilt]), axis=1).tolist() for reach in (np.nanmin, np.nanmax))
        return JointLimits((low[0], high[0]), (low[1], high[1]))

    def hold(self, pan_rad: np.ndarray, tilt_rad: np.ndarray) -> np.ndarray:
        """(B,) mask of the angles within the limits."""
        pan, tilt = self.pan_rad, self.tilt_rad
        return (pan_rad >= pan[0]) & (pan_rad <= pan[1]) & (tilt_rad >= tilt[0]) & (tilt_rad <= tilt[1])


@dataclass(frozen=True, eq=False)
class _Reach(Rows):
    """B feasible touches."""

    joints_rad: np.ndarray  # (B, 2) pan and tilt of the pressed antenna
    begin_rad: np.ndarray  # (B, 2) clear of the object, where the touch begins
    touch_rad: np.ndarray  # (B, 2) where it should first touch
    patch: np.ndarray  # (B,) of the surface
    unknowns: np.ndarray  # (B, 4) as `rig_arrays.UNKNOWNS`
    row: np.ndarray  # (B,) row, sweep and level it comes from
    sweep: np.ndarray
    level: np.ndarray
    point_m: np.ndarray  # (B, 3) of the contact, world frame
    normal: np.ndarray  # (B, 3) out of the object
    tangent: np.ndarray  # (B, 3)
    force_N: np.ndarray  # (B, 3)


def _frames(arrays: RigArrays, joints_rad: np.ndarray) -> Frames:
    """Frames at joint angles (B, 2), without points and readings."""
    rotation, _ = arrays.rig.kinematics.world_antenna(*joints_rad.T)
    return empty_frames(arrays, np.einsum("bji,j->bi", rotation, arrays.rig.gravity_world_m_s2))


def _bent(arrays: RigArrays, joints_rad: np.ndarray, unknowns: np.ndarray) -> Curves:
    """Antennas at joint angles (B, 2) with unknowns (B, 4), in the world frame."""
    rotation, translation = arrays.rig.kinematics.world_antenna(*joints_rad.T)
    shapes = bend(_frames(arrays, joints_rad), REFERENCE, unknowns[:, None])
    points, tangents = (np.einsum("bij,bmj->bmi", rotation, each) for each in (shapes.points_m, shapes.tangents))
    force = np.einsum("bij,bj->bi", rotation, shapes.force_N)
    return replace(shapes, points_m=points + translation[:, None], tangents=tangents, force_N=force)


def _against(
    found: SurfaceFit, patch: np.ndarray, bent: Curves, antenna: Antenna
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Gap (B,) between antennas and their patches, m, 0 (B,) where the antenna is tangential, and outward normal (B,
    3)."""
    gaps, tilts, normals = (np.full(shape, np.nan) for shape in (len(patch), len(patch), (len(patch), 3)))
    for index in np.unique(patch):
        m, one, solution = patch == index, found.patches[index], found.solution
        local, tangent = (bent.contact_m[m] - one.center_m) @ one.frame.T, bent.tangents[m, CONTACT] @ one.frame.T
        x = local[:, : one.dimensions]
        height = solution.mean(index, one.value_rows(x)).reshape(-1, len(x)).T
        slope = solution.mean(index, one.slope_rows(x)).reshape(2, len(x)).T
        if one.wide:
            normal = np.column_stack([-slope, np.ones(len(x))])
            length = np.linalg.norm(normal, axis=1)
            normal = normal / length[:, None]
            gap, flat = (local[:, 2] - height[:, 0]) / length, np.sum(normal * tangent, axis=1)
        else:
            along = np.column_stack([np.ones(len(x)), slope])
            along = along / np.linalg.norm(along, axis=1, keepdims=True)
            normal = np.cross(along, tangent)
            size = np.linalg.norm(normal, axis=1, keepdims=True)
            normal = normal / np.where(size > 0.05, size, np.nan) * np.where(normal[:, 2:] < 0.0, -1.0, 1.0)
            off = np.column_stack([np.zeros(len(x)), local[:, 1:] - height])
            gap = np.sum(off * normal, axis=1)
            flat = np.sum(off * np.cross(normal, along), axis=1) / _TouchSettings.place_m
        gaps[m], tilts[m], normals[m] = gap, flat, normal @ one.frame
    return gaps - antenna.radius_at(bent.arclength_m[:, CONTACT]), tilts, normals


def _surface_std(found: SurfaceFit, patch: np.ndarray, point_m: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """(B,) standard deviation, m, of the surface along normals (B, 3) under points (B, 3)."""
    result = np.full(len(patch), np.nan)
    for index in np.unique(patch):
        m, one = patch == index, found.patches[index]
        result[m] = found.std_along(index, (point_m[m] - one.center_m) @ one.frame.T, normal[m])
    return result


def _newton(residual: Callable[[np.ndarray], np.ndarray], start: np.ndarray) -> np.ndarray:
    """Solutions of B small systems (B, K) by Newton's method with difference quotients; NaN where it does not
    converge."""
    x, size, step = start, start.shape[1], _TouchSettings.difference_step
    for _ in range(_TouchSettings.most_steps):
        here = residual(x)
        slopes = np.stack([(residual(x + step * axis) - here) / step for axis in np.eye(size)], axis=-1)
        sound = np.isfinite(slopes).all(axis=(1, 2)) & np.isfinite(here).all(axis=1)
        slopes = np.where(sound[:, None, None], slopes, np.eye(size))
        damped = np.swapaxes(slopes, 1, 2) @ slopes
        damped += 1e-9 * np.trace(damped, axis1=1, axis2=2)[:, None, None] * np.eye(size)
        move = -np.linalg.solve(damped, np.einsum("bij,bi->bj", slopes, here)[..., None])[..., 0]
        longest = np.abs(move).max(axis=1, keepdims=True)
        x = np.where(
            sound[:, None], x + move * np.minimum(1.0, _TouchSettings.longest_step / np.maximum(longest, 1e-12)), np.nan
        )
    return np.where((np.abs(residual(x)).max(axis=1) < _TouchSettings.converged)[:, None], x, np.nan)


def _reachable(
    found: SurfaceFit, arrays: RigArrays, rows: np.ndarray, joints_rad: np.ndarray, limits: JointLimits
) -> _Reach:
    """Feasible touches near those already made, rows (P,) at joint angles (P, 2), pressed straight onto the known
    surface: from first contact on they stay on places that `reconstruct` would draw."""
    rows = rows[spread_evenly(len(rows), _TouchSettings.rows)]
    label = np.empty(len(found.touches), int)
    for index, one in enumerate(found.patches):
        label[one.members] = index
    antenna, length = arrays.rig.antenna, arrays.length_m
    at = joints_rad[rows]
    across, speed = _ways(arrays, at, found.touches.point_m[rows], found.normals.normal[rows])
    extent = np.array([np.linalg.norm(np.ptp(found.point_m[one.members], axis=0)) for one in found.patches])
    stride = np.minimum(
        _TouchSettings.swept_share * extent[label[rows]] / speed[:, 1], _TouchSettings.farthest_step_rad
    )
    # strokes from one contact
    row, sweep = (each.ravel() for each in np.meshgrid(np.arange(len(rows)), np.arange(-4, 5), indexing="ij"))
    press, along = across[row, 0], across[row, 1]
    start = at[row] + (sweep * stride[row])[:, None] * along
    patch, distance = label[rows][row], found.touches.distance_m[rows][row] / length

    def free(x: np.ndarray) -> np.ndarray:
        unknowns = np.zeros((len(x), UNKNOWNS))
        unknowns[:, 0] = np.clip(x[:, 0], _TouchSettings.nearest, 1.0)
        gap, flat, _ = _against(found, patch, _bent(arrays, start + x[:, 1:] * press, unknowns), antenna)
        return np.column_stack([gap / _TouchSettings.place_m, flat])

    first = _newton(free, np.column_stack([distance, np.zeros(len(row))]))
    touch = start + first[:, 1:] * press
    parts, known = [], np.isfinite(first).all(axis=1)
    unknowns = np.zeros((len(row), UNKNOWNS))
    unknowns[:, 0] = np.clip(np.nan_to_num(first[:, 0], nan=0.5), _TouchSettings.nearest, 1.0)
    begun = _bent(arrays, np.nan_to_num(touch), unknowns)
    _, _, normal = _against(found, patch, begun, antenna)
    std = _surface_std(found, patch, begun.contact_m, normal)
    bound_m = np.array([surely_known_m(found, index) for index in range(len(found.patches))])[patch]
    known &= std <= bound_m
    lever = _ways(arrays, np.nan_to_num(touch), begun.contact_m, np.nan_to_num(normal))[1][:, 0]
    begin = touch - ((_TouchSettings.clear_m + 3.0 * std) / lever)[:, None] * press
    for level, slope in enumerate(np.radians(_TouchSettings.slopes_deg)):
        size = 2.0 * antenna.stiffness_Nm2 * slope / (unknowns[:, 0] * length) ** 2
        size /= antenna.taper.turning(unknowns[:, 0])
        pressed_rad = 2.0 / 3.0 * slope * first[:, 0] * length / lever
        pressed = touch + pressed_rad[:, None] * press
        turn = arrays.rig.kinematics.world_antenna(*np.nan_to_num(pressed).T)[0]
        aim = np.einsum("bji,bj->bi", turn, np.nan_to_num(normal))[:, 1:]
        begun_at = np.column_stack([first[:, 0], size[:, None] * aim / arrays.force_unit_N])
        made, bent, outward = _pressed(found, arrays, patch, pressed, begun_at)
        std = _surface_std(found, patch, bent.contact_m, outward)
        inside = (made[:, 0] > _TouchSettings.nearest) & (made[:, 0] < _TouchSettings.farthest)
        known = known & np.isfinite(made).all(axis=1) & inside & (std <= bound_m)
        known &= np.sum(bent.force_N * outward, axis=1) > 0.0
        allowed = known & limits.hold(*pressed.T) & limits.hold(*begin.T)
        allowed[allowed] = _clear(found, patch[allowed], bent.points_m[allowed], 0.5 * antenna.diameter_m)
        part = _Reach(
            *(pressed, begin, touch, patch, made, row, sweep, np.full(len(row), level)),
            *(bent.contact_m, outward, bent.tangents[:, CONTACT], bent.force_N),
        )
        parts.append(part.picked(np.flatnonzero(allowed)))
    return _Reach.joined(parts)


def _pressed(
    found: SurfaceFit, arrays: RigArrays, patch: np.ndarray, joints_rad: np.ndarray, start: np.ndarray
) -> tuple[np.ndarray, Curves, np.ndarray]:
    """Unknowns (B, 4) of antennas in frictionless contact with the surface, NaN where there is none, their shapes,
    and the surface's normals (B, 3)."""
    antenna, scale = arrays.rig.antenna, np.linalg.norm(start[:, 1:], axis=1)

    def unknowns_of(x: np.ndarray) -> np.ndarray:
        force = scale[:, None] * x[:, 1:]
        return np.column_stack([np.clip(x[:, 0], _TouchSettings.nearest, 1.0), force, np.zeros(len(x))])

    def residual(x: np.ndarray) -> np.ndarray:
        bent = _bent(arrays, joints_rad, unknowns_of(x))
        gap, flat, normal = _against(found, patch, bent, antenna)
        give = found.state.compliance_m_N * np.sum(bent.force_N * normal, axis=1)
        side = np.sum(bent.force_N * np.cross(normal, bent.tangents[:, CONTACT]), axis=1)
        size = np.linalg.norm(bent.force_N, axis=1)
        return np.column_stack([(gap + give) / _TouchSettings.place_m, flat, side / np.maximum(size, 1e-12)])

    x = _newton(residual, np.column_stack([start[:, 0], start[:, 1:] / scale[:, None]]))
    unknowns = unknowns_of(x)
    bent = _bent(arrays, joints_rad, unknowns)
    return unknowns, bent, _against(found, patch, bent, antenna)[2]


def _carried(arrays: RigArrays, joints_rad: np.ndarray, to_rad: np.ndarray, point_m: np.ndarray) -> np.ndarray:
    """(B, 3) world displacement of points of the undeformed antenna when the joints move from (B, 2) to other
    angles."""
    (rotation, translation), (turned, shifted) = (
        arrays.rig.kinematics.world_antenna(*joints.T) for joints in (joints_rad, to_rad)
    )
    local = np.einsum("bji,bj->bi", rotation, point_m - translation)
    return np.einsum("bij,bj->bi", turned, local) + shifted - point_m


def _ways(
    arrays: RigArrays, joints_rad: np.ndarray, point_m: np.ndarray, normal: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(B, 2, 2) unit directions of the joint angles, onto the surface and along it, and the speeds (B, 2), m per
    rad, of points along them."""
    steps = (joints_rad + _TouchSettings.axis_step_rad * axis for axis in np.eye(2))
    velocity = np.stack(
        [_carried(arrays, joints_rad, to, point_m) / _TouchSettings.axis_step_rad for to in steps], axis=1
    )
    onto = -np.einsum("bki,bi->bk", velocity, normal)
    onto = onto / np.maximum(np.linalg.norm(onto, axis=1, keepdims=True), 1e-9)
    ways = np.stack([onto, np.column_stack([-onto[:, 1], onto[:, 0]])], axis=1)
    speed = np.linalg.norm(np.einsum("bwk,bki->bwi", ways, velocity), axis=2)
    speed[:, 0] = np.abs(np.einsum("bk,bki,bi->b", onto, velocity, normal))
    return ways, np.maximum(speed, 1e-6)


def _clear(found: SurfaceFit, patch: np.ndarray, nodes_m: np.ndarray, radius_m: float) -> np.ndarray:
    """(B,) mask of the antennas with nodes (B, M, 3) that no touched point of other patches obstructs."""
    clear = np.ones(len(patch), bool)
    share = np.linspace(0.0, 1.0, 8, endpoint=False)[:, None, None]
    for index in np.unique(patch):
        others = np.concatenate([[], *(one.members for k, one in enumerate(found.patches) if k != index)]).astype(int)
        m = np.flatnonzero(patch == index)
        if len(others) and len(m):
            ends = nodes_m[m]
            points = np.concatenate([ends[:, :-1] + part * (ends[:, 1:] - ends[:, :-1]) for part in share], axis=1)
            away = KDTree(found.point_m[others]).query(points.reshape(-1, 3))[0].reshape(len(m), -1).min(axis=1)
            clear[m] = away > radius_m + _TouchSettings.nearest_other_m
    return clear


def _along_surface(reach: _Reach) -> tuple[np.ndarray, np.ndarray]:
    """End (B,) of a stroke from each touch, as the index of another one, and its number of steps (B,): along its row
    and level as far as all are feasible, to the farther side."""
    keys = list(zip(reach.row.tolist(), reach.sweep.tolist(), reach.level.tolist(), strict=True))
    place = {key: index for index, key in enumerate(keys)}
    end, steps = np.arange(len(reach)), np.zeros(len(reach), int)
    for index, (row, sweep, level) in enumerate(keys):
        for way in (1, -1):
            count = 0
            while (row, sweep + way * (count + 1), level) in place:
                count += 1
            if count > steps[index]:
                end[index], steps[index] = place[row, sweep + way * count, level], count
    return end, steps


GOALS = ("surface", "friction", "stiffness")
UNITS = {"surface": "m", "friction": "", "stiffness": "m/N"}


@dataclass(frozen=True)
class NextTouch:
    """A touch to make next, and its expected information."""

    goal: str  # of `GOALS`
    begin_rad: tuple[float, float]  # pan and tilt clear of the object
    touch_rad: tuple[float, float]  # at the expected first contact
    press_rad: tuple[float, float]  # pressed
    end_rad: tuple[float, float]  # where a stroke for the friction ends, else as pressed
    distance_m: float  # along the antenna, as it should come out when pressed
    force_N: float  # its size, likewise
    point_m: tuple[float, float, float]  # the contact in the world
    normal: tuple[float, float, float]  # the object's there
    # deviation of the goal now: of the surface, rms over where it was touched and can be, m; μ; compliance, m/N
    std: float
    std_after: float  # expected standard deviation of the goal afterwards
    compared: int  # how many touches could be made

    def summary(self) -> dict[str, Any]:
        """The touch as plain data."""
        return asdict(self)


@validate_arguments
def next_touch(contacts: ContactTable, rig: Rig, goal: str = "surface", limits: JointLimits | None = None) -> NextTouch:
    """The touch that minimises the expected uncertainty of surface, friction or stiffness.

    contacts : of one object at rest; refined ones with the updated rig contain more information. goal : of `GOALS`.
    limits : of the joints; by default the angles of the recording.

    Raises
    ------
    InputError : contacts without a touch to go by; a goal that is none of these; no touch within the limits stays on
        what is known of the surface.
    """
    options = _touches_within(contacts, rig, goal, limits)
    return options.chosen(int(np.nanargmin(options.std_after)))


@dataclass(frozen=True, eq=False)
class _Options:
    """Feasible touches, and the expected standard deviation (B,) of the goal after each; NaN where undetermined."""

    goal: str
    reach: _Reach
    end_rad: np.ndarray
    std: float
    std_after: np.ndarray
    length_m: float

    def chosen(self, index: int) -> NextTouch:
        """One of the touches as plain numbers."""
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


def _touches_within(
    contacts: ContactTable, rig: Rig, goal: str = "surface", limits: JointLimits | None = None
) -> _Options:
    """All touches that `next_touch` compares."""
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
        reach = _reachable(found, arrays, np.flatnonzero(sound), joints, limits)
        seen = _offered(contacts, arrays, touches.row, reach) if len(reach) else None
    if seen is None or not len(seen.rows):
        raise InputError(
            "no touch within the joint limits stays on what is known of the surface",
            remedy="widen the limits, or touch the object once more close to where it was touched",
        )
    reach = reach.picked(seen.rows)
    end = reach.joints_rad
    if goal == "friction":
        rub = estimate_object(contacts, rig, events=False).friction
        std, after, end = _of_friction(found, arrays, reach, seen, rub)
    elif goal == "stiffness":
        found = fit(touches, rig.antenna.radius_at(touches.distance_m), found.patches, found.state, True)
        std, after = _of_stiffness(found, reach, seen)
    else:
        std, after = _of_surface(found, reach, seen)
    if not np.isfinite(after).any():
        raise InputError(
            f"no touch within the joint limits would add information on the {goal}",
            remedy="widen the limits" if goal != "friction" else "touch the object beside where it was touched first",
        )
    return _Options(goal, reach, end, std, after, arrays.length_m)


@dataclass(frozen=True, eq=False)
class _Offered:
    """Expected uncertainty of B touches."""

    rows: np.ndarray  # (B,) of the touches that were assessed
    shared: CommonErrors  # errors that they share with the contacts that were made
    force_N2: np.ndarray  # (B, 3, 3) own covariances, world
    angle_std_rad: np.ndarray  # (B,) of the friction angle
    friction_rad: float


def _offered(contacts: ContactTable, arrays: RigArrays, made: np.ndarray, reach: _Reach) -> _Offered:
    """The touches that the estimator would locate, and their expected uncertainty."""
    empty = _frames(arrays, reach.joints_rad)
    available = np.ones(len(reach)) * np.isfinite(contacts.moment_residual_Nm[made]).any()
    frames = noise_free_frames(empty, REFERENCE, reach.unknowns, available, point_per_px=True)
    there = linearised(frames, REFERENCE, reach.unknowns)
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


def _equations(found: SurfaceFit, index: int, reach: _Reach, seen: _Offered, m: np.ndarray) -> ShapeEquations:
    """Equations that the touches m (N,) would add to their patch; see `patches.height_field`."""
    one, give = found.patches[index], found.state.compliance_m_N
    frame, normal = one.frame, reach.normal[m]
    press = np.sum(reach.force_N[m] * normal, axis=1)
    local = (reach.point_m[m] - one.center_m) @ frame.T
    x = local[:, : one.dimensions]
    pressed = np.einsum("ni,nis->ns", normal, seen.shared.force_N[m])
    hypothetical = LocalTouches(
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
    return height_field(hypothetical) if one.wide else curve(hypothetical)


def _seen(solution: ShapeSolution, index: int, new: ShapeEquations) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Covariance of M new equations of a patch with the K solved ones, and their sensitivity to the compliance.

    Returns their covariance (K, M) with the solved ones, whitened by those; their own covariance (M, M) conditional on
    those and the compliance; and their sensitivity (M,) to the compliance, N, less what the solved ones predict of it.
    """
    prior = solution.priors[index]
    modes = np.concatenate([each.modes for each in solution.equations])
    old = new.modes @ modes.T + solution.seen_by(index, new.rows)
    half = solution.root @ old.T
    whole = covariance(new.rows, new.rows, prior) + new.noise + new.modes @ new.modes.T
    whole += np.diag((prior.slack_rad * new.slack) ** 2)
    return half, whole - half.T @ half, new.force_N - old @ solution.lift


def _of_surface(found: SurfaceFit, reach: _Reach, seen: _Offered) -> tuple[float, np.ndarray]:
    """Standard deviation of the surface, rms over all targets, at present and after each touch (A-optimality)."""
    solution = found.solution
    targets = _places(found, reach)
    # of a line its course out of the object: where beside it the antenna touches is no shape
    height = (np.array([1.0]), np.array([0.0, 1.0]))
    rows = [values_at(x, height[x.shape[1] == 1]) for x in targets]
    halves, now = [], []
    for index, view in enumerate(rows):
        halves.append(solution.whitened(index, view)[1])
        now.append(np.maximum(variance(view, solution.priors[index]) - np.sum(halves[-1] ** 2, axis=0), 0.0))
    count = sum(map(len, targets))
    whole = float(np.sum(np.concatenate(now)))
    after = np.full(len(reach), np.nan)
    for index in np.unique(reach.patch):
        m = np.flatnonzero(reach.patch == index)
        new = _equations(found, index, reach, seen, m)
        whitened, left, _ = _seen(solution, index, new)
        with_targets = [-half.T @ whitened for half in halves]
        with_targets[index] += covariance(rows[index], new.rows, solution.priors[index])
        cross = np.concatenate(with_targets)
        for place, row in enumerate(m.tolist()):
            own = slice(place, None, len(m))  # its point's, and its tangent's or its other coordinate's
            lower = np.linalg.cholesky(left[own, own])
            explained = float(np.sum(solve_triangular(lower, cross[:, own].T, lower=True) ** 2))
            after[row] = np.sqrt(max(whole - explained, 0.0) / count)
    return float(np.sqrt(whole / count)), after


def _places(found: SurfaceFit, reach: _Reach) -> list[np.ndarray]:
    """Places of each patch, (N, 1) or (N, 2), that were touched or are reachable."""
    result = []
    for index, one in enumerate(found.patches):
        more = (reach.point_m[reach.patch == index] - one.center_m) @ one.frame.T
        x = np.concatenate([found.local(one), more])[:, : one.dimensions]
        result.append(x[spread_evenly(len(x), _TouchSettings.targets)])
    return result


def _of_stiffness(found: SurfaceFit, reach: _Reach, seen: _Offered) -> tuple[float, np.ndarray]:
    """Standard deviation of the compliance, at present and after each touch."""
    after = np.full(len(reach), np.nan)
    information = 1.0 / found.solution.variance if found.solution.variance > 0.0 else 0.0
    for index in np.unique(reach.patch):
        m = np.flatnonzero(reach.patch == index)
        new = _equations(found, index, reach, seen, m)
        _, left, compliance_N = _seen(found.solution, index, new)
        for place, row in enumerate(m.tolist()):
            own = slice(place, None, len(m))  # its point's, and its tangent's or its other coordinate's
            pulled = compliance_N[own]
            explained = pulled @ np.linalg.solve(left[own, own], pulled)
            after[row] = 1.0 / np.sqrt(information + explained)
    return float(np.sqrt(1.0 / information)) if information else float("inf"), after


def _of_friction(
    found: SurfaceFit, arrays: RigArrays, reach: _Reach, seen: _Offered, rub: Friction
) -> tuple[float, np.ndarray, np.ndarray]:
    """Standard deviation of μ, at present and after a stroke along the surface from each touch, and the stroke's
    end. μ is observed across the antenna by the force and the shape's normal, along it by the friction angle."""
    low, high = rub.interval
    if rub.determined:
        mu, std = rub.mu, rub.std
    elif np.isfinite(high):
        mu, std = 0.5 * (max(low, 0.0) + high), max((high - max(low, 0.0)) / (2.0 * _TouchSettings.interval_std), 0.0)
    else:
        mu, std = _TouchSettings.likely_mu, _TouchSettings.unknown_mu
    to, steps = _along_surface(reach)
    end = reach.joints_rad[to]
    across, along = _slip(arrays, reach, end)
    lateral = _lateral(reach)
    size2 = np.sum(reach.force_N**2, axis=1)
    own = variance_along(seen.force_N2, lateral) / size2
    common = np.sum(np.einsum("ni,nis->ns", lateral, seen.shared.force_N) ** 2, axis=1) / size2
    turned = np.full(len(reach), np.nan)
    for index, one in enumerate(found.patches):
        m = reach.patch == index
        if m.any():
            nearest = one.members[KDTree(found.touches.point_m[one.members]).query(reach.point_m[m])[1]]
            turned[m] = variance_along(found.normals.covariance[nearest], lateral[m])
    alone = np.maximum(1.0 / seen.angle_std_rad**2 - 1.0 / seen.friction_rad**2, 0.0)
    by_force = (across / (1.0 + (mu * across) ** 2)) ** 2 / (
        (own / _TouchSettings.frames_a_step + turned) / np.maximum(steps, 1) + common
    )
    by_angle = (along / (1.0 + (mu * along) ** 2)) ** 2 * alone * steps
    after = 1.0 / np.sqrt(1.0 / std**2 + by_force + by_angle)
    return float(std), np.where((steps > 0) & (by_force + by_angle > 0.0), after, np.nan), end


def _lateral(reach: _Reach) -> np.ndarray:
    """(B, 3) unit vectors across the antenna on the surface."""
    lateral = np.cross(reach.normal, reach.tangent)
    return lateral / np.linalg.norm(lateral, axis=1, keepdims=True)


def _slip(arrays: RigArrays, reach: _Reach, end_rad: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Components (B,), (B,) across and along the antenna of the unit slip direction on the way to other joint
    angles."""
    moved = _carried(arrays, reach.joints_rad, end_rad, reach.point_m)
    across, along = (np.sum(moved * side, axis=1) for side in (_lateral(reach), reach.tangent))
    size = np.maximum(np.hypot(across, along), 1e-12)
    return across / size, along / size
