"""What following a recording in time gives; and when contact begins and ends: a sequential test on the evidence that
each frame gives for a contact.

A slow approach shows in several frames together before it shows in one, but not in their sum: the calibration's
error is common to all frames, and a rig that is off within its covariance gives every free frame the same little
evidence. So the last frames are held against the ones before them, which is what this very antenna shows when free.

Without contact the evidence follows χ²₃/2, or with a common error a noncentral χ² of smaller scatter. Its cube root is
nearly normal either way (Wilson and Hilferty 1931), so that the difference of two means follows Student's t, the
baseline's own uncertainty included.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.special import stdtrit

from estimator.table.contacts import ContactTable

FREE, TOUCHING, STICKING, SLIDING, ROLLING, UNKNOWN = "free", "touching", "sticking", "sliding", "rolling", "unknown"
FIRST_CONTACT, LOSS, SLIP_START, SLIP_END, RINGING = "first_contact", "loss", "slip_start", "slip_end", "ringing"

HALF_WINDOW_S = 0.1  # slips are slopes over the frames within this time
_WINDOWS = (3, 6, 12)  # last frames that are taken together
_ALARM = 1e-6  # probability of a false alarm by each of the windows, in a frame of the free antenna
# free frames that the free antenna is learnt from, at most and at least; so many of the last are left out where
# there are enough before them: a slow approach is in them
_BASELINE, _LEAST_BASELINE, _LAG = 60, 12, 30
_SPAN_RAD = 0.05  # it looks alike within so much joint travel: a weight that is known badly shows with the pose
_LEAST_SCATTER = 0.2  # of the cube root, below which no recording is believed: something else would drift
# a contact with that much evidence in one of its last frames is lost with the first frame that is within so many
# deviations of the baseline's mean; a weaker one with the mean of so many: near the threshold noise alone would end it
_FREE_AGAIN, _FIRM, _RECENT = 2.5, 40.0, 3
_FREE_TOGETHER, _LEAVING = 1.0, 6
_GAP_S = 0.5  # over a longer gap nothing is carried: what happened in it is not known
_TOUCHING = ("ok", "tip_contact", "low_signal")  # in contact; `no_contact` is free, all others are neither


@dataclass(frozen=True)
class Event:
    """Something that happened: its kind, and the number of the frame with which it was known.

    `time_s`, `time_std_s` say when it happened, NaN where that is undetermined, `delay_s` how much later it was known,
    `words` the same for a reader.
    """

    kind: str
    frame: int
    time_s: float
    time_std_s: float
    delay_s: float
    words: str


@dataclass(frozen=True, eq=False)
class Track:
    """A recording of B frames in time.

    Attributes
    ----------
    phase : (B,) "free", "touching": the motion is undecided, "sticking", "sliding", "rolling", or "unknown": not even
        contact is known.
    slip_velocity_m_s, slip_covariance_m2_s2 : (B, 3), (B, 3, 3) world, of the antenna's material point at the contact
        against the object, in the plane of contact; NaN where the data do not hold it.
    slip_std_m_s : (B,) largest standard deviation of its components.
    longitudinal_m_s, lateral_m_s : (B,) along the antenna towards the tip, and along normal × tangent.
    ringing : (B,) bool. events : in order of time. notes : what the recording leaves undetermined, in words.
    """

    phase: np.ndarray
    slip_velocity_m_s: np.ndarray
    slip_std_m_s: np.ndarray
    longitudinal_m_s: np.ndarray
    lateral_m_s: np.ndarray
    slip_covariance_m2_s2: np.ndarray
    ringing: np.ndarray
    events: tuple[Event, ...]
    notes: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class ContactChange:
    """A change between the free antenna and contact."""

    row: int  # of the frame with which it was decided
    begins: bool  # a contact begins; else it is lost
    known_before: np.ndarray  # (K,) frames in the state before, empty where that was never seen
    pooled: bool  # several frames together show it, none alone


@dataclass(frozen=True, eq=False)
class ContactStates:
    """The states of frames as they were decided in time."""

    state: np.ndarray  # (B,) 1 in contact, 0 free, -1 not known
    changes: tuple[ContactChange, ...]
    pooled_test: bool  # a baseline could be learnt, so that slow approaches show early


def contact_states(table: ContactTable, ringing: np.ndarray) -> ContactStates:
    """Go through a recording once, forward, as a live judge would; a ringing antenna says nothing."""
    said = np.where(np.isin(table.status, _TOUCHING), 1, np.where(table.status == "no_contact", 0, -1))
    said = np.where(ringing, -1, said)
    joints = np.column_stack([table.pan_rad, table.tilt_rad])
    root = np.cbrt(np.clip(table.evidence, 0.0, None))
    state = np.full(len(table), -1)
    changes: list[ContactChange] = []
    run: list[int] = []
    now, tested, last = -1, False, -np.inf
    for row in np.flatnonzero(said >= 0).tolist():
        if table.time_s[row] - last > _GAP_S:
            now, run = -1, []
        last, alone = float(table.time_s[row]), int(said[row])
        before = changes[-1].known_before if changes and changes[-1].begins else np.empty(0, int)
        # the last free frames in poses like this frame's; none where the joints are not known
        base = np.array(baseline_candidates(run if now == 0 else before.tolist()), int)
        base = base[(np.abs(joints[base] - joints[row]) <= _SPAN_RAD).all(axis=1) & np.isfinite(root[base])]
        if now == 1:
            late = np.array([*run[1 - _LEAVING :], row])
            if not (table.evidence[run[-_RECENT:]] <= _FIRM).all():
                stays = _exceeds(root[[row]], root[base], _FREE_AGAIN)
            else:  # a weak contact continues over a few frames, with one clear frame, or by all together
                some = len(late) < _LEAVING or bool((said[late] == 1).any())
                stays = some or _exceeds(root[late], root[base], _FREE_TOGETHER)
            found = 1 if alone == 1 or stays else 0
        else:
            several = alone == 0 and now == 0 and _rises(root, [*run[-_WINDOWS[-1] :], row], base)
            tested = tested or len(base) >= _LEAST_BASELINE
            found = 1 if alone == 1 or several else 0
        if found != now:
            if now != -1 or found == 1:
                changes.append(ContactChange(row, found == 1, np.array(run, int), alone == 0 and found == 1))
            now, run = found, []
        run.append(row)
        state[row] = now
    return ContactStates(state, tuple(changes), tested)


def baseline_candidates(free: Sequence[int]) -> Sequence[int]:
    """Of the frames of a free run those that no slow approach is in yet."""
    recent = free[-_BASELINE - _LAG :]
    early = recent[:-_LAG] if len(recent) >= _LAG + _LEAST_BASELINE else recent[: -_WINDOWS[-1]]
    return early[-_BASELINE:]


def _rises(root: np.ndarray, run: Sequence[int], base: np.ndarray) -> bool:
    """Whether the last frames of a run of free ones show more than the baseline's, and noise would hardly ever."""
    if len(base) < _LEAST_BASELINE:
        return False
    mean, scatter = _normal(root[base])
    limit = scatter * _threshold(len(base) - 1)
    return any(
        root[list(run[-window:])].mean() - mean > limit * np.sqrt(1.0 / window + 1.0 / len(base))
        for window in _WINDOWS
        if len(run) >= window
    )


