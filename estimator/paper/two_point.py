"""The paper's two-point formulas for the upright camera, which sees (x, y) of the antenna on plane C.

Of two points x1 < x2 with deflections y1, y2 the ratio y2/y1 depends on l alone and grows with it, from x2/x1 (l → 0)
over (3x2 − x1)/2x1 (l = x1) and 2x2³/((3x2 − x1)x1²) (l = x2) to (x2/x1)² (l → ∞). So exactly one of the three cases
holds, and the ratio says which.

NumPy or torch; arguments broadcast, and the work is in float64. The last axis of `x_m` and `y_m` holds the two points,
in either order. Where no contact 0 < l ≤ L explains them the numbers are NaN and the part is `Part.NONE`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property
from typing import Any

import numpy as np

from vbaa_calib.core.arrays import Array, as_floats, is_tensor, like, namespace, widest_float
from vbaa_calib.core.errors import InputError


def floats(*values: Any) -> list[Array]:
    """Values in float64: tensors on one device if one of them is a tensor, otherwise arrays."""
    tensors = [value for value in values if is_tensor(value)]
    if not tensors:
        return [as_floats(value, "an argument", "give numbers") for value in values]
    if not all(each.is_floating_point() for each in tensors):
        raise InputError("a tensor is of no real numbers", remedy="convert it to float32 or float64")
    reference = tensors[0].new_empty(0, dtype=widest_float(tensors[0].device))
    return [like(reference, value) for value in values]


def in_pieces(work: Callable[..., tuple[Array, ...]], x_m: Array, y_m: Array, *values: Array) -> list[Array]:
    """Results (...) of a function of points (n, 2), the nearer to the clamp first, and numbers (n,), computed in
    pieces. Points x, y (..., 2) and values (...) broadcast. Warnings about NaN are off."""
    xp = namespace(y_m)
    try:
        batch = np.broadcast_shapes(x_m.shape[:-1], y_m.shape[:-1], *(value.shape for value in values))
    except ValueError:
        batch = None
    if batch is None or (*x_m.shape[-1:], *y_m.shape[-1:]) != (2, 2):
        what = f"the points have the shapes {tuple(x_m.shape)} and {tuple(y_m.shape)}"
        raise InputError(what, remedy="give (..., 2) of x and of y, and numbers (...) that broadcast with them")
    points = [xp.broadcast_to(points, (*batch, 2)).reshape(-1, 2) for points in (x_m, y_m)]
    swap = abs(points[1][:, :1]) > abs(points[1][:, 1:])
    points = [xp.where(swap, xp.flip(pair, (1,)), pair) for pair in points]
    flat = [v if v.ndim == 0 and batch else xp.broadcast_to(v, batch).reshape(-1) for v in values]
    count = math.prod(batch)
    # frames at a time: few enough for the cache, enough for torch's threads
    step = 16384 if xp is np else 65536 if y_m.device.type == "cpu" else max(count, 1)
    with np.errstate(all="ignore"):
        pieces = [
            work(*(v if v.ndim == 0 else v[start : start + step] for v in (*points, *flat)))
            for start in range(0, max(count, 1), step)
        ]
    return [xp.concat(list(column)).reshape(batch) for column in zip(*pieces, strict=True)]


class Part(IntEnum):
    """Which parts of the antenna the two points lie on: the paper's cases (i), (ii), (iii)."""

    NONE = 0
    CURVED = 1
    STRAIGHT = 2
    MIXED = 3


@dataclass(frozen=True, eq=False)
class TwoPointContact:
    """Results (...) from two points at `x_m` (..., 2) along the antenna: a `Part`, contact distance l and f_y.

    By the tilted camera and the moment also f_z, and `solutions`, the number of admissible contacts: more than one is
    an ambiguity, not an answer.
    """

    part: Array
    contact_m: Array
    force_y_N: Array
    x_m: Array
    force_z_N: Array = None
    solutions: Array = None
    known_conditions: tuple[Array, ...] = ()

    @property
    def condition_contact(self) -> Array:
        """(...) condition number of l: its largest relative error per relative error of what is measured (y1 and y2; by
        the tilted camera x_p1, x_p2 and the moment, too). Computed on first use."""
        return self._conditions[0]

    @property
    def condition_force(self) -> Array:
        """(...) condition number of f_y: its largest relative error per relative error of the same."""
        return self._conditions[1]

    @cached_property
    def _conditions(self) -> tuple[Array, ...]:
        if self.known_conditions:
            return self.known_conditions
        with np.errstate(all="ignore"):
            return _conditions(*(elasticity(self.x_m[..., point], self.contact_m) for point in (0, 1)))


def two_point_contact(x_m: Any, y_m: Any, stiffness_Nm2: Any, length_m: Any = np.inf) -> TwoPointContact:
    """Contact distance and f_y from two points (..., 2), by the one of the three cases that is consistent with its
    own solution.

    Curved points solve Eqs. (8)–(11), straight ones Eqs. (12)–(15), of which Eq. (14) is mended. A contact beyond the
    antenna's length L, `length_m` (...), is inadmissible.
    """
    x, y, stiffness, length = floats(x_m, y_m, stiffness_Nm2, length_m)
    part, contact, force = in_pieces(_solved, x, y, stiffness, length)
    return TwoPointContact(part, contact, force, namespace(x).broadcast_to(x, (*part.shape, 2)))


