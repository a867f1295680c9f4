"""Sticking, sliding or rolling: what the slip and its deviation allow to be said of each frame."""

from __future__ import annotations

import numpy as np

from .result import ROLLING, SLIDING, STICKING, TOUCHING
from .slip import Slip

CLEAR, STILL_CLEAR = 4.5, 2.5
"""Deviations by which a slip must stand out to be called one, and for it to go on."""
NOTHING = 0.05
"""Share of the joints' motion below which a slip is not called one: curved paths and rolling leave as much."""
STUCK = 0.15
"""Share of the joints' motion that the slip must surely stay below where the contact is said to stick."""
REST_M_S = 3e-4
"""Nothing slower is told from rest."""


def phases(slip: Slip, antenna_radius_m: float) -> np.ndarray:
    """(P,) what each frame of a stroke does; "touching" where it cannot be told."""
    speed = np.linalg.norm(slip.velocity_m_s, axis=1)
    std = _along(slip, speed)
    carried = np.where(np.isfinite(slip.carried_m_s), slip.carried_m_s, slip.contact_m_s)
    nothing = NOTHING * carried + antenna_radius_m * slip.turning_rad_s
    with np.errstate(invalid="ignore"):
        surely, still = speed - CLEAR * std > nothing, speed - STILL_CLEAR * std > nothing
        fast = speed > REST_M_S
        sliding = _held(surely & fast, still & fast)
        rest = np.maximum(antenna_radius_m * slip.turning_rad_s, REST_M_S)
        small = speed + 2.0 * std <= np.maximum(STUCK * carried, rest)
        stuck = ~sliding & small & (speed - STILL_CLEAR * std <= rest)
        walks = slip.contact_m_s - CLEAR * slip.contact_std_m_s > 2.0 * np.maximum(speed + 2.0 * std, REST_M_S)
    found = np.full(len(speed), TOUCHING, dtype=object)
    found[stuck] = STICKING
    found[stuck & walks] = ROLLING
    found[sliding] = SLIDING
    return found.astype(str)


def _along(slip: Slip, speed: np.ndarray) -> np.ndarray:
    """(P,) standard deviation of the speed: along the slip where that is clear, else the larger of all directions."""
    widest = np.sqrt(np.maximum(np.linalg.eigvalsh(np.nan_to_num(slip.parts_m2_s2, nan=np.inf)).max(axis=-1), 0.0))
    toward = slip.velocity_m_s / np.maximum(speed, 1e-12)[:, None]
    own = np.sqrt(np.maximum(np.einsum("pi,pij,pj->p", toward, slip.covariance_m2_s2, toward), 0.0))
    with np.errstate(invalid="ignore"):
        return np.where(speed > CLEAR * widest, own, widest)


def _held(begin: np.ndarray, keep: np.ndarray) -> np.ndarray:
    """(P,) bool: on from a frame that begins it, forward and backward, as long as it is kept."""
    runs = np.cumsum(~keep)
    begun = np.unique(runs[begin & keep])
    return keep & np.isin(runs, begun)
