"""Joint angles at which the antenna touches a partly known surface, and the contacts there.

Joint angles are chosen, not places: a straight wire touches a body along its outline seen from the clamp. At given
angles the frictionless rod lies tangent on the surface's posterior mean: three equations for distance and force.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from estimator.contact.common_errors import empty_frames
from estimator.object.surface.build import surely_known_m
from estimator.object.surface.fit import SurfaceFit
from estimator.solver.frames import Frames
from estimator.solver.linearised import bend
from estimator.solver.rig_arrays import UNKNOWNS, RigArrays
from estimator.table.contacts import ContactTable, joint_angles
from vbaa_calib.antenna.nodes import CONTACT
from vbaa_calib.core.arrays import Rows
from vbaa_calib.core.errors import InputError
from vbaa_calib.rig import Rig

RUNG = "rod"


@dataclass(frozen=True)
class TouchSettings:
    """Where the next touch may be, and how it is found."""

    most_steps: int = 15  # of Newton's method for a touch
    longest_step: float = 0.25  # in antenna lengths
    converged: float = 1e-4  # misfit at which it ends
    swept_share: float = 0.12  # a step along the surface, of its patch's extent,
    farthest_step_rad: float = 0.06  # but no longer than this
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
        """The angles of a recording."""
        pan, tilt = joint_angles(rig.kinematics, table)
        if not np.isfinite(pan + tilt).any():
            raise InputError("no frame has its joint angles", remedy="give contacts.csv as vbaa estimate writes it")
        low, high = (reach(np.stack([pan, tilt]), axis=1).tolist() for reach in (np.nanmin, np.nanmax))
        return JointLimits((low[0], high[0]), (low[1], high[1]))

    def hold(self, pan_rad: np.ndarray, tilt_rad: np.ndarray) -> np.ndarray:
        """(B,) bool."""
        pan, tilt = self.pan_rad, self.tilt_rad
        return (pan_rad >= pan[0]) & (pan_rad <= pan[1]) & (tilt_rad >= tilt[0]) & (tilt_rad <= tilt[1])


@dataclass(frozen=True, eq=False)
class Reach(Rows):
    """B touches that can be made."""

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

    def frames(self, arrays: RigArrays) -> Frames:
        """Frames at their joint angles, without points and readings."""
        return _frames(arrays, self.joints_rad)


def _frames(arrays: RigArrays, joints_rad: np.ndarray) -> Frames:
    """Frames at joint angles (B, 2), without points and readings."""
    rotation, _ = arrays.rig.kinematics.world_antenna(*joints_rad.T)
    return empty_frames(arrays, np.einsum("bji,j->bi", rotation, arrays.rig.gravity_world_m_s2))


@dataclass(frozen=True, eq=False)
class _Bent:
    """B antennas in the world."""

    point_m: np.ndarray  # (B, 3) contact
    tangent: np.ndarray  # (B, 3)
    force_N: np.ndarray  # (B, 3)
    nodes_m: np.ndarray  # (B, M, 3)


def _bent(arrays: RigArrays, joints_rad: np.ndarray, unknowns: np.ndarray) -> _Bent:
    rotation, translation = arrays.rig.kinematics.world_antenna(*joints_rad.T)
    shapes = bend(_frames(arrays, joints_rad), RUNG, unknowns[:, None])
    nodes = np.einsum("bij,bmj->bmi", rotation, shapes.points_m) + translation[:, None]
    tangent, force = (np.einsum("bij,bj->bi", rotation, each) for each in (shapes.tangents[:, CONTACT], shapes.force_N))
    return _Bent(nodes[:, CONTACT], tangent, force, nodes)


def _against(
    found: SurfaceFit, patch: np.ndarray, bent: _Bent, radius_m: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Gap (B,) between antennas and their patches, m, 0 (B,) where the antenna lies flat, outward normal (B, 3)."""
    gaps, tilts, normals = (np.full(shape, np.nan) for shape in (len(patch), len(patch), (len(patch), 3)))
    for index in np.unique(patch):
        m, one, solution = patch == index, found.patches[index], found.solution
        local, tangent = (bent.point_m[m] - one.center_m) @ one.frame.T, bent.tangent[m] @ one.frame.T
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
            flat = np.sum(off * np.cross(normal, along), axis=1) / TouchSettings.place_m
        gaps[m], tilts[m], normals[m] = gap - radius_m, flat, normal @ one.frame
    return gaps, tilts, normals


