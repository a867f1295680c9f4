"""The Active Antenna and the 3D Active Antenna: the contact's distance from the antenna's rotational compliance.

A rigid object holds the contact while the base turns by w, so that the antenna is bent there by l·w: the moment grows
by τ = 3EI·w/l. No camera is needed. An object that gives way by 1/k per newton feels like a longer antenna,
3EI·w/τ = l + 3EI/(k·l²), and the sensor cannot know.

Kaneko, *Active Antenna* (ICRA 1994); Kaneko, Kanayama, Tsuji, *3D Active Antenna for contact sensing* (ICRA 1995): the
paper's [10]–[14].
"""

from __future__ import annotations

import numpy as np

from .press import Answer, Press

_STANDS_OUT = 5.0  # the moment's growth must be so many of its deviations
_ASIDE_RAD = 0.05  # moment and turn that differ in direction by more, and by more than noise, tell of a slip sideways

_Slope = tuple[float, float, float]


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
    """Of the moment over the turn (F,) by least squares, its deviation, and how much the last moment moves it.

    With an intercept if F > 1; NaN where nothing turns. An unknown deviation of the turn counts as none.
    """
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
