"""Large deflections in the deformation plane 𝒟: the planar elastica between the clamp and one contact.

Let u = l − s be the arclength measured back from the contact, ψ(u) = θ_c − θ how far the tangent there lags the one at
the contact, and α the force's lean: its angle from the antenna's normal at the contact, positive towards the clamp. The
moment is zero at the contact, so with υ = u·√(F/EI)

    ψ″ = cos(ψ + α),   ψ(0) = ψ′(0) = 0

is an initial value problem, and for each α one universal curve holds every load, contact distance and stiffness. The
clamp only says where that curve is cut: θ_c = ψ(√a) with the load a = F·l²/EI. This is a pendulum let go at rest, with
k² = (1 − sin α)/2 and the curve's coordinates C = ∫cos ψ dυ, S = ∫sin ψ dυ in Jacobi's functions (`_jacobi_curve`).

Below a = 2.5 (68° of slope at the contact if the force follows the normal, 51° if dead) the Taylor series in υ² is
faster and, for small loads, free of the cancellation that the closed form has. Its coefficients are trigonometric
polynomials in α, tabulated once. It converges for |υ|² < K(½)² + K′(½)² = 6.875 whatever α, the distance to the nearest
pole of the Jacobi functions.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ellipeinc, ellipj, ellipkinc

_SERIES_LOAD = 2.5
_SERIES_RADIUS = 6.875185818020372  # in υ²: 2·K(½)²
_SERIES_TERMS = 44
_DEAD_LOAD = 60.0


@dataclass(frozen=True, eq=False)
class PlanarShape:
    """The antenna's centreline in the deformation plane 𝒟.

    Attributes
    ----------
    x_m, w_m : (B, N) m, along the clamped tangent and across it.
    theta_rad : (B, N) rad, angle of the tangent from the clamped one.
    """

    x_m: np.ndarray
    w_m: np.ndarray
    theta_rad: np.ndarray


def planar_elastica(
    s_m: ArrayLike,
    contact_m: ArrayLike,
    force_N: ArrayLike,
    stiffness_Nm2: ArrayLike,
    friction_angle_rad: ArrayLike = 0.0,
) -> PlanarShape:
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
) -> PlanarShape:
    """As `planar_elastica`, under a force that keeps its direction: a hanging weight, for instance.

    `lean_rad`, () or (B,), is the force's angle from the normal of the *undeformed* antenna, positive where it pushes
    the antenna back. Loads a = F·l²/EI above 60, which leave less than 0.1° between antenna and force, give NaN.
    """
    s, load, contact, sign = _dimensionless(s_m, contact_m, force_N, stiffness_Nm2)
    return _scaled(dead_load(s, load, lean_rad), contact, sign)


def normal_load(s: ArrayLike, load: ArrayLike, lean_rad: ArrayLike = 0.0) -> PlanarShape:
    """Shape (B, N) in units of the contact distance: s (N,) or (B, N), contact at s = 1, load a = F·l²/EI ≥ 0 (B,).

    The lean, () or (B,), is measured from the antenna's normal at the contact. What is out of range gives NaN.
    """
    along = np.atleast_2d(np.asarray(s, float))
    amount = np.atleast_1d(np.asarray(load, float))
    lean = np.broadcast_to(np.asarray(lean_rad, float), amount.shape)
    # a load too small to bend anything, in place of 0/0
    root = np.sqrt(np.maximum(amount, 1e-200))
    root = np.where((amount >= 0.0) & (np.abs(lean) < np.pi / 2.0), root, np.nan)[:, None]
    beyond = np.maximum(along - 1.0, 0.0)
    # υ along the bent part; the clamp, where it is √a, rides along as the first column
    upsilon = np.empty((len(amount), along.shape[1] + 1))
    upsilon[:, :1] = root
    upsilon[:, 1:] = np.where(along >= 0.0, np.maximum(1.0 - along, 0.0), np.nan) * root
    psi, cos_integral, sin_integral = _universal_curve(upsilon, lean)
    theta = psi[:, :1] - psi[:, 1:]
    d_cos = (cos_integral[:, :1] - cos_integral[:, 1:]) / root
    d_sin = (sin_integral[:, :1] - sin_integral[:, 1:]) / root
    cos, sin = np.cos(psi[:, :1]), np.sin(psi[:, :1])
    return PlanarShape(cos * (d_cos + beyond) + sin * d_sin, sin * (d_cos + beyond) - cos * d_sin, theta)


def dead_load(s: ArrayLike, load: ArrayLike, lean_rad: ArrayLike = 0.0) -> PlanarShape:
    """As `normal_load`, under a force of fixed direction: the lean is measured from the undeformed antenna's normal."""
    amount = np.atleast_1d(np.asarray(load, float))
    lean = np.broadcast_to(np.asarray(lean_rad, float), amount.shape)
    return normal_load(s, amount, _lean_at_contact(amount, np.where(np.abs(lean) < np.pi / 2.0, lean, np.nan)))


def contact_force(force_N: ArrayLike, theta_rad: ArrayLike, friction_angle_rad: ArrayLike = 0.0) -> np.ndarray:
    """Force (..., 2) in N on the antenna along x and w, of `planar_elastica`'s signed magnitude, at tangent θ (...).

    The moment it has about the clamp, x·f_w − w·f_x, is EI times the curvature there.
    """
    force, theta = np.asarray(force_N, float), np.asarray(theta_rad, float)
    # the lean is towards the clamp on either side, so it turns with the sign of the force
    angle = theta + np.copysign(1.0, force) * np.asarray(friction_angle_rad, float)
    return np.stack(np.broadcast_arrays(-force * np.sin(angle), force * np.cos(angle)), axis=-1)


