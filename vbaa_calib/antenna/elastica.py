"""Large deflections in the deformation plane 𝒟: the planar elastica between the clamp and one contact.

Let u = l − s be the arclength measured back from the contact, ψ(u) = θ_c − θ how far the tangent there lags the one at
the contact, and α the force's inclination: its angle from the antenna's normal at the contact, positive towards the
clamp. The moment is zero at the contact, so with υ = u·√(F/EI)

    ψ″ = cos(ψ + α),   ψ(0) = ψ′(0) = 0

is an initial value problem, and for each α one universal curve holds every load, contact distance and stiffness. The
clamp only says where that curve is cut: θ_c = ψ(√a) with the load a = F·l²/EI. The curve is a pendulum let go at rest,
with k² = (1 − sin α)/2 and its coordinates C = ∫cos ψ dυ, S = ∫sin ψ dυ in Jacobi's functions (core: `pendulum.hpp`).

Only the inclination at the contact of a force of fixed direction has to be solved for.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ellipeinc, ellipkinc

from vbaa_calib.native import core


@dataclass(frozen=True, eq=False)
class _PlanarShape:
    """The antenna's centreline in the deformation plane 𝒟.

    Attributes
    ----------
    x_m, w_m : (B, N) m, along the clamped tangent and across it.
    theta_rad : (B, N) rad, angle of the tangent from the clamped one.
    """

    x_m: np.ndarray
    w_m: np.ndarray
    theta_rad: np.ndarray


def _planar_elastica(
    s_m: ArrayLike,
    contact_m: ArrayLike,
    force_N: ArrayLike,
    stiffness_Nm2: ArrayLike,
    friction_angle_rad: ArrayLike = 0.0,
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

    A negative arclength or contact distance, or an inclination beyond ±π/2, gives NaN.
    """
    s, load, contact, sign = _dimensionless(s_m, contact_m, force_N, stiffness_Nm2)
    return _scaled(normal_load(s, load, friction_angle_rad), contact, sign)


def planar_elastica_dead(
    s_m: ArrayLike, contact_m: ArrayLike, force_N: ArrayLike, stiffness_Nm2: ArrayLike, inclination_rad: ArrayLike = 0.0
) -> _PlanarShape:
    """`_planar_elastica` under a force of fixed direction, such as a hanging weight.

    `inclination_rad`, () or (B,), is the force's angle from the normal of the *undeformed* antenna, positive where it
    pushes the antenna back. Loads a = F·l²/EI above 60, which leave less than 0.1° between antenna and force, give NaN.
    """
    s, load, contact, sign = _dimensionless(s_m, contact_m, force_N, stiffness_Nm2)
    inclination = np.broadcast_to(np.asarray(inclination_rad, float), load.shape)
    inclination = _inclination_at_contact(load, np.where(np.abs(inclination) < np.pi / 2.0, inclination, np.nan))
    return _scaled(normal_load(s, load, inclination), contact, sign)


def normal_load(s: ArrayLike, load: ArrayLike, inclination_rad: ArrayLike = 0.0) -> _PlanarShape:
    """Shape (B, N) in units of the contact distance: s (N,) or (B, N), contact at s = 1, load a = F·l²/EI ≥ 0 (B,).

    The inclination, () or (B,), is measured from the antenna's normal at the contact. Values out of range give NaN.
    """
    along, amount = np.atleast_2d(np.asarray(s, float)), np.atleast_1d(np.asarray(load, float))
    inclination = np.array(np.broadcast_to(np.asarray(inclination_rad, float), amount.shape))
    # a load too small to bend anything, in place of 0/0
    root = np.sqrt(np.maximum(amount, 1e-200, where=amount >= 0.0, out=np.full(amount.shape, np.nan)))
    root = np.where(np.abs(inclination) < 0.5 * np.pi, root, np.nan)[:, None]
    back = 1.0 - along
    # υ along the bent part; the clamp, where it is √a, rides along as the first column
    bent = np.where(along >= 0.0, np.maximum(back, 0.0), np.nan) * root
    upsilon = np.concatenate([root, bent], -1)
    psi, cos_integral, sin_integral = core.antenna.universal_curve(upsilon, inclination)
    theta = psi[:, :1] - psi[:, 1:]
    onward = (cos_integral[:, :1] - cos_integral[:, 1:]) / root - np.minimum(back, 0.0)
    lateral = (sin_integral[:, :1] - sin_integral[:, 1:]) / root
    cos, sin = np.cos(psi[:, :1]), np.sin(psi[:, :1])
    return _PlanarShape(cos * onward + sin * lateral, sin * onward - cos * lateral, theta)


def _dimensionless(
    s_m: ArrayLike, contact_m: ArrayLike, force_N: ArrayLike, stiffness_Nm2: ArrayLike
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Arclengths s/l (B, N), load a = |F|·l²/EI (B,), contact (B, 1) with NaN where it is not positive, sign (B, 1)."""
    contact, force = np.atleast_1d(np.asarray(contact_m, float)), np.atleast_1d(np.asarray(force_N, float))
    contact = np.where(contact > 0.0, contact, np.nan)
    load = np.abs(force) * contact**2 / np.asarray(stiffness_Nm2, float)
    contact = np.broadcast_to(contact, load.shape)[:, None]
    return np.atleast_2d(np.asarray(s_m, float)) / contact, load, contact, np.copysign(1.0, force)[:, None]


def _scaled(shape: _PlanarShape, contact_m: np.ndarray, sign: np.ndarray) -> _PlanarShape:
    return _PlanarShape(shape.x_m * contact_m, shape.w_m * (sign * contact_m), shape.theta_rad * sign)


def _inclination_at_contact(load: np.ndarray, inclination: np.ndarray) -> np.ndarray:
    """Inclination α (B,) at the contact of a dead force inclined by β (B,) at the clamp: √a = F(φ, k), solved for k² >
    k_β².

    With k_β² = (1 − sin β)/2: tan²φ = (k² − k_β²)/(k_β² k′²). In η = −ln(k′²/k_β′²) the load a rises convexly from 0,
    so that Newton's steps never overshoot after the first.
    """
    m_clamp, rest_clamp = 0.5 * (1.0 - np.sin(inclination)), 0.5 * (1.0 + np.sin(inclination))
    # beyond, the antenna is within 0.1° of the force
    amount = np.where(load <= 60.0, np.maximum(load, 1e-200), np.nan)
    eta = np.minimum(amount * np.cos(inclination) ** 2 / (4.0 * rest_clamp), 2.0 * np.sqrt(amount))
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
    return np.arcsin(np.sin(inclination) + 2.0 * rest_clamp * np.expm1(-eta))
