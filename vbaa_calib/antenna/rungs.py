"""The ladder of antenna models, from the paper's beam to the static rod: one call for all of them.

`paper` : straight, weightless, rigidly clamped along x; small deflections.
`linear` : small deflections under contact, weight and bow, clamped where and as the antenna is.
`elastica` : large deflections; weight, bow, clamp and torsion by one sweep over the equilibrium of moments.
`rod` : the static rod in full, solved as in `antenna.rod`.
"""

from __future__ import annotations

import numpy as np

from vbaa_calib.core.arrays import validate_arguments
from vbaa_calib.core.errors import InputError
from vbaa_calib.native import core

from .shape import Curves, curves_of
from .taper import UNIFORM, Taper

RUNGS = ("paper", "linear", "elastica", "rod")
"""Lowest first, in the order of the core's."""
REFERENCE = "rod"
"""What the other rungs are compared with, as in the core: what they leave out is alike in neighbours and adds up."""


@validate_arguments
def curves(
    rung: str,
    parameters: np.ndarray,
    length_m: float,
    gravity_m_s2: np.ndarray,
    contact_m: np.ndarray,
    force_N: np.ndarray,
    friction_rad: np.ndarray | None = None,
    taper: Taper = UNIFORM,
) -> Curves:
    """Shapes of B antennas by the mechanical model of one rung.

    Parameters
    ----------
    rung : one of `RUNGS`.
    parameters : (B, 9), see `shape.PARAMETERS`; `paper` uses the stiffness alone.
    gravity_m_s2 : (B, 3) antenna frame.
    contact_m : (B,) arc length of the contact from the clamp.
    force_N : (B, 2) components (y, z), in the clamp's frame, of the force along the antenna's normal at the contact
        before it is turned with the antenna.
    friction_rad : (B,) angle of the contact force from that normal, positive towards the clamp, see `shape.bend`. Its
        effect on the shape is of second order: `linear` applies it to the force alone, `paper` ignores it.
    taper : how the antennas' stiffness and weight, which are the clamp's, change along them.
    """
    if rung not in RUNGS:
        raise InputError(f"rung is {rung!r}", remedy=f"one of {', '.join(RUNGS)} is needed")
    if parameters.ndim != 2 or parameters.shape[1] != 9:
        raise InputError(f"parameters have shape {parameters.shape}", remedy="give (B, 9)")
    count = len(parameters)
    shapes = {"gravity_m_s2": (count, 3), "contact_m": (count,), "force_N": (count, 2), "friction_rad": (count,)}
    for (name, shape), values in zip(shapes.items(), (gravity_m_s2, contact_m, force_N, friction_rad), strict=True):
        if values is not None and values.shape != shape:
            raise InputError(f"{name} has shape {values.shape}", remedy=f"give {shape}")
    friction_rad = np.zeros(count) if friction_rad is None else friction_rad
    wires, pushes = (parameters, length_m, taper.pieces), (contact_m, force_N, friction_rad)
    bent = core.antenna.curves(RUNGS.index(rung), wires, gravity_m_s2, pushes)
    return curves_of(contact_m, length_m, bent)