def _normal(values: np.ndarray) -> tuple[float, float]:
    """Mean and standard deviation, the latter larger where neighbouring frames are alike: they count for fewer."""
    mean, scatter = float(values.mean()), float(values.std(ddof=1))
    away = values - mean
    alike = float(away[1:] @ away[:-1]) / max(float(away @ away), 1e-30)
    alike = min(max(alike, 0.0), 0.8)
    return mean, max(scatter, _LEAST_SCATTER) * float(np.sqrt((1.0 + alike) / (1.0 - alike)))


def _exceeds(late: np.ndarray, base: np.ndarray, deviations: float) -> bool:
    """Whether the mean of some frames is more than the free antenna's by so many of its deviations."""
    if len(base) < _LEAST_BASELINE or not np.isfinite(late).all():
        return False
    mean, scatter = _normal(base)
    return bool(late.mean() > mean + deviations * scatter / np.sqrt(len(late)))


@lru_cache(maxsize=_BASELINE)
def _threshold(freedom: int) -> float:
    return -float(stdtrit(freedom, _ALARM))


def median_step(time_s: np.ndarray) -> float:
    """Median time from frame to frame; infinite where there is none."""
    steps = np.diff(time_s[np.isfinite(time_s)])
    steps = steps[steps > 0.0]
    return float(np.median(steps)) if len(steps) else np.inf
