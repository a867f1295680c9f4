"""Every related system by name: the sensors that it needs, and its formula."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import least_squares, minimize_scalar

from estimator.contact.motion import Beam
from estimator.paper.inclined import inclined_two_point_contact
from estimator.paper.two_point import force_z, two_point_contact
from vbaa_calib.core.arrays import validate_arguments
from vbaa_calib.core.errors import InputError

from .press import Answer, Press


@dataclass(frozen=True)
class _PressSettings:
    """Thresholds from which the methods of earlier sensors return a result."""

    stands_out_std: float = 5.0  # standard deviations that the moment's growth, or the ringing, must exceed
    lateral_rad: float = 0.05  # angle between moment and turn, beyond noise, from which the contact slips laterally
    fewest_periods: float = 2.0  # fewest periods of a ringing
    fewest_samples: int = 12  # fewest samples of a ringing
    nodes: int = 65  # places at which the first mode is exact
    finer: int = 8  # frequencies of a periodogram per its own resolution
    shares: tuple[float, float] = (0.6, 0.97)  # places of the two points, over the length
    uncertain: float = 0.1  # standard deviation of a distance, in lengths, from which it is withheld
    steep: float = 0.5  # slope of the straight part up to which deflections count as small (Assumption 1)
    fewest_frames: int = 3  # fewest frames for an object's stiffness
    known: float = 0.2  # relative standard deviation of a force up to which it is used: the formulas are not linear
    compliance_std: float = 3.0  # standard deviations that the compliance must exceed


_Slope = tuple[float, float, float]


def _active_antenna(press: Press) -> Answer:
    """Distance l = 3EI·w/τ on the axis about which the base turned most.

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


def _active_antenna_3d(press: Press) -> Answer:
    """Distance l = 3EI·|w|/|τ| from two moment axes, while the moment grows against the rotation.

    Assumes, besides, that the push is along the object's normal. Pushed at an angle the antenna slips sideways, the
    moment's direction leaves the turn's, and the formula has no answer: the reason says so.
    """
    turn, moment = np.asarray(press.turn_rad), np.asarray(press.moment_Nm)
    direction = turn[-1] - (turn[0] if len(turn) > 1 else 0.0)
    direction = direction / max(float(np.linalg.norm(direction)), 1e-300)
    slope = _slope(press, turn @ direction, -moment @ direction)
    lateral, lateral_std, _ = _slope(press, turn @ direction, -moment @ [-direction[1], direction[0]])
    (along, std, _), angle = slope, float(np.arctan2(abs(lateral), slope[0]))
    angle_std = np.hypot(lateral_std, angle * std) / max(abs(along), 1e-300)
    if angle > max(
        _PressSettings.lateral_rad, 0.0 if np.isnan(angle_std) else _PressSettings.stands_out_std * angle_std
    ):
        return Answer(reason=f"the antenna slips sideways: the moment leans {np.degrees(angle):.0f}° from the turn")
    return _distance(press, slope, moment[-1], direction)


def _slope(press: Press, turn: np.ndarray, moment: np.ndarray) -> _Slope:
    """Slope of the moment over the rotation (F,) by least squares, with an intercept if F > 1, its standard
    deviation, and its derivative by the last moment; NaN without rotation."""
    lateral = turn - turn.mean() if len(turn) > 1 else turn
    spread = float(lateral @ lateral)
    if spread <= 0.0:
        return np.nan, np.nan, np.nan
    slope = float(lateral @ moment) / spread
    noise = np.hypot(press.moment_std_Nm, 0.0 if np.isnan(press.turn_std_rad) else slope * press.turn_std_rad)
    return slope, float(noise / np.sqrt(spread)), float(lateral[-1]) / spread


