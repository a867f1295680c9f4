"""Test whether the antenna is at rest. Frames are fitted as static shapes; where the antenna vibrates or its base
shakes, inertia bends it as weight does, and a static fit shifts the contact.

The shapes of successive frames in the *world* frame give the acceleration of every piece of the antenna, that gives the
load per length q = −ρA·a, and that the deflection which the static fit attributed to the contact.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np

from vbaa_calib.antenna.taper import UNIFORM, Taper
from vbaa_calib.core.arrays import Rows
from vbaa_calib.native import core
from vbaa_calib.rig import Rig

from .settings import ContactSettings

PIECES = core.solver.PIECES
"""The antenna is judged at the middles of so many equal pieces; each one's inertia acts there as a point force."""
_TABLE = 65  # places of a contact at which the first mode is tabulated


@dataclass(frozen=True)
class Beam:
    """Dynamic properties of the antenna."""

    length_m: float
    stiffness_Nm2: float
    mass_per_length_kg_m: float
    taper: Taper = UNIFORM

    @staticmethod
    def of(rig: Rig) -> Beam:
        """The beam of the rig's antenna."""
        antenna = rig.antenna
        return Beam(antenna.length_m, antenna.stiffness_Nm2, antenna.mass_per_length_kg_m, antenna.taper)

    @property
    def pieces_m(self) -> np.ndarray:
        """(G,) arc lengths at which motion is tested."""
        return (np.arange(PIECES) + 0.5) * (self.length_m / PIECES)

    @cached_property
    def slowest_rad_s(self) -> float:
        """Angular frequency of the free antenna's first bending mode."""
        return float(self.first_mode_rad_s(np.zeros(())))

    @cached_property
    def _wave_numbers(self) -> np.ndarray:
        return _wave_numbers_of(self.taper) if self.taper else _wave_numbers()

    def first_mode_rad_s(self, contact: np.ndarray) -> np.ndarray:
        """(...) angular frequency of the first bending mode, clamped and touched at fractions (...) of the length.

        The contact keeps the antenna's place and lets it turn. 0 and NaN are the free antenna, which is the slowest.
        """
        place = (_TABLE - 1) * np.clip(np.where(np.isnan(contact), 0.0, contact), 0.0, 1.0)
        left = np.clip(place.astype(np.intp), 0, _TABLE - 2)
        table = self._wave_numbers
        wave = table[left] + (place - left) * (table[left + 1] - table[left])
        return wave**2 * (math.sqrt(self.stiffness_Nm2 / self.mass_per_length_kg_m) / self.length_m**2)


@dataclass(frozen=True, eq=False)
class Shapes(Rows):
    """Fitted shapes of the antenna in B successive frames; NaN where unknown.

    Attributes
    ----------
    time_s : (B,)
    points_m : (B, G, 3) at `Beam.pieces_m`, world frame: the base's motion is in them.
    std_m : (B, 1) or (B, G) what a point scatters by from frame to frame, along any axis: by pixels, by the moment, by
        the joint angles' resolution; not by the calibration: all frames share its error.
    contact : (B,) distance of the contact in antenna lengths; NaN or 0 where nothing is touched.
    """

    time_s: np.ndarray
    points_m: np.ndarray
    std_m: np.ndarray
    contact: np.ndarray

    @property
    def known(self) -> np.ndarray:
        """(B,) mask of the frames with a time, all points and their standard deviations."""
        points = np.isfinite(self.points_m).all(-1).all(-1)
        return points & (np.isfinite(self.std_m) & (self.std_m > 0.0)).all(-1) & np.isfinite(self.time_s)


@dataclass(frozen=True, eq=False)
class Inertia:
    """Effect of inertia on the antenna in R frames. NaN where undetermined.

    load_N_m : (R, G, 3) −ρA·a at `Beam.pieces_m`, world frame, in addition to the weight.
    load_std_N_m : (R, G, 3) standard deviation.
    response : (R,) share of an oscillation in the first mode, 0 to 1, that frames at these times show; the load is too
        small by this factor. 0.70 at 30 frames per second for the free steel antenna, 0.84 with many frames in a
        period. Touched, the antenna rings faster, and at 30 frames per second next to nothing of that is seen: near 0.
    """

    load_N_m: np.ndarray
    load_std_N_m: np.ndarray
    response: np.ndarray

    @property
    def significant(self) -> np.ndarray:
        """(R,) mask of the frames with an inertial load that exceeds noise, at a false-alarm rate of
        `motion_false_alarm`. False where undetermined."""
        return np.asarray((abs(self.load_N_m) > _threshold() * self.load_std_N_m).any((-1, -2)))


def _inertia(shapes: Shapes, beam: Beam, judged: slice = slice(None), *, live: bool = False) -> Inertia:
    """The inertial load in the R frames `judged` of a recording.

    The acceleration is that of the least-squares parabola over the frames within a quarter of the first mode's period
    on either side, at least one on each. Times that do not increase and gaps of more than half the free antenna's
    period end the neighbourhood: a frame with no neighbour inside it is not judged. Where frames are many and the
    points scatter about a smooth path more than they should, the standard deviation grows by as much.

    With `live` only earlier frames count, at least two: nothing is waited for, and the load is that of about an eighth
    of a period ago.
    """
    mode = beam.first_mode_rad_s(shapes.contact[judged])
    known = shapes.known
    kept = shapes if known.all() else shapes.picked(known)
    place = (np.cumsum(known) - 1)[judged]
    rows, points, std = known[judged], np.ascontiguousarray(kept.points_m), np.ascontiguousarray(kept.std_m)
    longest_s = math.pi / beam.slowest_rad_s
    each = core.solver.accelerations(
        kept.time_s, points, std, place[rows], mode[rows], longest_s, ContactSettings.motion_frames, live
    )
    if rows.all():
        acceleration, std, response = each
    else:
        among = np.where(rows, np.cumsum(rows) - 1, -1)
        acceleration, std, response = (np.append(one, np.full((1, *one.shape[1:]), np.nan), 0)[among] for one in each)
    density = beam.mass_per_length_kg_m * beam.taper.diameter(beam.pieces_m / beam.length_m)[:, None] ** 2
    return Inertia(-density * acceleration, density * std, response)


