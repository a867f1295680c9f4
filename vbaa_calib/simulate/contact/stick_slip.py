"""One step of antennas that are pressed against an object with Coulomb friction, for many strokes at a time.

Beside the state before the step, a contact's clamp moment M(0), arc length s, normal force N, grip g (the friction
force) and place p satisfy

    M(L) = 0                              the rod is in equilibrium under N n + g at s
    r(s) = p − N/k n                      the surfaces touch, indented by N/k
    distance(p) = antenna radius          p is where the centreline would be if the object did not give way
    n·t(s) = 0, or s = L and n·t ≤ 0      s is the nearest point: inside the antenna, or its tip
    g = held(g before − K Δu)             friction, where held() cuts off at the cone's rim, |g| ≤ μN

with n the object's normal at p and Δu = Δr − t Δs, across n, the way of the antenna's material point at the contact:
the contact may roll on without it. This is backward Euler's return mapping. K is a tiny compliance of the grip in place
of none: an antenna that sticks gives way by |g|/K, with `STICK` a micrometre or two at the cone's rim.

All but the last line is smooth: Newton's method, in which the last line, with Δu and N linear in g, is solved for
itself (`gripped`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np

from vbaa_calib.antenna.rod import Rod, empty_nodes
from vbaa_calib.antenna.shooting import RodNumbers, shoot
from vbaa_calib.core.arrays import Rows
from vbaa_calib.core.compiled import kernel
from vbaa_calib.core.newton import slopes_of, solve
from vbaa_calib.geometry import Pose
from vbaa_calib.geometry.vectors import dot, moved, scaled, turned, turned_back, unit, vector
from vbaa_calib.simulate.scene.distance import ObjectNumbers, signed_distance
from vbaa_calib.simulate.scene.objects import TouchObject

TOLERANCE = 1e-11
"""On lengths in L, moments in EI/L and n·t."""
_GRIP_TOLERANCE = 1e-8
"""On the grip in EI/L²."""
_STICK = 1e5
"""Stiffness K of a sticking contact in EI/L³: 28 kN/m for the steel whisker, whose own stiffness at the tip is 3."""
_DOUBLINGS, _BISECTIONS = 60, 60
_ITERATIONS = 20
_ROOM = 0.3
"""Of the contact's place in one step, in L."""

_Law = tuple[np.ndarray, np.ndarray, np.ndarray, float, np.ndarray, float]


@dataclass(frozen=True, eq=False)
class Setting:
    """What does not change in a recording. `antenna_radius_m` is half the antenna's diameter, gravity (3,)."""

    rod: Rod
    antenna_radius_m: float
    object: TouchObject
    gravity_world_m_s2: np.ndarray


@dataclass(frozen=True, eq=False)
class Bases(Rows):
    """Where B bases are: R_world_antenna (B, 3, 3), and the antenna frame's origin (B, 3) in the world."""

    rotation: np.ndarray
    origin_m: np.ndarray

    @staticmethod
    def of(T_world_antenna: Sequence[Pose]) -> Bases:
        """Of B poses."""
        turns, origins = zip(*((pose.rotation, pose.translation_m) for pose in T_world_antenna), strict=True)
        return Bases(np.stack(turns), np.stack(origins))

    def world(self, points_m: np.ndarray) -> np.ndarray:
        """(B, ..., 3) points of the antenna frames in the world."""
        turned = np.einsum("bij,b...j->b...i", self.rotation, points_m)
        return turned + self.origin_m.reshape(len(turned), *(1,) * (turned.ndim - 2), 3)


@dataclass(frozen=True, eq=False)
class Held(Rows):
    """B contacts.

    Attributes
    ----------
    moment_Nm : (B, 3) M(0), antenna frame. arclength_m, press_N : (B,).
    grip_N : (B, 3) friction force on the antenna. place_m : (B, 3) p. normal : (B, 3) there.
    point_m, tangent : (B, 3) of the centreline at the contact. All of these in the world frame.
    slipped_m : (B, 3) way along the object in the step, world frame.
    """

    moment_Nm: np.ndarray
    arclength_m: np.ndarray
    press_N: np.ndarray
    grip_N: np.ndarray
    place_m: np.ndarray
    normal: np.ndarray
    point_m: np.ndarray
    tangent: np.ndarray
    slipped_m: np.ndarray

    @property
    def packed(self) -> np.ndarray:
        """(B, 23) all fields side by side."""
        return np.column_stack([getattr(self, each.name) for each in fields(self)])

    @staticmethod
    def of(packed: np.ndarray) -> Held:
        """Of (B, 23)."""
        moment, arclength, press, *others = np.split(packed, [3, 4, 5, 8, 11, 14, 17, 20], axis=1)
        return Held(moment, arclength[:, 0], press[:, 0], *others)

    def put(self, rows: np.ndarray, others: Held) -> None:
        """Overwrite some of them."""
        for each in fields(self):
            getattr(self, each.name)[rows] = getattr(others, each.name)

    @staticmethod
    def nowhere(count: int) -> Held:
        """No contacts yet: NaN."""
        short = ("arclength_m", "press_N")
        return Held(*(np.full(count if each.name in short else (count, 3), np.nan) for each in fields(Held)))


