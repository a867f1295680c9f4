"""Strokes of antennas along an object, frame by frame: where they touch, stick, slide and lift off.

All strokes of a recording advance together. Between two frames the base moves evenly, in steps of at most `step_m`, and
in shorter ones where a step has no equilibrium.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from vbaa_calib.antenna.rod import RodShape, sample_shape, solve_rod
from vbaa_calib.core.errors import SolveError
from vbaa_calib.geometry import Pose
from vbaa_calib.simulate.scene.objects import WEDGES

from .stick_slip import STROKE, Bases, Held, Setting, advance

_Place = tuple[Bases, np.ndarray]
"""Bases, and the free antenna's nodes (B, N, 3) in their frames."""


def follow(setting: Setting, strokes: Sequence[Bases]) -> list[tuple[np.ndarray, np.ndarray, Held]]:
    """The contacts of all strokes of one recording; each stroke is its bases (at least one) in order of time.

    Returns for each stroke masks (B,) of its frames that touch and of those that stick, and the contacts, meaningless
    where there is none. A contact sticks if it has slid by less than `STROKE.sticks_m` since the frame before, in which
    it touched too.

    A stroke that begins in contact is first pressed on along the object's normal, without friction.

    Raises
    ------
    SolveError : names the first stroke and frame without a trustworthy equilibrium, and why.
    """
    path, count = _path(setting, strokes), len(strokes)
    gap = _gaps(setting, path.at(1, 0.0), path.arclength_m)[0]
    walk = _Walk(setting, path, Held.nowhere(count), np.zeros(count, bool), gap)
    touches, sticks, gripped = [], [], []
    for frame in range(1, len(path.bases)):
        # the first frame is where it is pressed on
        friction = 0.0 if frame == 1 else setting.object.friction
        before = walk.touches
        walk, way, slid_m = _to_frame(walk, frame, friction)
        touches.append(walk.touches)
        sticks.append(before & walk.touches & (slid_m < STROKE.sticks_m) & (friction > 0.0))
        gripped.append(replace(walk.contacts, slipped_m=way))

    def of(stroke: int, frames: int) -> tuple[np.ndarray, np.ndarray, Held]:
        columns = ([getattr(at, each.name)[stroke] for at in gripped[:frames]] for each in fields(Held))
        touching, sticking = (np.array(each)[:frames, stroke] for each in (touches, sticks))
        return touching, sticking, Held(*map(np.array, columns))

    return [of(stroke, len(bases.origin_m)) for stroke, bases in enumerate(strokes)]


@dataclass(frozen=True, eq=False)
class _Path:
    """The bases of B strokes in T frames, with the free antenna's nodes (B, N, 3) and their arc lengths (N,)."""

    bases: list[Bases]
    points_m: list[np.ndarray]
    arclength_m: np.ndarray

    def at(self, frame: int, share: float) -> _Place:
        """The bases at a fraction of the way from the previous frame to this one."""
        points = self.points_m[frame - 1] * (1.0 - share) + self.points_m[frame] * share
        return _between(self.bases[frame - 1], self.bases[frame], share), points

    def ways(self, frame: int) -> np.ndarray:
        """(B,) the largest motion of a point of the free antenna since the previous frame."""
        start, end = (self.bases[i].world(self.points_m[i]) for i in (frame - 1, frame))
        return np.asarray(np.linalg.norm(end - start, axis=-1).max(axis=1))


def _between(start: Bases, end: Bases, share: float) -> Bases:
    turns = (Pose(one, np.zeros(3)).rotvec_rad for one in end.rotation @ np.swapaxes(start.rotation, 1, 2))
    rotation = np.stack([Pose.from_rotvec(share * turn, np.zeros(3)).rotation for turn in turns])
    return Bases(rotation @ start.rotation, start.origin_m + share * (end.origin_m - start.origin_m))


def _path(setting: Setting, strokes: Sequence[Bases]) -> _Path:
    """The motion of all strokes over all frames, after an added first frame without contact; shorter strokes rest at
    their ends."""
    bases = []
    for frame in range(max(len(each.origin_m) for each in strokes)):
        at = [min(frame, len(each.origin_m) - 1) for each in strokes]
        rotation, origin = (
            np.array([getattr(each, name)[i] for each, i in zip(strokes, at, strict=True)])
            for name in ("rotation", "origin_m")
        )
        bases.append(Bases(rotation, origin))
    gravity = np.concatenate([setting.gravity_world_m_s2 @ at.rotation for at in bases])
    shape = solve_rod(setting.rod, gravity, np.full(len(gravity), setting.rod.length_m / 2), np.zeros_like(gravity))
    points = list(shape.points_m.reshape(len(bases), len(strokes), -1, 3))
    path = _Path([bases[0], *bases], [points[0], *points], shape.arclength_m[0])
    path.bases[0] = _drawn_back(setting, path)
    return path