def _dimensionless(
    s_m: ArrayLike, contact_m: ArrayLike, force_N: ArrayLike, stiffness_Nm2: ArrayLike
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Arclengths s/l (B, N), load a = |F|·l²/EI (B,), contact (B, 1) with NaN where it is not positive, sign (B, 1)."""
    contact = np.atleast_1d(np.asarray(contact_m, float))
    contact = np.where(contact > 0.0, contact, np.nan)
    force = np.atleast_1d(np.asarray(force_N, float))
    load = np.abs(force) * contact**2 / np.asarray(stiffness_Nm2, float)
    contact = np.broadcast_to(contact, load.shape)[:, None]
    return np.atleast_2d(np.asarray(s_m, float)) / contact, load, contact, np.copysign(1.0, force)[:, None]


def _scaled(shape: PlanarShape, contact_m: np.ndarray, sign: np.ndarray) -> PlanarShape:
    return PlanarShape(shape.x_m * contact_m, shape.w_m * (sign * contact_m), shape.theta_rad * sign)


def _universal_curve(upsilon: np.ndarray, lean: np.ndarray) -> np.ndarray:
    """ψ, C and S, stacked (3, B, N), at υ (B, N) whose first column is each row's largest, for leans α (B,)."""
    small = ~(upsilon[:, 0] ** 2 > _SERIES_LOAD)
    if small.all():
        return _series_curve(upsilon, lean)
    curve = np.empty((3, *upsilon.shape))
    curve[:, ~small] = _jacobi_curve(upsilon[~small], lean[~small])
    if small.any():
        curve[:, small] = _series_curve(upsilon[small], lean[small])
    return curve


def _jacobi_curve(upsilon: np.ndarray, lean: np.ndarray) -> np.ndarray:
    """The closed form, (3, B, N): with sn, cn, dn of (υ | k²), k² = (1 − sin α)/2 and k′² = 1 − k²,

    tan(ψ/2) = k k′ (1 − cn)/(k′² + k² cn); in the force's frame (x along it) ∫cos χ = χ′ and ∫sin χ by the energy.
    """
    sin_lean, cos_lean = np.sin(lean)[:, None], np.cos(lean)[:, None]
    m = 0.5 * (1.0 - sin_lean)
    sn, cn, dn, amplitude = ellipj(upsilon, m)
    # cos α = 2 k k′
    half_sin = 0.5 * cos_lean * sn**2 / np.where(cn > 0.0, 1.0 + cn, 1.0)
    half_sin = np.where(cn > 0.0, half_sin, 0.5 * cos_lean * (1.0 - cn))
    psi = 2.0 * np.arctan2(half_sin, (1.0 - m) + m * cn)
    along = cos_lean * sn / dn
    across = 2.0 * ellipeinc(amplitude, m) - upsilon - 2.0 * m * sn * cn / dn
    return np.stack([psi, cos_lean * along + sin_lean * across, cos_lean * across - sin_lean * along])


def _series_curve(upsilon: np.ndarray, lean: np.ndarray) -> np.ndarray:
    """The Taylor series in υ², (3, B, N), with as many terms as the largest load needs for full precision."""
    square = upsilon**2
    largest = np.fmax.reduce(square[:, 0], initial=1e-6)
    terms = min(_SERIES_TERMS, math.ceil(math.log(1e-18) / math.log(largest / _SERIES_RADIUS)))
    modes = np.exp(1j * np.outer(lean, np.arange(terms + 1)))
    coefficients = (modes @ _series_table()[:, :terms, : terms + 1].reshape(3 * terms, -1).T).real
    ordered = coefficients.reshape(-1, 3, terms).transpose(2, 1, 0)[..., None]
    total = np.empty((3, *upsilon.shape))
    total[:] = ordered[-1]
    for term in ordered[-2::-1]:
        total *= square
        total += term
    return total * np.stack([square, upsilon, upsilon * square])


@cache
def _series_table() -> np.ndarray:
    """Taylor coefficients of ψ/υ², C/υ and S/υ³ in υ², as Fourier coefficients over the lean (3, terms, terms + 1)."""
    leans = 2.0 * np.pi * np.arange(128) / 128
    psi, cos, sin = np.zeros((3, _SERIES_TERMS + 1, leans.size))
    cos[0] = 1.0
    for n in range(_SERIES_TERMS):
        psi[n + 1] = (np.cos(leans) * cos[n] - np.sin(leans) * sin[n]) / ((2 * n + 2) * (2 * n + 1))
        k = np.arange(1, n + 2)[:, None]
        sin[n + 1] = (k * psi[1 : n + 2] * cos[n::-1]).sum(axis=0) / (n + 1)
        cos[n + 1] = -(k * psi[1 : n + 2] * sin[n::-1]).sum(axis=0) / (n + 1)
    odd = 2.0 * np.arange(_SERIES_TERMS + 1)[:, None] + 1.0
    samples = np.stack([psi[1:], (cos / odd)[:-1], (sin / odd)[1:]])
    spectrum = np.fft.rfft(samples, axis=-1)[..., : _SERIES_TERMS + 1] / leans.size
    spectrum[..., 1:] *= 2.0
    return spectrum


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
