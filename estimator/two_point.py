"""The paper's two-point formulas for the upright camera, which sees (x, y) of the antenna on plane C.

Two points x1 < x2 and the deflections y1, y2 there fix the contact distance l and the force component f_y. The ratio
y2/y1 depends on l alone and grows with it: from x2/x1 (l → 0) over (3x2 − x1)/2x1 (l = x1) and
2x2³/((3x2 − x1)x1²) (l = x2) to (x2/x1)² (l → ∞). So exactly one of the three cases holds, and the ratio says which.

Arguments broadcast; the last axis of `x_m` and `y_m` holds the two points, in either order. Where no contact
0 < l ≤ L explains them the numbers are NaN and the part is `Part.NONE`: coincident points, deflections of opposite sign
or zero, a straight line through the clamp, points at or behind the clamp.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import ArrayLike

from vbaa_calib.antenna import linear


class Part(IntEnum):
    """Which parts of the antenna the two points lie on: the paper's cases (i), (ii), (iii)."""

    NONE = 0
    CURVED = 1
    STRAIGHT = 2
    MIXED = 3


@dataclass(frozen=True, eq=False)
class TwoPointContact:
    """What two points on plane C tell.

    Attributes
    ----------
    part : (...) a `Part` each.
    contact_m : (...) contact distance l.
    force_y_N : (...) force component f_y.
    condition_contact, condition_force : (...) largest relative error of l, and of f_y, per relative error of y1 and y2.
    """

    part: np.ndarray
    contact_m: np.ndarray
    force_y_N: np.ndarray
    condition_contact: np.ndarray
    condition_force: np.ndarray


def two_point_contact(
    x_m: ArrayLike, y_m: ArrayLike, stiffness_Nm2: ArrayLike, length_m: ArrayLike = np.inf
) -> TwoPointContact:
    """Contact distance and f_y from two points (..., 2), by the one case that is consistent with its own solution.

    `length_m` (...) is the antenna's length L; a contact beyond it is inadmissible.
    """
    x, y = _ordered(x_m, y_m)
    x1, x2 = x[..., 0], x[..., 1]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        spread, ratio = x1 / x2, y[..., 1] / y[..., 0]
        part = _part(spread, ratio)
        # rounding must not carry a contact beside one of the points out of its part
        contact = np.select(
            [part == Part.CURVED, part == Part.STRAIGHT, part == Part.MIXED],
            [
                np.maximum(x2 * _curved_root(spread, ratio), x2),
                np.minimum(x2 * _straight_root(spread, ratio), x1),
                np.clip(x2 * _mixed_root(spread, ratio), x1, x2),
            ],
            np.nan,
        )
        contact = np.where((contact > 0.0) & (contact <= length_m) & (x1 > 0.0), contact, np.nan)
        force = y[..., 1] / linear.deflection(x2, contact, 1.0, stiffness_Nm2)
        condition_contact, condition_force = conditions(
            contact * linear.deflection_by_contact(x1, contact, 1.0, 1.0) / linear.deflection(x1, contact, 1.0, 1.0),
            contact * linear.deflection_by_contact(x2, contact, 1.0, 1.0) / linear.deflection(x2, contact, 1.0, 1.0),
        )
    part = np.where(np.isnan(contact), np.int8(Part.NONE), part)
    return TwoPointContact(part, contact, force, condition_contact, condition_force)


