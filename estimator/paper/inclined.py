"""The paper's tilted orthographic camera B: it sees plane C along a direction tilted by φ, so depth looks like length.

A point (x, y, z) of the antenna appears at x_p = x + z·tanφ, y_p = y. A point load bends the antenna in one plane, so
z/y = f_z/f_y everywhere, and with κ = tanφ·f_z/f_y the true position is x = x_p − κ·y on the curved and the straight
part alike. The moment sensor closes it: κ·l·f_y = τ_y·tanφ. For two curved points that is a quintic in κ, for two
straight ones κ cancels, Eq. (30); `_candidates` solves all cases as one, exactly where the paper's sextic is not.

NumPy or torch; arguments broadcast, and the work is in float64. The last axis of `xp_m` and `y_m` holds the two points;
|y| decides which of them is nearer to the clamp. At strong tilts and large slopes two points may admit more than one
contact: the one with the smallest slope is taken, and `solutions` says how many there were. Where there is none the
numbers are NaN and the part is `Part.NONE`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from vbaa_calib.core.arrays import Array, as_floats, namespace
from vbaa_calib.core.errors import InputError

from .two_point import Part, TwoPointContact, bending, elasticity, floats, in_pieces, relative_contact

_CLOSE = 1e-9  # a step of Newton's, relative, after which one more reaches rounding


def _candidates(xp1: Array, xp2: Array, ratio: Array, torque: Array) -> tuple[Array, Array, Array, Array]:
    """Part, l, x1 and x2 (n, 3) of the up to three contacts, NaN for missing ones: two with a curved point, and the
    one with both points straight, Eq. (30), with its points by Eq. (26), corrected so that it inverts Eq. (25), and
    depth by Eqs. (27), (28). ratio : y2/y1. torque : τ_y·tanφ/2EI."""
    xp = namespace(ratio)
    drop = ratio * xp1 - xp2
    drop = xp.where((drop > 0.0) & (ratio > 1.0) & (abs(torque) < np.inf), drop, np.nan)
    place, load = xp2 / drop, torque * drop
    first, last = (xp.sqrt(ratio) + 1.0) / (ratio - 1.0), (2.0 * ratio + 1.0) / (ratio - 1.0)

    def excess(v: Array) -> tuple[Array, Array]:
        pull, growth = _pull(v, ratio)
        return (place - v) * pull - load, pull * ((place - v) * growth - 1.0)

    fold = (xp2 < xp1) & (load < 0.0)
    turn = _turn(place, ratio, xp.maximum(first, place), last, fold)
    at_first, at_turn, at_last = (place - first) / first**2 - load, excess(turn)[0], excess(last)[0]
    guess = xp.minimum(xp.maximum(place, first), turn)
    begin = xp.where((at_first >= 0.0) & (at_turn < 0.0), first, np.nan)
    found = [_root(excess, begin, turn, guess), first * np.nan]
    back = fold & (at_turn < 0.0) & (at_last >= 0.0)
    if bool(back.any()):
        found[1] = _root(excess, xp.where(back, last, np.nan), turn, 0.5 * (turn + last))
    shapes = [_shape(v, ratio) for v in found]
    contact = 3.0 * drop / (ratio - 1.0)
    x1, x2 = ((p + torque * contact**2 / 3.0) / (1.0 + torque * contact) for p in (xp1, xp2))
    beyond = ((at_last < 0.0) == fold) & (x1 >= contact * (1.0 - _CLOSE))
    parts = [part for part, _ in shapes] + [xp.where(beyond, int(Part.STRAIGHT), int(Part.NONE))]
    contacts = [drop * v * reach for v, (_, reach) in zip(found, shapes, strict=True)]
    contacts.append(xp.where(beyond, xp.minimum(contact, x1), np.nan))
    firsts, seconds = [drop * (1.0 + v) / ratio for v in found], [drop * v for v in found]
    return xp.stack(parts, -1), xp.stack(contacts, -1), xp.stack([*firsts, x1], -1), xp.stack([*seconds, x2], -1)


def _shape(v: Array, ratio: Array) -> tuple[Array, Array]:
    """Part and λ = l/x2 at v = x2/(r·x_p1 − x_p2), r = y2/y1, short of two straight points."""
    xp = namespace(v)
    spread = (1.0 + v) / (ratio * v)
    known = spread**2 * ratio
    part = xp.where(known * (3.0 - spread) >= 2.0, int(Part.CURVED), int(Part.MIXED))
    # l/x2 of deflections as if under a pure moment
    return part, xp.where(known < 1.0, relative_contact(part, spread, ratio), 1e15)


def _pull(v: Array, ratio: Array) -> tuple[Array, Array]:
    """Function g(v) of the equation (place − v)·g(v) = load that `_candidates` solves for v (see `_shape`), and d ln
    g/dv. The deflection is homogeneous: ∂ln y/∂ln x = 3 − ∂ln y/∂ln l."""
    xp = namespace(v)
    _, reach = _shape(v, ratio)
    one = xp.ones_like(v)
    e1, e2 = elasticity((1.0 + v) / (ratio * v), reach), elasticity(one, reach)
    lengthening = ((3.0 - e1) / (1.0 + v) - (3.0 - e2) / v) / (e2 - e1)
    return 3.0 * reach / (v**2 * bending(one, reach)), (1.0 - e2) * lengthening - (3.0 - e2) / v


def _turn(place: Array, ratio: Array, first: Array, last: Array, fold: Array) -> Array:
    """The place in [first, last] at which a folded picture's equation has its extremum; `last` for others."""
    turn = last + 0.0 * first
    if not bool(fold.any()):
        return last
    place, ratio, low, high = place[fold], ratio[fold], first[fold], last[fold]
    xp = namespace(place)
    high = xp.maximum(low, high)
    for _ in range(36):
        middle = 0.5 * (low + high)
        before = 1.0 / (middle - place) + _pull(middle, ratio)[1] > 0.0
        low, high = xp.where(before, middle, low), xp.where(before, high, middle)
    turn[fold] = high
    return turn


