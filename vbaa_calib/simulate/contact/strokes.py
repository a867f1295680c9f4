"""Strokes of antennas along an object, frame by frame: where they touch, stick, slide and lift off.

All strokes of a recording advance together. Between two frames the base moves evenly, in steps of at most `step_m`; a
step without an equilibrium is halved.
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
    rows = np.arange(len(points_m))
    nearest = setting.object.rough_distance(bases.world(points_m)).argmin(axis=1)
    low = arclength_m[np.maximum(nearest - 1, 0)]
    high = arclength_m[np.minimum(nearest + 1, len(arclength_m) - 1)]
    fine = low[:, None] + (high - low)[:, None] * np.linspace(0.0, 1.0, STROKE.fine)
    close = bases.world(_interpolated(points_m, arclength_m, fine))
    distance, normal = setting.object.signed_distance(close)
    best = distance.argmin(axis=1)
    gap = distance[rows, best] - setting.radius_at(fine[rows, best])
    passes = ~setting.object.within(close[rows, best]) | (fine[rows, best] < 0.01 * setting.rod.length_m)
    return np.where(passes, np.abs(gap) + STROKE.clear_m, gap), fine[rows, best], close[rows, best], normal[rows, best]


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


def _to_frame(walk: _Walk, frame: int, friction: float) -> tuple[_Walk, np.ndarray, np.ndarray]:
    """Advance to a frame. Returns the slip vector (B, 3) and the slip path's length (B,)."""
    setting, path = walk.setting, walk.path
    ways, gap = path.ways(frame), _gaps(setting, path.at(frame, 1.0), path.arclength_m)[0]
    # a free antenna may also have met the object on its way
    busy = walk.touches | (walk.gap_m + gap < ways)
    steps = int(np.clip(np.ceil(ways[busy].max(initial=0.0) / STROKE.step_m), 1, STROKE.most_steps))
    slipped, slid_m = np.zeros_like(walk.contacts.point_m), np.zeros(len(walk.touches))
    for step in range(1, steps + 1):
        ends = path.at(frame, (step - 1) / steps), path.at(frame, step / steps)
        walk, way = _step(walk, ends, friction, frame - 1)
        slipped, slid_m = slipped + way, slid_m + np.linalg.norm(way, axis=1)
    return walk, slipped, slid_m


def _step(walk: _Walk, ends: tuple[_Place, _Place], friction: float, frame: int) -> tuple[_Walk, np.ndarray]:
    """Advance by one step of the base: contacts that last, begin and end; returns their slip (B, 3)."""
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
    rows = np.concatenate([lasting, landing])
    touches, way = np.zeros(count, bool), np.zeros((count, 3))
    if rows.size:
        bases = ends[0][0].picked(rows), ends[1][0].picked(rows)
        found, good = _carry(walk.setting, bases, before.picked(rows), guess.picked(rows), friction, STROKE.halvings)
        if not good.all():
            raise _refused(count, int(rows[np.argmin(good)]), frame, "no equilibrium; the antenna may have slipped off")
        after.put(rows, found)
        touches[rows] = (found.press_N > 0.0) & walk.setting.object.within(found.place_m)
        way[touches] = after.slipped_m[touches]
    # the free antenna would lie beyond the last contact
    at = np.nan_to_num(walk.contacts.arclength_m)[:, None]
    point = ends[1][0].world(_interpolated(ends[1][1], walk.path.arclength_m, at))[:, 0]
    behind = ((point - walk.contacts.place_m) * walk.contacts.normal).sum(axis=1) < -STROKE.snap_m
    snapped = walk.touches & (after.press_N <= 0.0) & behind
    if snapped.any():
        raise _refused(count, int(np.argmax(snapped)), frame, "the antenna has slipped off the object")
    return replace(walk, contacts=after, touches=touches, gap_m=gap), way


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


def _carry(
    setting: Setting, ends: tuple[Bases, Bases], before: Held, guess: Held, friction: float, halvings: int
) -> tuple[Held, np.ndarray]:
    """The contacts at the end of a step, and the mask of those found; failures are retried in two half steps."""
    found, good = advance(setting, ends[1], before, guess, friction)
    rows = np.flatnonzero(~good)
    if rows.size == 0 or halvings == 0:
        return found, good
    start, end = (bases.picked(rows) for bases in ends)
    middle = _between(start, end, 0.5)
    first, fine = _carry(setting, (start, middle), before.picked(rows), guess.picked(rows), friction, halvings - 1)
    if not fine.all():
        return found, good
    second, fine = _carry(setting, (middle, end), first, first, friction, halvings - 1)
    found.put(rows, replace(second, slipped_m=first.slipped_m + second.slipped_m))
    good[rows] = fine
    return found, good
