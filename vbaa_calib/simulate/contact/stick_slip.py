"""One step of antennas that are pressed against an object with Coulomb friction, for many strokes at a time.

With the state before the step known, a contact's clamp moment M(0), arc length s, normal force N, grip g (the friction
force) and place p satisfy

    M(L) = 0                              the rod is in equilibrium under N n + g at s
    r(s) = p − N/k n                      the surfaces touch, indented by N/k
    distance(p) = antenna radius          p is where the centreline would be if the object did not give way
    n·t(s) = 0, or s = L and n·t ≤ 0      s is the nearest point: inside the antenna, or its tip
    g = cut(g before − K Δu)              friction, where cut() ends at the cone's rim, |g| ≤ μN

with n the object's normal at p and Δu = Δr − t Δs, across n, the way of the antenna's material point at the contact:
the contact may roll on without it. This is backward Euler's return mapping. K is a tiny compliance of the grip in place
of none: an antenna that sticks gives way by |g|/K, with `STICK` a micrometre or two at the cone's rim.

All but the last line is smooth: Newton's method, in which the last line, with Δu and N linear in g, is solved for
itself (`gripped`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from vbaa_calib.antenna.rod import Rod
from vbaa_calib.core.arrays import Rows
from vbaa_calib.geometry import Pose
from vbaa_calib.native import core
from vbaa_calib.simulate.scene.objects import TouchObject


@dataclass(frozen=True)
class _StrokeSettings:
    """Step sizes and tolerances of the motion between two frames.

    On a cylinder at μ = 0.3, steps of 4 mm agree with steps of 0.5 mm within 0.3 µm of the contact's place, 0.5 % of N,
    and 0.5° of the direction of friction but in the frame of first touch.
    """

    # slip that counts as none: a sticking contact creeps by nanometres, as the antenna yields along itself
    sticks_m: float = 1e-6
    step_m: float = 4e-3  # largest motion of the free antenna in one step
    most_steps: int = 100  # between two frames
    halvings: int = 6  # of all steps between two frames, where one does not converge
    doublings: int = 8  # of the length in which the first touch is bracketed
    snap_m: float = 2e-4  # depth behind the place of contact from which the antenna has snapped past the object
    clear_m: float = 2e-3  # gap that is surely open
    fine: int = 24  # places along a bracket at which the gap is looked up
    finest_m: float = 1e-7  # distance of such places where the gap may be smaller between them
    tolerance: float = 1e-11  # of a solution: on lengths in L, moments in EI/L and n·t
    samples: int = 400  # of the antenna, at which the object is sought


STROKE = _StrokeSettings()


@dataclass(frozen=True, eq=False)
class Setting:
    """Constants of a recording. antenna_radius_m : half the antenna's diameter at the clamp. gravity_world_m_s2 :
    (3,)."""

    rod: Rod
    antenna_radius_m: float
    object: TouchObject
    gravity_world_m_s2: np.ndarray

    def radius_at(self, arclength_m: np.ndarray) -> np.ndarray:
        """Half the antenna's diameter at arc lengths."""
        return self.antenna_radius_m * self.rod.taper.diameter(arclength_m / self.rod.length_m)


@dataclass(frozen=True, eq=False)
class Bases(Rows):
    """Poses of B bases: R_world_antenna (B, 3, 3), and the antenna frame's origin (B, 3) in the world."""

    rotation: np.ndarray
    origin_m: np.ndarray

    @staticmethod
    def of(T_world_antenna: Sequence[Pose]) -> Bases:
        """The bases of B poses T_world_antenna."""
        turns, origins = zip(*((pose.rotation, pose.translation_m) for pose in T_world_antenna), strict=True)
        return Bases(np.stack(turns), np.stack(origins))

    def world(self, points_m: np.ndarray) -> np.ndarray:
        """(B, ..., 3) points in the world, from points in the antenna frames."""
        turned = np.einsum("bij,b...j->b...i", self.rotation, points_m)
        return turned + self.origin_m.reshape(len(turned), *(1,) * (turned.ndim - 2), 3)


@dataclass(frozen=True, eq=False)
class Held(Rows):
    """States of B contacts: clamp moment, arc length, forces and place, see the module.

    Attributes
    ----------
    moment_Nm : (B, 3) M(0), antenna frame. arclength_m, press_N : (B,).
    grip_N : (B, 3) friction force on the antenna. place_m : (B, 3) p. normal : (B, 3) there.
    point_m, tangent : (B, 3) of the centreline at the contact. All of these in the world frame.
    slipped_m : (B, 3) slip along the object in the step, world frame.
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
        """(B, 23) all fields in one array."""
        return np.column_stack([getattr(self, each.name) for each in fields(self)])

    @staticmethod
    def of(packed: np.ndarray) -> Held:
        """The contacts in an array (B, 23), see `packed`."""
        moment, arclength, press, *others = np.split(packed, [3, 4, 5, 8, 11, 14, 17, 20], axis=1)
        return Held(moment, arclength[:, 0], press[:, 0], *others)

    def put(self, rows: np.ndarray, others: Held) -> None:
        """Overwrite the contacts `rows` by others."""
        for each in fields(self):
            getattr(self, each.name)[rows] = getattr(others, each.name)

    @staticmethod
    def nowhere(count: int) -> Held:
        """`count` missing contacts: NaN."""
        short = ("arclength_m", "press_N")
        return Held(*(np.full(count if each.name in short else (count, 3), np.nan) for each in fields(Held)))


def _tangent_axes(normal: np.ndarray) -> np.ndarray:
    """(B, 2, 3) two orthogonal unit vectors across each normal."""
    least = np.eye(3)[np.argmin(np.abs(normal), axis=1)]
    first = np.cross(normal, least)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(normal, first)], axis=1)


def advance(setting: Setting, bases: Bases, before: Held, start: Held, friction: float) -> tuple[Held, np.ndarray]:
    """The contacts after a step to these bases, and the mask (B,) of those that were found.

    `before` is the state at the step's beginning, `start` where the search begins, `friction` the coefficient.
    """
    force_unit, radius = setting.rod.bending_stiffness_Nm2 / setting.rod.length_m**2, setting.antenna_radius_m
    touching = radius, 1.0 / setting.object.stiffness_N_m, force_unit, friction, STROKE.tolerance
    gravity = np.broadcast_to(setting.gravity_world_m_s2, (len(before.normal), 1, 3))
    frames = np.concatenate([bases.rotation, bases.origin_m[:, None], gravity, _tangent_axes(start.normal)], axis=1)
    ends = np.stack([before.packed, start.packed], axis=1)
    held, good = core.simulate.advance(setting.rod.numbers, setting.object.numbers, touching, frames, ends)
    return Held.of(held), good.view(bool)
