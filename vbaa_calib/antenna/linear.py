"""Small deflections of a straight, weightless cantilever: the paper's beam.

Everything here lives in a plane through the antenna's x axis: with the whole force f′_y it is the shape in the
deformation plane 𝒟; with the component f_y (or f_z) the shape projected on the xy (or xz) plane, because an antenna of
equal compliance bends linearly with the force vector. Arguments broadcast; a position before the clamp (x < 0), or a
contact there (l < 0), gives NaN. NumPy or torch: if one argument is a tensor, so is what comes out.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch

from vbaa_calib.core.arrays import Array, namespace


def alike(*values: Any) -> list[Array]:
    """All values as tensors of the first tensor's dtype and device if one is a tensor, else as NumPy's float64."""
    for value in values:
        if isinstance(value, torch.Tensor):
            return [torch.as_tensor(other, dtype=value.dtype, device=value.device) for other in values]
    return [np.asarray(value, float) for value in values]


def deflection(x_m: Array, contact_m: Array, force_N: Array, stiffness_Nm2: Array) -> Array:
    """Deflection (...) in m at x under a transverse point force at l.

    Curved part 0 < x ≤ l: Eq. (1), on plane C with f_y Eq. (6). Straight part x ≥ l: Eq. (2), on plane C Eq. (7).
    """
    x, contact, force, stiffness = alike(x_m, contact_m, force_N, stiffness_Nm2)
    near, far = _ordered(_not_negative(x), _not_negative(contact))
    # the curved part sees the load's arm, the straight part its own: Maxwell's reciprocity makes them one formula
    return force * (3.0 * far - near) * near**2 / (6.0 * stiffness)


def slope(x_m: Array, contact_m: Array, force_N: Array, stiffness_Nm2: Array) -> Array:
    """Slope dy/dx (...) at x under a transverse point force at l; constant beyond the contact."""
    x, contact, force, stiffness = alike(x_m, contact_m, force_N, stiffness_Nm2)
    bent, _ = _ordered(_not_negative(x), _not_negative(contact))
    return force * (2.0 * contact - bent) * bent / (2.0 * stiffness)


def deflection_by_contact(x_m: Array, contact_m: Array, force_N: Array, stiffness_Nm2: Array) -> Array:
    """∂y/∂l (...), how much the deflection at x grows per metre that the same force sits further out."""
    x, contact, force, stiffness = alike(x_m, contact_m, force_N, stiffness_Nm2)
    near, _ = _ordered(_not_negative(x), _not_negative(contact))
    return force * near * (2.0 * x - near) / (2.0 * stiffness)


def deflection_at_contact(contact_m: Array, force_N: Array, stiffness_Nm2: Array) -> Array:
    """Displacement (...) in m of the contact: f_y gives Δy, Eq. (17); f_z gives Δz, Eq. (18)."""
    contact, force, stiffness = alike(contact_m, force_N, stiffness_Nm2)
    return force * _not_negative(contact) ** 3 / (3.0 * stiffness)


def superposed_deflection(x_m: Array, contacts_m: Array, forces_N: Array, stiffness_Nm2: Array) -> Array:
    """Deflection (..., N) in m at x (..., N) under several point forces (..., M) at contacts (..., M) together."""
    x, contacts, forces, stiffness = alike(x_m, contacts_m, forces_N, stiffness_Nm2)
    per_load = deflection(x[..., None], contacts[..., None, :], forces[..., None, :], stiffness[..., None, None])
    return per_load.sum(-1)


def clamp_moment(contact_m: Array, force_N: Array) -> Array:
    """Moment (...) in N·m at the clamp of a transverse point force: with f_z the sensor's τ_y = + l·f_z."""
    contact, force = alike(contact_m, force_N)
    return _not_negative(contact) * force


def weight_deflection(x_m: Array, length_m: Array, load_N_per_m: Array, stiffness_Nm2: Array) -> Array:
    """Deflection (...) in m at x ≤ L under a uniform transverse load, such as the weight of a level antenna."""
    x, length, load, stiffness = alike(x_m, length_m, load_N_per_m, stiffness_Nm2)
    x = _on_antenna(x, length)
    return load * x**2 * (6.0 * length**2 - 4.0 * length * x + x**2) / (24.0 * stiffness)


def weight_slope(x_m: Array, length_m: Array, load_N_per_m: Array, stiffness_Nm2: Array) -> Array:
    """Slope (...) at x ≤ L under a uniform transverse load."""
    x, length, load, stiffness = alike(x_m, length_m, load_N_per_m, stiffness_Nm2)
    x = _on_antenna(x, length)
    return load * x * (3.0 * length**2 - 3.0 * length * x + x**2) / (6.0 * stiffness)


def weight_clamp_moment(length_m: Array, load_N_per_m: Array) -> Array:
    """Moment (...) in N·m at the clamp of a uniform transverse load."""
    length, load = alike(length_m, load_N_per_m)
    return 0.5 * load * _not_negative(length) ** 2


def _not_negative(values_m: Array) -> Array:
    return namespace(values_m).where(values_m >= 0.0, values_m, float("nan"))


def _ordered(x_m: Array, contact_m: Array) -> tuple[Array, Array]:
    xp = namespace(x_m)
    return xp.minimum(x_m, contact_m), xp.maximum(x_m, contact_m)


def _on_antenna(x_m: Array, length_m: Array) -> Array:
    x = _not_negative(x_m)
    return namespace(x).where(x <= length_m, x, float("nan"))