def _root(function: Callable[[Array], tuple[Array, Array]], above: Array, below: Array, start: Array) -> Array:
    """Root between `above`, where the function (value and derivative) is positive, and `below`, by Newton's method
    with bisection bounds."""
    xp = namespace(above)
    v, middle = start, 0.5 * (above + below)
    v = xp.where((v - above) * (v - below) < 0.0, v, middle)
    for turn in range(100):
        value, slope = function(v)
        above, below = xp.where(value >= 0.0, v, above), xp.where(value >= 0.0, below, v)
        newton, middle = v - value / slope, 0.5 * (above + below)
        inside = (newton - above) * (newton - below) <= 0.0
        close = inside & (abs(newton - v) <= _CLOSE * abs(v))
        # far into the loop every other step halves: Newton's may swing between two places
        v = xp.where(close | (inside & ((turn < 20) | (turn % 2 == 0))), newton, middle)
        if bool((close | (value != value) | (abs(above - below) <= 1e-15 * abs(v))).all()):
            break
    value, slope = function(v)
    newton = v - value / slope
    return xp.where((newton - above) * (newton - below) <= 0.0, newton, v)


def project(points_m: Any, camera_tilt_rad: Any = 0.0) -> Array:
    """Image (..., 2) on plane C of antenna points (..., 3): camera A (upright) by Eq. (23), camera B by Eq. (24)."""
    points, tilt = floats(points_m, camera_tilt_rad)
    xp = namespace(points)
    shifted = points[..., 0] + points[..., 2] * xp.tan(tilt)
    return xp.stack([shifted, xp.broadcast_to(points[..., 1], shifted.shape)], -1)


def inclined_two_point_contact(
    xp_m: Any, y_m: Any, moment_Nm: Any, stiffness_Nm2: Any, camera_tilt_rad: Any, length_m: Any = np.inf
) -> TwoPointContact:
    """Contact and force from two points (..., 2) of camera B and the moment τ_y (...), in all three cases.

    `camera_tilt_rad` is the paper's φ, `length_m` the antenna's length L; a contact beyond it is inadmissible.
    """
    position, y, *rest = floats(xp_m, y_m, moment_Nm, stiffness_Nm2, camera_tilt_rad, length_m)
    part, contact, fy, fz, x1, x2, solutions, *conditions = in_pieces(_solved, position, y, *rest)
    return TwoPointContact(part, contact, fy, namespace(y).stack([x1, x2], -1), fz, solutions, tuple(conditions))


