"""The antenna pressed against an object: contact point and force in each frame of a recording.

Frames are solved in order (`strokes`), with Coulomb friction and sticking (`stick_slip`).

Neglected: the lever of friction about the centreline (one antenna radius, below 1 % in twist and bending), and rolling
of the wire about its own axis.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vbaa_calib.antenna.rod import Rod, RodShape, sample_shape, solve_rod
from vbaa_calib.core.errors import SolveError
from vbaa_calib.geometry import Pose
from vbaa_calib.simulate.scene.objects import TouchObject

from .stick_slip import Bases, Held, Setting
from .strokes import follow


@dataclass(frozen=True, eq=False)
class Touch:
    """The contacts in B frames.

    Attributes
    ----------
    in_contact : (B,) bool.
    contact_m : (B,) arc length of the contact from the clamp; NaN without contact, as the next three but the force.
    force_antenna_N : (B, 3) the object's force on the antenna, antenna frame; zero without contact.
    contact_antenna_m : (B, 3) point of the centreline at the contact, antenna frame.
    touched_world_m, normal_world : (B, 3) touched point of the undeformed surface, and its outward normal.
    sticks : (B,) bool; in contact in the previous frame, too, without slip since (`STROKE.sticks_m`).
    slip_world_m : (B, 3) slip of the antenna's material point since the previous frame; zero without contact there.
    shape : the antenna under its weight and this force.
    """

    in_contact: np.ndarray
    contact_m: np.ndarray
    force_antenna_N: np.ndarray
    contact_antenna_m: np.ndarray
    touched_world_m: np.ndarray
    normal_world: np.ndarray
    sticks: np.ndarray
    slip_world_m: np.ndarray
    shape: RodShape


def touch(
    rod: Rod, antenna_radius_m: float, obj: TouchObject, T_world_antenna: Sequence[Pose], gravity_world_m_s2: np.ndarray
) -> Touch:
    """The antenna pressed against the object, in every frame of one stroke.

    Parameters
    ----------
    antenna_radius_m : half the antenna's diameter at its clamp.
    T_world_antenna : poses in order of time, at least one: side and friction depend on the frames before.
    gravity_world_m_s2 : (3,).

    Raises
    ------
    SolveError : names the first frame without a trustworthy equilibrium, and why.
    """
    return touch_strokes(rod, antenna_radius_m, obj, [T_world_antenna], gravity_world_m_s2)[0]


def touch_strokes(
    rod: Rod,
    antenna_radius_m: float,
    obj: TouchObject,
    strokes: Sequence[Sequence[Pose]],
    gravity_world_m_s2: np.ndarray,
) -> list[Touch]:
    """`touch` for several independent strokes, which is faster than one by one."""
    setting = Setting(rod, antenna_radius_m, obj, np.asarray(gravity_world_m_s2, float))
    bases = [Bases.of(poses) for poses in strokes]
    return [_touch(setting, at, *found) for at, found in zip(bases, follow(setting, bases), strict=True)]


def _touch(setting: Setting, bases: Bases, touching: np.ndarray, sticks: np.ndarray, contacts: Held) -> Touch:
    """The antenna's shapes under the forces of contacts. touching, sticks : (B,) masks of those that exist, and that
    stick. Raises SolveError for impossible contacts."""
    rod, obj = setting.rod, setting.object
    lost = ~touching[:, None]
    normal = np.where(lost, np.nan, contacts.normal)
    force_world = np.where(lost, 0.0, contacts.press_N[:, None] * contacts.normal + contacts.grip_N)
    force = np.einsum("bji,bj->bi", bases.rotation, force_world)
    where = np.where(touching, contacts.arclength_m, rod.length_m / 2)
    radius = setting.radius_at(where)
    shape = solve_rod(rod, setting.gravity_world_m_s2 @ bases.rotation, where, force)
    point = np.where(lost, np.nan, sample_shape(shape, where[:, None])[0][:, 0])
    in_world, indentation = bases.world(point), contacts.press_N / obj.stiffness_N_m
    contact = np.where(touching, contacts.arclength_m, np.nan)
    # of the surface, next to where it touches
    points = bases.world(shape.points_m)
    depth = np.where(obj.within(points), setting.radius_at(shape.arclength_m) - obj.signed_distance(points)[0], -np.inf)
    reasons = {
        "the antenna would pass through the object": depth.max(axis=1) > np.where(touching, indentation, 0.0) + 1e-6,
        "the contact lies beyond the object's end": touching & ~obj.within(in_world),
    }
    if obj.shape == "knife_edge":
        reasons["the antenna lies on the blade's flank"] = normal @ obj.wedge_world >= 0.0
    for reason, found in reasons.items():
        if found.any():
            raise SolveError(f"frame {np.argmax(found)}: {reason}")
    touched = in_world - (radius - indentation)[:, None] * normal
    return Touch(touching, contact, force, point, touched, normal, sticks, contacts.slipped_m, shape)
