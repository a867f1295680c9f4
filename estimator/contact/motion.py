"""Is the antenna at rest? Frames are fitted as static shapes; where the antenna rings or its base shakes, its inertia
bends it as weight does, and a fit that knows nothing of it puts the contact elsewhere.

From the shapes of successive frames in the *world* frame follows the acceleration of every piece of the antenna, from
that the load per length q = −ρA·a, and from that the deflection that the static fit took for the contact's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from scipy.special import ndtri

from vbaa_calib.rig import Rig

_MOST = 64  # at most so many frames on either side count: what a judge of a recording must remember is bounded
_PATH, _TESTED = 4, 7
"""Degree of the path about which points should scatter as they are said to, and the fewest frames that can test it."""
PIECES = 12
"""The antenna is judged at the middles of so many equal pieces; each one's inertia acts there as a point force."""
_FALSE_ALARM = 1e-5
"""Probability that a frame at rest is taken for a moving one, at most: over all pieces and axes together."""
_CLAMPED_FREE, _FASTEST = 1.8751040687119611, 4.6945
"""βL of the free antenna's first mode, and a bound for any contact's: where it sits on a node of the second mode."""
_TABLE = 65


@dataclass(frozen=True, eq=False)
class _Neighbours:
    """For each of R judged frames, of index `centre` (R,), W others near to it in time, itself among them: their index
    `at` (R, W), time from it, and which count; whether those are `enough` (R,) for a parabola about it."""

    centre: np.ndarray
    at: np.ndarray
    after_s: np.ndarray
    inside: np.ndarray
    enough: np.ndarray


def _neighbours(
    time_s: np.ndarray, judged: np.ndarray, reach_s: np.ndarray, longest_s: float, *, live: bool = False
) -> _Neighbours:
    """Of frames at times (n,) those around each judged one (R,), at most `reach_s` (R,) from it, the next in any case.

    A gap longer than `longest_s`, or none at all, ends a neighbourhood. `live`: only earlier frames, two in any case.
    """
    gap = time_s[1:] - time_s[:-1]
    broken = ~((gap > 0.0) & (gap <= longest_s))
    # frames that share a number have no wrong gap between them
    run = np.cumsum(np.concatenate([np.zeros(1), broken]))
    least = 2 if live else 1
    offsets = np.arange(-_MOST, 1 if live else _MOST + 1)
    place = judged[:, None] + offsets
    at = np.clip(place, 0, len(time_s) - 1)
    after = time_s[at] - time_s[judged][:, None]
    near = (abs(after) <= reach_s[:, None]) | (abs(offsets) <= least)
    inside = near & (run[at] == run[judged][:, None]) & (place == at)
    enough = inside[:, _MOST - least : _MOST + 1 if live else _MOST + 2].all(-1)
    used = inside.any(0) | (offsets == 0)
    return _Neighbours(judged, at[:, used], after[:, used], inside[:, used], enough)


