"""Small deflections of a straight, weightless cantilever: the paper's beam.

Everything here lives in a plane through the antenna's x axis: with the whole force f′_y it is the shape in the
deformation plane 𝒟; with the component f_y (or f_z) the shape projected on the xy (or xz) plane, because an antenna of
equal compliance bends linearly with the force vector. Arguments broadcast; a position before the clamp (x < 0), or a
contact there (l < 0), gives NaN.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike


def deflection(x_m: ArrayLike, contact_m: ArrayLike, force_N: ArrayLike, stiffness_Nm2: ArrayLike) -> np.ndarray:
    """Deflection (...) in m at x under a transverse point force at l.

    Curved part 0 < x ≤ l: Eq. (1), on plane C with f_y Eq. (6). Straight part x ≥ l: Eq. (2), on plane C Eq. (7).
    """
    x, contact = _positions(x_m, contact_m)
    near, far = np.minimum(x, contact), np.maximum(x, contact)
    # the curved part sees the load's arm, the straight part its own: Maxwell's reciprocity makes them one formula
    return _array(force_N) * (3.0 * far - near) * near**2 / (6.0 * _array(stiffness_Nm2))


def slope(x_m: ArrayLike, contact_m: ArrayLike, force_N: ArrayLike, stiffness_Nm2: ArrayLike) -> np.ndarray:
    """Slope dy/dx (...) at x under a transverse point force at l; constant beyond the contact."""
    x, contact = _positions(x_m, contact_m)
    bent = np.minimum(x, contact)
    return _array(force_N) * (2.0 * contact - bent) * bent / (2.0 * _array(stiffness_Nm2))


def deflection_by_contact(
    x_m: ArrayLike, contact_m: ArrayLike, force_N: ArrayLike, stiffness_Nm2: ArrayLike
) -> np.ndarray:
    """∂y/∂l (...), how much the deflection at x grows per metre that the same force sits further out."""
    x, contact = _positions(x_m, contact_m)
    near = np.minimum(x, contact)
    return _array(force_N) * near * (2.0 * x - near) / (2.0 * _array(stiffness_Nm2))


def deflection_at_contact(contact_m: ArrayLike, force_N: ArrayLike, stiffness_Nm2: ArrayLike) -> np.ndarray:
    """Displacement (...) in m of the contact: f_y gives Δy, Eq. (17); f_z gives Δz, Eq. (18)."""
    contact = _not_negative(contact_m)
    return _array(force_N) * contact**3 / (3.0 * _array(stiffness_Nm2))


def superposed_deflection(
    x_m: ArrayLike, contacts_m: ArrayLike, forces_N: ArrayLike, stiffness_Nm2: ArrayLike
) -> np.ndarray:
    """Deflection (..., N) in m at x (..., N) under several point forces (..., M) at contacts (..., M) together."""
    stiffness = _array(stiffness_Nm2)[..., None, None]
    per_load = deflection(
        _array(x_m)[..., :, None],
        _array(contacts_m)[..., None, :],
        _array(forces_N)[..., None, :],
        stiffness,
    )
    return per_load.sum(axis=-1)


def clamp_moment(contact_m: ArrayLike, force_N: ArrayLike) -> np.ndarray:
    """Moment (...) in N·m at the clamp of a transverse point force: with f_z the sensor's τ_y = + l·f_z."""
    return _not_negative(contact_m) * _array(force_N)


def weight_deflection(
    x_m: ArrayLike, length_m: ArrayLike, load_N_per_m: ArrayLike, stiffness_Nm2: ArrayLike
) -> np.ndarray:
    """Deflection (...) in m at x ≤ L under a uniform transverse load, such as the weight of a level antenna."""
    x, length = _on_antenna(x_m, length_m)
    return _array(load_N_per_m) * x**2 * (6.0 * length**2 - 4.0 * length * x + x**2) / (24.0 * _array(stiffness_Nm2))


def weight_slope(x_m: ArrayLike, length_m: ArrayLike, load_N_per_m: ArrayLike, stiffness_Nm2: ArrayLike) -> np.ndarray:
    """Slope (...) at x ≤ L under a uniform transverse load."""
    x, length = _on_antenna(x_m, length_m)
    return _array(load_N_per_m) * x * (3.0 * length**2 - 3.0 * length * x + x**2) / (6.0 * _array(stiffness_Nm2))


def weight_clamp_moment(length_m: ArrayLike, load_N_per_m: ArrayLike) -> np.ndarray:
    """Moment (...) in N·m at the clamp of a uniform transverse load."""
    return 0.5 * _array(load_N_per_m) * _not_negative(length_m) ** 2


def _array(value: ArrayLike) -> np.ndarray:
    return np.asarray(value, float)


def _not_negative(value_m: ArrayLike) -> np.ndarray:
    value = _array(value_m)
    return np.where(value >= 0.0, value, np.nan)


def _positions(x_m: ArrayLike, contact_m: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    return _not_negative(x_m), _not_negative(contact_m)


def _on_antenna(x_m: ArrayLike, length_m: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    x, length = _positions(x_m, length_m)
    return np.where(x <= length, x, np.nan), length
