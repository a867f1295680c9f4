"""Small deflections of a straight, weightless cantilever: the paper's beam.

Everything here lives in a plane through the antenna's x axis: with the whole force f′_y it is the shape in the
deformation plane 𝒟; with the component f_y (or f_z) the shape projected on the xy (or xz) plane, because an antenna of
equal compliance bends linearly with the force vector. Arguments broadcast; a position before the clamp (x < 0), or a
contact there (l < 0), gives NaN.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike


def deflection(x_m: ArrayLike, contact_m: ArrayLike, force_N: ArrayLike, stiffness_Nm2: ArrayLike) -> Any:
    """Deflection (...) in m at x under a transverse point force at l.

    Curved part 0 < x ≤ l: Eq. (1), on plane C with f_y Eq. (6). Straight part x ≥ l: Eq. (2), on plane C Eq. (7). At
    the contact itself, x = l: Δy by f_y, Eq. (17), and Δz by f_z, Eq. (18).
    """
    x, contact, force, stiffness = _floats(x_m, contact_m, force_N, stiffness_Nm2)
    near, far = _ordered(_not_negative(x), _not_negative(contact))
    # the curved part sees the load's arm, the straight part its own: Maxwell's reciprocity makes them one formula
    return force * (3.0 * far - near) * near**2 / (6.0 * stiffness)


def slope(x_m: ArrayLike, contact_m: ArrayLike, force_N: ArrayLike, stiffness_Nm2: ArrayLike) -> Any:
    """Slope dy/dx (...) at x under a transverse point force at l; constant beyond the contact."""
    x, contact, force, stiffness = _floats(x_m, contact_m, force_N, stiffness_Nm2)
    bent, _ = _ordered(_not_negative(x), _not_negative(contact))
    return force * (2.0 * contact - bent) * bent / (2.0 * stiffness)


def _floats(*values: ArrayLike) -> list[np.ndarray]:
    return [np.asarray(value, float) for value in values]


def _not_negative(values_m: np.ndarray) -> np.ndarray:
    return np.where(values_m >= 0.0, values_m, np.nan)


def _ordered(x_m: np.ndarray, contact_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return np.minimum(x_m, contact_m), np.maximum(x_m, contact_m)
