"""Coulomb's law across the normal, against a linear rest: the small problem inside each of Newton's steps."""

from __future__ import annotations

import numpy as np

_DOUBLINGS, _BISECTIONS = 60, 60


def gripped(
    now: np.ndarray,
    before: np.ndarray,
    way: np.ndarray,
    give: np.ndarray,
    press: np.ndarray,
    lift: np.ndarray,
    friction: float,
    stick: float,
) -> np.ndarray:
    """(B, 2) the grip g = held(g before − K Δu), where held() cuts its length off at μN.

    Both the way Δu = way + give·(g − now) and the normal force N = press + lift·(g − now) are linear in it.

    Parameters
    ----------
    now, before : (B, 2) the grip about which they are linear, and that before the step.
    way, give : (B, 2) and (B, 2, 2). press, lift : (B,) and (B, 2). In units that belong together.
    friction, stick : μ and K.

    Notes
    -----
    With λ g = g before − K Δu, the grip is (λ + K·give)⁻¹ b: λ = 1 sticks, and a slide has the λ > 1 that puts g on
    the rim.
    """
    if friction == 0.0:
        return np.zeros_like(now)
    spring = stick * give
    pull = before - stick * way + np.einsum("bij,bj->bi", spring, now)

    def at(share: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The grip for each λ, and by how much it is beyond the rim."""
        a, d = share + spring[:, 0, 0], share + spring[:, 1, 1]
        b, c = spring[:, 0, 1], spring[:, 1, 0]
        determinant = a * d - b * c
        grip = np.stack([d * pull[:, 0] - b * pull[:, 1], a * pull[:, 1] - c * pull[:, 0]], axis=1)
        grip = grip / determinant[:, None]
        rim = friction * np.maximum(press + (lift * (grip - now)).sum(axis=1), 0.0)
        return grip, np.hypot(grip[:, 0], grip[:, 1]) - rim

    low = np.ones(len(now))
    grip, beyond = at(low)
    slides = beyond > 0.0
    if not slides.any():
        return grip
    high = low.copy()
    for _ in range(_DOUBLINGS):
        still = slides & (at(high)[1] > 0.0)
        if not still.any():
            break
        low, high = np.where(still, high, low), np.where(still, 4.0 * high, high)
    for _ in range(_BISECTIONS):
        middle = np.sqrt(low * high)
        outside = at(middle)[1] > 0.0
        low, high = np.where(outside, middle, low), np.where(outside, high, middle)
    return np.where(slides[:, None], at(high)[0], grip)
