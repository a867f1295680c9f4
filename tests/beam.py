"""How a cantilever's small deflection goes with the place of its force, beside `vbaa_calib.antenna.linear`."""

from __future__ import annotations

from typing import Any

import numpy as np


def deflection_by_contact(x_m: Any, contact_m: Any, force_N: Any, stiffness_Nm2: Any) -> Any:
    """∂y/∂l (...), how much the deflection at x grows per metre that the same force sits further out."""
    near = np.minimum(x_m, contact_m)
    return force_N * near * (2.0 * x_m - near) / (2.0 * stiffness_Nm2)
