"""A baseline for comparison: the straight line through the part of the antenna beyond the contact.

On plane C that part is y = f_y·l²·(3x − l)/6EI, Eq. (13): it crosses the undeformed antenna at x = l/3 with the slope
f_y·l²/2EI. A least-squares line through it thus gives both, as one would with a ruler. It uses none of the curved part,
which is why it is a baseline only; the estimator takes all points.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from vbaa_calib.core.arrays import Array, like, namespace

from .two_point import floats

ROUNDS = 3


@dataclass(frozen=True, eq=False)
class StraightLineContact:
    """What the line tells; NaN where fewer than two points or no 0 < l were left.

    Attributes
    ----------
    contact_m, force_y_N : (...) contact distance l, force component f_y.
    points : (...) number of points that the last line went through.
    """

    contact_m: Array
    force_y_N: Array
    points: Array


def straight_line_contact(
    x_m: Any, y_m: Any, guess_m: Any, stiffness_Nm2: Any, rounds: int = ROUNDS
) -> StraightLineContact:
    """Contact distance and f_y from points (..., N) on plane C, upright camera; NumPy or torch, NaN points left out.

    The first line goes through the points beyond `guess_m` (...), each further one through those beyond the l before.
    """
    x, y, contact, stiffness = floats(x_m, y_m, guess_m, stiffness_Nm2)
    xp = namespace(x)
    given = (x == x) & (y == y)
    x, y = xp.where(given, x, 0.0), xp.where(given, y, 0.0)
    with np.errstate(all="ignore"):
        for _ in range(rounds):
            weight = like(x, given & (x >= contact[..., None]))
            count = weight.sum(-1)
            mean_x, mean_y = (weight * x).sum(-1) / count, (weight * y).sum(-1) / count
            aside = weight * (x - mean_x[..., None])
            slope = (aside * y).sum(-1) / (aside * x).sum(-1)
            contact = 3.0 * (mean_x - mean_y / slope)
            contact = xp.where((count >= 2.0) & (contact > 0.0) & (contact < np.inf), contact, np.nan)
        return StraightLineContact(contact, 2.0 * stiffness * slope / contact**2, count)