def _surface_std(found: SurfaceFit, patch: np.ndarray, point_m: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """(B,) deviation of the surface along normals (B, 3) under points (B, 3), m."""
    result = np.full(len(patch), np.nan)
    for index in np.unique(patch):
        m, one = patch == index, found.patches[index]
        result[m] = found.std_along(index, (point_m[m] - one.center_m) @ one.frame.T, normal[m])
    return result


def _newton(residual: Callable[[np.ndarray], np.ndarray], start: np.ndarray, step: float) -> np.ndarray:
    """B small systems (B, K) at once, by differences; NaN where they do not converge."""
    x, size = start, start.shape[1]
    for _ in range(TouchSettings.most_steps):
        here = residual(x)
        slopes = np.stack([(residual(x + step * axis) - here) / step for axis in np.eye(size)], axis=-1)
        sound = np.isfinite(slopes).all(axis=(1, 2)) & np.isfinite(here).all(axis=1)
        slopes = np.where(sound[:, None, None], slopes, np.eye(size))
        damped = np.swapaxes(slopes, 1, 2) @ slopes
        damped += 1e-9 * np.trace(damped, axis1=1, axis2=2)[:, None, None] * np.eye(size)
        move = -np.linalg.solve(damped, np.einsum("bij,bi->bj", slopes, here)[..., None])[..., 0]
        longest = np.abs(move).max(axis=1, keepdims=True)
        x = np.where(
            sound[:, None], x + move * np.minimum(1.0, TouchSettings.longest_step / np.maximum(longest, 1e-12)), np.nan
        )
    return np.where((np.abs(residual(x)).max(axis=1) < TouchSettings.converged)[:, None], x, np.nan)


def reachable(
    found: SurfaceFit, arrays: RigArrays, rows: np.ndarray, joints_rad: np.ndarray, limits: JointLimits
) -> Reach:
    """Touches near those that were made, rows (P,) at joint angles (P, 2), pressed straight onto what is known of the
    surface: all the way from the first contact lies on places that `reconstruct` would draw."""
    if len(rows) > TouchSettings.rows:
        rows = rows[np.unique(np.linspace(0, len(rows) - 1, TouchSettings.rows).astype(int))]
    label = np.empty(len(found.touches), int)
    for index, one in enumerate(found.patches):
        label[one.members] = index
    radius, length = 0.5 * arrays.rig.antenna.diameter_m, arrays.length_m
    at = joints_rad[rows]
    across, speed = _ways(arrays, at, found.touches.point_m[rows], found.normals.normal[rows])
    extent = np.array([np.linalg.norm(np.ptp(found.point_m[one.members], axis=0)) for one in found.patches])
    stride = np.minimum(TouchSettings.swept_share * extent[label[rows]] / speed[:, 1], TouchSettings.farthest_step_rad)
    # strokes from one contact
    row, sweep = (each.ravel() for each in np.meshgrid(np.arange(len(rows)), np.arange(-4, 5), indexing="ij"))
    press, along = across[row, 0], across[row, 1]
    start = at[row] + (sweep * stride[row])[:, None] * along
    patch, distance = label[rows][row], found.touches.distance_m[rows][row] / length

    def free(x: np.ndarray) -> np.ndarray:
        unknowns = np.zeros((len(x), UNKNOWNS))
        unknowns[:, 0] = np.clip(x[:, 0], TouchSettings.nearest, 1.0)
        gap, flat, _ = _against(found, patch, _bent(arrays, start + x[:, 1:] * press, unknowns), radius)
        return np.column_stack([gap / TouchSettings.place_m, flat])

    first = _newton(free, np.column_stack([distance, np.zeros(len(row))]), 1e-4)
    touch = start + first[:, 1:] * press
    parts, known = [], np.isfinite(first).all(axis=1)
    unknowns = np.zeros((len(row), UNKNOWNS))
    unknowns[:, 0] = np.clip(np.nan_to_num(first[:, 0], nan=0.5), TouchSettings.nearest, 1.0)
    begun = _bent(arrays, np.nan_to_num(touch), unknowns)
    _, _, normal = _against(found, patch, begun, radius)
    std = _surface_std(found, patch, begun.point_m, normal)
    shown = np.array([surely_known_m(found, index) for index in range(len(found.patches))])[patch]
    known &= std <= shown
    lever = _ways(arrays, np.nan_to_num(touch), begun.point_m, np.nan_to_num(normal))[1][:, 0]
    begin = touch - ((TouchSettings.clear_m + 3.0 * std) / lever)[:, None] * press
    for level, slope in enumerate(np.radians(TouchSettings.slopes_deg)):
        antenna = arrays.rig.antenna
        size = 2.0 * antenna.stiffness_Nm2 * slope / (unknowns[:, 0] * length) ** 2
        size /= antenna.taper.turning(unknowns[:, 0])
        pressed_rad = 2.0 / 3.0 * slope * first[:, 0] * length / lever
        pressed = touch + pressed_rad[:, None] * press
        turn = arrays.rig.kinematics.world_antenna(*np.nan_to_num(pressed).T)[0]
        aim = np.einsum("bji,bj->bi", turn, np.nan_to_num(normal))[:, 1:]
        begun_at = np.column_stack([first[:, 0], size[:, None] * aim / arrays.force_unit_N])
        made, bent, outward = _pressed(found, arrays, patch, pressed, begun_at)
        std = _surface_std(found, patch, bent.point_m, outward)
        inside = (made[:, 0] > TouchSettings.nearest) & (made[:, 0] < TouchSettings.farthest)
        known = known & np.isfinite(made).all(axis=1) & inside & (std <= shown)
        known &= np.sum(bent.force_N * outward, axis=1) > 0.0
        allowed = known & limits.hold(*pressed.T) & limits.hold(*begin.T)
        allowed[allowed] = _clear(found, patch[allowed], bent.nodes_m[allowed], radius)
        part = Reach(
            *(pressed, begin, touch, patch, made, row, sweep, np.full(len(row), level)),
            *(bent.point_m, outward, bent.tangent, bent.force_N),
        )
        parts.append(part.picked(np.flatnonzero(allowed)))
    return Reach.joined(parts)


def _pressed(
    found: SurfaceFit, arrays: RigArrays, patch: np.ndarray, joints_rad: np.ndarray, start: np.ndarray
) -> tuple[np.ndarray, _Bent, np.ndarray]:
    """Unknowns (B, 4) of antennas that lie frictionless on the surface, NaN where none does, where they are, and the
    surface's normals (B, 3)."""
    radius, scale = 0.5 * arrays.rig.antenna.diameter_m, np.linalg.norm(start[:, 1:], axis=1)

    def unknowns_of(x: np.ndarray) -> np.ndarray:
        force = scale[:, None] * x[:, 1:]
        return np.column_stack([np.clip(x[:, 0], TouchSettings.nearest, 1.0), force, np.zeros(len(x))])

    def residual(x: np.ndarray) -> np.ndarray:
        bent = _bent(arrays, joints_rad, unknowns_of(x))
        gap, flat, normal = _against(found, patch, bent, radius)
        give = found.state.compliance_m_N * np.sum(bent.force_N * normal, axis=1)
        side = np.sum(bent.force_N * np.cross(normal, bent.tangent), axis=1)
        size = np.linalg.norm(bent.force_N, axis=1)
        return np.column_stack([(gap + give) / TouchSettings.place_m, flat, side / np.maximum(size, 1e-12)])

    x = _newton(residual, np.column_stack([start[:, 0], start[:, 1:] / scale[:, None]]), 1e-4)
    unknowns = unknowns_of(x)
    bent = _bent(arrays, joints_rad, unknowns)
    return unknowns, bent, _against(found, patch, bent, radius)[2]


def carried(arrays: RigArrays, joints_rad: np.ndarray, to_rad: np.ndarray, point_m: np.ndarray) -> np.ndarray:
    """(B, 3) how far the joints (B, 2) carry points of the undeformed antenna on their way to other angles, world."""
    (rotation, translation), (turned, shifted) = (
        arrays.rig.kinematics.world_antenna(*joints.T) for joints in (joints_rad, to_rad)
    )
    local = np.einsum("bji,bj->bi", rotation, point_m - translation)
    return np.einsum("bij,bj->bi", turned, local) + shifted - point_m


def _ways(
    arrays: RigArrays, joints_rad: np.ndarray, point_m: np.ndarray, normal: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(B, 2, 2) unit ways of the joints, onto the surface and along it, and how fast (B, 2) points move by them, m."""
    steps = (joints_rad + TouchSettings.axis_step_rad * axis for axis in np.eye(2))
    velocity = np.stack(
        [carried(arrays, joints_rad, to, point_m) / TouchSettings.axis_step_rad for to in steps], axis=1
    )
    onto = -np.einsum("bki,bi->bk", velocity, normal)
    onto = onto / np.maximum(np.linalg.norm(onto, axis=1, keepdims=True), 1e-9)
    ways = np.stack([onto, np.column_stack([-onto[:, 1], onto[:, 0]])], axis=1)
    speed = np.linalg.norm(np.einsum("bwk,bki->bwi", ways, velocity), axis=2)
    speed[:, 0] = np.abs(np.einsum("bk,bki,bi->b", onto, velocity, normal))
    return ways, np.maximum(speed, 1e-6)


def _clear(found: SurfaceFit, patch: np.ndarray, nodes_m: np.ndarray, radius_m: float) -> np.ndarray:
    """(B,) bool: nothing that was touched of other patches is in the way of antennas with nodes (B, M, 3)."""
    clear = np.ones(len(patch), bool)
    share = np.linspace(0.0, 1.0, 8, endpoint=False)[:, None, None]
    for index in np.unique(patch):
        others = np.concatenate([[], *(one.members for k, one in enumerate(found.patches) if k != index)]).astype(int)
        m = np.flatnonzero(patch == index)
        if len(others) and len(m):
            ends = nodes_m[m]
            points = np.concatenate([ends[:, :-1] + part * (ends[:, 1:] - ends[:, :-1]) for part in share], axis=1)
            away = KDTree(found.point_m[others]).query(points.reshape(-1, 3))[0].reshape(len(m), -1).min(axis=1)
            clear[m] = away > radius_m + TouchSettings.nearest_other_m
    return clear


def along_surface(reach: Reach) -> tuple[np.ndarray, np.ndarray]:
    """Where a stroke from each touch ends (B,), index of another, and over how many steps (B,): along its row and
    level, as far as all can be made, to the farther side."""
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
