"""The elastica's universal curve, compiled: ψ, C = ∫cos ψ dυ and S = ∫sin ψ dυ of υ and the lean α, see `elastica`.

Below a = υ² = 2.5 (68° of slope at the contact if the force follows the normal, 51° if dead) the Taylor series in υ² is
faster and, for small loads, free of the cancellation that the closed form has. It converges for
|υ|² < K(½)² + K′(½)² = 6.875 whatever α, the distance to the nearest pole of the Jacobi functions.
"""

from __future__ import annotations

import math

import numpy as np

from vbaa_calib.core.compiled import compiled, kernel
from vbaa_calib.core.lanes import LANES, Lanes, load, spread, store

SERIES_LOAD = 2.5
"""Loads a = F·l²/EI up to which the series serves."""
_TERMS = 40
"""Of the series for full precision up to that load."""
_RECIPROCAL = 1.0 / np.maximum(np.arange(2 * _TERMS + 1), 1)
_SERIES_RADIUS = 6.875185818020372  # in υ²: 2·K(½)²
_STEPS = 9
"""Halvings of the modulus: nothing of it is left, even from 1 − m = 1e-12."""
_SINE = np.array([(-1.0) ** n / math.factorial(2 * n + 1) for n in range(12)])
_COSINE = np.array([(-1.0) ** n / math.factorial(2 * n) for n in range(12)])
"""Taylor coefficients in the angle's square."""


@kernel
def universal_curve(upsilon: np.ndarray, lean_rad: np.ndarray, curve: np.ndarray) -> None:
    """Write ψ, C and S (3, B, N) at υ (B, N) whose first column is each row's largest, for leans (B,)."""
    coefficients = np.empty((3, _TERMS + 1, LANES))
    for row in range(len(upsilon)):
        largest, lean = upsilon[row, 0] ** 2, lean_rad[row]
        if largest > SERIES_LOAD:
            chain = landen(0.5 * (1.0 - math.sin(lean)))
            for n in range(upsilon.shape[1]):
                curve[0, row, n], curve[1, row, n], curve[2, row, n] = closed_form(upsilon[row, n], lean, chain)
        else:
            terms = series_terms(largest)
            _taylor(spread(math.sin(lean)), spread(math.cos(lean)), terms, coefficients)
            for n in range(upsilon.shape[1]):
                place = upsilon[row, n]
                psi, along, across = 0.0, 0.0, 0.0
                for term in range(terms - 1, -1, -1):
                    psi = psi * place**2 + coefficients[0, term, 0]
                    along = along * place**2 + coefficients[1, term, 0] / (2.0 * term + 1.0)
                    across = across * place**2 + coefficients[2, term + 1, 0] / (2.0 * term + 3.0)
                curve[0, row, n], curve[1, row, n], curve[2, row, n] = psi * place**2, along * place, across * place**3


@compiled
def hinge_by_series(
    loads: Lanes, sin_lean: Lanes, cos_lean: Lanes, terms: int, inner: np.ndarray, hinge: np.ndarray
) -> None:
    """Write −sin ψ, cos ψ and θ′·EI/(F·l) (3, N, LANES) at N − 1 of N fractions of the way from clamp to contact."""
    coefficients = np.empty((3, _TERMS + 1, LANES))
    _taylor(sin_lean, cos_lean, terms, coefficients)
    for node in range(len(inner) - 1):
        back = 1.0 - inner[node]
        square = loads * (back * back)
        total, rate = spread(0.0), spread(0.0)
        for term in range(terms - 1, -1, -1):
            coefficient = load(coefficients, 0, term)
            total = total * square + coefficient
            rate = rate * square + (2.0 * term + 2.0) * coefficient
        sine, cosine = sine_and_cosine(total * square)
        store(hinge, -sine, 0, node)
        store(hinge, cosine, 1, node)
        store(hinge, back * rate, 2, node)


@compiled
def sine_and_cosine(angle_rad: Lanes) -> tuple[Lanes, Lanes]:
    """Of angles within ±π/2, by their Taylor series."""
    square = angle_rad * angle_rad
    sine, cosine = spread(0.0), spread(0.0)
    for term in range(len(_SINE) - 1, -1, -1):
        sine = sine * square + _SINE[term]
        cosine = cosine * square + _COSINE[term]
    return angle_rad * sine, cosine


@compiled
def series_terms(largest_load: float) -> int:
    """Terms of the series for full precision up to this load."""
    largest = largest_load if largest_load > 1e-6 else 1e-6
    return min(_TERMS, math.ceil(math.log(1e-18) / math.log(largest / _SERIES_RADIUS)))


@compiled
def _taylor(sin_lean: Lanes, cos_lean: Lanes, terms: int, coefficients: np.ndarray) -> None:
    """Write Taylor coefficients (3, ..., LANES) of ψ/υ², cos ψ and sin ψ in υ², from ψ″ = cos(ψ + α) term by term."""
    rates = np.empty((_TERMS, LANES))
    store(coefficients, spread(1.0), 1, 0)
    store(coefficients, spread(0.0), 2, 0)
    for n in range(terms):
        second = cos_lean * load(coefficients, 1, n) - sin_lean * load(coefficients, 2, n)
        coefficient = second * (_RECIPROCAL[2 * n + 2] * _RECIPROCAL[2 * n + 1])
        store(coefficients, coefficient, 0, n)
        store(rates, coefficient * (n + 1.0), n)
        sine, cosine = spread(0.0), spread(0.0)
        for k in range(n + 1):
            sine = sine + load(rates, k) * load(coefficients, 1, n - k)
            cosine = cosine - load(rates, k) * load(coefficients, 2, n - k)
        store(coefficients, cosine * _RECIPROCAL[n + 1], 1, n + 1)
        store(coefficients, sine * _RECIPROCAL[n + 1], 2, n + 1)


@kernel
def closed_form(upsilon: float, lean_rad: float, chain: np.ndarray) -> tuple[float, float, float]:
    """ψ, C and S: with sn, cn, dn of (υ | k²), k² = (1 − sin α)/2 the parameter of the chain and k′² = 1 − k²,

    tan(ψ/2) = k k′ (1 − cn)/(k′² + k² cn); in the force's frame (x along it) ∫cos χ = χ′ and ∫sin χ by the energy.
    """
    sn, cn, dn, second = jacobi_at(upsilon, chain)
    sin_lean, cos_lean, m = math.sin(lean_rad), math.cos(lean_rad), chain[_STEPS, 2]
    # cos α = 2 k k′
    half_sin = 0.5 * cos_lean * (sn**2 / (1.0 + cn) if cn > 0.0 else 1.0 - cn)
    psi = 2.0 * math.atan2(half_sin, (1.0 - m) + m * cn)
    along = cos_lean * sn / dn
    across = 2.0 * second - upsilon - 2.0 * m * sn * cn / dn
    return psi, cos_lean * along + sin_lean * across, cos_lean * across - sin_lean * along


@kernel
def landen(m: float) -> np.ndarray:
    """Landen's descending chain for the parameter m: half gaps, sines, cosines; the last row for the end."""
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


@compiled
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
