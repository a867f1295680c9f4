"""The paper's tilted orthographic camera B: it sees plane C along a direction tilted by φ, so depth looks like length.

A point (x, y, z) of the antenna appears at x_p = x + z·tanφ, y_p = y. A point load bends the antenna in one plane, so
z/y = f_z/f_y everywhere, and with κ = tanφ·f_z/f_y the true position is x = x_p − κ·y on the curved and the straight
part alike. The moment sensor closes it: κ·l·f_y = τ_y·tanφ. For two curved points that is a quintic in κ, for two
straight ones κ cancels, Eq. (30); `inclined_roots` solves all cases as one, exactly where the paper's sextic is not.

NumPy or torch; arguments broadcast, and the work is in float64. The last axis of `xp_m` and `y_m` holds the two points.
Since |y| grows along the antenna whatever κ is, it tells which of the two is nearer to the clamp. At strong tilts and
large slopes two points may admit more than one contact: all are found, the one with the smallest slope is taken, and
`solutions` says how many there were. Where there is none the numbers are NaN and the part is `Part.NONE`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from vbaa_calib.arrays import Array, namespace

from .batches import floats, in_pieces
from .inclined_roots import candidates
from .polynomial import real_roots
from .two_point import Part, bending, elasticity, ordered

_ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class InclinedContact:
    """What two points seen by the tilted camera and the moment tell.

    Attributes
    ----------
    part : (...) a `Part` each.
    contact_m, force_y_N, force_z_N : (...) contact distance l and force components.
    x_m : (..., 2) where the two points really are along the antenna, the nearer one first.
    solutions : (...) number of different admissible contacts; more than one is an ambiguity, not an answer.
    condition_contact, condition_force : (...) largest relative error of l, and of f_y, per relative error of y1, y2,
        x_p1, x_p2 and the moment.
    """

    part: Array
    contact_m: Array
    force_y_N: Array
    force_z_N: Array
    x_m: Array
    solutions: Array
    condition_contact: Array
    condition_force: Array


def project(points_m: Any, camera_tilt_rad: Any = 0.0) -> Array:
    """Image (..., 2) on plane C of antenna points (..., 3): camera A (upright) by Eq. (23), camera B by Eq. (24)."""
    points, tilt = floats(points_m, camera_tilt_rad)
    xp = namespace(points)
    shifted = points[..., 0] + points[..., 2] * xp.tan(tilt)
    return xp.stack([shifted, xp.broadcast_to(points[..., 1], shifted.shape)], -1)


def straight_depth(x_m: Any, contact_m: Any, moment_Nm: Any, stiffness_Nm2: Any) -> Array:
    """z (...) of the straight part, Eq. (27), by the moment alone, Eq. (28)."""
    x, contact, moment, stiffness = floats(x_m, contact_m, moment_Nm, stiffness_Nm2)
    return moment * (3.0 * x - contact) * contact / (6.0 * stiffness)


def straight_image(x_m: Any, contact_m: Any, moment_Nm: Any, stiffness_Nm2: Any, camera_tilt_rad: Any) -> Array:
    """x_p (...) at which a point of the straight part appears, Eq. (25)."""
    x, tilt = floats(x_m, camera_tilt_rad)
    return x + straight_depth(x_m, contact_m, moment_Nm, stiffness_Nm2) * namespace(tilt).tan(tilt)


def straight_position(xp_m: Any, contact_m: Any, moment_Nm: Any, stiffness_Nm2: Any, camera_tilt_rad: Any) -> Array:
    """x (...) of a point of the straight part that appears at x_p: Eq. (26), mended to be the inverse of Eq. (25)."""
    seen, contact, moment, stiffness, tilt = floats(xp_m, contact_m, moment_Nm, stiffness_Nm2, camera_tilt_rad)
    torque = moment * namespace(tilt).tan(tilt)
    return (6.0 * stiffness * seen + torque * contact**2) / (6.0 * stiffness + 3.0 * torque * contact)


def inclined_two_point_contact(
    xp_m: Any, y_m: Any, moment_Nm: Any, stiffness_Nm2: Any, camera_tilt_rad: Any, length_m: Any = np.inf
) -> InclinedContact:
    """Contact and force from two points (..., 2) of camera B and the moment τ_y (...), whichever case they are.

    `camera_tilt_rad` is the paper's φ, `length_m` the antenna's length L; a contact beyond it is inadmissible.
    """
    position, y, *rest = floats(xp_m, y_m, moment_Nm, stiffness_Nm2, camera_tilt_rad, length_m)
    batch = np.broadcast_shapes(position.shape[:-1], y.shape[:-1], *(value.shape for value in rest))
    xp = namespace(y)
    columns = [xp.broadcast_to(value, (*batch, 2))[..., point] for value in (position, y) for point in (0, 1)]
    part, contact, fy, fz, x1, x2, solutions, *worth = in_pieces(_solved, batch, *columns, *rest)
    return InclinedContact(part, contact, fy, fz, xp.stack([x1, x2], -1), solutions, *worth)


def eq29_baseline(
    xp_m: Any, y_m: Any, moment_Nm: Any, stiffness_Nm2: Any, camera_tilt_rad: Any, length_m: Any = np.inf
) -> Array:
    """Contact distance (...) for two curved points as the paper has it, Eq. (29): for comparison only, it is biased.

    With γ = τ_y·tanφ/6EI, as its coefficients demand (2EI is printed). It gives the *curved* points the depth of the
    straight part. Smallest root in 0 < l ≤ L, NaN where there is none.
    """
    position, y, *rest = floats(xp_m, y_m, moment_Nm, stiffness_Nm2, camera_tilt_rad, length_m)
    batch = np.broadcast_shapes(position.shape[:-1], y.shape[:-1], *(value.shape for value in rest))
    xp = namespace(y)
    columns = [xp.broadcast_to(value, (*batch, 2))[..., point] for value in (position, y) for point in (0, 1)]
    return in_pieces(_eq29, batch, *columns, *rest)[0]


def _solved(
    xp_a: Array,
    xp_b: Array,
    y_a: Array,
    y_b: Array,
    moment: Array,
    stiffness: Array,
    tilt: Array,
    length: Array,
) -> tuple[Array, ...]:
    """`InclinedContact` of flat arrays (n,): part, l, f_y, f_z, x1, x2, solutions, conditions."""
    xp = namespace(y_a)
    xp1, xp2, y1, y2 = ordered(abs(y_a) > abs(y_b), (xp_a, xp_b), (y_a, y_b))
    twist = moment * xp.tan(tilt)
    part, contact, x1, x2 = candidates(xp1, xp2, y2 / y1, twist / (2.0 * stiffness))
    limit = (length + 0.0 * y1)[:, None]
    contact = xp.where((contact > 0.0) & (contact <= limit * (1.0 + _ROUNDING)), xp.minimum(contact, limit), np.nan)
    force = (6.0 * stiffness * y2)[:, None] / bending(x2, contact)
    found = contact == contact
    # of several, the one that small deflections allow best
    steepness = (force * contact**2) ** 2 + ((moment + 0.0 * y1)[:, None] * contact) ** 2
    best = xp.argmin(xp.where(found, steepness, np.inf), -1)[:, None]
    contact, force, x1, x2 = (_taken(value, best) for value in (contact, force, x1, x2))
    part = xp.where(contact == contact, _taken(part, best), int(Part.NONE))
    missing = 0.0 * contact
    seen = ((xp1, x1, y1), (xp2, x2, y2))
    worth = _conditions(*((elasticity(x, contact), p / x, twist / (contact * force) * y / x) for p, x, y in seen))
    return part, contact, force, moment / contact, x1 + missing, x2 + missing, found.sum(-1), *worth


def _taken(values: Array, column: Array) -> Array:
    """values[i, column[i]], (n,), of values (n, k) and columns (n, 1)."""
    if isinstance(values, np.ndarray):
        return np.take_along_axis(values, column, -1)[:, 0]
    return values.gather(-1, column)[:, 0]


def _conditions(first: tuple[Array, Array, Array], second: tuple[Array, Array, Array]) -> tuple[Array, Array]:
    """Condition numbers (n,) of l and f_y, from each point's ∂ln y/∂ln l, x_p/x and κ·y/x.

    A point's ln y moves by d ln f + e·d ln l + s·d ln x with s = 3 − e, and x = x_p − κ·y with κ = τ_y·tanφ/(l·f_y).
    """
    (e1, stretch1, lean1), (e2, stretch2, lean2) = first, second
    s1, s2 = 3.0 - e1, 3.0 - e2
    a1, a2 = s1 * lean1, s2 * lean2
    # the errors of y1, y2, x_p1, x_p2 and of the moment, each at its worst sign
    errors = ((1.0 + a1, 0.0), (0.0, 1.0 + a2), (s1 * stretch1, 0.0), (0.0, s2 * stretch2), (a1, a2))
    gap = abs((1.0 + a1) * (e2 + a2) - (1.0 + a2) * (e1 + a1))
    contact = sum(abs((1.0 + a1) * right - (1.0 + a2) * left) for left, right in errors)
    force = sum(abs((e2 + a2) * left - (e1 + a1) * right) for left, right in errors)
    return contact / gap, force / gap


def _eq29(
    xp_a: Array,
    xp_b: Array,
    y_a: Array,
    y_b: Array,
    moment: Array,
    stiffness: Array,
    tilt: Array,
    length: Array,
) -> tuple[Array]:
    xp = namespace(y_a)
    p1, p2, y1, y2 = ordered(abs(y_a) > abs(y_b), (xp_a, xp_b), (y_a, y_b))
    unit = xp.maximum(abs(p1), abs(p2))
    g = moment * xp.tan(tilt) / (6.0 * stiffness) * unit
    p1, p2, e1 = p1 / unit, p2 / unit, y1 / y2
    a0, a1, a2, a3 = (p1**k - p2**k * e1 for k in range(4))
    sextic = [8.0 * g**3 * a0, 3.0 * g**2 * a0, 15.0 * g**2 * a1, 6.0 * g * a1, 6.0 * g * a2, 3.0 * a2, -a3]
    # as a polynomial in 1/l: its leading coefficient does not vanish with γ
    contact = unit[:, None] / real_roots(xp.stack(sextic, -1))
    inside = (contact > 0.0) & (contact <= (length + 0.0 * unit)[:, None])
    smallest = xp.amin(xp.where(inside, contact, np.inf), -1)
    return (xp.where(smallest < np.inf, smallest, np.nan),)
