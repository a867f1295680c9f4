"""A recording over time, and the beginning and end of contact by a sequential test on each frame's evidence for
contact.

A slow approach is visible in several frames together before it is in one, but not in their sum: the calibration's error
is shared by all frames, and a rig that is off within its covariance gives every free frame the same small evidence. So
the last frames are compared with the ones before them, which are this very antenna's when free.

Without contact the evidence follows χ²₃/2, or with a shared error a noncentral χ² of smaller scatter. Its cube root is
nearly normal either way (Wilson and Hilferty 1931), so that the difference of two means follows Student's t, with the
baseline's own uncertainty.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from estimator.table.contacts import ContactTable


@dataclass(frozen=True)
class TrackSettings:
    """Thresholds of contact, loss, slip and vibration over time."""

    half_window_s: float = 0.1  # slips are slopes over the frames within this time
    windows: tuple[int, ...] = (3, 6, 12)  # last frames that are taken together
    false_alarm: float = 1e-6  # probability of one by each window, in a free frame
    baseline_frames: int = 60  # free frames from which the free antenna is learnt, at most
    fewest_baseline: int = 12  # and at least
    lag_frames: int = 30  # last ones left out where enough precede them: a slow approach is in them
    span_rad: float = 0.05  # joint travel within which the free antenna looks alike
    least_scatter: float = 0.2  # of the evidence's cube root
    free_again_std: float = 2.5  # from the baseline's mean: within it one frame ends a firm contact
    firm_evidence: float = 40.0  # in one of the last frames: the contact is firm
    recent_frames: int = 3  # how many these are
    free_together_std: float = 1.0  # from the baseline's mean: within it the mean of several ends a weak contact
    leaving_frames: int = 6  # how many these are
    gap_s: float = 0.5  # over a longer gap nothing is carried
    joined_s: float = 0.15  # swinging frames no farther apart belong together, with those between
    around_s: float = 0.3  # frames before and after that the frequency is estimated from, too
    fewest_frames: int = 8  # for a frequency
    fewest_periods: float = 1.5  # in them
    trial_frequencies: int = 400  # that are compared
    chance: float = 1e-3  # probability that noise alone shows a line as strong, at most
    frames_before: int = 45  # a change whose evidence is used
    frames_after: int = 12  # a change whose evidence is used
    most_forces: int = 6  # after a change that are used, most
    force_s: float = 0.5  # after a change up to which forces are used
    trusted_evidence: float = 60.0  # up to which it grows with the square of the deflection
    hidden_share: float = 0.6  # of the common error behind which a deflection may hide
    stepped_p: float = 0.02  # probability that forces did not grow evenly from zero: a base that moves in steps
    instants: int = 64  # of the change that are compared between frames
    own_share: float = 0.5  # of a force's deviation that differs between frames
    relative_force: float = 0.03  # of a force's size that differs besides
    fewest_smoothed: int = 5  # frames of a piece; shorter ones stay as they are
    least_noise: float = 1e-6  # of a point's own variance in every direction: the filter divides by it
    # how unevenly an approach grows from its start to the last frame used: standard deviation
    uneven_share: float = 0.15
    slip_std: float = 4.5  # standard deviations by which a slip must stand out to begin
    static_slip_std: float = 2.5  # standard deviations by which a slip must stand out to go on
    # of the joints' motion below which nothing slips: curved paths and rolling leave as much
    no_slip_share: float = 0.05
    stuck_share: float = 0.15  # of the joints' motion that a sticking contact surely stays below
    rest_m_s: float = 3e-4  # nothing slower is distinguishable from rest
    radius_m: float = 0.5e-3  # of an antenna without a rig: limits how much a sticking one may roll
    gap_frames: float = 4.0  # a run of located frames ends where so many frames' time passes without one
    fewest_bends: int = 6  # second differences needed for a scatter
    most_scatter: float = 3.0  # largest ratio of a path's scatter across the antenna to the expected one
    least_neighbours: int = 1  # frames on each side that a velocity is taken over, at least
    open_share: float = 0.01  # of a slip that stays open: the object touches an antenna radius from the centreline
    friction_rad: float = 0.35  # standard deviation of the angle between force and normal, across the antenna
    inclined_rad: float = 0.8  # a slip farther from the plane across the force says nothing about the normal


@dataclass(frozen=True)
class Event:
    """An event: its kind, and the number of the frame in which it was detected.

    kind : "first_contact", "loss", "slip_start", "slip_end" or "ringing".
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


ContactChange = tuple[int, bool, np.ndarray, bool]
"""A change between the free antenna and contact: row of the frame with which it was decided; whether a contact begins,
else it is lost; (K,) frames in the state before, empty where that was never seen; whether several frames together show
it, none alone."""


