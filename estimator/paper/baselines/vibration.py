"""The Dynamic Active Antenna: the contact's distance from the frequency at which the touched antenna rings.

Clamped at its base, held but free to turn at the contact, free beyond it, the antenna's first mode rises from the free
antenna's frequency (contact at the clamp) to its largest where the contact sits on a node of the second mode, l =
0.783 L, and falls again towards the tip. So beyond about half the length two distances ring alike.

Ueno, Kaneko, *Dynamic Active Antenna* (ICRA 1994, 1995): the paper's [15], [16].
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import least_squares

from estimator.contact.motion import Beam

from .press import Answer, Press, Ring

_STANDS_OUT = 5.0  # the ringing's amplitude must be so many deviations of its own
_FEWEST_PERIODS, _FEWEST_SAMPLES = 2.0, 12
_NODES, _FINER = 65, 8  # places at which the first mode is exact; how much finer than its own the periodogram is


def dynamic_active_antenna(press: Press) -> Answer:
    """l from the natural frequency of the ring-down in the moment signal; where two places ring alike, both of them.

    Assumes: a contact that neither moves nor is left while the antenna rings, and that lets it turn; one mode that
    outlives the others. An object that gives way lowers the frequency: it feels like a contact nearer to the clamp.
    """
    wire, places = press.wire, np.linspace(0.0, 1.0, _NODES)
    assert press.ring is not None
    beam = Beam(wire.length_m, wire.stiffness_Nm2, wire.mass_per_length_kg_m)
    curve = CubicSpline(places, beam.first_mode_rad_s(places))
    free, tip = float(curve(0.0)), float(curve(1.0))
    found = fit_ringing(press.ring, (0.8 * free, 1.2 * float(curve(np.linspace(0.0, 1.0, 4 * _NODES)).max())))
    if isinstance(found, str):
        return Answer(reason=found)
    natural, std = found
    relative = 0.5 * np.hypot(
        wire.stiffness_std_Nm2 / wire.stiffness_Nm2, wire.mass_per_length_std_kg_m / wire.mass_per_length_kg_m
    )
    std = float(np.hypot(std, natural * relative))
    pace = f"{natural / (2.0 * np.pi):.1f} Hz"
    if natural < free + 2.0 * std:
        return Answer(reason=f"{pace} is the free antenna's frequency, or below: nothing holds it")
    held = curve.solve(natural, extrapolate=False)
    if len(held) == 0:
        return Answer(reason=f"{pace} is faster than the first mode is with any contact")
    distances = np.sort(held) * wire.length_m
    if natural > tip - 2.0 * std:
        distances = distances if len(distances) > 1 else np.array([distances[0], wire.length_m])
        listed = " and ".join(f"{1e3 * value:.0f}" for value in distances)
        words = f"{pace} is rung with a contact on either side of the second mode's node: {listed} mm"
        return Answer(candidates_m=distances, reason=words)
    return Answer(float(distances[0]), std * wire.length_m / float(curve(held[0], 1)), candidates_m=distances)


def fit_ringing(ring: Ring, band_rad_s: tuple[float, float]) -> tuple[float, float] | str:
    """Natural frequency √(ω² + decay²) of the strongest damped sinusoid over a constant, and the deviation of ω from
    the misfit that is left, rad/s; in words why there is none.

    It is looked for in the band, within which a first mode can be: higher modes may be louder.
    """
    time, signal = np.asarray(ring.time_s, float), np.asarray(ring.moment_Nm, float)
    given = np.isfinite(time) & np.isfinite(signal)
    time, signal = time[given] - (time[given].min() if given.any() else 0.0), signal[given]
    if len(time) < _FEWEST_SAMPLES:
        return f"{len(time)} samples: at least {_FEWEST_SAMPLES} are needed"
    omega = _strongest(time, signal, band_rad_s)
    if not omega > 0.0:
        return "the times do not rise, or are too few for the first mode's frequencies"
    size, span = float(signal.std()) or 1.0, float(time[-1])

    def basis(pace: float, decay: float) -> np.ndarray:
        envelope, turn = np.exp(-decay * time / span), omega * pace * time
        return np.stack([envelope * np.cos(turn), envelope * np.sin(turn), np.ones_like(time)], axis=1)

    linear = np.linalg.lstsq(basis(1.0, 1.0), signal / size, rcond=None)[0]
    solved = least_squares(
        lambda unknowns: basis(*unknowns[:2]) @ unknowns[2:] - signal / size, [1.0, 1.0, *linear], x_scale="jac"
    )
    information = solved.jac.T @ solved.jac
    if not np.isfinite(solved.x).all() or np.linalg.cond(information) > 1e14:
        return "no oscillation can be told from the signal"
    covariance = np.linalg.inv(information) * (2.0 * solved.cost / (len(time) - len(solved.x)))
    amplitude = float(np.hypot(*solved.x[2:4]))
    toward = solved.x[2:4] / max(amplitude, 1e-300)
    if amplitude < _STANDS_OUT * float(np.sqrt(toward @ covariance[2:4, 2:4] @ toward)):
        return "no ringing stands out of the signal's noise"
    damped = float(abs(omega * solved.x[0]))
    if damped * span < _FEWEST_PERIODS * 2.0 * np.pi:
        return f"fewer than {_FEWEST_PERIODS:.0f} periods: the frequency cannot be told from a drift"
    return float(np.hypot(damped, solved.x[1] / span)), float(omega * np.sqrt(covariance[0, 0]))


def _strongest(time_s: np.ndarray, signal: np.ndarray, band_rad_s: tuple[float, float]) -> float:
    """ω of the periodogram's peak in the band, beyond what a drift fills; NaN where there is no such frequency."""
    if not (np.diff(time_s) > 0.0).all():
        return np.nan
    even = np.interp(np.linspace(0.0, time_s[-1], len(time_s)), time_s, signal)
    power = np.abs(np.fft.rfft((even - even.mean()) * np.hanning(len(even)), _FINER * len(even))) ** 2
    omega = 2.0 * np.pi * np.arange(len(power)) / _FINER / len(even) * (len(even) - 1) / time_s[-1]
    inside = (np.arange(len(power)) >= _FINER) & (omega >= band_rad_s[0]) & (omega <= band_rad_s[1])
    return float(omega[np.argmax(np.where(inside, power, -1.0))]) if inside.any() else np.nan