def _distance(press: Press, found: _Slope, moment_Nm: np.ndarray, direction: np.ndarray) -> Answer:
    """Distance from dτ/dw = 3EI/l; the force is the last moment (2,) over l, along the components that were rotated."""
    wire, (slope, std, by_last) = press.wire, found
    if not slope > (0.0 if np.isnan(std) else _PressSettings.stands_out_std * std):
        return Answer(reason="the moment does not grow with the turn beyond its noise: nothing is pressed")
    distance = 3.0 * wire.stiffness_Nm2 / slope
    relative = np.hypot(std / slope, wire.stiffness_std_Nm2 / wire.stiffness_Nm2)
    if distance > wire.length_m * (1.0 + (0.0 if np.isnan(relative) else 2.0 * relative)):
        beyond = "is beyond the antenna: the object gives way, or the antenna slips"
        return Answer(candidates_m=np.array([distance]), reason=f"{1e3 * distance:.0f} mm {beyond}")
    push, turned, own = moment_Nm / distance, direction != 0.0, press.moment_std_Nm / distance
    # the last moment is in the slope, too
    variance = own**2 * (1.0 - 2.0 * by_last * direction * moment_Nm / slope) + (push * relative) ** 2
    force, force_std = np.full(3, np.nan), np.full(3, np.nan)
    force[1:][turned], force_std[1:][turned] = push[turned], np.sqrt(np.maximum(variance, 0.0))[turned]
    return Answer(distance, distance * relative, force, force_std)


def _dynamic_active_antenna(press: Press) -> Answer:
    """Distance l from the natural frequency of the ring-down in the moment signal; both where two distances have the
    same.

    Assumes: a contact that neither moves nor is left while the antenna rings, and that lets it turn; one mode that
    outlives the others. An object that gives way lowers the frequency: it feels like a contact nearer to the clamp.
    """
    wire, places = press.wire, np.linspace(0.0, 1.0, _PressSettings.nodes)
    assert press.ring is not None
    beam = Beam(wire.length_m, wire.stiffness_Nm2, wire.mass_per_length_kg_m)
    curve = CubicSpline(places, beam.first_mode_rad_s(places))
    free, tip = float(curve(0.0)), float(curve(1.0))
    found = _fit_ringing(
        press.ring, (0.8 * free, 1.2 * float(curve(np.linspace(0.0, 1.0, 4 * _PressSettings.nodes)).max()))
    )
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
    roots = curve.solve(natural, extrapolate=False)
    if len(roots) == 0:
        return Answer(reason=f"{pace} is faster than the first mode is with any contact")
    distances = np.sort(roots) * wire.length_m
    if natural > tip - 2.0 * std:
        distances = distances if len(distances) > 1 else np.array([distances[0], wire.length_m])
        listed = " and ".join(f"{1e3 * value:.0f}" for value in distances)
        words = f"{pace} is rung with a contact on either side of the second mode's node: {listed} mm"
        return Answer(candidates_m=distances, reason=words)
    return Answer(float(distances[0]), std * wire.length_m / float(curve(roots[0], 1)), candidates_m=distances)


def _fit_ringing(ring: np.ndarray, band_rad_s: tuple[float, float]) -> tuple[float, float] | str:
    """Natural frequency √(ω² + decay²), rad/s, of the strongest damped sinusoid over a constant in times and moments
    (R, 2), and the standard deviation of ω from the residuals; or the reason in words why there is none.

    It is sought in the band of possible first modes: higher modes may be louder.
    """
    time, signal = np.asarray(ring, float).T
    finite = np.isfinite(time) & np.isfinite(signal)
    time, signal = time[finite] - (time[finite].min() if finite.any() else 0.0), signal[finite]
    if len(time) < _PressSettings.fewest_samples:
        return f"{len(time)} samples: at least {_PressSettings.fewest_samples} are needed"
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
    if amplitude < _PressSettings.stands_out_std * float(np.sqrt(toward @ covariance[2:4, 2:4] @ toward)):
        return "no ringing stands out of the signal's noise"
    damped = float(abs(omega * solved.x[0]))
    if damped * span < _PressSettings.fewest_periods * 2.0 * np.pi:
        return (
            f"fewer than {_PressSettings.fewest_periods:.0f} periods: the frequency is indistinguishable from a drift"
        )
    return float(np.hypot(damped, solved.x[1] / span)), float(omega * np.sqrt(covariance[0, 0]))


