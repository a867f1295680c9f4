"""Small deflections of a cantilever, beside `vbaa_calib.antenna.linear`: several forces, derivatives, weight."""

from __future__ import annotations

from typing import Any

import numpy as np

from vbaa_calib.antenna.linear import deflection


def deflection_by_contact(x_m: Any, contact_m: Any, force_N: Any, stiffness_Nm2: Any) -> Any:
    """∂y/∂l (...), how much the deflection at x grows per metre that the same force sits further out."""
    near = np.minimum(x_m, contact_m)
    return force_N * near * (2.0 * x_m - near) / (2.0 * stiffness_Nm2)


def superposed_deflection(x_m: np.ndarray, contacts_m: np.ndarray, forces_N: np.ndarray, stiffness_Nm2: float) -> Any:
    """Deflection (..., N) in m at x (..., N) under several point forces (..., M) at contacts (..., M) together."""
    return deflection(x_m[..., None], contacts_m[..., None, :], forces_N[..., None, :], stiffness_Nm2).sum(-1)


def weight_clamp_moment(length_m: float, load_N_per_m: float) -> float:
    """Moment in N·m at the clamp of a uniform transverse load."""
    return 0.5 * load_N_per_m * length_m**2