def _second_derivative(
    near: _Neighbours, points: np.ndarray, std: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Second derivatives (R, G, 3) of points (n, G, 3), their standard deviations (R, G, 3) and weights (R, W).

    `std` (n, 1) or (n, G) is that of one component of a point. Where there are `_TESTED` frames or more, and the points
    scatter about a smooth path by more, the result's grows by as much; it never shrinks. NaN where there is not enough.
    """
    unit, by_last, tested = _orthonormal(near)
    start = points[near.centre]
    parts = [0.0 * start] * (_PATH + 1)
    squares, variance = 0.0 * start, 0.0 * std[near.centre]
    expected = variance
    for column in range(unit.shape[-1]):
        counts = near.inside[:, column].astype(float)[:, None]
        moved = (points[near.at[:, column]] - start) * counts[..., None]
        parts = [part + unit[:, power, column, None, None] * moved for power, part in enumerate(parts)]
        squares = squares + moved**2
        own = std[near.at[:, column]] ** 2
        variance = variance + unit[:, 2, column, None] ** 2 * own
        expected = expected + counts * own
    count = near.inside.sum(-1)[:, None]
    spare = np.where(tested[:, None], expected * (count - _PATH - 1.0) / count, np.inf)
    scatter = (squares - sum(part**2 for part in parts)) / spare[..., None]
    std = np.sqrt(variance[..., None] * np.clip(scatter, 1.0, None))
    scale = np.where(near.enough, by_last, np.nan)
    return scale[:, None, None] * parts[2], scale[:, None, None] * std, scale[:, None] * unit[:, 2]


def _orthonormal(near: _Neighbours) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Polynomials (R, PATH + 1, W) of rising degree, orthonormal over each neighbourhood.

    Also the quadratic one's second derivative (R,), and which neighbourhoods have frames enough for those beyond it.
    """
    counts = (near.inside & near.enough[:, None]).astype(float)
    tested = counts.sum(-1) >= _TESTED
    reach = np.where(near.enough, np.amax(abs(near.after_s) * counts, -1), 1.0)
    tau = near.after_s / reach[:, None]
    usable = np.stack([near.enough] * 3 + [tested] * (_PATH - 2), -1)
    powers = np.stack([counts * tau**power for power in range(_PATH + 1)], -2) * usable[..., None]
    # a unit in place of each one that there is not enough for
    gram = np.einsum("riw,rjw->rij", powers, powers) + ~usable[..., None] * np.eye(_PATH + 1)
    lower = np.linalg.cholesky(gram)
    return np.linalg.solve(lower, powers), 2.0 / (reach**2 * lower[:, 2, 2]), tested


@dataclass(frozen=True)
class Beam:
    """What the antenna is to its own motion."""

    length_m: float
    stiffness_Nm2: float
    mass_per_length_kg_m: float

    @staticmethod
    def of(rig: Rig) -> Beam:
        """The rig's antenna."""
        antenna = rig.antenna
        return Beam(antenna.length_m, antenna.stiffness_Nm2, antenna.mass_per_length_kg_m)

    @property
    def pieces_m(self) -> np.ndarray:
        """(G,) arc lengths at which the antenna is judged."""
        return (np.arange(PIECES) + 0.5) * (self.length_m / PIECES)

    def first_mode_rad_s(self, contact: np.ndarray) -> np.ndarray:
        """(...) angular frequency of the first bending mode, clamped and touched at fractions (...) of the length.

        The contact keeps the antenna's place and lets it turn. 0 and NaN are the free antenna, which is the slowest.
        """
        place = (_TABLE - 1) * np.clip(np.where(np.isnan(contact), 0.0, contact), 0.0, 1.0)
        left = np.clip(place.astype(np.intp), 0, _TABLE - 2)
        table = _wave_numbers()
        wave = table[left] + (place - left) * (table[left + 1] - table[left])
        return wave**2 * (math.sqrt(self.stiffness_Nm2 / self.mass_per_length_kg_m) / self.length_m**2)


@dataclass(frozen=True, eq=False)
class Shapes:
    """The antenna's fitted shapes in B successive frames; what is not known of a frame is NaN.

    Attributes
    ----------
    time_s : (B,)
    points_m : (B, G, 3) at `Beam.pieces_m`, world frame: the base's motion is in them.
    std_m : (B, 1) or (B, G) what a point scatters by from frame to frame, along any axis: by pixels, by the moment, by
        the joint angles' resolution; not by the calibration, whose error all frames share.
    contact : (B,) distance of the contact in antenna lengths; NaN or 0 where nothing is touched.
    """

    time_s: np.ndarray
    points_m: np.ndarray
    std_m: np.ndarray
    contact: np.ndarray

    def __len__(self) -> int:
        return len(self.time_s)

    def picked(self, which: slice | np.ndarray) -> Shapes:
        """The frames of a slice, a mask or indices."""
        return Shapes(*(each[which] for each in vars(self).values()))

    def followed_by(self, later: Shapes) -> Shapes:
        """Both, one after the other."""
        both = zip(vars(self).values(), vars(later).values(), strict=True)
        return Shapes(*(np.concatenate(each) for each in both))

    @property
    def known(self) -> np.ndarray:
        """(B,) frames that have a time, all points and their standard deviations."""
        points = np.isfinite(self.points_m).all(-1).all(-1)
        return points & (np.isfinite(self.std_m) & (self.std_m > 0.0)).all(-1) & np.isfinite(self.time_s)


@dataclass(frozen=True, eq=False)
class Inertia:
    """What inertia does to the antenna in R frames. NaN where undetermined.

    load_N_m : (R, G, 3) −ρA·a at `Beam.pieces_m`, world frame, beside the weight.
    load_std_N_m : (R, G, 3) standard deviation.
    response : (R,) how much of an oscillation in the first mode frames at these times show, 0 to 1: the load is too
        small by it. 0.70 at 30 frames per second for the free steel antenna, 0.84 with many frames in a period.
        Touched, the antenna rings faster, and at 30 frames per second next to nothing of that is seen: near 0.
    """

    load_N_m: np.ndarray
    load_std_N_m: np.ndarray
    response: np.ndarray

    @property
    def significant(self) -> np.ndarray:
        """(R,) whether noise alone would hardly ever show as much (`_FALSE_ALARM`); False where undetermined."""
        return np.asarray((abs(self.load_N_m) > _threshold() * self.load_std_N_m).any((-1, -2)))


def inertia(shapes: Shapes, beam: Beam, judged: slice = slice(None), *, live: bool = False) -> Inertia:
    """The inertial load in the frames `judged` (R of them) of a recording.

    The acceleration is that of the least-squares parabola over the frames within a quarter of the first mode's period
    on either side, at least one on each. Times that do not increase and gaps of more than half the free antenna's
    period end the neighbourhood: a frame with no neighbour inside it is not judged. Where frames are many and the
    points scatter about a smooth path more than they should, the standard deviation grows by as much.

    With `live` only earlier frames count, at least two: nothing is waited for, and the load is that of about an eighth
    of a period ago.
    """
    mode = beam.first_mode_rad_s(shapes.contact[judged])
    known = shapes.known
    kept = shapes.picked(known) if known.any() else shapes
    place = np.clip(np.cumsum(known)[judged] - 1, 0, None)
    half_period_s = math.pi / float(beam.first_mode_rad_s(np.zeros(())))
    near = _neighbours(kept.time_s, place, 0.5 * math.pi / mode, half_period_s, live=live)
    near = replace(near, enough=near.enough & known[judged])
    acceleration, std, weights = _second_derivative(near, kept.points_m, kept.std_m)
    response = -(weights * np.cos(mode[:, None] * near.after_s)).sum(-1) / mode**2
    density = beam.mass_per_length_kg_m
    return Inertia(-density * acceleration, density * std, response)


class Motion:
    """The judge of a recording that comes in parts, of one frame or more, with bounded memory.

    A frame's verdict comes with the first one that is more than a quarter of the first mode's period later: at 30
    frames per second with the next. With `live` it comes at once, from earlier frames alone.
    """

    def __init__(self, beam: Beam, live: bool = False) -> None:
        self._beam, self._live = beam, live
        self._held: Shapes | None = None
        self._judged = 0

    def push(self, shapes: Shapes) -> Inertia:
        """The verdicts (K,) that these frames make possible: in order, the first on the first that still waited."""
        held = shapes if self._held is None else self._held.followed_by(shapes)
        waiting = held.picked(slice(self._judged, None))
        complete = len(waiting)
        if complete and not self._live:  # the first frames that have all later ones of their neighbourhoods
            time = np.where(np.isfinite(waiting.time_s), waiting.time_s, -np.inf)
            ends = time + 0.5 * math.pi / self._beam.first_mode_rad_s(waiting.contact)
            complete = int(np.cumprod(ends < time.max()).sum())
        return self._judge(held, max(complete, len(waiting) - _MOST))

    def finish(self) -> Inertia | None:
        """The verdicts on the frames that still wait; None if none was ever pushed, or none waits."""
        return None if self._held is None or self._live else self._judge(self._held, len(self._held) - self._judged)

    def _judge(self, held: Shapes, count: int) -> Inertia:
        end = self._judged + count
        verdicts = inertia(held, self._beam, slice(self._judged, end), live=self._live)
        start = max(0, end - _MOST)
        self._held, self._judged = held.picked(slice(start, None)), end - start
        return verdicts


@cache
def _threshold() -> float:
    """Standard deviations that noise exceeds, on any piece and axis, with `_FALSE_ALARM`'s probability."""
    return -float(ndtri(_FALSE_ALARM / (2 * 3 * PIECES)))


@cache
def _wave_numbers() -> np.ndarray:
    """(T,) βL of the first mode, the contact at equal steps from clamp to tip."""
    return np.array([_wave_number(contact) for contact in np.linspace(0.0, 1.0, _TABLE)])


def _wave_number(contact: float) -> float:
    """βL of the first mode of a beam clamped at 0, on a knife edge at the contact (of 1) and free beyond it.

    The moments that the two parts need for a turn at the knife edge cancel.
    """

    from scipy.optimize import brentq  # a single frame is not tested for motion

    def hinged(x: float) -> float:
        return math.cosh(x) * math.sin(x) - math.sinh(x) * math.cos(x)

    def moment(wave: float) -> float:
        inner, outer = wave * contact, wave * (1.0 - contact)
        clamped = 1.0 - math.cosh(inner) * math.cos(inner)
        free = 1.0 + math.cosh(outer) * math.cos(outer)
        return hinged(inner) * free - hinged(outer) * clamped

    return brentq(moment, _CLAMPED_FREE, _FASTEST) if contact > 0.0 else _CLAMPED_FREE