def eq29_baseline(
    xp_m: Any, y_m: Any, moment_Nm: Any, stiffness_Nm2: Any, camera_tilt_rad: Any, length_m: Any = np.inf
) -> np.ndarray:
    """Contact distance (...) for two curved points by the paper's Eq. (29), which is biased: for comparison only.

    With γ = τ_y·tanφ/6EI (2EI is printed). It gives the *curved* points the depth of the straight part. Smallest root
    in 0 < l ≤ L, NaN where there is none. NumPy alone.
    """
    arrays = [
        as_floats(each, "an argument", "give numbers")
        for each in (xp_m, y_m, moment_Nm, stiffness_Nm2, camera_tilt_rad, length_m)
    ]
    if {arrays[0].shape[-1:], arrays[1].shape[-1:]} != {(2,)}:
        what = f"the points have the shapes {arrays[0].shape} and {arrays[1].shape}"
        raise InputError(what, remedy="give (..., 2) of x and of y")
    with np.errstate(all="ignore"):
        return np.vectorize(_eq29, signature="(2),(2),(),(),(),()->()", otypes=[float])(*arrays)


def _eq29(position: np.ndarray, y: np.ndarray, moment: float, stiffness: float, tilt: float, length: float) -> float:
    unit = np.abs(position).max()
    g = moment * np.tan(tilt) / (6.0 * stiffness) * unit
    (p1, p2), e1 = position / unit, y[0] / y[1]
    a0, a1, a2, a3 = (p1**k - p2**k * e1 for k in range(4))
    # as a polynomial in 1/l: its leading coefficient does not vanish with γ
    sextic = [-a3, 3.0 * a2, 6.0 * g * a2, 6.0 * g * a1, 15.0 * g**2 * a1, 3.0 * g**2 * a0, 8.0 * g**3 * a0]
    if not np.isfinite(sextic).all():
        return np.nan
    roots = np.roots(sextic)
    contact = unit / roots.real[(roots.real > 0.0) & (np.abs(roots.imag) <= 1e-6 * np.abs(roots))]
    inside = contact[contact <= length]
    return float(inside.min()) if len(inside) else np.nan


def _solved(
    position: Array, y: Array, moment: Array, stiffness: Array, tilt: Array, length: Array
) -> tuple[Array, ...]:
    """`TwoPointContact` of points (n, 2), the nearer to the clamp first: part, l, f_y, f_z, x1, x2, solutions,
    conditions."""
    xp = namespace(y)
    (xp1, xp2), (y1, y2) = (points.T for points in (position, y))
    twist = moment * xp.tan(tilt)
    part, contact, x1, x2 = _candidates(xp1, xp2, y2 / y1, twist / (2.0 * stiffness))
    limit = (length + 0.0 * y1)[:, None]
    rounding = 1e-9
    contact = xp.where((contact > 0.0) & (contact <= limit * (1.0 + rounding)), xp.minimum(contact, limit), np.nan)
    force = (6.0 * stiffness * y2)[:, None] / bending(x2, contact)
    found = contact == contact
    # of several, the one that small deflections allow best
    steepness = (force * contact**2) ** 2 + ((moment + 0.0 * y1)[:, None] * contact) ** 2
    best = xp.argmin(xp.where(found, steepness, np.inf), -1)[:, None]
    contact, force, x1, x2 = (_taken(value, best) for value in (contact, force, x1, x2))
    part = xp.where(contact == contact, _taken(part, best), int(Part.NONE))
    missing = 0.0 * contact
    seen = ((xp1, x1, y1), (xp2, x2, y2))
    conditions = _conditions(*((elasticity(x, contact), p / x, twist / (contact * force) * y / x) for p, x, y in seen))
    return part, contact, force, moment / contact, x1 + missing, x2 + missing, found.sum(-1), *conditions


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