class Motion:
    """Motion test of a recording that comes in parts, of one frame or more, with bounded memory.

    A frame's verdict comes with the first one that is more than a quarter of the first mode's period later: at 30
    frames per second with the next. With `live` it comes at once, from earlier frames alone.
    """

    def __init__(self, beam: Beam, live: bool = False) -> None:
        self._beam, self._live = beam, live
        self._kept: Shapes | None = None
        self._judged = 0

    def push(self, shapes: Shapes) -> Inertia:
        """The results (K,) that these frames make possible: in order, beginning with the first pending frame."""
        kept = shapes if self._kept is None else Shapes.joined([self._kept, shapes])
        waiting = complete = len(kept) - self._judged
        if complete and not self._live:  # the first frames that have all later ones of their neighbourhoods
            late = kept.picked(slice(self._judged, None))
            time = np.where(np.isfinite(late.time_s), late.time_s, -np.inf)
            ends = time + 0.5 * math.pi / self._beam.first_mode_rad_s(late.contact)
            complete = int(np.cumprod(ends < time.max()).sum())
        return self._judge(kept, max(complete, waiting - ContactSettings.motion_frames))

    def finish(self) -> Inertia | None:
        """The results for the pending frames; None if there are none."""
        return None if self._kept is None or self._live else self._judge(self._kept, len(self._kept) - self._judged)

    def _judge(self, kept: Shapes, count: int) -> Inertia:
        end = self._judged + count
        verdicts = _inertia(kept, self._beam, slice(self._judged, end), live=self._live)
        start = max(0, end - ContactSettings.motion_frames)
        self._kept, self._judged = kept.picked(slice(start, None)), end - start
        return verdicts


@cache
def _threshold() -> float:
    """Number of standard deviations that noise exceeds, on any piece and axis, with probability
    `motion_false_alarm`."""
    from statistics import NormalDist

    return -NormalDist().inv_cdf(ContactSettings.motion_false_alarm / (2 * 3 * PIECES))


@cache
def _wave_numbers() -> np.ndarray:
    """(T,) βL of the first mode of a beam that is clamped at 0, supported at the contact and free beyond it, for
    contacts at equal steps from clamp to tip.

    At the mode the two parts need opposite moments for a common turn at the support; found by bisection.
    """

    def hinged(x: np.ndarray) -> np.ndarray:
        return np.cosh(x) * np.sin(x) - np.sinh(x) * np.cos(x)

    def moment(wave: np.ndarray) -> np.ndarray:
        inner, outer = wave * contact, wave * (1.0 - contact)
        clamped = 1.0 - np.cosh(inner) * np.cos(inner)
        free = 1.0 + np.cosh(outer) * np.cos(outer)
        return hinged(inner) * free - hinged(outer) * clamped

    contact = np.linspace(0.0, 1.0, _TABLE)
    # βL of the free antenna's first mode, and a bound for any contact's, where it sits on a node of the second mode
    clamped_free, fastest = 1.8751040687119611, 4.6945
    low, high = np.full(_TABLE, clamped_free), np.full(_TABLE, fastest)
    sign = np.sign(moment(low))
    for _ in range(52):
        middle = 0.5 * (low + high)
        same = np.sign(moment(middle)) == sign
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    return np.where(contact > 0.0, 0.5 * (low + high), clamped_free)


def _wave_numbers_of(taper: Taper) -> np.ndarray:
    """(T,) as `_wave_numbers` for a tapered antenna, from its frequency relative to a uniform one's, by finite
    elements."""
    from scipy.linalg import eigh  # slow to load

    count, width = _TABLE - 1, 1.0 / (_TABLE - 1)
    h, stiff, heavy = width, np.zeros((2 * _TABLE, 2 * _TABLE)), np.zeros((2 * _TABLE, 2 * _TABLE))
    bend = np.array([[12, 6 * h, -12, 6 * h], [6 * h, 4 * h * h, -6 * h, 2 * h * h]])
    bend = np.vstack([bend, [-12, -6 * h, 12, -6 * h], [6 * h, 2 * h * h, -6 * h, 4 * h * h]]) / h**3
    weigh = np.array([[156, 22 * h, 54, -13 * h], [22 * h, 4 * h * h, 13 * h, -3 * h * h]])
    weigh = np.vstack([weigh, [54, 13 * h, 156, -22 * h], [-13 * h, -3 * h * h, -22 * h, 4 * h * h]]) * h / 420
    middle = (np.arange(count) + 0.5) * width
    for k, (soft, thick) in enumerate(zip(taper.stiffness(middle), taper.diameter(middle) ** 2, strict=True)):
        own = slice(2 * k, 2 * k + 4)
        stiff[own, own] += soft * bend
        heavy[own, own] += thick * weigh
    found = []
    for contact in range(_TABLE):
        # the clamp's place and turn, and the contact's place, are kept
        free = np.setdiff1d(np.arange(2, 2 * _TABLE), [2 * contact])
        both = stiff[np.ix_(free, free)], heavy[np.ix_(free, free)]
        found.append(eigh(*both, eigvals_only=True, subset_by_index=[0, 0])[0])
    return np.asarray(np.sqrt(np.sqrt(np.array(found))))