@dataclass(frozen=True, eq=False)
class Contacts:
    """One stroke of B frames: who touches, who sticks (B,), and the contacts, which mean nothing where none is.

    A contact sticks if it has slid by less than `strokes.STICKS_M` since the frame before, in which it touched too.
    """

    touches: np.ndarray
    sticks: np.ndarray
    held: Held


def tangent_axes(normal: np.ndarray) -> np.ndarray:
    """(B, 2, 3) two orthogonal unit vectors across each normal."""
    least = np.eye(3)[np.argmin(np.abs(normal), axis=1)]
    first = np.cross(normal, least)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(normal, first)], axis=1)


def advance(setting: Setting, bases: Bases, before: Held, start: Held, friction: float) -> tuple[Held, np.ndarray]:
    """The contacts at these bases, and which of them (B,) were found.

    `before` is the state at the step's beginning, `start` where the search begins, `friction` the coefficient.
    """
    force_unit = setting.rod.bending_stiffness_Nm2 / setting.rod.length_m**2
    touching = np.array([setting.antenna_radius_m, 1.0 / setting.object.stiffness_N_m, force_unit, friction])
    gravity = np.broadcast_to(setting.gravity_world_m_s2, (len(before.normal), 1, 3))
    frames = np.concatenate([bases.rotation, bases.origin_m[:, None], gravity, tangent_axes(start.normal)], axis=1)
    ends = np.stack([before.packed, start.packed], axis=1)
    numbers = setting.rod.numbers, setting.object.numbers
    held, good = _advance(numbers, touching, frames, ends, empty_nodes(1)[0])
    return Held.of(held), good


class _Step(NamedTuple):
    """One contact's step as the kernels know it, vectors in the world frame.

    touching : (4,) the antenna's radius, the object's compliance, EI/L², friction.
    frame : (7, 3) R_world_antenna, the antenna frame's origin, gravity, and two axes across the normal at the start.
    before, start : (23,) the contact before the step, and where the search begins, as `Held` packs it.
    nodes : (N, 4, 3) scratch.
    """

    rod: RodNumbers
    object: ObjectNumbers
    touching: np.ndarray
    frame: np.ndarray
    before: np.ndarray
    start: np.ndarray
    nodes: np.ndarray


_ARCLENGTH, _PRESS, _GRIP, _PLACE, _NORMAL, _POINT, _TANGENT, _SLIPPED, _PACKED = 3, 4, 5, 8, 11, 14, 17, 20, 23
"""Where they stand in a packed contact; the clamp's moment comes first."""


