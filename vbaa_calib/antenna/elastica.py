"""Large deflections in the deformation plane 𝒟: the planar elastica between the clamp and one contact.

Let u = l − s be the arclength measured back from the contact, ψ(u) = θ_c − θ how far the tangent there lags the one at
the contact, and α the force's lean: its angle from the antenna's normal at the contact, positive towards the clamp. The
moment is zero at the contact, so with υ = u·√(F/EI)

    ψ″ = cos(ψ + α),   ψ(0) = ψ′(0) = 0

is an initial value problem, and for each α one universal curve holds every load, contact distance and stiffness. The
clamp only says where that curve is cut: θ_c = ψ(√a) with the load a = F·l²/EI. The curve is a pendulum let go at rest,
with k² = (1 − sin α)/2 and its coordinates C = ∫cos ψ dυ, S = ∫sin ψ dυ in Jacobi's functions (`_closed_form`).

Below a = υ² = 2.5 (68° of slope at the contact if the force follows the normal, 51° if dead) the Taylor series in υ² is
faster and, for small loads, free of the cancellation that the closed form has. Its coefficients are trigonometric
polynomials in α, tabulated once. It converges for |υ|² < K(½)² + K′(½)² = 6.875 whatever α, the distance to the nearest
pole of the Jacobi functions.

NumPy or torch: if one argument is a tensor, so is what comes out, of its dtype and on its device. Only a dead force,
whose lean at the contact is solved for, is NumPy's alone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ellipeinc, ellipkinc

from vbaa_calib.core.arrays import Array, like, namespace

from .linear import alike

_DEAD_LOAD = 60.0
SERIES_LOAD = 2.5
"""Loads a = F·l²/EI up to which the series serves."""
SERIES_TERMS = 40
"""Of the series for full precision up to that load."""
_SERIES_RADIUS = 6.875185818020372  # in υ²: 2·K(½)²
_STEPS = 9
"""Halvings of the modulus: nothing of it is left, even from 1 − m = 1e-12."""


@dataclass(frozen=True, eq=False)
class _PlanarShape:
    """The antenna's centreline in the deformation plane 𝒟.

    Attributes
    ----------
    x_m, w_m : (B, N) m, along the clamped tangent and across it.
    theta_rad : (B, N) rad, angle of the tangent from the clamped one.
    """

    x_m: Array
    w_m: Array
    theta_rad: Array


def planar_elastica(
    s_m: Array,
    contact_m: Array,
    force_N: Array,
    stiffness_Nm2: Array,
    friction_angle_rad: Array = 0.0,
) -> _PlanarShape:
    """Shape (B, N) under a contact force along the antenna's own normal there, or tilted from it by friction.

    Parameters
    ----------
    s_m : (N,) or (B, N) arclengths from the clamp, up to and beyond the contact; beyond it the antenna is straight.
    contact_m : (B,) arclength of the contact.
    force_N : (B,) magnitude of the force, signed: a negative force gives the mirror image.
    stiffness_Nm2 : () or (B,).
    friction_angle_rad : () or (B,), within ±π/2; positive leans the force towards the clamp (it pushes the antenna
        back), negative towards the tip, for either sign of the force. 0 is a frictionless contact.

    A negative arclength or contact distance, or a lean beyond ±π/2, gives NaN.
    """
    s, load, contact, sign = _dimensionless(s_m, contact_m, force_N, stiffness_Nm2)
    return _scaled(normal_load(s, load, friction_angle_rad), contact, sign)


def planar_elastica_dead(
    s_m: ArrayLike,
    contact_m: ArrayLike,
    force_N: ArrayLike,
    stiffness_Nm2: ArrayLike,
    lean_rad: ArrayLike = 0.0,
) -> _PlanarShape:
    """As `planar_elastica`, under a force that keeps its direction: a hanging weight, for instance.

    `lean_rad`, () or (B,), is the force's angle from the normal of the *undeformed* antenna, positive where it pushes
    the antenna back. Loads a = F·l²/EI above 60, which leave less than 0.1° between antenna and force, give NaN.
    """
    s, load, contact, sign = _dimensionless(s_m, contact_m, force_N, stiffness_Nm2)
    lean = np.broadcast_to(np.asarray(lean_rad, float), load.shape)
    lean = _lean_at_contact(load, np.where(np.abs(lean) < np.pi / 2.0, lean, np.nan))
    return _scaled(normal_load(s, load, lean), contact, sign)


def normal_load(s: Array, load: Array, lean_rad: Array = 0.0) -> _PlanarShape:
    """Shape (B, N) in units of the contact distance: s (N,) or (B, N), contact at s = 1, load a = F·l²/EI ≥ 0 (B,).

    The lean, () or (B,), is measured from the antenna's normal at the contact. What is out of range gives NaN.
    """
    along, amount, lean = alike(s, load, lean_rad)
    xp = namespace(along)
    along, amount = xp.atleast_2d(along), xp.atleast_1d(amount)
    lean = xp.broadcast_to(lean, amount.shape)
    # a load too small to bend anything, in place of 0/0
    root = xp.sqrt(xp.where(amount > 1e-200, amount, 1e-200))
    root = xp.where((amount >= 0.0) & (xp.abs(lean) < 0.5 * np.pi), root, np.nan)[:, None]
    back = 1.0 - along
    # υ along the bent part; the clamp, where it is √a, rides along as the first column
    bent = xp.where(along >= 0.0, xp.where(back > 0.0, back, 0.0), np.nan) * root
    psi, cos_integral, sin_integral = universal_curve(xp.concat([root, bent], -1), lean)
    theta = psi[:, :1] - psi[:, 1:]
    onward = (cos_integral[:, :1] - cos_integral[:, 1:]) / root - xp.where(back < 0.0, back, 0.0)
    aside = (sin_integral[:, :1] - sin_integral[:, 1:]) / root
    cos, sin = xp.cos(psi[:, :1]), xp.sin(psi[:, :1])
    return _PlanarShape(cos * onward + sin * aside, sin * onward - cos * aside, theta)


def _dimensionless(
    s_m: Array, contact_m: Array, force_N: Array, stiffness_Nm2: Array
) -> tuple[Array, Array, Array, Array]:
    """Arclengths s/l (B, N), load a = |F|·l²/EI (B,), contact (B, 1) with NaN where it is not positive, sign (B, 1)."""
    arclength, contact, force, stiffness = alike(s_m, contact_m, force_N, stiffness_Nm2)
    xp = namespace(arclength)
    contact, force = xp.atleast_1d(contact), xp.atleast_1d(force)
    contact = xp.where(contact > 0.0, contact, np.nan)
    load = xp.abs(force) * contact**2 / stiffness
    contact = xp.broadcast_to(contact, load.shape)[:, None]
    return xp.atleast_2d(arclength) / contact, load, contact, xp.copysign(xp.ones_like(force), force)[:, None]


def _scaled(shape: _PlanarShape, contact_m: Array, sign: Array) -> _PlanarShape:
    return _PlanarShape(shape.x_m * contact_m, shape.w_m * (sign * contact_m), shape.theta_rad * sign)


def _lean_at_contact(load: np.ndarray, lean: np.ndarray) -> np.ndarray:
    """Lean α (B,) at the contact of a dead force with lean β (B,) at the clamp: √a = F(φ, k), solved for k² > k_β².

    With k_β² = (1 − sin β)/2: tan²φ = (k² − k_β²)/(k_β² k′²). In η = −ln(k′²/k_β′²) the load a rises convexly from 0,
    so that Newton's steps never overshoot after the first.
    """
    m_clamp, rest_clamp = 0.5 * (1.0 - np.sin(lean)), 0.5 * (1.0 + np.sin(lean))
    amount = np.where(load <= _DEAD_LOAD, np.maximum(load, 1e-200), np.nan)
    eta = np.minimum(amount * np.cos(lean) ** 2 / (4.0 * rest_clamp), 2.0 * np.sqrt(amount))
    for _ in range(60):
        excess, rest = -rest_clamp * np.expm1(-eta), rest_clamp * np.exp(-eta)
        m = m_clamp + excess
        tangent = np.sqrt(excess / (m_clamp * rest))
        phi = np.arctan(tangent)
        upsilon = ellipkinc(phi, m)
        dn = np.exp(-0.5 * eta)
        by_phi = rest_clamp / (2.0 * m_clamp * rest * tangent * (1.0 + tangent**2) * dn)
        by_m = (ellipeinc(phi, m) - rest * upsilon) / (2.0 * m) - np.sin(2.0 * phi) / (4.0 * dn)
        step = (upsilon**2 - amount) / (2.0 * upsilon * (by_phi + by_m))
        eta = eta - step
        if not np.any(np.abs(step) > 1e-14 * eta):
            break
    return np.arcsin(np.sin(lean) + 2.0 * rest_clamp * np.expm1(-eta))


class _Jacobi(NamedTuple):
    """sn, cn and dn of (u | m), and E(am(u | m) | m), each of the shape that u and m broadcast to."""

    sn: Array
    cn: Array
    dn: Array
    second: Array


def jacobi(u: Array, m: Array) -> _Jacobi:
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
    return _Jacobi(sn, cn, xp.sqrt((1.0 - m) + m * cn**2), second)


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
