"""The universal curve of the elastica: one for every load, contact distance and stiffness (`antenna.elastica`).

ψ″ = cos(ψ + α), ψ(0) = ψ′(0) = 0 is a pendulum let go at rest, with k² = (1 − sin α)/2 and the curve's coordinates
C = ∫cos ψ dυ, S = ∫sin ψ dυ in Jacobi's functions (`_closed_form`).

Below a = υ² = 2.5 (68° of slope at the contact if the force follows the normal, 51° if dead) the Taylor series in υ² is
faster and, for small loads, free of the cancellation that the closed form has. Its coefficients are trigonometric
polynomials in α, tabulated once. It converges for |υ|² < K(½)² + K′(½)² = 6.875 whatever α, the distance to the nearest
pole of the Jacobi functions.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from vbaa_calib.core.arrays import Array, like, namespace

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


SERIES_LOAD = 2.5
"""Loads a = F·l²/EI up to which the series serves."""
SERIES_TERMS = 40
"""Of the series for full precision up to that load."""
_SERIES_RADIUS = 6.875185818020372  # in υ²: 2·K(½)²


def universal_curve(upsilon: Array, lean: Array) -> Array:
    """ψ, C and S, stacked (3, B, N), at υ (B, N) whose first column is each row's largest, for leans α (B,) in rad."""
    xp = namespace(upsilon)
    large = upsilon[:, :1] ** 2 > SERIES_LOAD
    if not large.any():
        return _series(upsilon, lean)
    return xp.where(large, _closed_form(upsilon, lean), _series(xp.where(large, 0.0, upsilon), lean))


def angle_coefficients(lean: Array) -> Array:
    """Taylor coefficients (B, SERIES_TERMS) of ψ/υ² in υ² for leans (B,) in rad."""
    return _modes(lean, SERIES_TERMS) @ like(lean, _series_table(SERIES_TERMS)[0])


def _modes(lean: Array, terms: int) -> Array:
    """(B, 2·terms + 1) 1, cos α, cos 2α …, sin α, sin 2α …"""
    xp = namespace(lean)
    angles = lean[:, None] * like(lean, np.arange(1.0, terms + 1))
    return xp.concat([xp.ones_like(lean)[:, None], xp.cos(angles), xp.sin(angles)], -1)


def _closed_form(upsilon: Array, lean: Array) -> Array:
    """The curve (3, B, N): with sn, cn, dn of (υ | k²), k² = (1 − sin α)/2 and k′² = 1 − k²,

    tan(ψ/2) = k k′ (1 − cn)/(k′² + k² cn); in the force's frame (x along it) ∫cos χ = χ′ and ∫sin χ by the energy.
    """
    xp = namespace(upsilon)
    sin_lean, cos_lean = xp.sin(lean)[:, None], xp.cos(lean)[:, None]
    m = 0.5 * (1.0 - sin_lean)
    sn, cn, dn, second = jacobi(upsilon, m)
    # cos α = 2 k k′
    half_sin = 0.5 * cos_lean * sn**2 / xp.where(cn > 0.0, 1.0 + cn, 1.0)
    half_sin = xp.where(cn > 0.0, half_sin, 0.5 * cos_lean * (1.0 - cn))
    psi = 2.0 * xp.arctan2(half_sin, (1.0 - m) + m * cn)
    along = cos_lean * sn / dn
    across = 2.0 * second - upsilon - 2.0 * m * sn * cn / dn
    return xp.stack([psi, cos_lean * along + sin_lean * across, cos_lean * across - sin_lean * along])


def _series(upsilon: Array, lean: Array) -> Array:
    """The Taylor series in υ², (3, B, N), with as many terms as the largest load needs for full precision."""
    xp = namespace(upsilon)
    square = upsilon**2
    terms = _terms(square[:, 0])
    ordered = _modes(lean, terms) @ like(lean, _series_table(terms))
    total = xp.zeros_like(ordered[..., :1]) * square
    for term in reversed(range(terms)):
        total = total * square + ordered[..., term, None]
    return total * xp.stack([square, upsilon, upsilon * square])


def _terms(load: Array) -> int:
    """Terms of the series for full precision at loads (B,); loads that are not numbers have no say."""
    known = load[load == load]
    largest = max(float(known.max()) if len(known) else 0.0, 1e-6)
    return min(SERIES_TERMS, math.ceil(math.log(1e-18) / math.log(largest / _SERIES_RADIUS)))


@cache
def _series_table(terms: int) -> Any:
    """Taylor coefficients of ψ/υ², C/υ and S/υ³ in υ² (3, 2·terms + 1, terms) by `_modes`."""
    leans = 2.0 * np.pi * np.arange(128) / 128
    psi, cos, sin = np.zeros((3, terms + 1, leans.size))
    cos[0] = 1.0
    for n in range(terms):
        psi[n + 1] = (np.cos(leans) * cos[n] - np.sin(leans) * sin[n]) / ((2 * n + 2) * (2 * n + 1))
        k = np.arange(1, n + 2)[:, None]
        sin[n + 1] = (k * psi[1 : n + 2] * cos[n::-1]).sum(axis=0) / (n + 1)
        cos[n + 1] = -(k * psi[1 : n + 2] * sin[n::-1]).sum(axis=0) / (n + 1)
    odd = 2.0 * np.arange(terms + 1)[:, None] + 1.0
    samples = np.stack([psi[1:], (cos / odd)[:-1], (sin / odd)[1:]])
    spectrum = np.fft.rfft(samples, axis=-1)[..., : terms + 1] / leans.size
    parts = np.concatenate([spectrum[..., :1].real, 2 * spectrum[..., 1:].real, -2 * spectrum[..., 1:].imag], axis=-1)
    return np.ascontiguousarray(parts.swapaxes(1, 2))