@kernel
def _unpacked(step: _Step, x: np.ndarray, held: np.ndarray, axes: np.ndarray) -> float:
    """Write a trial's contact (23,), its way in place of the slip, and the axes (2, 3) across its normal.

    x : (10,) M(0) in EI/L, s in L, N in EI/L², change of p in L, and g in EI/L² along the axes.

    Returns
    -------
    float : how far the place is from where the centreline should be, m.
    """
    length, (radius, _, force_unit, _) = step.rod.length_m, step.touching
    press, arclength = force_unit * x[4], length * x[3]
    old, place = vector(step.start[_NORMAL:]), moved(vector(step.start[_PLACE:]), length, vector(x[5:]))
    distance, normal = signed_distance(step.object, place)
    # the axes turn with the normal; in them the grip stays as it is
    both = moved(old, 1.0, normal)
    for i in range(2):
        axis = vector(step.frame[5 + i])
        axis = moved(axis, -dot(axis, normal) / (1.0 + dot(old, normal)), both)
        axes[i, 0], axes[i, 1], axes[i, 2] = axis
    grip = scaled(force_unit, moved(scaled(x[8], vector(axes[0])), x[9], vector(axes[1])))
    gravity = turned_back(step.frame, vector(step.frame[4]))
    force, moment = turned_back(step.frame, moved(grip, press, normal)), scaled(force_unit * length, vector(x))
    contact = shoot(step.rod, gravity, arclength, force, moment, step.nodes)
    point = moved(turned(step.frame, vector(step.nodes[contact, 0])), 1.0, vector(step.frame[3]))
    tangent = turned(step.frame, vector(step.nodes[contact, 1]))
    run = unit(moved(tangent, 1.0, vector(step.before[_TANGENT:])))
    way = moved(moved(point, -1.0, vector(step.before[_POINT:])), step.before[_ARCLENGTH] - arclength, run)
    way = moved(way, -dot(way, normal), normal)
    held[_ARCLENGTH], held[_PRESS] = arclength, press
    for i in range(3):
        held[i], held[_GRIP + i], held[_PLACE + i], held[_NORMAL + i] = moment[i], grip[i], place[i], normal[i]
        held[_POINT + i], held[_TANGENT + i], held[_SLIPPED + i] = point[i], tangent[i], way[i]
    return distance - radius


@kernel
def _left(step: _Step, x: np.ndarray, values: np.ndarray) -> None:
    """Write what is left of the smooth equations (8), scaled, and Δu in L along the axes (2)."""
    held, axes = np.empty(_PACKED), np.empty((2, 3))
    gap = _unpacked(step, x, held, axes)
    length, (_, compliance, force_unit, _) = step.rod.length_m, step.touching
    normal, way = vector(held[_NORMAL:]), vector(held[_SLIPPED:])
    for i in range(3):
        values[i] = step.nodes[-1, 3, i] / (force_unit * length)
        indent = held[_PRESS] * compliance * normal[i]
        values[3 + i] = (held[_POINT + i] - held[_PLACE + i] + indent) / length
    values[6] = gap / length
    values[7] = min(1.0 - x[3], -dot(normal, vector(held[_TANGENT:])))
    values[8], values[9] = dot(vector(axes[0]), way) / length, dot(vector(axes[1]), way) / length


_differentiate = slopes_of(_left)


