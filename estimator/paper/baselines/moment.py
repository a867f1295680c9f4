"""The baselines that touch without seeing.

*The Active Antenna and the 3D Active Antenna* take the contact's distance from the antenna's rotational compliance. A
rigid object holds the contact while the base turns by w, so that the antenna is bent there by l·w: the moment grows by
τ = 3EI·w/l. An object that gives way by 1/k per newton feels like a longer antenna, 3EI·w/τ = l + 3EI/(k·l²), and the
sensor cannot know. Kaneko, *Active Antenna* (ICRA 1994); Kaneko, Kanayama, Tsuji, *3D Active Antenna for contact
sensing* (ICRA 1995): the paper's [10]–[14].

*The Dynamic Active Antenna* takes it from the frequency at which the touched antenna rings. Clamped at its base, held
but free to turn at the contact, free beyond it, the antenna's first mode rises from the free antenna's frequency
(contact at the clamp) to its largest where the contact sits on a node of the second mode, l = 0.783 L, and falls again
towards the tip. So beyond about half the length two distances ring alike. Ueno, Kaneko, *Dynamic Active Antenna* (ICRA
1994, 1995): the paper's [15], [16].
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import least_squares

from estimator.contact.motion import Beam

from .press import Answer, Press, Ring

_STANDS_OUT = 5.0  # the moment's growth, or the ringing's amplitude, must be so many of its deviations
_ASIDE_RAD = 0.05  # moment and turn that differ in direction by more, and by more than noise, indicate a slip sideways

_Slope = tuple[float, float, float]
_FEWEST_PERIODS, _FEWEST_SAMPLES = 2.0, 12
_NODES, _FINER = 65, 8  # places at which the first mode is exact; how much finer than its own the periodogram is


def active_antenna(press: Press) -> Answer:
    """l = 3EI·w/τ on the axis about which the base turned most.

    Assumes: a rigid object, small turns, no slip and no friction. The slope of τ over w is taken with a free intercept,
    so that neither the sensor's offset nor the moment of first contact matters; a single frame goes through the origin.
    """
    turn, moment = np.asarray(press.turn_rad), np.asarray(press.moment_Nm)
    axis = int(np.argmax(np.ptp(turn, axis=0) if len(turn) > 1 else np.abs(turn[0])))
    if not np.isfinite(moment[:, axis]).all():
        return Answer(reason=f"turned about {'zy'[axis]}, where there is no moment sensor")
    direction = np.eye(2)[axis]
    slope = _slope(press, turn[:, axis], -moment[:, axis])
    return _distance(press, slope, float(moment[-1, axis]) * direction, direction)


def active_antenna_3d(press: Press) -> Answer:
    """The same with two moment axes: l = 3EI·|w|/|τ| while the moment grows against the turn.

    Assumes, besides, that the push is along the object's normal. Pushed at an angle the antenna slips sideways, the
    moment's direction leaves the turn's, and the formula has no answer: the reason says so.
    """
    turn, moment = np.asarray(press.turn_rad), np.asarray(press.moment_Nm)
    direction = turn[-1] - (turn[0] if len(turn) > 1 else 0.0)
    direction = direction / max(float(np.linalg.norm(direction)), 1e-300)
    slope = _slope(press, turn @ direction, -moment @ direction)
    aside, aside_std, _ = _slope(press, turn @ direction, -moment @ [-direction[1], direction[0]])
    (along, std, _), angle = slope, float(np.arctan2(abs(aside), slope[0]))
    angle_std = np.hypot(aside_std, angle * std) / max(abs(along), 1e-300)
    if angle > max(_ASIDE_RAD, 0.0 if np.isnan(angle_std) else _STANDS_OUT * angle_std):
        return Answer(reason=f"the antenna slips sideways: the moment leans {np.degrees(angle):.0f}° from the turn")
    return _distance(press, slope, moment[-1], direction)


def _slope(press: Press, turn: np.ndarray, moment: np.ndarray) -> _Slope:
    """Of the moment over the turn (F,) by least squares, with an intercept if F > 1, its deviation, and how much the
    last moment moves it; NaN where nothing turns."""
    aside = turn - turn.mean() if len(turn) > 1 else turn
    spread = float(aside @ aside)
    if spread <= 0.0:
        return np.nan, np.nan, np.nan
    slope = float(aside @ moment) / spread
    noise = np.hypot(press.noise.moment_Nm, 0.0 if np.isnan(press.noise.turn_rad) else slope * press.noise.turn_rad)
    return slope, float(noise / np.sqrt(spread)), float(aside[-1]) / spread


def _distance(press: Press, found: _Slope, moment_Nm: np.ndarray, direction: np.ndarray) -> Answer:
    """From dτ/dw = 3EI/l; the force is the last moment (2,) over l, along the components that were turned."""
    wire, (slope, std, by_last) = press.wire, found
    if not slope > (0.0 if np.isnan(std) else _STANDS_OUT * std):
        return Answer(reason="the moment does not grow with the turn beyond its noise: nothing is pressed")
    distance = 3.0 * wire.stiffness_Nm2 / slope
    relative = np.hypot(std / slope, wire.stiffness_std_Nm2 / wire.stiffness_Nm2)
    if distance > wire.length_m * (1.0 + (0.0 if np.isnan(relative) else 2.0 * relative)):
        beyond = "is beyond the antenna: the object gives way, or the antenna slips"
        return Answer(candidates_m=np.array([distance]), reason=f"{1e3 * distance:.0f} mm {beyond}")
    push, turned, own = moment_Nm / distance, direction != 0.0, press.noise.moment_Nm / distance
    # the last moment is in the slope, too
    variance = own**2 * (1.0 - 2.0 * by_last * direction * moment_Nm / slope) + (push * relative) ** 2
    force, force_std = np.full(3, np.nan), np.full(3, np.nan)
    force[1:][turned], force_std[1:][turned] = push[turned], np.sqrt(np.maximum(variance, 0.0))[turned]
    return Answer(distance, distance * relative, force, force_std)


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
    found = _fit_ringing(press.ring, (0.8 * free, 1.2 * float(curve(np.linspace(0.0, 1.0, 4 * _NODES)).max())))
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


def _fit_ringing(ring: Ring, band_rad_s: tuple[float, float]) -> tuple[float, float] | str:
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
        return "no oscillation is found in the signal"
    covariance = np.linalg.inv(information) * (2.0 * solved.cost / (len(time) - len(solved.x)))
    amplitude = float(np.hypot(*solved.x[2:4]))
    toward = solved.x[2:4] / max(amplitude, 1e-300)
    if amplitude < _STANDS_OUT * float(np.sqrt(toward @ covariance[2:4, 2:4] @ toward)):
        return "no ringing stands out of the signal's noise"
    damped = float(abs(omega * solved.x[0]))
    if damped * span < _FEWEST_PERIODS * 2.0 * np.pi:
        return f"fewer than {_FEWEST_PERIODS:.0f} periods: the frequency is indistinguishable from a drift"
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
