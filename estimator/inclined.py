"""The paper's tilted orthographic camera B: it sees plane C along a direction tilted by φ, so depth looks like length.

A point (x, y, z) of the antenna appears at x_p = x + z·tanφ, y_p = y. A point load bends the antenna in one plane, so
z/y = f_z/f_y everywhere, and with κ = tanφ·f_z/f_y the true position is x = x_p − κ·y on the curved and the straight
part alike. The moment sensor closes it: κ = T/M with T = τ_y·tanφ known and M = l·f_y. Each of the paper's cases then
is one polynomial in M, of degree 5 (two curved points), 1 (two straight points) and 6 (one of each), exact where the
paper's sextic is not.

Arguments broadcast; the last axis of `xp_m` and `y_m` holds the two points. Since |y| grows along the antenna whatever
κ is, it tells which of the two is nearer to the clamp. At strong tilts and large slopes two points may admit more than
one contact: all are found, the one with the smallest slope is taken, and `solutions` says how many there were. Where
there is none the numbers are NaN and the part is `Part.NONE`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from vbaa_calib.antenna import linear

from .polynomial import product, real_roots
from .two_point import Part, conditions

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
    condition_contact, condition_force : (...) largest relative error of l, and of f_y, per relative error of y1 and y2.
    """

    part: np.ndarray
    contact_m: np.ndarray
    force_y_N: np.ndarray
    force_z_N: np.ndarray
    x_m: np.ndarray
    solutions: np.ndarray
    condition_contact: np.ndarray
    condition_force: np.ndarray


def project(points_m: ArrayLike, camera_tilt_rad: ArrayLike = 0.0) -> np.ndarray:
    """Image (..., 2) on plane C of antenna points (..., 3): camera A (upright) by Eq. (23), camera B by Eq. (24)."""
    points = np.asarray(points_m, float)
    shifted = points[..., 0] + points[..., 2] * np.tan(np.asarray(camera_tilt_rad, float))
    return np.stack(np.broadcast_arrays(shifted, points[..., 1]), axis=-1)


def straight_depth(x_m: ArrayLike, contact_m: ArrayLike, moment_Nm: ArrayLike, stiffness_Nm2: ArrayLike) -> np.ndarray:
    """z (...) of the straight part, Eq. (27), by the moment alone, Eq. (28)."""
    x, contact = np.asarray(x_m, float), np.asarray(contact_m, float)
    return np.asarray(moment_Nm, float) * (3.0 * x - contact) * contact / (6.0 * np.asarray(stiffness_Nm2, float))


def straight_image(
    x_m: ArrayLike, contact_m: ArrayLike, moment_Nm: ArrayLike, stiffness_Nm2: ArrayLike, camera_tilt_rad: ArrayLike
) -> np.ndarray:
    """x_p (...) at which a point of the straight part appears, Eq. (25)."""
    return np.asarray(x_m, float) + straight_depth(x_m, contact_m, moment_Nm, stiffness_Nm2) * np.tan(camera_tilt_rad)


def straight_position(
    xp_m: ArrayLike, contact_m: ArrayLike, moment_Nm: ArrayLike, stiffness_Nm2: ArrayLike, camera_tilt_rad: ArrayLike
) -> np.ndarray:
    """x (...) of a point of the straight part that appears at x_p: Eq. (26), mended to be the inverse of Eq. (25)."""
    contact, stiffness = np.asarray(contact_m, float), np.asarray(stiffness_Nm2, float)
    torque = np.asarray(moment_Nm, float) * np.tan(np.asarray(camera_tilt_rad, float))
    return (6.0 * stiffness * np.asarray(xp_m, float) + torque * contact**2) / (
        6.0 * stiffness + 3.0 * torque * contact
    )


