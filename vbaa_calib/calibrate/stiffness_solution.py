"""What a table of deflections says of EI, and the evidence for it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Fit:
    """EI under one set of assumptions; offset and clamp rotation are 0 where they were held."""

    stiffness_Nm2: float
    std_Nm2: float
    offset_m: float
    offset_std_m: float
    clamp_rotation_rad: float
    rms_m: float


@dataclass(frozen=True, eq=False)
class StiffnessSolution:
    """EI of a rod and the evidence for it.

    Attributes
    ----------
    fit : the estimate; its std holds the correlated scatter and the clamp's prior.
    interval_Nm2 : the 95 % interval of EI.
    model, model_reason : "linear" or "elastica", and why.
    slope_at_load : dy/dx of the fitted rod.
    linear_bias : by which share the small-angle formula would miss EI on such a rod.
    residuals_m : (N,) of all readings, outliers too.
    outliers : which readings were left out.
    correlation, correlation_length_m : of neighbouring residuals, and the length over which it dies out.
    effective_readings : how many independent readings would fix EI as well as these.
    clamp_share_std, clamp_std_Nm2 : the clamp's prior, and its part of EI's std.
    offset_free : whether the gauge's offset was fitted.
    other_offset : the same with the offset held at 0, or free where it was held.
    free_clamp : the same with a clamp that may turn at no cost; None where no such fit settles.
    """

    fit: Fit
    interval_Nm2: tuple[float, float]
    model: str
    model_reason: str
    slope_at_load: float
    linear_bias: float
    residuals_m: np.ndarray
    outliers: tuple[int, ...]
    correlation: float
    correlation_length_m: float
    effective_readings: float
    clamp_share_std: float
    clamp_std_Nm2: float
    offset_free: bool
    other_offset: Fit
    free_clamp: Fit | None
