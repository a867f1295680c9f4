"""How far the object yields, in words and numbers: what a fit with a compliance says, and what it cannot say."""

from __future__ import annotations

import numpy as np

from .fit import SETTLED, Fit
from .result import Compliance

DEVIATIONS_95 = 1.96
LEAST_VARIATION = 0.05
"""Below this relative spread of the normal forces nothing can be said."""


MODEL_M, MODEL_SHARE = 1e-5, 0.015
"""What the model leaves out may move contacts by so much over the forces felt, and draws the compliance by this part:
noise along the antenna flattens what is bent. Rubbed at μ = 0.6, a rigid cylinder seems to yield by 0.25 mm/N
(`vbaa bench object`)."""


def compliance_of(fit: Fit) -> Compliance:
    """What a fit with a compliance says."""
    solution, touches, compliance_m_N = fit.solution, fit.touches, fit.state.compliance_m_N
    press = np.sum(touches.force_N * fit.normals.normal, axis=1)
    pressed = press[press > 0]
    low_N, high_N = (float(np.min(pressed)), float(np.max(pressed))) if len(pressed) else (0.0, 0.0)
    own = float(np.sqrt(solution.own_variance))
    left_out = np.hypot(MODEL_M / max(high_N - low_N, 1e-12), MODEL_SHARE * compliance_m_N)
    std = float(np.hypot(np.sqrt(solution.variance), left_out))
    lowest, highest = compliance_m_N - DEVIATIONS_95 * std, compliance_m_N + DEVIATIONS_95 * std
    nothing = np.full(2, np.nan)
    forces = f"normal forces from {1e3 * low_N:.3g} to {1e3 * high_N:.3g} mN"

    def untold(reason: str, interval: np.ndarray = nothing) -> Compliance:
        return Compliance(compliance_m_N, std, own, np.nan, interval, False, reason)

    if len(touches) < 3 or not high_N - low_N > LEAST_VARIATION * high_N or not std > 0:
        return untold(f"the object's stiffness cannot be told: {len(touches)} contacts, {forces}")
    if abs(solution.compliance_m_N) > SETTLED * std:
        return untold("the object's stiffness cannot be told: shape and stiffness do not settle together")
    if highest <= 0:
        return untold(
            "the object's stiffness cannot be told: the harder it was pressed, the farther out it was found, by "
            f"{-1e3 * compliance_m_N:.3g} ± {1e3 * std:.2g} mm/N; check the rig's calibration"
        )
    if lowest > 0:
        interval = np.array([1 / highest, 1 / lowest])
        stiffness = 1 / compliance_m_N
        words = f"the object's stiffness is {stiffness:.4g} N/m, 95 % interval {interval[0]:.4g} to {interval[1]:.4g}"
        return Compliance(compliance_m_N, std, own, stiffness, interval, True, f"{words} ({forces})")
    extent = float(np.linalg.norm(np.ptp(touches.point_m, axis=0)))
    if highest * (high_N - low_N) > max(0.5 * extent, 1e-3):
        return untold(f"the object's stiffness cannot be told from these contacts: {forces} do not move it apart")
    return untold(
        f"the object is stiffer than {1 / highest:.3g} N/m (95 %); the surface is as it was under these forces",
        np.array([1 / highest, np.inf]),
    )


def nothing_known(reason: str) -> Compliance:
    """Where there is nothing to judge by."""
    return Compliance(np.nan, np.nan, np.nan, np.nan, np.full(2, np.nan), False, reason)
