"""Pressing the antenna against an object: where it touches and how hard, for each frame of a recording.

Two ways lead there. Frictionless contacts with a cylinder, a sphere or a knife edge hang on nothing but the side from
which the antenna came: `equilibrium` solves all frames at once, `approach` knows the side. With friction, and on the
other objects, the frames follow one another (`strokes`): Coulomb's friction with sticking (`grip`).

Friction's lever of one antenna radius about the centreline is left out: it twists and bends a thin antenna by less
than a part in a hundred. So is the way by which the wire rolls about its own axis.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vbaa_calib.antenna.rod import Rod, sample_shape, solve_rod
from vbaa_calib.core.errors import InputError, SolveError
from vbaa_calib.geometry import Pose
from vbaa_calib.simulate.scene.objects import TouchObject

from .at_once import touch_at_once
from .holding import Setting, Touch, stacked
from .strokes import Followed, follow

__all__ = ["Touch", "touch", "touch_strokes"]

_AT_ONCE = ("cylinder", "sphere", "knife_edge")


def touch(
    rod: Rod,
    antenna_radius_m: float,
    obj: TouchObject,
    T_world_antenna: Sequence[Pose],
    gravity_world_m_s2: np.ndarray,
    *,
    slip_scale_m: float | None = None,
) -> Touch:
    """The antenna pressed against the object, in every frame of one stroke.

    Parameters
    ----------
    antenna_radius_m : half the antenna's diameter.
    T_world_antenna : B poses in order of time: the side of the contact and the friction depend on the frames before.
    gravity_world_m_s2 : (3,).
    slip_scale_m : friction of a simpler kind, for cylinder, sphere and knife edge: full slip, μN·tanh(slip since the
        frame before / this), the slip that of the frictionless antenna. Nothing sticks, and friction turns at once
        where a path turns back. Frames close together slip little: pressing a cylinder by 0.5° a frame slips about
        0.02 mm each. The first frame is frictionless.

    Raises
    ------
    InputError : no frames, or a radius that is not positive.
    SolveError : names the first frame without a trustworthy equilibrium, and why.
    """
    if slip_scale_m is None:
        return touch_strokes(rod, antenna_radius_m, obj, [T_world_antenna], gravity_world_m_s2)[0]
    _checked(antenna_radius_m, [T_world_antenna])
    if obj.shape not in _AT_ONCE:
        raise InputError(f"a {obj.shape} takes no slip_scale_m", where="touch", remedy="leave it out")
    return touch_at_once(rod, antenna_radius_m, obj, T_world_antenna, gravity_world_m_s2, slip_scale_m)


def touch_strokes(
    rod: Rod,
    antenna_radius_m: float,
    obj: TouchObject,
    strokes: Sequence[Sequence[Pose]],
    gravity_world_m_s2: np.ndarray,
) -> list[Touch]:
    """As `touch`, of several strokes that know nothing of each other, which is faster than one by one."""
    _checked(antenna_radius_m, strokes)
    if obj.friction == 0.0 and obj.shape in _AT_ONCE:
        return [touch_at_once(rod, antenna_radius_m, obj, poses, gravity_world_m_s2, None) for poses in strokes]
    setting = Setting(rod, antenna_radius_m, obj)
    followed = follow(setting, strokes, gravity_world_m_s2)
    return [_followed(setting, followed, i, poses, gravity_world_m_s2) for i, poses in enumerate(strokes)]


def _checked(antenna_radius_m: float, strokes: Sequence[Sequence[Pose]]) -> None:
    fewest = min((len(poses) for poses in strokes), default=0)
    if not fewest or not antenna_radius_m > 0.0:
        raise InputError(f"{fewest} frames, antenna radius {antenna_radius_m} m", where="touch")


def _followed(
    setting: Setting, followed: Followed, stroke: int, poses: Sequence[Pose], gravity_world_m_s2: np.ndarray
) -> Touch:
    """One stroke's contacts, and the antenna's shapes under their forces."""
    rotations, origins = stacked(poses)
    count, rod, radius = len(poses), setting.rod, setting.antenna_radius_m
    touching = followed.touches[stroke, :count]
    states = [contacts.picked(np.array([stroke])) for contacts in followed.contacts[:count]]
    arclength, press, grip, place, normal = (
        np.concatenate([getattr(state, name) for state in states])
        for name in ("arclength_m", "press_N", "grip_N", "place_m", "normal")
    )
    lost = ~touching[:, None]
    force_world = np.where(lost, 0.0, press[:, None] * normal + grip)
    force = np.einsum("bji,bj->bi", rotations, force_world)
    gravity = np.asarray(gravity_world_m_s2, float) @ rotations
    where = np.where(touching, arclength, rod.length_m / 2)
    shape = solve_rod(rod, gravity, where, force)
    point = sample_shape(shape, where[:, None])[0][:, 0]
    result = Touch(
        in_contact=touching,
        contact_m=np.where(touching, arclength, np.nan),
        force_antenna_N=force,
        contact_antenna_m=np.where(lost, np.nan, point),
        touched_world_m=np.where(lost, np.nan, place - radius * normal),
        normal_world=np.where(lost, np.nan, normal),
        sticks=followed.sticks[stroke, :count],
        slip_world_m=followed.slipped_m[stroke, :count],
        shape=shape,
    )
    whole = np.einsum("bij,bnj->bni", rotations, shape.points_m) + origins[:, None]
    deepest = setting.object.signed_distance(whole)[0].min(axis=1)
    reasons = {
        "the antenna would pass through the object elsewhere": deepest
        < radius - press / setting.object.stiffness_N_m - 1e-6,
        "the contact lies beyond the object's end": ~setting.object.within(place),
    }
    if setting.object.shape == "knife_edge":
        reasons["the antenna lies on the blade's flank"] = normal @ setting.object.wedge_world >= 0.0
    for reason, found in reasons.items():
        if (found & touching).any():
            raise SolveError(f"frame {np.flatnonzero(found & touching)[0]}: {reason}")
    return result