def _strongest(time_s: np.ndarray, signal: np.ndarray, band_rad_s: tuple[float, float]) -> float:
    """Angular frequency, rad/s, of the periodogram's peak in the band, above the lowest ones, which a drift fills; NaN
    without one."""
    if not (np.diff(time_s) > 0.0).all():
        return np.nan
    even = np.interp(np.linspace(0.0, time_s[-1], len(time_s)), time_s, signal)
    power = np.abs(np.fft.rfft((even - even.mean()) * np.hanning(len(even)), _PressSettings.finer * len(even))) ** 2
    omega = 2.0 * np.pi * np.arange(len(power)) / _PressSettings.finer / len(even) * (len(even) - 1) / time_s[-1]
    inside = (np.arange(len(power)) >= _PressSettings.finer) & (omega >= band_rad_s[0]) & (omega <= band_rad_s[1])
    return float(omega[np.argmax(np.where(inside, power, -1.0))]) if inside.any() else np.nan


_Formula = Callable[[np.ndarray], np.ndarray]  # from M inputs (M, K) to results (M, Q)


def _vbaa_2d(press: Press) -> Answer:
    """l and f_y from vision alone, with a view perpendicular to plane C. Where the object bends the antenna out of
    C, f_z is missed."""
    return _upright(press, np.nan)


def _vbaa_3d_camera_a(press: Press) -> Answer:
    """l and f_y from vision, f_z = τ_y/l from the moment sensor; orthographic view perpendicular to plane C."""
    return _upright(press, float(np.asarray(press.moment_Nm)[-1, 1]))


def _vbaa_3d_camera_b(press: Press) -> Answer:
    """l, f_y and f_z from two points and the moment together, exactly; orthographic view, inclined by ϕ to the
    clamp."""

    def solve(finite: np.ndarray) -> np.ndarray:
        found = inclined_two_point_contact(
            finite[:, 0:2], finite[:, 2:4], finite[:, 4], finite[:, 5], press.camera_tilt_rad, press.wire.length_m
        )
        alone = np.where(found.solutions > 1, np.nan, found.contact_m)
        return np.stack([alone, found.force_y_N, found.force_z_N], axis=1)

    return _answer(press, solve, _two_points(press, -1), float(np.asarray(press.moment_Nm)[-1, 1]))


def _vbaa_2d_pushing(press: Press) -> Answer:
    """`_vbaa_2d` of the last frame, and the object's stiffness from all of them.

    Assumes, besides: a turn within plane C against an object with its normal along y, a linear spring, no friction. At
    least three frames of different force. Frames are left out where no contact explains the two points. What the beam's
    second order leaves, some 0.1 % of the antenna's own compliance l³/3EI at slopes of 3°, 0.3 % at 7°, is a bias.
    """
    last = _vbaa_2d(press)
    frames = [_yield_at(press, *frame) for frame in enumerate(np.asarray(press.turn_rad)[:, 0])]
    kept = [frame for frame in frames if frame is not None and np.isfinite(frame[0]).all()]
    prefix = f"{last.reason}; object's stiffness:" if last.reason else "object's stiffness:"
    if len(kept) < _PressSettings.fewest_frames:
        return replace(
            last, reason=f"{prefix} {len(kept)} frames with a contact, {_PressSettings.fewest_frames} are needed"
        )
    compliance, std = _compliance_of(*map(np.array, zip(*kept, strict=True)))
    if np.isfinite(std) and not compliance > _PressSettings.compliance_std * std:
        least = 1.0 / (max(compliance, 0.0) + 2.0 * std)
        words = f"{prefix} gives way by no more than the noise; probably stiffer than {least:.3g} N/m"
        return replace(last, reason=words)
    if not compliance > 0.0:
        return replace(last, reason=f"{prefix} it does not give way under the force")
    return replace(last, object_stiffness_N_m=1.0 / compliance, object_stiffness_std_N_m=std / compliance**2)


