"""The ladder of antenna models, from the paper's beam to the static rod: one call for all of them, NumPy or torch."""

from __future__ import annotations

from ..arrays import Array, namespace
from . import linear
from .shape import Curves, aligned_arclength, bend

RUNGS = ("paper", "linear", "elastica", "rod")
"""Lowest first.

`paper` : straight, weightless, rigidly clamped along x; small deflections.
`linear` : small deflections under contact, weight and bow, clamped where and as the antenna is.
`elastica` : large deflections; what weight, bow and clamp do to the contact's moment to first order.
`rod` : the static rod, as far as `antenna.rod` can tell.
"""

ELASTICA_SWEEPS, ROD_SWEEPS = 1, 3
"""Passes over the equilibrium of moments (`shape.bend`)."""


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
    sweeps = {"elastica": ELASTICA_SWEEPS, "rod": ROD_SWEEPS}[rung]
    return bend(parameters, length_m, gravity_m_s2, contact_m, force_N, sweeps=sweeps, friction_rad=friction_rad)


def _paper(parameters: Array, length_m: float, contact_m: Array, force_N: Array) -> Curves:
    xp = namespace(parameters)
    s = aligned_arclength(contact_m, length_m)
    stiffness, contact = xp.exp(parameters[:, 6:7]), contact_m[:, None]
    deflection = linear.deflection(s, contact, 1.0, stiffness)
    slope = linear.slope(s, contact, 1.0, stiffness)
    y, z = force_N[:, :1], force_N[:, 1:]
    force = xp.concat([xp.zeros_like(y), y, z], -1)
    return _flat(s, y * deflection, z * deflection, y * slope, z * slope, force, contact_m * force_N[:, 1])


def _linear(
    parameters: Array,
    length_m: float,
    gravity_m_s2: Array,
    contact_m: Array,
    force_N: Array,
    friction_rad: Array | None,
) -> Curves:
    xp = namespace(parameters)
    s = aligned_arclength(contact_m, length_m)
    contact, stiffness = contact_m[:, None], xp.exp(parameters[:, 6:7])
    weight = xp.exp(parameters[:, 7:8]) * gravity_m_s2
    held = contact * force_N + linear.weight_clamp_moment(length_m, weight[:, 1:])
    turn = parameters[:, 8:] / stiffness * held
    by_force = linear.deflection(s, contact, 1.0, stiffness), linear.slope(s, contact, 1.0, stiffness)
    by_weight = (
        linear.weight_deflection(s, length_m, 1.0, stiffness),
        linear.weight_slope(s, length_m, 1.0, stiffness),
    )
    half_square = 0.5 * s**2
    placed = []
    # turned about z the antenna goes to +y, about y to −z
    for axis, (about, sign) in enumerate(((1, 1.0), (0, -1.0))):
        f, w, b = force_N[:, axis, None], weight[:, axis + 1, None], sign * parameters[:, 4 + about, None]
        start = sign * parameters[:, 2 + about, None] + turn[:, axis, None]
        at = parameters[:, axis, None] + start * s + b * half_square + f * by_force[0] + w * by_weight[0]
        placed.append((at, start + b * s + f * by_force[1] + w * by_weight[1]))
    along = xp.zeros_like(contact)
    if friction_rad is not None:
        along = -xp.hypot(force_N[:, :1], force_N[:, 1:]) * xp.tan(friction_rad)[:, None]
    moment = held[:, 1] - parameters[:, 1] * (along[:, 0] + length_m * weight[:, 0])
    (y, y_slope), (z, z_slope) = placed
    return _flat(s, y, z, y_slope, z_slope, xp.concat([along, force_N], -1), moment)


def _flat(
    arclength_m: Array, y_m: Array, z_m: Array, y_slope: Array, z_slope: Array, force_N: Array, moment_Nm: Array
) -> Curves:
    """Curves (B, N) whose abscissa is their arc length."""
    xp = namespace(arclength_m)
    x = 1.0 / xp.sqrt(1.0 + y_slope**2 + z_slope**2)
    tangents = xp.stack([x, y_slope * x, z_slope * x], -1)
    return Curves(arclength_m, xp.stack([arclength_m, y_m, z_m], -1), tangents, force_N, moment_Nm)