def inclined_two_point_contact(
    xp_m: ArrayLike,
    y_m: ArrayLike,
    moment_Nm: ArrayLike,
    stiffness_Nm2: ArrayLike,
    camera_tilt_rad: ArrayLike,
    length_m: ArrayLike = np.inf,
) -> InclinedContact:
    """Contact and force from two points (..., 2) of camera B and the moment τ_y (...), whichever case they are.

    `camera_tilt_rad` is the paper's φ, `length_m` the antenna's length L; a contact beyond it is inadmissible.
    """
    xp, y, shape, (moment, stiffness, tilt, length) = _flat(
        xp_m, y_m, moment_Nm, stiffness_Nm2, camera_tilt_rad, length_m
    )
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        unit = np.abs(xp).max(axis=-1, keepdims=True)
        p, e1 = xp / unit, y[:, :1] / y[:, 1:]
        t = (moment * np.tan(tilt))[:, None] * unit / (2.0 * stiffness[:, None])
        parts, contact, x1, x2 = _candidates(p[:, :1], p[:, 1:], e1, t)
        admissible = (contact > 0.0) & (contact <= length[:, None] / unit) & (x1 > 0.0) & (x1 < x2)
        contact = np.where(admissible & (e1 > 0.0), contact * unit, np.nan)
        force_y = y[:, 1:] / linear.deflection(x2 * unit, contact, 1.0, stiffness[:, None])
        force_z = moment[:, None] / contact
        # of several, the one that small deflections allow best
        steepness = np.hypot(force_y, force_z) * contact**2
        best = np.argmin(np.where(np.isnan(steepness), np.inf, steepness), axis=-1)[:, None]
        part, distance, fy, fz, *x = (
            np.take_along_axis(value, best, axis=-1)[:, 0]
            for value in (np.broadcast_to(parts, contact.shape), contact, force_y, force_z, x1 * unit, x2 * unit)
        )
        elasticities = (_elasticity(value, distance, np.tan(tilt) * fz / stiffness) for value in x)
        condition_contact, condition_force = conditions(*elasticities)
    found = ~np.isnan(distance)
    return InclinedContact(
        part=np.where(found, part, Part.NONE).reshape(shape),
        contact_m=distance.reshape(shape),
        force_y_N=fy.reshape(shape),
        force_z_N=fz.reshape(shape),
        x_m=np.where(found[:, None], np.stack(x, axis=-1), np.nan).reshape(*shape, 2),
        solutions=_count_different(contact).reshape(shape),
        condition_contact=condition_contact.reshape(shape),
        condition_force=condition_force.reshape(shape),
    )


