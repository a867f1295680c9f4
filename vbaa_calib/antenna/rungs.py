"""The ladder of antenna models, from the paper's beam to the static rod: one call for all of them, NumPy or torch."""

from __future__ import annotations

from vbaa_calib.core.arrays import Array, namespace

from . import linear
from .nodes import CONTACT, aligned_arclength, on_shaft
from .shape import Curves, bend

RUNGS = ("paper", "linear", "elastica", "rod")
"""Lowest first.

`paper` : straight, weightless, rigidly clamped along x; small deflections.
`linear` : small deflections under contact, weight and bow, clamped where and as the antenna is.
`elastica` : large deflections; weight, bow, clamp and torsion by one sweep over the equilibrium of moments.
`rod` : the static rod, as far as `antenna.rod` can tell.
"""

_ELASTICA_SWEEPS, _ROD_SWEEPS = 1, 4
"""Passes over the equilibrium of moments (`shape.bend`).

Largest distance from `antenna.rod` in 60 antennas bowed by 0.2 /m, clamped 1° askew, gravity in all directions,
friction of ±0.3 rad, with the contact's slope at 20°, 35° and 45°, in µm: one sweep 87, 298, 570; two 3.4, 17, 41;
three 0.14, 1.0, 2.8; four 0.006, 0.06, 0.21.
"""


def curves(
    rung: str,
    parameters: Array,
    length_m: float,
    gravity_m_s2: Array,
    contact_m: Array,
    force_N: Array,
    friction_rad: Array | None = None,
) -> Curves:
    """Shapes of B antennas as a rung of the ladder sees them.

    Parameters
    ----------
    rung : one of `RUNGS`.
    parameters : (B, 9), see `shape.PARAMETERS`; `paper` knows the stiffness alone.
    gravity_m_s2 : (B, 3) antenna frame.
    contact_m : (B,) arc length of the contact from the clamp.
    force_N : (B, 2) components (y, z), in the clamp's frame, of the force along the antenna's normal at the contact
        before it is turned with the antenna.
    friction_rad : (B,) angle of the contact force from that normal, positive towards the clamp, see `shape.bend`. What
        it does to the shape is of second order: `linear` has it in its force alone, `paper` not at all.
    """
    if rung == "paper":
        return _paper(parameters, length_m, contact_m, force_N)
    if rung == "linear":
        return _linear(parameters, length_m, gravity_m_s2, contact_m, force_N, friction_rad)
    sweeps = {"elastica": _ELASTICA_SWEEPS, "rod": _ROD_SWEEPS}[rung]
    return bend(parameters, length_m, gravity_m_s2, contact_m, force_N, sweeps=sweeps, friction_rad=friction_rad)


def _paper(parameters: Array, length_m: float, contact_m: Array, force_N: Array) -> Curves:
    """The beam in both planes (`linear`)."""
    xp = namespace(parameters)
    contact = on_shaft(contact_m, length_m)[:, None]
    s, stiffness = aligned_arclength(contact[:, 0], length_m), xp.exp(parameters[:, 6:7])
    shape, slope = linear.deflection(s, contact, 1.0, stiffness), linear.slope(s, contact, 1.0, stiffness)
    y, z = force_N[:, :1], force_N[:, 1:]
    moment = linear.clamp_moment(contact, z)[:, 0]
    y_slope, z_slope = y * slope, z * slope
    along = _across(xp.zeros_like(y), force_N, y_slope, z_slope)
    return _flat(s, y * shape, z * shape, y_slope, z_slope, xp.concat([along, y, z], -1), moment)


def _linear(
    parameters: Array,
    length_m: float,
    gravity_m_s2: Array,
    contact_m: Array,
    force_N: Array,
    friction_rad: Array | None,
) -> Curves:
    """Contact, lateral weight, bow, clamp and its give, superposed."""
    xp = namespace(parameters)
    contact, stiffness = on_shaft(contact_m, length_m)[:, None], xp.exp(parameters[:, 6:7])
    s = xp.clip(aligned_arclength(contact[:, 0], length_m), None, length_m)
    weight = xp.exp(parameters[:, 7:8]) * gravity_m_s2
    held = linear.clamp_moment(contact, force_N) + linear.weight_clamp_moment(length_m, weight[:, 1:])
    # turned or bowed about z the antenna goes to +y, about y to −z
    turn = xp.stack([parameters[:, 3], -parameters[:, 2]], -1) + parameters[:, 8:] / stiffness * held
    bow = xp.stack([parameters[:, 5], -parameters[:, 4]], -1)
    pushed, push_slope = linear.deflection(s, contact, 1.0, stiffness), linear.slope(s, contact, 1.0, stiffness)
    sagged = linear.weight_deflection(s, length_m, 1.0, stiffness)
    sag_slope = linear.weight_slope(s, length_m, 1.0, stiffness)

    def lateral(axis: int) -> tuple[Array, Array]:
        start, about, force, load = (
            values[:, axis, None] for values in (parameters[:, :2], bow, force_N, weight[:, 1:])
        )
        slope = turn[:, axis, None] + about * s + force * push_slope + load * sag_slope
        return start + (turn[:, axis, None] + 0.5 * about * s) * s + force * pushed + load * sagged, slope

    along = xp.zeros_like(contact)
    if friction_rad is not None:
        along = -xp.hypot(force_N[:, :1], force_N[:, 1:]) * xp.tan(friction_rad)[:, None]
    moment = held[:, 1] - parameters[:, 1] * (along[:, 0] + length_m * weight[:, 0])
    (y, y_slope), (z, z_slope) = lateral(0), lateral(1)
    along = _across(along, force_N, y_slope, z_slope)
    return _flat(s, y, z, y_slope, z_slope, xp.concat([along, force_N], -1), moment)


def _across(along: Array, force_N: Array, y_slope: Array, z_slope: Array) -> Array:
    """(B, 1) the force along x, that of friction given, of a force across the antenna where it touches.

    What it adds to shape and moment is of second order; its direction in the world it is not.
    """
    return along - force_N[:, :1] * y_slope[:, CONTACT, None] - force_N[:, 1:] * z_slope[:, CONTACT, None]


def _flat(
    arclength_m: Array, y_m: Array, z_m: Array, y_slope: Array, z_slope: Array, force_N: Array, moment_Nm: Array
) -> Curves:
    """Curves (B, N) whose abscissa is their arc length."""
    xp = namespace(arclength_m)
    x = 1.0 / xp.sqrt(1.0 + y_slope**2 + z_slope**2)
    tangents = xp.stack([x, y_slope * x, z_slope * x], -1)
    return Curves(arclength_m, xp.stack([arclength_m, y_m, z_m], -1), tangents, force_N, moment_Nm)
