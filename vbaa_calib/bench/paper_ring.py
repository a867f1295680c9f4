"""How the moment rings of an antenna that is held by an object's spring: finite elements, no code of the baselines."""

from __future__ import annotations

import numpy as np
from scipy.linalg import eigh

from ..rig import Antenna

ELEMENTS, MODES = 60, 4
DAMPING = 0.01
RATE_HZ, SAMPLES = 1000.0, 400
PLUCK_NM = 3e-4
"""Change of the clamp's moment by which the antenna is let go."""

_SPRING = np.array([[12, 6, -12, 6], [6, 4, -6, 2], [-12, -6, 12, -6], [6, 2, -6, 4.0]])
_INERT = np.array([[156, 22, 54, -13], [22, 4, 13, -3], [54, 13, 156, -22], [-13, -3, -22, 4.0]])
"""Of an element with cubic shapes over (w, h·w′) at its ends, in EI/h³ and ρA·h/420."""


def ring_down(antenna: Antenna, contact_m: float, object_N_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Times (R,) s and moments (R,) N·m after the tip is let go, the antenna in contact with a spring.

    Euler–Bernoulli elements with cubic shapes; a contact that holds and lets turn; each mode damped by `DAMPING`.
    """
    stiffness, mass, sites = _assembled(antenna, contact_m)
    held = int(np.argmin(np.abs(sites - contact_m)))
    rigid = 1e6 * antenna.stiffness_Nm2 / contact_m**3
    stiffness[2 * held, 2 * held] += min(object_N_m, rigid)
    # clamped: the first node's height and slope are none
    stiffness, mass = stiffness[2:, 2:], mass[2:, 2:]
    squares, shapes = eigh(stiffness, mass, subset_by_index=[0, MODES - 1])
    load = np.zeros(len(stiffness))
    load[-2] = 1.0
    started = shapes.T @ mass @ np.linalg.solve(stiffness, load)
    clamp = antenna.stiffness_Nm2 * shapes.T @ _curvature_at_clamp(sites[1], len(stiffness))
    amplitude = started * clamp
    amplitude = PLUCK_NM * amplitude / np.abs(amplitude).sum()
    time = np.arange(SAMPLES) / RATE_HZ
    omega = np.sqrt(squares)[:, None]
    envelope = amplitude[:, None] * np.exp(-DAMPING * omega * time)
    return time, (envelope * np.cos(omega * np.sqrt(1.0 - DAMPING**2) * time)).sum(axis=0)


def _assembled(antenna: Antenna, contact_m: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Stiffness and mass (2n, 2n) over heights and slopes of the nodes, which stand at (n,) m; one is the contact."""
    before = max(2, round(ELEMENTS * contact_m / antenna.length_m))
    sites = np.concatenate(
        [
            np.linspace(0.0, contact_m, before + 1),
            np.linspace(contact_m, antenna.length_m, max(2, ELEMENTS - before) + 1)[1:],
        ]
    )
    stiffness, mass = (np.zeros((2 * len(sites), 2 * len(sites))) for _ in range(2))
    for index, h in enumerate(np.diff(sites)):
        at = np.ix_(range(2 * index, 2 * index + 4), range(2 * index, 2 * index + 4))
        by_length = np.diag([1.0, h, 1.0, h])
        stiffness[at] += antenna.stiffness_Nm2 / h**3 * by_length @ _SPRING @ by_length
        mass[at] += antenna.mass_per_length_kg_m * h / 420.0 * by_length @ _INERT @ by_length
    return stiffness, mass, sites


def _curvature_at_clamp(h: float, count: int) -> np.ndarray:
    """(count,) w″(0) by the first free node's height and slope."""
    row = np.zeros(count)
    row[:2] = 6.0 / h**2, -2.0 / h
    return row
