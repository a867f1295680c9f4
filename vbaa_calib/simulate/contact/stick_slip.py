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
from dataclasses import dataclass, fields, replace
from typing import TypeVar

import numpy as np

from vbaa_calib.antenna.rod import STEPS_PER_SEGMENT, Rod, shoot
from vbaa_calib.geometry import Pose
from vbaa_calib.simulate.scene.objects import TouchObject

TOLERANCE = 1e-11
"""On lengths in L, moments in EI/L and n·t."""
_GRIP_TOLERANCE = 1e-8
"""On the grip in EI/L²."""
_STICK = 1e5
"""Stiffness K of a sticking contact in EI/L³: 28 kN/m for the steel whisker, whose own stiffness at the tip is 3."""
_DOUBLINGS, _BISECTIONS = 60, 60
_DIFFERENCE = -1e-7
_ITERATIONS = 20
_ROOM = 0.3
"""Of the contact's place in one step, in L."""

_Rows = TypeVar("_Rows", "Bases", "Held")


def picked(of: _Rows, rows: np.ndarray) -> _Rows:
    """Some of the rows of all fields."""
    return type(of)(*(getattr(of, each.name)[rows] for each in fields(of)))


@dataclass(frozen=True, eq=False)
class Setting:
    """What does not change in a recording. `antenna_radius_m` is half the antenna's diameter, gravity (3,)."""

    rod: Rod
    antenna_radius_m: float
    object: TouchObject
    gravity_world_m_s2: np.ndarray

    @property
    def moment_unit_Nm(self) -> float:
        """EI/L."""
        return self.rod.bending_stiffness_Nm2 / self.rod.length_m

    @property
    def force_unit_N(self) -> float:
        """EI/L²."""
        return self.moment_unit_Nm / self.rod.length_m


@dataclass(frozen=True, eq=False)
class Bases:
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
class Held:
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


