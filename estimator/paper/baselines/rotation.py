"""The Active Antenna and the 3D Active Antenna: the contact's distance from the antenna's rotational compliance.

A rigid object holds the contact while the base turns by w, so that the antenna is bent there by l·w: the moment grows
by τ = 3EI·w/l. No camera is needed. An object that gives way by 1/k per newton feels like a longer antenna,
3EI·w/τ = l + 3EI/(k·l²), and the sensor cannot know.

Kaneko, *Active Antenna* (ICRA 1994); Kaneko, Kanayama, Tsuji, *3D Active Antenna for contact sensing* (ICRA 1995): the
paper's [10]–[14].
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .press import Answer, Press

_STANDS_OUT = 5.0
"""The moment's growth must be so many of its deviations."""
_ASIDE_RAD = 0.05
"""Moment and turn that differ in direction by more, and by more than noise, tell of a slip sideways."""


@dataclass(frozen=True)
class Slope:
    """Of a straight line, its deviation, and how much it is moved by the last point's y."""

    value: float
    std: float
    by_last: float


def active_antenna(press: Press) -> Answer:
    """l = 3EI·w/τ on the axis about which the base turned most.

    Assumes: a rigid object, small turns, no slip and no friction. The slope of τ over w is taken with a free intercept,
    so that neither the sensor's offset nor the moment of first contact matters; a single frame goes through the origin.
    """
    turn, moment = _given(press)
    axis = int(np.argmax(np.ptp(turn, axis=0) if len(turn) > 1 else np.abs(turn[0])))
    if not np.isfinite(moment[:, axis]).all():
        return Answer(reason=f"turned about {'zy'[axis]}, where there is no moment sensor")
    slope = fitted_slope(turn[:, axis], -moment[:, axis], press.noise.turn_rad, press.noise.moment_Nm)
    direction = np.eye(2)[axis]
    return _distance(press, slope, float(moment[-1, axis]) * direction, direction)


def active_antenna_3d(press: Press) -> Answer:
    """The same with two moment axes: l = 3EI·|w|/|τ| while the moment grows against the turn.

    Assumes, besides, that the push is along the object's normal. Pushed at an angle the antenna slips sideways, the
    moment's direction leaves the turn's, and the formula has no answer: the reason says so.
    """
    turn, moment = _given(press)
    direction = turn[-1] - (turn[0] if len(turn) > 1 else 0.0)
    direction = direction / max(float(np.linalg.norm(direction)), 1e-300)
    along = fitted_slope(turn @ direction, -moment @ direction, press.noise.turn_rad, press.noise.moment_Nm)
    across = np.array([-direction[1], direction[0]])
    aside = fitted_slope(turn @ direction, -moment @ across, press.noise.turn_rad, press.noise.moment_Nm)
    angle = float(np.arctan2(abs(aside.value), along.value))
    angle_std = np.hypot(aside.std, angle * along.std) / max(abs(along.value), 1e-300)
    if angle > max(_ASIDE_RAD, 0.0 if np.isnan(angle_std) else _STANDS_OUT * angle_std):
        return Answer(reason=f"the antenna slips sideways: the moment leans {np.degrees(angle):.0f}° from the turn")
    return _distance(press, along, moment[-1], direction)


def fitted_slope(x: np.ndarray, y: np.ndarray, x_std: float, y_std: float) -> Slope:
    """Slope of y (F,) over x (F,) by least squares, its deviation from noise of both; NaN where x does not change.

    With an intercept if F > 1. An unknown deviation of x counts as none; with one of y unknown the slope's is NaN.
    """
    aside = x - x.mean() if len(x) > 1 else x
    spread = float(aside @ aside)
    if spread <= 0.0:
        return Slope(np.nan, np.nan, np.nan)
    value = float(aside @ y) / spread
    noise = np.hypot(y_std, 0.0 if np.isnan(x_std) else value * x_std)
    return Slope(value, float(noise / np.sqrt(spread)), float(aside[-1]) / spread)


def _given(press: Press) -> tuple[np.ndarray, np.ndarray]:
    assert press.turn_rad is not None
    assert press.moment_Nm is not None
    return np.asarray(press.turn_rad, float), np.asarray(press.moment_Nm, float)


def _distance(press: Press, slope: Slope, moment_now_Nm: np.ndarray, direction: np.ndarray) -> Answer:
    """From dτ/dw = 3EI/l; the force is the moment over l, along the components that were turned."""
    wire = press.wire
    if not slope.value > (0.0 if np.isnan(slope.std) else _STANDS_OUT * slope.std):
        return Answer(reason="the moment does not grow with the turn beyond its noise: nothing is pressed")
    distance = 3.0 * wire.stiffness_Nm2 / slope.value
    relative = np.hypot(slope.std / slope.value, wire.stiffness_std_Nm2 / wire.stiffness_Nm2)
    if distance > wire.length_m * (1.0 + (0.0 if np.isnan(relative) else 2.0 * relative)):
        return Answer(
            candidates_m=np.array([distance]),
            reason=f"{1e3 * distance:.0f} mm is beyond the antenna: the object gives way, or the antenna slips",
        )
    push, turned = moment_now_Nm / distance, direction != 0.0
    # the last moment is in the slope, too
    own = press.noise.moment_Nm / distance
    shared = own**2 * 2.0 * slope.by_last * direction * -moment_now_Nm / slope.value
    variance = own**2 + shared + (push * relative) ** 2
    force, force_std = np.full(3, np.nan), np.full(3, np.nan)
    force[1:][turned], force_std[1:][turned] = push[turned], np.sqrt(np.maximum(variance, 0.0))[turned]
    return Answer(distance, distance * relative, force, force_std)