def _drawn_back(setting: Setting, path: _Path) -> Bases:
    """The first frame's bases, moved out of the object if a stroke begins in contact."""
    home, points = path.at(1, 1.0)
    gap, _, _, normal = _gaps(setting, (home, points), path.arclength_m)
    outward = -setting.object.wedge_world if setting.object.shape in WEDGES else normal
    away = np.where(gap < 0.0, STROKE.clear_m - gap, 0.0)
    for _ in range(STROKE.doublings):
        back = replace(path.bases[0], origin_m=path.bases[0].origin_m + away[:, None] * outward)
        inside = _gaps(setting, (back, points), path.arclength_m)[0] < 0.0
        if not inside.any():
            return back
        away = np.where(inside, 2.0 * away, away)
    raise _refused(len(gap), int(np.argmax(inside)), 0, "the antenna begins inside the object")


def _refused(count: int, stroke: int, frame: int, reason: str) -> SolveError:
    return SolveError(f"{f'stroke {stroke}, ' if count > 1 else ''}frame {frame}: {reason}")


def _gaps(
    setting: Setting, place: _Place, arclength_m: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Clearance (B,) of the free antenna from the object, with its arc length (B,), and point and normal (B, 3)
    there, world frame.

    A nearest point beyond the object's ends, or at the clamp, counts as clear.
    """
    bases, points_m = place
    nearest = setting.object.rough_distance(bases.world(points_m)).argmin(axis=1)
    ends = arclength_m[np.clip([nearest - 1, nearest + 1], 0, len(arclength_m) - 1)]
    gap, at, point, normal = _gaps_between(setting, place, arclength_m, ends)
    apart = (ends[1] - ends[0]) / (STROKE.fine - 1)
    # between two of these places a thin edge may be touched
    while (rows := np.flatnonzero((gap > 0.0) & (gap < apart / 2) & (apart > STROKE.finest_m))).size:
        close = np.array([at[rows] - apart[rows], at[rows] + apart[rows]])
        some = bases.picked(rows), points_m[rows]
        gap[rows], at[rows], point[rows], normal[rows] = _gaps_between(
            setting, some, arclength_m, np.clip(close, 0.0, arclength_m[-1])
        )
        apart[rows] *= 2 / (STROKE.fine - 1)
    passes = ~setting.object.within(point) | (at < 0.01 * setting.rod.length_m)
    return np.where(passes, np.abs(gap) + STROKE.clear_m, gap), at, point, normal


def _gaps_between(
    setting: Setting, place: _Place, arclength_m: np.ndarray, ends_m: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """`_gaps` evaluated at the nearest of a few places between arc lengths (2, B)."""
    (bases, points_m), (low, high) = place, ends_m
    fine = low[:, None] + (high - low)[:, None] * np.linspace(0.0, 1.0, STROKE.fine)
    close = bases.world(_interpolated(points_m, arclength_m, fine))
    distance, normal = setting.object.signed_distance(close)
    best = np.arange(len(close)), distance.argmin(axis=1)
    return distance[best] - setting.radius_at(fine[best]), fine[best], close[best], normal[best]


def _interpolated(points_m: np.ndarray, arclength_m: np.ndarray, at_m: np.ndarray) -> np.ndarray:
    """(B, K, 3) points at arc lengths (B, K) by a smooth curve through nodes (B, N, 3)."""
    tangents = np.gradient(points_m, arclength_m, axis=1)
    tangents /= np.linalg.norm(tangents, axis=-1, keepdims=True)
    nodes = np.broadcast_to(arclength_m, points_m.shape[:2])
    return sample_shape(RodShape(nodes, points_m, tangents, np.empty(0)), at_m)[0]


@dataclass(frozen=True, eq=False)
class _Walk:
    """State of all strokes: contacts, the mask (B,) of those that touch, and the clearance (B,) of the free ones."""

    setting: Setting
    path: _Path
    contacts: Held
    touches: np.ndarray
    gap_m: np.ndarray


def _to_frame(walk: _Walk, frame: int, friction: float, finer: int = 0) -> tuple[_Walk, np.ndarray, np.ndarray]:
    """Advance to a frame, in 2^`finer` times as many steps as usual, or more where a step has no equilibrium. Returns
    the slip vector (B, 3) and the slip path's length (B,)."""
    setting, path, begun = walk.setting, walk.path, walk
    ways, gap = path.ways(frame), _gaps(setting, path.at(frame, 1.0), path.arclength_m)[0]
    # a free antenna may also have met the object on its way
    busy = walk.touches | (walk.gap_m + gap < ways)
    steps = int(np.clip(np.ceil(ways[busy].max(initial=0.0) / STROKE.step_m), 1, STROKE.most_steps)) * 2**finer
    slipped, slid_m = np.zeros_like(walk.contacts.point_m), np.zeros(len(walk.touches))
    for step in range(1, steps + 1):
        ends = path.at(frame, (step - 1) / steps), path.at(frame, step / steps)
        walk, lost = _step(walk, ends, friction, frame - 1)
        if lost.size and finer < STROKE.halvings:
            return _to_frame(begun, frame, friction, finer + 1)
        if lost.size:
            reason = "no equilibrium; the antenna may have slipped off"
            raise _refused(len(gap), int(lost[0]), frame - 1, reason)
        way = np.where(walk.touches[:, None], walk.contacts.slipped_m, 0.0)
        slipped, slid_m = slipped + way, slid_m + np.linalg.norm(way, axis=1)
    return walk, slipped, slid_m


def _step(walk: _Walk, ends: tuple[_Place, _Place], friction: float, frame: int) -> tuple[_Walk, np.ndarray]:
    """Advance by one step of the base, in which contacts last, begin and end; and the strokes that have no
    equilibrium then."""
    near = _gaps(walk.setting, ends[1], walk.path.arclength_m)
    gap, count = near[0], len(near[0])
    before, guess, after = (Held.nowhere(count) for _ in range(3))
    lasting, landing = np.flatnonzero(walk.touches), np.flatnonzero(~walk.touches & (gap < 0.0))
    for state in (before, guess):
        state.put(lasting, walk.contacts.picked(lasting))
    if landing.size:
        met, start = _landing(walk, ends, near, landing)
        before.put(landing, met)
        guess.put(landing, start)
    rows, touches = np.concatenate([lasting, landing]), np.zeros(count, bool)
    if rows.size:
        found, good = advance(walk.setting, ends[1][0].picked(rows), before.picked(rows), guess.picked(rows), friction)
        if not good.all():
            return walk, rows[~good]
        after.put(rows, found)
        touches[rows] = (found.press_N > 0.0) & walk.setting.object.within(found.place_m)
    # the free antenna would lie beyond the last contact
    at = np.nan_to_num(walk.contacts.arclength_m)[:, None]
    point = ends[1][0].world(_interpolated(ends[1][1], walk.path.arclength_m, at))[:, 0]
    behind = ((point - walk.contacts.place_m) * walk.contacts.normal).sum(axis=1) < -STROKE.snap_m
    snapped = walk.touches & (after.press_N <= 0.0) & behind
    if snapped.any():
        raise _refused(count, int(np.argmax(snapped)), frame, "the antenna has slipped off the object")
    # beyond a sphere's middle a contact without friction is no stable equilibrium
    past = touches & ((after.normal * near[3]).sum(axis=1) < 0.0)
    if friction == 0.0 and walk.setting.object.shape == "sphere" and past.any():
        reason = "the antenna would slip off round the sphere; push less far, or use a cylinder"
        raise _refused(count, int(np.argmax(past)), frame, reason)
    return replace(walk, contacts=after, touches=touches, gap_m=gap), rows[:0]


def _landing(
    walk: _Walk, ends: tuple[_Place, _Place], near: tuple[np.ndarray, ...], rows: np.ndarray
) -> tuple[Held, Held]:
    """The contact at first touch within a step, and an initial value for the contact at the step's end.

    The guess is a straight cantilever in series with the object's spring, displaced by the depth.
    """
    setting, rod = walk.setting, walk.setting.rod
    gap, at, point, normal = (values[rows] for values in near)
    at = np.clip(at, 0.05 * rod.length_m, 0.999 * rod.length_m)
    (bases, nodes), (start, start_nodes) = ((end[0].picked(rows), end[1][rows]) for end in reversed(ends))
    was = start.world(_interpolated(start_nodes, walk.path.arclength_m, at[:, None]))[:, 0]
    share = (walk.gap_m[rows] / np.maximum(walk.gap_m[rows] - gap, 1e-12))[:, None]
    pair = at[:, None] + np.array([-1e-4, 1e-4]) * rod.length_m
    tangent = np.diff(bases.world(_interpolated(nodes, walk.path.arclength_m, pair)), axis=1)[:, 0]
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    press = -gap / (rod.yielding_m(at) + 1.0 / setting.object.stiffness_N_m)
    force = np.einsum("bji,bj->bi", bases.rotation, press[:, None] * normal)
    weight = rod.mass_kg * (setting.gravity_world_m_s2 @ bases.rotation)
    along = rod.T_antenna_clamp.rotation[:, 0]
    moment = np.cross(along, at[:, None] * force + rod.length_m / 2 * weight)
    nothing = np.zeros_like(normal)
    if rod.taper:  # the tip's turn stands for it
        moment = nothing
    guess = Held(moment, at, press, nothing, point - gap[:, None] * normal, normal, point, tangent, nothing)
    return replace(guess, point_m=was + share * (point - was)), guess