@kernel
def _advance(
    numbers: tuple[RodNumbers, ObjectNumbers],
    touching: np.ndarray,
    frames: np.ndarray,
    ends: np.ndarray,
    nodes: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """B contacts (B, 23), and which were found (B,): frames (B, 7, 3) and `ends` (B, 2, 23) as in `_Step`."""
    held, good, axes = np.empty((len(frames), _PACKED)), np.empty(len(frames), np.bool_), np.empty((2, 3))
    x = np.empty(10)
    length, (_, _, force_unit, _) = numbers[0].length_m, touching
    for i, frame in enumerate(frames):
        before, start = ends[i]
        step = _Step(numbers[0], numbers[1], touching, frame, before, start, nodes)
        old, begun = vector(before[_GRIP:]), vector(start[_GRIP:])
        first, second = vector(frame[5]), vector(frame[6])
        grip = dot(first, old) / force_unit, dot(second, old) / force_unit
        for j in range(3):
            x[j], x[5 + j] = start[j] / (force_unit * length), 0.0
        x[3], x[4] = start[_ARCLENGTH] / length, start[_PRESS] / force_unit
        x[8], x[9] = dot(first, begun) / force_unit, dot(second, begun) / force_unit
        good[i] = _found(step, x, grip)
        _unpacked(step, x, held[i], axes)
        # what the grip's own spring gives way is slip too
        for j in range(3):
            change = (x[8] - grip[0]) * axes[0, j] + (x[9] - grip[1]) * axes[1, j]
            held[i, _SLIPPED + j] += change * length / _STICK
    return held, good


@kernel
def _found(step: _Step, x: np.ndarray, grip: tuple[float, float]) -> bool:
    """Newton's method from x (10,), which is overwritten; `grip` is the one before the step, in EI/L²."""
    values, slopes, others, move = np.empty(10), np.empty((10, 10)), np.empty(10), np.zeros(10)
    size = np.inf
    for _ in range(_ITERATIONS):
        _left(step, x, values)
        _differentiate(step, x, values, slopes, others)
        now = np.abs(values[:8]).max()
        if not (np.isfinite(now) and np.isfinite(slopes).all()):
            now = np.inf
        if now > max(2.0 * size, 1e3 * TOLERANCE):
            move *= 0.5
            x -= move
            continue
        size = now
        _newton_step(x, values, slopes, grip, step.touching[3], move)
        if size <= TOLERANCE and max(abs(move[8]), abs(move[9])) <= _GRIP_TOLERANCE:
            return True
        # within the rod, and not far from where the search began
        steep = 50.0 / min(max(x[3], 0.05), 1.0)
        for i in range(10):
            most = steep if i < 3 else 1.0 if i == 3 else _ROOM if 5 <= i < 8 else 20.0 * steep
            limited = min(max(x[i] + move[i], 0.01 if i == 3 else -most), most)
            move[i], x[i] = limited - x[i], limited
    return False


@kernel
def _newton_step(
    x: np.ndarray, left: np.ndarray, slopes: np.ndarray, grip: tuple[float, float], friction: float, move: np.ndarray
) -> None:
    """Write the step (10,): the linearised rest keeps the law of friction exactly; zero where that is not finite."""
    # of the unknowns other than the grip: `solved[:, 0]` without a change of the grip, the others with one
    solved = np.empty((8, 3))
    for i in range(8):
        solved[i, 0], solved[i, 1], solved[i, 2] = -left[i], -slopes[i, 8], -slopes[i, 9]
    if not solve(slopes[:8, :8].copy(), solved):
        move[:] = 0.0
        return
    pull, spring = np.empty(2), np.empty((2, 2))
    for i in range(2):
        way = left[8 + i]
        spring[i, 0], spring[i, 1] = slopes[8 + i, 8], slopes[8 + i, 9]
        for j in range(8):
            way += slopes[8 + i, j] * solved[j, 0]
            spring[i, 0] += slopes[8 + i, j] * solved[j, 1]
            spring[i, 1] += slopes[8 + i, j] * solved[j, 2]
        spring[i] *= _STICK
        pull[i] = grip[i] - _STICK * way + spring[i, 0] * x[8] + spring[i, 1] * x[9]
    found = gripped(x[8:], pull, spring, x[4] + solved[4, 0], solved[4, 1:], friction)
    for i in range(2):
        move[8 + i] = found[i] - x[8 + i]
    for i in range(8):
        move[i] = solved[i, 0] + solved[i, 1] * move[8] + solved[i, 2] * move[9]


@kernel
def gripped(
    now: np.ndarray, pull: np.ndarray, spring: np.ndarray, press: float, lift: np.ndarray, friction: float
) -> tuple[float, float]:
    """The grip g = held(g before − K Δu), where held() cuts its length off at μN.

    Both the way Δu = way + give·(g − now) and the normal force N = press + lift·(g − now) are linear in it.

    Parameters
    ----------
    now : (2,) the grip about which they are linear.
    pull, spring : (2,) g before − K way + K give·now, and (2, 2) K give.
    press, lift : N and (2,). In units that belong together. friction : μ.

    Notes
    -----
    With λ g = g before − K Δu, the grip is (λ + spring)⁻¹ pull: λ = 1 sticks, and a slide has the λ > 1 that puts g on
    the rim.
    """
    if friction == 0.0:
        return 0.0, 0.0
    law = now, pull, spring, press, lift, friction
    low = high = 1.0
    if not _beyond_rim(low, law) > 0.0:
        return _grip_at(low, pull, spring)
    for _ in range(_DOUBLINGS):
        if not _beyond_rim(high, law) > 0.0:
            break
        low, high = high, 4.0 * high
    for _ in range(_BISECTIONS):
        middle = np.sqrt(low * high)
        if _beyond_rim(middle, law) > 0.0:
            low = middle
        else:
            high = middle
    return _grip_at(high, pull, spring)


@kernel
def _grip_at(share: float, pull: np.ndarray, spring: np.ndarray) -> tuple[float, float]:
    """For this λ."""
    a, b, c, d = share + spring[0, 0], spring[0, 1], spring[1, 0], share + spring[1, 1]
    determinant = a * d - b * c
    return (d * pull[0] - b * pull[1]) / determinant, (a * pull[1] - c * pull[0]) / determinant


@kernel
def _beyond_rim(share: float, law: _Law) -> float:
    """By how much the grip for this λ is too long, by what `gripped` is given."""
    now, pull, spring, press, lift, friction = law
    y, z = _grip_at(share, pull, spring)
    return np.hypot(y, z) - friction * max(press + lift[0] * (y - now[0]) + lift[1] * (z - now[1]), 0.0)