def gripped(
    now: np.ndarray, pull: np.ndarray, spring: np.ndarray, press: np.ndarray, lift: np.ndarray, friction: float
) -> np.ndarray:
    """(B, 2) the grip g = held(g before − K Δu), where held() cuts its length off at μN.

    Both the way Δu = way + give·(g − now) and the normal force N = press + lift·(g − now) are linear in it.

    Parameters
    ----------
    now : (B, 2) the grip about which they are linear.
    pull, spring : (B, 2) g before − K way + K give·now, and (B, 2, 2) K give.
    press, lift : (B,) and (B, 2). In units that belong together. friction : μ.

    Notes
    -----
    With λ g = g before − K Δu, the grip is (λ + spring)⁻¹ pull: λ = 1 sticks, and a slide has the λ > 1 that puts g on
    the rim.
    """
    if friction == 0.0:
        return np.zeros_like(now)

    def at(share: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The grip for each λ, and by how much it is beyond the rim."""
        a, d = share + spring[:, 0, 0], share + spring[:, 1, 1]
        b, c = spring[:, 0, 1], spring[:, 1, 0]
        determinant = a * d - b * c
        grip = np.stack([d * pull[:, 0] - b * pull[:, 1], a * pull[:, 1] - c * pull[:, 0]], axis=1)
        grip = grip / determinant[:, None]
        rim = friction * np.maximum(press + (lift * (grip - now)).sum(axis=1), 0.0)
        return grip, np.hypot(grip[:, 0], grip[:, 1]) - rim

    low = np.ones(len(now))
    grip, beyond = at(low)
    slides = beyond > 0.0
    if not slides.any():
        return grip
    high = low.copy()
    for _ in range(_DOUBLINGS):
        still = slides & (at(high)[1] > 0.0)
        if not still.any():
            break
        low, high = np.where(still, high, low), np.where(still, 4.0 * high, high)
    for _ in range(_BISECTIONS):
        middle = np.sqrt(low * high)
        outside = at(middle)[1] > 0.0
        low, high = np.where(outside, middle, low), np.where(outside, high, middle)
    return np.where(slides[:, None], at(high)[0], grip)


@np.errstate(over="ignore", invalid="ignore")
def advance(setting: Setting, bases: Bases, before: Held, start: Held, friction: float) -> tuple[Held, np.ndarray]:
    """The contacts at these bases, and which of them (B,) were found.

    `before` is the state at the step's beginning, `start` where the search begins, `friction` the coefficient.
    """
    count, frame = len(start.press_N), tangent_axes(start.normal)
    x, size = _packed(setting, start, frame), np.full(count, np.inf)
    step, good = np.zeros_like(x), np.zeros(count, bool)
    grip = np.einsum("bij,bj->bi", frame, before.grip_N) / setting.force_unit_N
    rows = np.arange(count)
    for _ in range(_ITERATIONS):
        left, slopes = _linearised(
            setting, picked(bases, rows), picked(before, rows), picked(start, rows), frame[rows], x[rows]
        )
        now = np.abs(left[:, :8]).max(axis=1)
        now = np.where(np.isfinite(now) & np.isfinite(slopes).all(axis=(1, 2)), now, np.inf)
        worse = now > np.maximum(2.0 * size[rows], 1e3 * TOLERANCE)
        x[rows[worse]] -= 0.5 * step[rows[worse]]
        step[rows[worse]] *= 0.5
        better = ~worse
        at = rows[better]
        size[at] = now[better]
        step[at] = _newton_step(x[at], left[better], slopes[better], grip[at], friction)
        done = (size[at] <= TOLERANCE) & (np.abs(step[at, 8:]).max(axis=1, initial=0.0) <= _GRIP_TOLERANCE)
        good[at[done]] = True
        moving = at[~done]
        limited = _limited(x[moving] + step[moving])
        step[moving] = limited - x[moving]
        x[moving] = limited
        rows = np.flatnonzero(~good)
        if rows.size == 0:
            break
    held, _, _, axes = _unpacked(setting, bases, start, frame, x)
    change = np.einsum("bi,bij->bj", x[:, 8:] - grip, axes) * setting.force_unit_N
    slipped = _way(before, held) + change * setting.rod.length_m / (_STICK * setting.force_unit_N)
    return replace(held, slipped_m=slipped), good


def _linearised(
    setting: Setting, bases: Bases, before: Held, start: Held, frame: np.ndarray, x: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(B, 10) what is left of the smooth equations (8) and the way along the object in L (2), and their slopes."""
    count, size = x.shape
    every = np.tile(np.arange(count), size + 1)
    trials = np.concatenate([x, (x + _DIFFERENCE * np.eye(size)[:, None]).reshape(-1, size)])
    trial = _unpacked(setting, picked(bases, every), picked(start, every), frame[every], trials)
    values = _left(setting, picked(before, every), *trial).reshape(size + 1, count, -1)
    return values[0], np.moveaxis((values[1:] - values[0]) / _DIFFERENCE, 0, -1)


def _newton_step(x: np.ndarray, left: np.ndarray, slopes: np.ndarray, grip: np.ndarray, friction: float) -> np.ndarray:
    """(B, 10) with the law of friction kept exactly by the linearised rest; zero where that is singular."""
    usable = np.isfinite(slopes).all(axis=(1, 2))
    inverse = np.zeros((len(x), 8, 8))
    inverse[usable] = np.linalg.pinv(slopes[usable, :8, :8])
    # unknowns other than the grip: `plain` without a change of the grip, `lean` with it
    plain = -np.einsum("bij,bj->bi", inverse, left[:, :8])
    lean = -inverse @ slopes[:, :8, 8:]
    way = left[:, 8:] + np.einsum("bij,bj->bi", slopes[:, 8:, :8], plain)
    spring = _STICK * (slopes[:, 8:, 8:] + slopes[:, 8:, :8] @ lean)
    pull = grip - _STICK * way + np.einsum("bij,bj->bi", spring, x[:, 8:])
    change = gripped(x[:, 8:], pull, spring, x[:, 4] + plain[:, 4], lean[:, 4], friction) - x[:, 8:]
    return np.hstack([plain + np.einsum("bij,bj->bi", lean, change), change])


def _limited(x: np.ndarray) -> np.ndarray:
    """Within the rod, and not far from where the search began."""
    steep = 50.0 / np.clip(x[:, 3:4], 0.05, 1.0)
    least, most = np.full_like(x, -_ROOM), np.full_like(x, _ROOM)
    least[:, :3], most[:, :3] = -steep, steep
    least[:, 3], most[:, 3] = 0.01, 1.0
    least[:, [4, 8, 9]], most[:, [4, 8, 9]] = -20.0 * steep, 20.0 * steep
    return np.clip(x, least, most)


def tangent_axes(normal: np.ndarray) -> np.ndarray:
    """(B, 2, 3) two orthogonal unit vectors across each normal."""
    least = np.eye(3)[np.argmin(np.abs(normal), axis=1)]
    first = np.cross(normal, least)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(normal, first)], axis=1)