def contact_states(table: ContactTable, ringing: np.ndarray) -> tuple[np.ndarray, tuple[ContactChange, ...], bool]:
    """States of a recording's frames, decided forwards in time as in a live run; vibrating frames are not used.

    Returns (B,) 1 in contact, 0 free, -1 not known; the changes; and whether a baseline could be learnt, so that slow
    approaches show early.
    """
    # in contact; `no_contact` is free, all others are neither
    contact_by_status = np.where(
        np.isin(table.status, ("ok", "tip_contact", "low_signal")), 1, np.where(table.status == "no_contact", 0, -1)
    )
    contact_by_status = np.where(ringing, -1, contact_by_status)
    joints = np.column_stack([table.pan_rad, table.tilt_rad])
    root = np.cbrt(np.clip(table.evidence, 0.0, None))
    state = np.full(len(table), -1)
    changes: list[ContactChange] = []
    run: list[int] = []
    now, tested, last = -1, False, -np.inf
    for row in np.flatnonzero(contact_by_status >= 0).tolist():
        if table.time_s[row] - last > TrackSettings.gap_s:
            now, run = -1, []
        last, alone = float(table.time_s[row]), int(contact_by_status[row])
        before = changes[-1][2] if changes and changes[-1][1] else np.empty(0, int)
        # the last free frames in poses like this frame's; none where the joints are not known
        base = np.array(baseline_candidates(run if now == 0 else before.tolist()), int)
        base = base[
            (np.abs(joints[base] - joints[row]) <= TrackSettings.span_rad).all(axis=1) & np.isfinite(root[base])
        ]
        if now == 1:
            late = np.array([*run[1 - TrackSettings.leaving_frames :], row])
            if not (table.evidence[run[-TrackSettings.recent_frames :]] <= TrackSettings.firm_evidence).all():
                stays = _exceeds(root[[row]], root[base], TrackSettings.free_again_std)
            else:  # a weak contact continues over a few frames, with one clear frame, or by all together
                some = len(late) < TrackSettings.leaving_frames or bool((contact_by_status[late] == 1).any())
                stays = some or _exceeds(root[late], root[base], TrackSettings.free_together_std)
            found = 1 if alone == 1 or stays else 0
        else:
            several = alone == 0 and now == 0 and _rises(root, [*run[-TrackSettings.windows[-1] :], row], base)
            tested = tested or len(base) >= TrackSettings.fewest_baseline
            found = 1 if alone == 1 or several else 0
        if found != now:
            if now != -1 or found == 1:
                changes.append((row, found == 1, np.array(run, int), alone == 0 and found == 1))
            now, run = found, []
        run.append(row)
        state[row] = now
    return state, tuple(changes), tested


def baseline_candidates(free: Sequence[int]) -> Sequence[int]:
    """The frames of a free run that precede any slow approach."""
    recent = free[-TrackSettings.baseline_frames - TrackSettings.lag_frames :]
    early = (
        recent[: -TrackSettings.lag_frames]
        if len(recent) >= TrackSettings.lag_frames + TrackSettings.fewest_baseline
        else recent[: -TrackSettings.windows[-1]]
    )
    return early[-TrackSettings.baseline_frames :]


def _rises(root: np.ndarray, run: Sequence[int], base: np.ndarray) -> bool:
    """Whether the evidence of a free run's last frames exceeds the baseline's significantly."""
    if len(base) < TrackSettings.fewest_baseline:
        return False
    mean, scatter = _normal(root[base])
    limit = scatter * _threshold(len(base) - 1)
    return any(
        root[list(run[-window:])].mean() - mean > limit * np.sqrt(1.0 / window + 1.0 / len(base))
        for window in TrackSettings.windows
        if len(run) >= window
    )


def _normal(values: np.ndarray) -> tuple[float, float]:
    """Mean and standard deviation, increased where neighbouring frames are correlated and count for fewer."""
    mean, scatter = float(values.mean()), float(values.std(ddof=1))
    away = values - mean
    alike = float(away[1:] @ away[:-1]) / max(float(away @ away), 1e-30)
    alike = min(max(alike, 0.0), 0.8)
    return mean, max(scatter, TrackSettings.least_scatter) * float(np.sqrt((1.0 + alike) / (1.0 - alike)))


def _exceeds(late: np.ndarray, base: np.ndarray, deviations: float) -> bool:
    """Whether the mean of some frames exceeds the free antenna's by `deviations` of its standard deviations."""
    if len(base) < TrackSettings.fewest_baseline or not np.isfinite(late).all():
        return False
    mean, scatter = _normal(base)
    return bool(late.mean() > mean + deviations * scatter / np.sqrt(len(late)))


@lru_cache(maxsize=TrackSettings.baseline_frames)
def _threshold(freedom: int) -> float:
    from scipy.special import stdtrit  # slow to load

    return -float(stdtrit(freedom, TrackSettings.false_alarm))
