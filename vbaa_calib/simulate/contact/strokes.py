"""Antennas that stroke an object, in order of time: where they touch, stick, slide and lift off.

All strokes of a recording go on together, each from a free antenna or from one that has just been pressed on. Between
two frames the base moves evenly, in steps of `base_path.STEP_M` at most; a step that finds no equilibrium is halved.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vbaa_calib.geometry import Pose

from .base_path import MOST_STEPS, STEP_M, Path, Place, between, gaps, interpolated, path_of, refused
from .holding import Bases, Held, Setting
from .stick_slip import advance

STICKS_M = 1e-6
"""Along itself the antenna hardly gives way, so that a contact that else sticks creeps by nanometres."""
_HALVINGS = 6
_SNAP_M = 2e-4


@dataclass(frozen=True, eq=False)
class Followed:
    """B strokes of T frames.

    Attributes
    ----------
    touches, sticks : (B, T) bool; an antenna sticks in a frame if it has slid by less than `STICKS_M` since the frame
        before, in which it touched too.
    contacts : T states of B contacts each; meaningless where nothing is touched.
    slipped_m : (B, T, 3) way of the antenna's material point along the object since the frame before, world frame.
    """

    touches: np.ndarray
    sticks: np.ndarray
    contacts: Sequence[Held]
    slipped_m: np.ndarray


def follow(setting: Setting, strokes: Sequence[Sequence[Pose]], gravity_world_m_s2: np.ndarray) -> Followed:
    """All strokes of one recording, each T_world_antenna (at least one) in order of time.

    Shorter strokes rest at their ends. A stroke that begins in contact is pressed on along the object's normal first,
    without friction.

    Raises
    ------
    SolveError : names the first stroke and frame without a trustworthy equilibrium, and why.
    """
    path = path_of(setting, strokes, gravity_world_m_s2)
    count, frames = path.points_m.shape[:2]
    walk = _Walk(setting, path, Held.nowhere(count), np.zeros(count, bool), np.zeros(count))
    touches, sticks = np.zeros((2, frames, count), bool)
    slipped, contacts = np.zeros((frames, count, 3)), []
    walk = replace(walk, gap_m=gaps(setting, *path.at(1, 0.0), path.arclength_m)[0])
    for frame in range(1, frames):
        friction = 0.0 if frame == 1 else setting.object.friction
        before = walk.touches
        walk, way, slid_m = _to_frame(walk, frame, friction)
        touches[frame], slipped[frame] = walk.touches, way
        sticks[frame] = before & walk.touches & (slid_m < STICKS_M) & (friction > 0.0)
        contacts.append(walk.contacts)
    return Followed(touches[1:].T, sticks[1:].T, contacts, np.swapaxes(slipped[1:], 0, 1))


@dataclass(frozen=True, eq=False)
class _Walk:
    """How far the strokes have come: contacts, who touches (B,), and how clear of the object (B,) the free ones are."""

    setting: Setting
    path: Path
    contacts: Held
    touches: np.ndarray
    gap_m: np.ndarray


def _to_frame(walk: _Walk, frame: int, friction: float) -> tuple[_Walk, np.ndarray, np.ndarray]:
    """On to a frame: how far the contacts slid (B, 3), and the length of that way (B,)."""
    setting, path = walk.setting, walk.path
    ways, gap = path.ways(frame), gaps(setting, *path.at(frame, 1.0), path.arclength_m)[0]
    # a free antenna may also have met the object on its way
    busy = walk.touches | (walk.gap_m + gap < ways)
    steps = int(np.clip(np.ceil(ways[busy].max(initial=0.0) / STEP_M), 1, MOST_STEPS))
    slipped, slid_m = np.zeros_like(walk.contacts.point_m), np.zeros(len(walk.touches))
    for step in range(1, steps + 1):
        ends = path.at(frame, (step - 1) / steps), path.at(frame, step / steps)
        walk, way = _step(walk, ends, friction, frame - 1)
        slipped, slid_m = slipped + way, slid_m + np.linalg.norm(way, axis=1)
    return walk, slipped, slid_m


def _step(walk: _Walk, ends: tuple[Place, Place], friction: float, frame: int) -> tuple[_Walk, np.ndarray]:
    """One step of the base: contacts that last, begin and end, and how far they slid (B, 3)."""
    near = gaps(walk.setting, *ends[1], walk.path.arclength_m)
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
        found, good = _carry(walk, bases, before.picked(rows), guess.picked(rows), friction, _HALVINGS)
        if not good.all():
            raise refused(count, int(rows[np.argmin(good)]), frame, "no equilibrium; the antenna may have slipped off")
        after.put(rows, found)
        touches[rows] = (found.press_N > 0.0) & walk.setting.object.within(found.place_m)
        way[touches] = after.slipped_m[touches]
    snapped = walk.touches & (after.press_N <= 0.0) & _behind(walk, ends[1])
    if snapped.any():
        raise refused(count, int(np.argmax(snapped)), frame, "the antenna has slipped off the object")
    return replace(walk, contacts=after, touches=touches, gap_m=gap), way


def _behind(walk: _Walk, free: Place) -> np.ndarray:
    """(B,) whether the free antenna would lie on the other side of where it has touched last."""
    at = np.nan_to_num(walk.contacts.arclength_m)[:, None]
    point = free[0].world(interpolated(free[1], walk.path.arclength_m, at))[:, 0]
    height = ((point - walk.contacts.place_m) * walk.contacts.normal).sum(axis=1)
    return np.asarray(height < -_SNAP_M)


def _landing(
    walk: _Walk, ends: tuple[Place, Place], near: tuple[np.ndarray, ...], rows: np.ndarray
) -> tuple[Held, Held]:
    """The moment in which free antennas meet the object in a step, and a guess of the contact at its end.

    The guess is a straight cantilever and the object's spring in series, displaced by the depth.
    """
    setting, rod = walk.setting, walk.setting.rod
    gap, at, point, normal = (values[rows] for values in near)
    at = np.clip(at, 0.05 * rod.length_m, 0.999 * rod.length_m)
    was = ends[0][0].world(interpolated(ends[0][1], walk.path.arclength_m, _filled(at, rows, len(walk.touches))))
    share = (walk.gap_m[rows] / np.maximum(walk.gap_m[rows] - gap, 1e-12))[:, None]
    met = was[rows, 0] + share * (point - was[rows, 0])
    bases, nodes = ends[1][0].picked(rows), ends[1][1][rows]
    pair = at[:, None] + np.array([-1e-4, 1e-4]) * rod.length_m
    tangent = np.diff(bases.world(interpolated(nodes, walk.path.arclength_m, pair)), axis=1)[:, 0]
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    press = -gap / (at**3 / (3.0 * rod.bending_stiffness_Nm2) + 1.0 / setting.object.stiffness_N_m)
    force = np.einsum("bji,bj->bi", bases.rotation, press[:, None] * normal)
    weight = rod.mass_per_length_kg_m * rod.length_m * bases.gravity
    along = rod.T_antenna_clamp.rotation[:, 0]
    moment = np.cross(along, at[:, None] * force + rod.length_m / 2 * weight)
    nothing = np.zeros_like(normal)
    guess = Held(moment, at, press, nothing, point - gap[:, None] * normal, normal, point, tangent, nothing)
    return replace(guess, point_m=met), guess


def _filled(values: np.ndarray, rows: np.ndarray, count: int) -> np.ndarray:
    whole = np.zeros((count, 1))
    whole[rows, 0] = values
    return whole


def _carry(
    walk: _Walk, ends: tuple[Bases, Bases], before: Held, guess: Held, friction: float, halvings: int
) -> tuple[Held, np.ndarray]:
    """The contacts at the end of a step, and which were found; what fails is tried in two halves."""
    found, good = advance(walk.setting, ends[1], before, guess, friction)
    rows = np.flatnonzero(~good)
    if rows.size == 0 or halvings == 0:
        return found, good
    start, end = ends[0].picked(rows), ends[1].picked(rows)
    middle = between(start, end, 0.5, walk.path.gravity_world_m_s2)
    first, fine = _carry(walk, (start, middle), before.picked(rows), guess.picked(rows), friction, halvings - 1)
    if not fine.all():
        return found, good
    second, fine = _carry(walk, (middle, end), first, first, friction, halvings - 1)
    found.put(rows, replace(second, slipped_m=first.slipped_m + second.slipped_m))
    good[rows] = fine
    return found, good