def _across(vectors: np.ndarray, normal: np.ndarray) -> np.ndarray:
    return np.asarray(vectors - (vectors * normal).sum(axis=1, keepdims=True) * normal)


def _turned(frame: np.ndarray, normal: np.ndarray, new: np.ndarray) -> np.ndarray:
    """The axes (B, 2, 3) across a normal, turned with it to a new one; in them the grip stays as it is."""
    both = normal + new
    share = np.einsum("bij,bj->bi", frame, new) / (1.0 + (normal * new).sum(axis=1, keepdims=True))
    return np.asarray(frame - share[:, :, None] * both[:, None, :])


def _way(before: Held, after: Held) -> np.ndarray:
    """(B, 3) Δu."""
    tangent = before.tangent + after.tangent
    tangent = tangent / np.linalg.norm(tangent, axis=1, keepdims=True)
    run = (after.arclength_m - before.arclength_m)[:, None]
    return _across(after.point_m - before.point_m - run * tangent, after.normal)


def _packed(setting: Setting, held: Held, frame: np.ndarray) -> np.ndarray:
    """(B, 10) M(0) in EI/L, s in L, N in EI/L², change of p in L, and g in EI/L² along the axes."""
    unit = setting.force_unit_N
    return np.hstack(
        [
            held.moment_Nm / setting.moment_unit_Nm,
            held.arclength_m[:, None] / setting.rod.length_m,
            held.press_N[:, None] / unit,
            np.zeros((len(frame), 3)),
            np.einsum("bij,bj->bi", frame, held.grip_N) / unit,
        ]
    )


def _unpacked(
    setting: Setting, bases: Bases, start: Held, frame: np.ndarray, x: np.ndarray
) -> tuple[Held, np.ndarray, np.ndarray, np.ndarray]:
    """The contacts of a trial, the tip's moment (B, 3), the distance (B,) of the place from the surface, and the axes
    (B, 2, 3) across its normal."""
    rod, unit = setting.rod, setting.force_unit_N
    moment, arclength, press = x[:, :3] * setting.moment_unit_Nm, x[:, 3] * rod.length_m, x[:, 4] * unit
    place = start.place_m + x[:, 5:8] * rod.length_m
    distance, normal = setting.object.signed_distance(place)
    axes = _turned(frame, start.normal, normal)
    grip = np.einsum("bi,bij->bj", x[:, 8:] * unit, axes)
    force = np.einsum("bji,bj->bi", bases.rotation, press[:, None] * normal + grip)
    nodes = shoot(rod, setting.gravity_world_m_s2 @ bases.rotation, arclength, force, moment)
    contact = np.where(arclength < rod.length_m, nodes[STEPS_PER_SEGMENT], nodes[-1])
    tangent = np.einsum("bij,jb->bi", bases.rotation, contact[1])
    point = bases.world(contact[0].T)
    held = Held(moment, arclength, press, grip, place, normal, point, tangent, np.zeros_like(grip))
    return held, nodes[-1, 3].T, distance, axes


def _left(
    setting: Setting, before: Held, trial: Held, tip_moment: np.ndarray, distance: np.ndarray, axes: np.ndarray
) -> np.ndarray:
    """(B, 10) what is left of the smooth equations, scaled, and Δu in L along the axes."""
    length = setting.rod.length_m
    indent = (trial.press_N / setting.object.stiffness_N_m)[:, None] * trial.normal
    return np.hstack(
        [
            tip_moment / setting.moment_unit_Nm,
            (trial.point_m - trial.place_m + indent) / length,
            (distance - setting.antenna_radius_m)[:, None] / length,
            np.minimum(1.0 - trial.arclength_m / length, -(trial.normal * trial.tangent).sum(axis=1))[:, None],
            np.einsum("bij,bj->bi", axes, _way(before, trial)) / length,
        ]
    )