def force_z(moment_Nm: Any, contact_m: Any) -> Array:
    """Force component f_z (...) in N from the moment sensor, Eq. (16); NaN unless l > 0."""
    moment, contact = floats(moment_Nm, contact_m)
    return moment / namespace(contact).where(contact > 0.0, contact, np.nan)


def contact_position(contact_m: Any, force_y_N: Any, force_z_N: Any, stiffness_Nm2: Any) -> Array:
    """The contact (l, Δy, Δz), (..., 3) m in the antenna frame, Eq. (20)."""
    contact, force_y, force_z, stiffness = floats(contact_m, force_y_N, force_z_N, stiffness_Nm2)
    xp = namespace(contact)
    give = xp.where(contact >= 0.0, contact, np.nan) ** 3 / (3.0 * stiffness)
    parts = (contact, give * force_y, give * force_z)
    shape = np.broadcast_shapes(*(part.shape for part in parts))
    return xp.stack([xp.broadcast_to(part, shape) for part in parts], -1)


def _conditions(elasticity_1: Array, elasticity_2: Array) -> tuple[Array, Array]:
    """Condition numbers (...) of l and f_y, each point's ln y_i moving by d ln f + e_i·d ln l."""
    gap = abs(elasticity_2 - elasticity_1)
    return 2.0 / gap, (abs(elasticity_1) + abs(elasticity_2)) / gap


def bending(x: Array, contact: Array) -> Array:
    """Deflection (...) at x times 6EI/f under a force at `contact`, on either part and wherever x is."""
    xp = namespace(x)
    near = xp.minimum(x, contact)
    return (3.0 * xp.maximum(x, contact) - near) * near**2


def elasticity(x: Array, contact: Array) -> Array:
    """∂ln y/∂ln l (...) at constant force: 1 far beyond the point, 3/2 at it, towards 2 far before it."""
    near = namespace(x).minimum(x, contact)
    return 3.0 * contact * near * (2.0 * x - near) / bending(x, contact)


def relative_contact(part: Array, spread: Array, ratio: Array) -> Array:
    """λ = l/x2 (...) of points in a part with q = x1/x2 and r = y2/y1: Eq. (11), Eq. (15), and for the
    case that the paper omits Eq. (8) at x1 and Eq. (13) at x2, −y1·l³ + 3x2y1·l² − 3x1²y2·l + x1³y2 = 0."""
    xp = namespace(spread)
    known = spread * spread * ratio
    # rounding must not carry a contact beside one of the points out of its part
    root = xp.where(part == Part.MIXED, _mixed_root(spread, known), np.nan)
    root = xp.where(part == Part.STRAIGHT, xp.minimum(3.0 * (spread * ratio - 1.0) / (ratio - 1.0), spread), root)
    curved_root = (1.0 - spread * known) / (3.0 * (1.0 - known))
    return xp.where(part == Part.CURVED, xp.where(curved_root > 1.0, curved_root, 1.0), root)


def _solved(x: Array, y: Array, stiffness: Array, length: Array) -> tuple[Array, ...]:
    """Part, l and f_y (n,) of points (n, 2), the nearer to the clamp first."""
    xp = namespace(x)
    spread, ratio = x[:, 0] / x[:, 1], y[:, 1] / y[:, 0]
    part = _part(spread, ratio)
    contact = x[:, 1] * relative_contact(part, spread, ratio)
    rounding = 1e-9
    fits = (contact > 0.0) & (contact <= length * (1.0 + rounding)) & (x[:, 0] > 0.0)
    contact = xp.where(fits, xp.minimum(contact, length), np.nan)
    return xp.where(fits, part, int(Part.NONE)), contact, 6.0 * stiffness * y[:, 1] / bending(x[:, 1], contact)


def _part(spread: Array, ratio: Array) -> Array:
    """The part (...) from q = x1/x2 in (0, 1) and r = y2/y1; comparisons with NaN leave NONE."""
    xp = namespace(spread)
    steady = spread * ratio
    known = spread * steady
    inside = (spread > 0.0) & (spread < 1.0) & (steady > 1.0) & (known < 1.0)
    mixed_from, curved_from = 2.0 * steady > 3.0 - spread, known * (3.0 - spread) >= 2.0
    part = xp.where(mixed_from, xp.where(curved_from, int(Part.CURVED), int(Part.MIXED)), int(Part.STRAIGHT))
    return xp.where(inside, part, int(Part.NONE))


def _mixed_root(spread: Array, known: Array) -> Array:
    """l/x2 = λ in [q, 1] with λ²(3 − λ) = k(3λ − q), k = q²r, the middle one of three real roots, by Newton from a
    quadratic that is right to 6 %; Cardano's formula would lose half the digits as two roots meet (q → 0)."""
    xp = namespace(spread)
    lowest, highest = 0.5 * spread * (3.0 - spread), 2.0 / (3.0 - spread)
    share = (known - lowest) / (highest - lowest)
    cubed = 3.0 - spread - (1.0 - spread) * share
    root = (3.0 * known + xp.sqrt(9.0 * known**2 - 4.0 * cubed * known * spread)) / (2.0 * cubed)
    for _ in range(4):
        residual = root**2 * (3.0 - root) - known * (3.0 * root - spread)
        root = root - residual / (3.0 * (root * (2.0 - root) - known))
    return xp.minimum(xp.maximum(root, spread), xp.ones_like(root))
