"""Jacobi's elliptic functions and the incomplete elliptic integral of the second kind, in NumPy or torch.

Descending Landen transformation by the arithmetic-geometric mean (Abramowitz and Stegun 16.4, 17.6).
"""

from __future__ import annotations

from typing import NamedTuple

from ..arrays import Array, namespace

_STEPS = 9
"""Halvings of the modulus: nothing of it is left, even from 1 − m = 1e-12."""


class Jacobi(NamedTuple):
    """sn, cn and dn of (u | m), and E(am(u | m) | m), each of the shape that u and m broadcast to."""

    sn: Array
    cn: Array
    dn: Array
    second: Array


def jacobi(u: Array, m: Array) -> Jacobi:
    """Jacobi's functions at u (...) for the parameter m = k² (...) in [0, 1)."""
    xp = namespace(u)
    mean, other = xp.ones_like(m), xp.sqrt(1.0 - m)
    chain = []
    power, lost = 1.0, m
    for _ in range(_STEPS):
        mean, other, half_gap = 0.5 * (mean + other), xp.sqrt(mean * other), 0.5 * (mean - other)
        power *= 2.0
        lost = lost + power * half_gap**2
        chain.append((half_gap, half_gap / mean, other / mean))
    amplitude = power * mean * u
    second = (1.0 - 0.5 * lost) * u
    for half_gap, sine, cosine in reversed(chain):
        sin, cos = xp.sin(amplitude), xp.cos(amplitude)
        second = second + half_gap * sin
        # the arcsine of sine·sin, which alone would lose half of the digits where that is nearly 1
        amplitude = 0.5 * (amplitude + xp.arctan2(sine * sin, xp.sqrt(cos**2 + (cosine * sin) ** 2)))
    sn, cn = xp.sin(amplitude), xp.cos(amplitude)
    return Jacobi(sn, cn, xp.sqrt((1.0 - m) + m * cn**2), second)