def eq29_baseline(
    xp_m: ArrayLike,
    y_m: ArrayLike,
    moment_Nm: ArrayLike,
    stiffness_Nm2: ArrayLike,
    camera_tilt_rad: ArrayLike,
    length_m: ArrayLike = np.inf,
) -> np.ndarray:
    """Contact distance (...) for two curved points as the paper has it, Eq. (29): for comparison only, it is biased.

    With γ = τ_y·tanφ/6EI, as its coefficients demand (2EI is printed). It gives the *curved* points the depth of the
    straight part. Smallest root in 0 < l ≤ L, NaN where there is none.
    """
    xp, y, shape, (moment, stiffness, tilt, length) = _flat(
        xp_m, y_m, moment_Nm, stiffness_Nm2, camera_tilt_rad, length_m
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        unit = np.abs(xp).max(axis=-1)
        g = moment * np.tan(tilt) / (6.0 * stiffness) * unit
        p, e = (xp / unit[:, None]).T, (y / y[:, 1:]).T
        a0, a1, a2, a3 = (p[0] ** k * e[1] - p[1] ** k * e[0] for k in range(4))
        sextic = [8.0 * g**3 * a0, 3.0 * g**2 * a0, 15.0 * g**2 * a1, 6.0 * g * a1, 6.0 * g * a2, 3.0 * a2, -a3]
        # as a polynomial in 1/l: its leading coefficient does not vanish with γ
        contact = unit[:, None] / real_roots(np.stack(sextic, axis=-1))
    smallest = np.where((contact > 0.0) & (contact <= length[:, None]), contact, np.inf).min(axis=-1)
    return np.where(np.isfinite(smallest), smallest, np.nan).reshape(shape)


def _flat(
    xp_m: ArrayLike, y_m: ArrayLike, *others: ArrayLike
) -> tuple[np.ndarray, np.ndarray, tuple[int, ...], list[np.ndarray]]:
    """x_p and y (n, 2) with the point nearer to the clamp first, the batch shape, and the other arguments (n,)."""
    xp, y = np.broadcast_arrays(np.asarray(xp_m, float), np.asarray(y_m, float))
    rest = [np.asarray(value, float) for value in others]
    shape = np.broadcast_shapes(xp.shape[:-1], *(value.shape for value in rest))
    xp, y = (np.broadcast_to(value, (*shape, 2)).reshape(-1, 2) for value in (xp, y))
    swap = np.abs(y[:, :1]) > np.abs(y[:, 1:])
    xp, y = np.where(swap, xp[:, ::-1], xp), np.where(swap, y[:, ::-1], y)
    return xp, y, shape, [np.broadcast_to(value, shape).reshape(-1) for value in rest]


def _candidates(p1: np.ndarray, p2: np.ndarray, e1: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, ...]:
    """Parts (12,), and l, x1, x2 (n, 12) of every solution that lies on the parts it was derived for.

    Two straight points lose κ and keep the upright camera's l, Eq. (30).
    Everything (n, 1), in units in which the larger |x_p|, y2 and 2EI are 1; there t is T, and the unknown m is M.
    A candidate beside one of the points may belong to either part to within rounding.
    """
    m5, m6 = real_roots(_curved_quintic(p1, p2, e1, t)), real_roots(_mixed_sextic(p1, p2, e1, t))
    straight = 3.0 * (p1 - p2 * e1) / (1.0 - e1)
    x1 = [p1 - t * e1 / m5, _straight_x(p1, straight, t), p1 - t * e1 / m6]
    x2 = [p2 - t / m5, _straight_x(p2, straight, t), p2 - t / m6]
    contact = [
        (x1[0] ** 3 - x2[0] ** 3 * e1) / (3.0 * (x1[0] ** 2 - x2[0] ** 2 * e1)),
        straight,
        x1[2] ** 3 / (3.0 * (x1[2] ** 2 - e1 / m6)),
    ]
    on_part = [
        contact[0] >= x2[0] - _ROUNDING,
        contact[1] <= x1[1] + _ROUNDING,
        (contact[2] >= x1[2] - _ROUNDING) & (contact[2] <= x2[2] + _ROUNDING),
    ]
    parts = np.repeat([Part.CURVED, Part.STRAIGHT, Part.MIXED], [5, 1, 6])
    found = np.where(np.concatenate(on_part, axis=-1), np.concatenate(contact, axis=-1), np.nan)
    return parts, found, np.concatenate(x1, axis=-1), np.concatenate(x2, axis=-1)


def _straight_x(p: np.ndarray, contact: np.ndarray, t: np.ndarray) -> np.ndarray:
    return straight_position(p, contact, t, 0.5, np.pi / 4.0)


def _curved_quintic(p1: np.ndarray, p2: np.ndarray, e1: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Two curved points, (n, 6), rising powers of m.

    With ξ_i = x_i·m = p_i·m − t·e_i: m(ξ2³e1 − ξ1³) = ξ1²ξ2²(ξ2 − ξ1).
    """
    one = np.ones_like(p1)
    xi1, xi2 = np.concatenate([-t * e1, p1], axis=-1), np.concatenate([-t * one, p2], axis=-1)
    m = np.concatenate([0.0 * one, one], axis=-1)
    left = product(m, e1 * product(xi2, xi2, xi2) - product(xi1, xi1, xi1))
    right = product(xi1, xi1, xi2, xi2, xi2 - xi1)
    right[:, :5] -= left
    return right


def _mixed_sextic(p1: np.ndarray, p2: np.ndarray, e1: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Point 1 curved, point 2 straight, (n, 7), rising powers of m.

    The moment gives l = x1³/3(x1² − e1/m); in the upright cubic of case (iii), with d = ξ1² − e1·m, that leaves
    −e1ξ1⁶ + 9e1ξ2ξ1³d − 27ξ1²d² + 27d³ = 0.
    """
    one = np.ones_like(p1)
    xi1, xi2 = np.concatenate([-t * e1, p1], axis=-1), np.concatenate([-t * one, p2], axis=-1)
    square = product(xi1, xi1)
    d = square - e1 * np.concatenate([0.0 * one, one, 0.0 * one], axis=-1)
    return (
        -e1 * product(square, square, square)
        + 9.0 * e1 * product(xi2, xi1, square, d)
        + 27.0 * product(d, d, d - square)
    )


def _count_different(contact_m: np.ndarray) -> np.ndarray:
    """How many contacts (n, 12) differ by more than rounding; a contact beside a point turns up in two cases."""
    ordered = np.sort(contact_m, axis=-1)
    return (np.diff(ordered, axis=-1, prepend=0.0) > 1e-6 * ordered).sum(axis=-1)


def _elasticity(x: np.ndarray, contact: np.ndarray, lean: np.ndarray) -> np.ndarray:
    """∂ln y/∂ln l (n,) at constant f_y, x_p and τ_y, where `lean` = tanφ·f_z/EI; x moves along with l."""
    y, by_x = linear.deflection(x, contact, 1.0, 1.0), linear.slope(x, contact, 1.0, 1.0)
    by_contact = linear.deflection_by_contact(x, contact, 1.0, 1.0)
    x_by_contact = -lean * (by_contact - y / contact) / (1.0 + lean * by_x)
    return contact * (by_contact + by_x * x_by_contact) / y
