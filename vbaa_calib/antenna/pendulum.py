"""The elastica's universal curve, compiled: by its Taylor series for eight loads at once, in closed form for any load.

See `antenna.elastica` for ψ, υ and the lean α.
"""

from __future__ import annotations

import math

import numpy as np

from vbaa_calib.core.compiled import kernel

from .lanes import LANES, Lanes, cos, load, sin, spread, store

SERIES_LOAD = 2.5
"""Loads a = F·l²/EI up to which the series serves."""
_TERMS = 40
"""Of the series for full precision up to that load."""
_SERIES_RADIUS = 6.875185818020372  # in υ²: 2·K(½)²
_STEPS = 9
"""Halvings of the modulus: nothing of it is left, even from 1 − m = 1e-12."""
_SINE = np.array([(-1.0) ** n / math.factorial(2 * n + 1) for n in range(12)])
_COSINE = np.array([(-1.0) ** n / math.factorial(2 * n) for n in range(12)])
"""Taylor coefficients in ψ²: full precision for the angles that the series serves, |ψ| ≤ a/2."""


@kernel
def series_terms(largest_load: float) -> int:
    """Terms of the series for full precision up to this load."""
    ratio = max(largest_load, 1e-6) / _SERIES_RADIUS
    return min(_TERMS, math.ceil(math.log(1e-18) / math.log(ratio)))


@kernel
def series(loads: Lanes, lean_rad: Lanes, terms: int, inner: np.ndarray, hinge: np.ndarray) -> None:
    """Write −sin ψ, cos ψ and θ′·EI/(F·l) (3, N, LANES) at N fractions of the way from clamp to contact."""
    angle = np.empty((_TERMS + 1, LANES))
    _coefficients(lean_rad, terms, angle)
    for node in range(len(inner) - 1):
        back = 1.0 - inner[node]
        square = loads * (back * back)
        total, rate = spread(0.0), spread(0.0)
        for term in range(terms - 1, -1, -1):
            coefficient = load(angle, term)
            total = total * square + coefficient
            rate = rate * square + (2.0 * term + 2.0) * coefficient
        psi = total * square
        squared = psi * psi
        sine, cosine = spread(0.0), spread(0.0)
        for term in range(len(_SINE) - 1, -1, -1):
            sine = sine * squared + _SINE[term]
            cosine = cosine * squared + _COSINE[term]
        store(hinge, -psi * sine, 0, node)
        store(hinge, cosine, 1, node)
        store(hinge, back * rate, 2, node)


@kernel
def _coefficients(lean_rad: Lanes, terms: int, angle: np.ndarray) -> None:
    """Taylor coefficients of ψ/υ² in υ², from ψ″ = cos(ψ + α) term by term."""
    sin_lean, cos_lean = sin(lean_rad), cos(lean_rad)
    parts = np.empty((3, _TERMS + 1, LANES))
    rates, cosines, sines = parts[0], parts[1], parts[2]
    store(cosines, spread(1.0), 0)
    store(sines, spread(0.0), 0)
    for n in range(terms):
        second = cos_lean * load(cosines, n) - sin_lean * load(sines, n)
        coefficient = second / ((2.0 * n + 2.0) * (2.0 * n + 1.0))
        store(angle, coefficient, n)
        store(rates, (n + 1.0) * coefficient, n)
        sine, cosine = spread(0.0), spread(0.0)
        for k in range(n + 1):
            rate = load(rates, k)
            sine = sine + rate * load(cosines, n - k)
            cosine = cosine - rate * load(sines, n - k)
        store(sines, sine / (n + 1.0), n + 1)
        store(cosines, cosine / (n + 1.0), n + 1)


@kernel
def landen(m: float) -> np.ndarray:
    """Landen's descending chain (_STEPS + 1, 3) for the parameter m: half gap, its sine and cosine; last row whole."""
    chain = np.empty((_STEPS + 1, 3))
    mean, other, power, lost = 1.0, math.sqrt(1.0 - m), 1.0, m
    for step in range(_STEPS):
        half_gap, root = 0.5 * (mean - other), math.sqrt(mean * other)
        mean, other = 0.5 * (mean + other), root
        power *= 2.0
        lost += power * half_gap**2
        chain[step, 0], chain[step, 1], chain[step, 2] = half_gap, half_gap / mean, other / mean
    chain[_STEPS, 0], chain[_STEPS, 1], chain[_STEPS, 2] = power * mean, 1.0 - 0.5 * lost, m
    return chain


@kernel
def jacobi_at(u: float, chain: np.ndarray) -> tuple[float, float, float, float]:
    """sn, cn and dn of (u | m), and E(am(u | m) | m)."""
    amplitude, second, m = chain[_STEPS, 0] * u, chain[_STEPS, 1] * u, chain[_STEPS, 2]
    for step in range(_STEPS - 1, -1, -1):
        half_gap, sine, cosine = chain[step, 0], chain[step, 1], chain[step, 2]
        s, c = math.sin(amplitude), math.cos(amplitude)
        second += half_gap * s
        # the arcsine of sine·sin, which alone would lose half of the digits where that is nearly 1
        amplitude = 0.5 * (amplitude + math.atan2(sine * s, math.sqrt(c**2 + (cosine * s) ** 2)))
    s, c = math.sin(amplitude), math.cos(amplitude)
    return s, c, math.sqrt((1.0 - m) + m * c**2), second


@kernel
def angle_and_rate(upsilon: float, lean_rad: float, chain: np.ndarray) -> tuple[float, float]:
    """ψ and ψ′ at υ in closed form: with k² = (1 − sin α)/2 the parameter of the chain and k′² = 1 − k²,

    tan(ψ/2) = k k′ (1 − cn)/(k′² + k² cn),  ψ′ = cos α · sn/dn.
    """
    sn, cn, dn, _ = jacobi_at(upsilon, chain)
    m = chain[_STEPS, 2]
    # cos α = 2 k k′
    half_cos = 0.5 * math.cos(lean_rad)
    half_sin = half_cos * sn**2 / (1.0 + cn) if cn > 0.0 else half_cos * (1.0 - cn)
    return 2.0 * math.atan2(half_sin, (1.0 - m) + m * cn), 2.0 * half_cos * sn / dn