def curved(x_m: ArrayLike, y_m: ArrayLike, stiffness_Nm2: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Case (i): l (...) by Eq. (11) and f_y (...) by Eq. (10), which solve Eq. (8) and Eq. (9); NaN unless x2 ≤ l."""
    (x1, x2), (y1, y2) = (np.moveaxis(value, -1, 0) for value in _ordered(x_m, y_m))
    with np.errstate(divide="ignore", invalid="ignore"):
        contact = (x1**3 * y2 - x2**3 * y1) / (3.0 * (x1**2 * y2 - x2**2 * y1))
        force = 6.0 * np.asarray(stiffness_Nm2) * (x2**2 * y1 - x1**2 * y2) / (x1**2 * x2**2 * (x2 - x1))
        return _if((x1 > 0.0) & (x1 < x2) & (x2 <= contact), contact, force)


def straight(x_m: ArrayLike, y_m: ArrayLike, stiffness_Nm2: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Case (ii): l (...) by Eq. (15) and f_y (...) by Eq. (14), which solve Eq. (12) and Eq. (13); NaN unless l ≤ x1.

    In Eq. (14) the last factor of the denominator is squared: as printed, the force has not even the unit of a force.
    """
    (x1, x2), (y1, y2) = (np.moveaxis(value, -1, 0) for value in _ordered(x_m, y_m))
    with np.errstate(divide="ignore", invalid="ignore"):
        contact = 3.0 * (x1 * y2 - x2 * y1) / (y2 - y1)
        force = 2.0 * np.asarray(stiffness_Nm2) * (y2 - y1) ** 3 / (9.0 * (x2 - x1) * (x1 * y2 - x2 * y1) ** 2)
        return _if((contact > 0.0) & (contact <= x1) & (x1 < x2), contact, force)


def mixed(x_m: ArrayLike, y_m: ArrayLike, stiffness_Nm2: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Case (iii), which the paper omits: Eq. (8) at x1 and Eq. (13) at x2; NaN unless x1 ≤ l ≤ x2.

    Without f_y they leave −y1·l³ + 3x2y1·l² − 3x1²y2·l + x1³y2 = 0, which has one root in [x1, x2].
    """
    x, y = _ordered(x_m, y_m)
    x1, x2 = x[..., 0], x[..., 1]
    with np.errstate(divide="ignore", invalid="ignore"):
        spread, ratio = x1 / x2, y[..., 1] / y[..., 0]
        contact = np.clip(x2 * _mixed_root(spread, ratio), x1, x2)
        force = y[..., 1] / linear.deflection(x2, contact, 1.0, stiffness_Nm2)
        return _if(_part(spread, ratio) == Part.MIXED, contact, force)


def force_z(moment_Nm: ArrayLike, contact_m: ArrayLike) -> np.ndarray:
    """Force component f_z (...) in N from the moment sensor, Eq. (16); NaN unless l > 0."""
    contact = np.asarray(contact_m, float)
    return np.asarray(moment_Nm, float) / np.where(contact > 0.0, contact, np.nan)


def contact_position(
    contact_m: ArrayLike, force_y_N: ArrayLike, force_z_N: ArrayLike, stiffness_Nm2: ArrayLike
) -> np.ndarray:
    """The contact (l, Δy, Δz), (..., 3) m in the antenna frame, Eq. (20)."""
    shift_y = linear.deflection_at_contact(contact_m, force_y_N, stiffness_Nm2)
    shift_z = linear.deflection_at_contact(contact_m, force_z_N, stiffness_Nm2)
    return np.stack(np.broadcast_arrays(np.asarray(contact_m, float), shift_y, shift_z), axis=-1)


def conditions(elasticity_1: np.ndarray, elasticity_2: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Condition numbers (...) of l and of f_y in y1 and y2, from each point's e_i = ∂ln y_i/∂ln l at constant force.

    ln y_i moves by d ln f + e_i·d ln l. Solved for l and f, with both errors at their worst signs.
    """
    gap = np.abs(elasticity_2 - elasticity_1)
    return 2.0 / gap, (np.abs(elasticity_1) + np.abs(elasticity_2)) / gap


def _ordered(x_m: ArrayLike, y_m: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Both (..., 2), the point nearer to the clamp first."""
    x, y = np.broadcast_arrays(np.asarray(x_m, float), np.asarray(y_m, float))
    swap = (x[..., 0] > x[..., 1])[..., None]
    return np.where(swap, x[..., ::-1], x), np.where(swap, y[..., ::-1], y)


def _if(admissible: np.ndarray, contact: np.ndarray, force: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return np.where(admissible, contact, np.nan), np.where(admissible, force, np.nan)


def _part(spread: np.ndarray, ratio: np.ndarray) -> np.ndarray:
    """The part (...) from q = x1/x2 in (0, 1) and r = y2/y1; comparisons with NaN leave NONE."""
    inside = (spread > 0.0) & (spread < 1.0) & (ratio * spread > 1.0) & (ratio * spread**2 < 1.0)
    mixed_from = ratio * 2.0 * spread > 3.0 - spread
    curved_from = ratio * (3.0 - spread) * spread**2 >= 2.0
    return np.where(inside, np.where(curved_from, Part.CURVED, np.where(mixed_from, Part.MIXED, Part.STRAIGHT)), 0)


def _curved_root(spread: np.ndarray, ratio: np.ndarray) -> np.ndarray:
    """l/x2, the right side of Eq. (11) in q = x1/x2 and r = y2/y1."""
    return (1.0 - spread**3 * ratio) / (3.0 * (1.0 - spread**2 * ratio))


def _straight_root(spread: np.ndarray, ratio: np.ndarray) -> np.ndarray:
    """l/x2, the right side of Eq. (15) in q = x1/x2 and r = y2/y1."""
    return 3.0 * (spread * ratio - 1.0) / (ratio - 1.0)


def _mixed_root(spread: np.ndarray, ratio: np.ndarray) -> np.ndarray:
    """l/x2 = λ in [q, 1] with λ²(3 − λ) = q²r(3λ − q): the middle one of three real roots."""
    known = spread**2 * ratio
    radius = np.sqrt(1.0 - known)
    sine = (2.0 - 3.0 * known + spread * known) / (2.0 * radius**3)
    root = 1.0 - 2.0 * radius * np.sin(np.arcsin(np.minimum(sine, 1.0)) / 3.0)
    # the arcsine loses half the digits where two roots meet (q → 0); two steps restore them
    for _ in range(2):
        residual = root**2 * (3.0 - root) - known * (3.0 * root - spread)
        root = root - residual / (3.0 * (root * (2.0 - root) - known))
    return root
