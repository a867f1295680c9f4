"""The static rod as a library call, without a camera: from loads to shape.

from estimator import rod
shape = rod.solve(rod.wire(0.24, 0.8e-3, "stainless steel"), force_N=[0, 0.05, 0])
shape.points_m[-1]  # the tip
"""

from __future__ import annotations

import math
from dataclasses import fields

import numpy as np
from numpy.typing import ArrayLike

from vbaa_calib.antenna.materials import MATERIALS, Material
from vbaa_calib.antenna.rod import TORSION_RATIO, Rod, RodShape, solve_rod
from vbaa_calib.core.arrays import validate_arguments
from vbaa_calib.core.errors import InputError, quoted
from vbaa_calib.rig import Rig

__all__ = ["Rod", "RodShape", "solve", "wire"]


@validate_arguments
def wire(length_m: float, diameter_m: float, material: str = "stainless steel") -> Rod:
    """A round, straight wire of one of `materials.MATERIALS`, clamped along x.

    Raises InputError for another material, or a length or diameter that no antenna has: they are in metres.
    """
    from vbaa_calib.core.models import checked
    from vbaa_calib.session import NominalAntenna  # loads as long as all else here

    known = Material.named(material)
    if known is None:
        raise InputError(f"material is {quoted(material)}", remedy=f"give one of {', '.join(MATERIALS)}")
    stated = {"length_m": length_m, "diameter_m": diameter_m}
    of_material = {"youngs_modulus_Pa": known.youngs_modulus_Pa, "density_kg_m3": known.density_kg_m3}
    one = checked(NominalAntenna, stated | of_material, "wire", "give metres")
    return Rod(one.length_m, one.stiffness_Nm2, one.stiffness_Nm2 / TORSION_RATIO, one.mass_per_length_kg_m)


@validate_arguments
def solve(
    antenna: Rod | Rig,
    force_N: ArrayLike = (0.0, 0.0, 0.0),
    contact_m: ArrayLike | None = None,
    gravity_m_s2: ArrayLike | None = None,
) -> RodShape:
    """Shape under weight and one force of fixed direction, for any deflection.

    Its arrays have no B where all loads are one.

    Parameters
    ----------
    antenna : a rod, or the antenna of a rig.
    force_N : (3,) or (B, 3) antenna frame: x along the clamped rod, y to the left, z up.
    contact_m : () or (B,) arc length of the force from the clamp; None: the tip.
    gravity_m_s2 : (3,) or (B, 3) antenna frame; None: a rig's at pan and tilt 0, for a rod 9.80665 m/s² along −z.

    Raises
    ------
    InputError : wrong shapes, what is no number, a contact off the rod.
    SolveError : no equilibrium was found.
    """
    rod = antenna.antenna.rod if isinstance(antenna, Rig) else antenna
    if not isinstance(rod, Rod):
        raise InputError(f"antenna is {quoted(antenna)}", remedy="give a Rod or a Rig")
    if gravity_m_s2 is None and isinstance(antenna, Rig):
        gravity_m_s2 = antenna.gravity_world_m_s2 @ antenna.kinematics.T_world_antenna(0.0, 0.0).rotation
    force = np.asarray(force_N, float)
    gravity = np.asarray((0.0, 0.0, -9.80665) if gravity_m_s2 is None else gravity_m_s2, float)
    contact = np.asarray(rod.length_m if contact_m is None else contact_m, float)
    for name, values in (("force_N", force), ("gravity_m_s2", gravity)):
        if values.ndim not in (1, 2) or values.shape[-1] != 3:
            raise InputError(f"{name} has shape {values.shape}", remedy="give (3,) or (B, 3)")
    if contact.ndim > 1:
        raise InputError(f"contact_m has shape {contact.shape}", remedy="give () or (B,)")
    try:
        shape = np.broadcast_shapes(force.shape[:-1], gravity.shape[:-1], contact.shape)
    except ValueError:
        what = f"force_N has shape {force.shape}, gravity_m_s2 {gravity.shape}, contact_m {contact.shape}"
        raise InputError(what, remedy="give one of each, or B") from None
    count = math.prod(shape)
    loads = [np.broadcast_to(values, (*shape, 3)).reshape(count, 3) for values in (gravity, force)]
    found = solve_rod(rod, loads[0], np.broadcast_to(contact, shape).reshape(count), loads[1])
    if shape:
        return found
    return RodShape(**{one.name: getattr(found, one.name)[0] for one in fields(found)})