def _two_points(press: Press, frame: int) -> np.ndarray | None:
    """(2, 2) the points of a frame nearest to `_PressSettings.shares` of the length; None without two of them."""
    points = np.asarray(press.points_m)[frame]
    points = points[np.isfinite(points).all(axis=1)]
    if len(points) < 2:
        return None
    first, second = np.argmin(
        np.abs(points[:, 0] - np.array(_PressSettings.shares)[:, None] * press.wire.length_m), axis=1
    )
    return points[[first, second]] if first != second else None


def _propagate(solve: _Formula, finite: np.ndarray, std: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Results (Q,) of one input (K,), and their changes (Q, K) by independent noise of these standard deviations
    (K,): half the difference over ± one standard deviation; NaN where that leaves the range with a solution."""
    values = solve(finite + np.concatenate([np.zeros((1, len(finite))), np.diag(std), -np.diag(std)]))
    up, down = np.split(values[1:], 2)
    return values[0], 0.5 * (up - down).T


def _upright(press: Press, moment_Nm: float) -> Answer:
    def solve(finite: np.ndarray) -> np.ndarray:
        found = two_point_contact(finite[:, 0:2], finite[:, 2:4], finite[:, 5], press.wire.length_m)
        return np.stack([found.contact_m, found.force_y_N, force_z(finite[:, 4], found.contact_m)], axis=1)

    points = _two_points(press, -1)
    if points is not None and abs(np.diff(points[:, 1])) > _PressSettings.steep * abs(np.diff(points[:, 0])):
        return Answer(reason=f"bent beyond small deflections: a slope of more than {_PressSettings.steep:g}")
    return _answer(press, solve, points, moment_Nm)


def _answer(press: Press, solve: _Formula, points: np.ndarray | None, moment_Nm: float) -> Answer:
    """A method's answer by a formula over (x1, x2, y1, y2, τ_y, EI), with first-order standard deviations; NaN for a
    missing moment."""
    if points is None:
        return Answer(reason="fewer than two points of the antenna are seen apart from each other")
    wire, point_std, blind = press.wire, press.point_std_m, bool(np.isnan(moment_Nm))
    moment, moment_std = (0.0, 0.0) if blind else (moment_Nm, press.moment_std_Nm)
    std = np.array([0.0, 0.0, point_std, point_std, moment_std, wire.stiffness_std_Nm2])
    values, moved = _propagate(
        solve, np.array([*points[:, 0], *points[:, 1], moment, wire.stiffness_Nm2]), np.nan_to_num(std)
    )
    if np.isnan(values[0]):
        return Answer(reason="no contact explains the two points, or more than one: too little bent for their noise")
    deviations = np.full(3, np.nan) if np.isnan(std).any() else np.sqrt((moved**2).sum(axis=1))
    if not (np.isnan(std).any() or deviations[0] < _PressSettings.uncertain * wire.length_m):
        reason = "bent too little: the two points' noise leaves the contact's place open"
        return Answer(candidates_m=values[:1], reason=reason)
    force, force_std = np.full(3, np.nan), np.full(3, np.nan)
    seen = slice(1, 2 if blind else 3)
    force[seen], force_std[seen] = values[seen], deviations[seen]
    return Answer(float(values[0]), float(deviations[0]), force, force_std)


def _compliance_of(values: np.ndarray, covariance: np.ndarray) -> tuple[float, float]:
    """Compliance 1/k in m/N and its standard deviation from −f and u (n, 2), with covariances (n, 2, 2): a line with
    errors in both.

    Least is Σ (u − u₀ − slope·(−f))²/variance of that, which depends on the slope, since the errors of f and u go
    together. The deviation grows with the scatter where that is more than the noise, or where no noise is known.
    """
    force, finite = values.T
    if len(values) < _PressSettings.fewest_frames or not np.ptp(force) > 0.0:
        return np.nan, np.nan
    noisy = bool(np.isfinite(covariance).all() and (covariance[:, 1, 1] > 0.0).all())
    noise = covariance if noisy else np.broadcast_to(np.diag([0.0, 1.0]), (len(values), 2, 2))

    def cost(slope: float) -> float:
        weight = 1.0 / np.einsum("i,nij,j->n", [-slope, 1.0], noise, [-slope, 1.0])
        residual = finite - slope * force
        return float(weight @ (residual - (weight @ residual) / weight.sum()) ** 2)

    rough, step = np.polyfit(force, finite, 1)[0], float(np.ptp(finite) + 1e-9 * np.ptp(force)) / float(np.ptp(force))
    best = float(minimize_scalar(cost, bracket=(rough - 0.1 * step, rough + 0.1 * step)).x)
    step = 1e-3 * step
    curvature = (cost(best + step) - 2.0 * cost(best) + cost(best - step)) / step**2
    if not curvature > 0.0:
        return np.nan, np.nan
    scatter = cost(best) / (len(values) - 2)
    return best, float(np.sqrt(2.0 * (max(scatter, 1.0) if noisy else scatter) / curvature))


def _yield_at(press: Press, frame: int, turn_rad: float) -> tuple[np.ndarray, np.ndarray] | None:
    """−f_y and u of one frame, and their covariance (2, 2); None without two points or a known force."""
    points, stiffness = _two_points(press, frame), press.wire.stiffness_Nm2
    if points is None:
        return None

    def solve(finite: np.ndarray) -> np.ndarray:
        found = two_point_contact(points[:, 0], finite[:, :2], stiffness, press.wire.length_m)
        contact, force = found.contact_m, found.force_y_N
        bent = force * contact**3 / (3.0 * stiffness)
        return np.stack([-force, contact * np.sin(finite[:, 2]) + bent * np.cos(finite[:, 2])], axis=1)

    point_std, turn_std = np.nan_to_num([press.point_std_m, press.turn_std_rad])
    values, moved = _propagate(solve, np.array([*points[:, 1], turn_rad]), np.array([point_std, point_std, turn_std]))
    if np.isnan(press.point_std_m):
        return values, np.full((2, 2), np.nan)
    if not np.linalg.norm(moved[0]) < _PressSettings.known * abs(values[0]):
        return None
    return values, moved @ moved.T


METHODS: dict[str, tuple[Callable[[Press], Answer], str]] = {
    "Active Antenna": (_active_antenna, "turns moment_y|moment_z"),
    "3D Active Antenna": (_active_antenna_3d, "turns moment_y moment_z"),
    "Dynamic Active Antenna": (_dynamic_active_antenna, "ring"),
    "2D-VBAA": (_vbaa_2d, "centreline"),
    "2D-VBAA, pushing": (_vbaa_2d_pushing, "centreline turns"),
    "3D-VBAA, camera A": (_vbaa_3d_camera_a, "centreline moment_y"),
    "3D-VBAA, camera B": (_vbaa_3d_camera_b, "centreline moment_y"),
}
"""How each answers, and which measurements (`Press.has`) it needs; of those joined by | any one is enough."""


@validate_arguments
def run_method(name: str, press: Press) -> Answer:
    """The method's answer to the press; where it lacks a sensor, with that as the reason.

    Raises InputError for an unknown name.
    """
    if name not in METHODS:
        raise InputError(f"no method {name!r}", remedy=f"one of {', '.join(METHODS)}")
    solve, needs = METHODS[name]
    any_of = [need.split("|") for need in needs.split()]
    words = {
        "turns": "the base's turns since first contact",
        "moment_y": "a moment sensor about y",
        "moment_z": "a moment sensor about z",
        "centreline": "the antenna's centreline on plane C",
        "ring": "a ring-down of the moment, and the wire's mass",
    }
    lacking = [" or ".join(words[each] for each in need) for need in any_of if press.has.isdisjoint(need)]
    return Answer(reason=f"needs {' and '.join(lacking)}") if lacking else solve(press)
