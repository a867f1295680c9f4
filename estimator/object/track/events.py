"""What happened, from the states and phases of a recording's frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.special import log_ndtr, logsumexp

from estimator.contact.motion import Beam
from estimator.table.contacts import LOCATED, ContactTable

from .onset import (
    FIRST_CONTACT,
    HALF_WINDOW_S,
    LOSS,
    RINGING,
    ROLLING,
    SLIDING,
    SLIP_END,
    SLIP_START,
    STICKING,
    Change,
    ContactStates,
    Event,
    baseline_candidates,
    median_step,
)

# swinging frames no further apart belong together, the frames between them too: at its turning points an antenna
# swings, half way between them it looks at rest
_JOINED_S = 0.15
_AROUND_S = 0.3  # frames before and after that the frequency is estimated from, too
_LEAST_FRAMES, _LEAST_PERIODS, _TRIALS = 8, 1.5, 400
_CHANCE = 1e-3  # probability that noise alone shows a line as strong, at most
_BEFORE, _AFTER = 45, 12  # frames around a change whose evidence is looked at
_FORCES, _FORCE_S = 6, 0.5  # forces after a change that are looked at: at most so many, and none later than this
_TRUSTED = 60.0  # evidence up to which it grows with the square of the deflection
_RATES = np.geomspace(0.3, 30.0, 36)  # trial rates of growth over the one that the last frame alone would ask for
_COSINES = np.linspace(-0.8, 0.8, 5)
# trial changes of the rate over the frames looked at, in `_UNEVEN`s, and their probabilities; `_UNEVEN` is how unevenly
# an approach is thought to grow from t₀ to the last frame looked at: standard deviation of the share
_BENDS, _SHARES, _UNEVEN = np.array([-1.4, 0.0, 1.4]), np.array([0.25, 0.5, 0.25]), 0.15
# part of the common error behind which a deflection may hide besides: distance and direction are fitted to that error
# first, and only later to the contact
_HIDDEN = 0.6
# probability that forces did not grow from zero at one rate: a base that moves in steps lands between two frames
_STEPPED = 0.02
_INSTANTS = 64
_OWN_SHARE, _RELATIVE = 0.5, 0.03  # how much of a force's deviation differs between frames, and of its size besides


def ringing_frames(table: ContactTable) -> np.ndarray:
    """(B,) bool: the frame is `not_quasistatic`, or between two such."""
    swings = np.flatnonzero(table.status == "not_quasistatic")
    found = np.zeros(len(table), bool)
    found[swings] = True
    for first, second in pairwise(swings):
        if table.time_s[second] - table.time_s[first] <= _JOINED_S:
            found[first : second + 1] = True
    return found


def ringing_events(table: ContactTable, ringing: np.ndarray, beam: Beam | None) -> tuple[Event, ...]:
    """One for each run of swinging frames."""
    ends = np.flatnonzero(np.diff(np.concatenate([[False], ringing, [False]]).astype(int)))
    step = median_step(table.time_s)
    std = step / np.sqrt(12.0) if np.isfinite(step) else np.nan
    # a frame without a time stands where the one before it does
    clock = np.nan_to_num(np.fmax.accumulate(table.time_s), nan=-np.inf)
    events = []
    for begin, end in ends.reshape(-1, 2):
        time = table.time_s[begin:end]
        first, last = np.searchsorted(clock, time[0] - _AROUND_S), np.searchsorted(clock, time[-1] + _AROUND_S, "right")
        pace = _frequency_words(table, slice(first, last), beam, step)
        words = f"the antenna swings from {time[0]:.3f} s to {time[-1]:.3f} s; {pace}"
        events.append(Event(RINGING, int(table.frame[begin]), float(time[0]), std, 0.0, words))
    return tuple(events)


def _frequency_words(table: ContactTable, near: slice, beam: Beam | None, step: float) -> str:
    known = np.isfinite(table.evidence[near]) & np.isfinite(table.time_s[near])
    time, signal = table.time_s[near][known], np.sqrt(2.0 * np.clip(table.evidence[near][known], 0.0, None))
    if len(time) < _LEAST_FRAMES or not np.isfinite(step):
        return "too few frames for a frequency"
    fastest = 0.5 / step
    free_Hz = 0.0 if beam is None else float(beam.first_mode_rad_s(np.zeros(()))) / (2.0 * np.pi)
    if free_Hz > 0.9 * fastest:
        return f"its first mode, {free_Hz:.1f} Hz or more, is too fast for {1.0 / step:.0f} frames a second"
    found = frequency(time, signal, fastest)
    if found is None:
        return "no one frequency stands out"
    doubt = "(or, of a free antenna that swings about rest, half of it)"
    return f"its bend comes and goes at {found[0]:.1f} ± {found[1]:.1f} Hz {doubt}, observable up to {fastest:.0f} Hz"


def frequency(time_s: np.ndarray, signal: np.ndarray, fastest_Hz: float) -> tuple[float, float] | None:
    """Frequency in Hz and standard deviation of the strongest line in a signal (N,) beside a slope (Lomb–Scargle); None
    where noise would show as much (beta distribution of the power's share)."""
    time = time_s - time_s.mean()
    away = signal - np.polyval(np.polyfit(time, signal, 1), time)
    span, count = float(np.ptp(time)), len(time)
    slowest = _LEAST_PERIODS / span if span > 0.0 else np.inf
    if not slowest < fastest_Hz or count < _LEAST_FRAMES or not (away @ away) > 0.0:
        return None
    from scipy.signal import lombscargle  # takes a quarter of a second to load

    trials = np.linspace(slowest, fastest_Hz, _TRIALS)
    share = lombscargle(time, away, 2.0 * np.pi * trials, normalize=True)
    best = int(np.argmax(share))
    independent = max(span * (fastest_Hz - slowest), 1.0)
    if independent * (1.0 - min(share[best], 1.0)) ** (0.5 * (count - 3)) > _CHANCE:
        return None
    left = max(1.0 - float(share[best]), 1e-6)
    std = np.sqrt(6.0 * left / (float(share[best]) * count)) / (np.pi * span)
    return float(trials[best]), float(np.hypot(std, (trials[1] - trials[0]) / np.sqrt(12.0)))


@dataclass(frozen=True, eq=False)
class _Growth:
    """What surrounds a change, in order of time; a loss is looked at backwards."""

    time_s: np.ndarray  # (N,) of frames before and after
    evidence: np.ndarray  # (N,)
    free_evidence: np.ndarray  # (K,) of frames that are free for certain
    force_time_s: np.ndarray  # (F,) of the first located frames
    force_N: np.ndarray  # (F,)
    force_std_N: np.ndarray  # (F,)
    earliest_s: float  # bounds of the instant
    latest_s: float


def _instant(growth: _Growth) -> tuple[float, float]:
    """t₀ and its standard deviation, s."""
    low, high = growth.earliest_s, growth.latest_s
    mean, std = 0.5 * (low + high), (high - low) / np.sqrt(12.0)
    likeliest = None
    for _ in range(3):  # each time on a finer grid about what was found
        step = (high - low) / _INSTANTS
        at = low + (np.arange(_INSTANTS) + 0.5) * step
        by_force = _by_force(growth, at)
        likeliest = by_force.max() if likeliest is None else likeliest
        log = _by_evidence(growth, at) + np.logaddexp(np.log1p(-_STEPPED) + by_force - likeliest, np.log(_STEPPED))
        weight = np.exp(log - log.max())
        weight /= weight.sum()
        mean = float(weight @ at)
        std = float(np.sqrt(weight @ (at - mean) ** 2 + step**2 / 12.0))
        reach = 6.0 * np.hypot(std, step)
        low, high = max(low, mean - reach), min(high, mean + reach)
    # the rate by the last frame whose evidence can be trusted or, beyond, is known to be more
    after = np.flatnonzero((growth.time_s > mean) & np.isfinite(growth.evidence))
    if not len(after):
        return mean, std
    trusted = after[growth.evidence[after] <= _TRUSTED]
    last = trusted[-1] if len(trusted) else after[0]
    more = max(float(growth.evidence[last]) - _free_level(growth.free_evidence)[0], 1.0)
    rate_per_s = float(np.sqrt(2.0 * more) / (growth.time_s[last] - mean))
    return mean, float(np.hypot(std, _HIDDEN * _common(growth) / rate_per_s))


def _common(growth: _Growth) -> float:
    """The common error in deviations."""
    level, noise = _free_level(growth.free_evidence)
    return float(np.sqrt(max(2.0 * level - 3.0 * noise, 0.0)))


def _free_level(evidence: np.ndarray) -> tuple[float, float]:
    """Mean evidence E₀ of free frames (K,) and ε², their noise alone; what theory says where there are too few."""
    if len(evidence) < 5:
        return 1.5, 1.0
    mean, variance = max(float(evidence.mean()), 0.05), float(evidence.var(ddof=1))
    inside = max(4.0 * mean**2 - 6.0 * variance, 0.0)
    return mean, max((2.0 * mean - np.sqrt(inside)) / 3.0, 0.01)


def _by_evidence(growth: _Growth, at: np.ndarray) -> np.ndarray:
    """(A,) log-likelihood of t₀ by the evidence, up to the first frame of which it is only known to be much."""
    much = np.flatnonzero(growth.evidence > _TRUSTED)
    end = int(much[0]) + 1 if len(much) else len(growth.evidence)
    # frames before that carry no information
    telling = np.isfinite(growth.evidence[:end]) & (growth.time_s[:end] > at[0])
    used = np.flatnonzero(telling)
    if len(used) == 0:
        return np.zeros(len(at))
    time, evidence = growth.time_s[used], np.minimum(growth.evidence[used], _TRUSTED)
    root = np.cbrt(np.clip(evidence, 0.0, None))
    (level, noise), common = _free_level(growth.free_evidence), _common(growth)
    late = np.clip(time - at[:, None], 0.0, None)  # (A, N)
    span = max(float(time[-1] - at[0]), 1e-9)
    reached = np.sqrt(2.0 * max(float(evidence[-1]) - level, 1.0))
    rate = _RATES * (reached / np.maximum(late[:, -1:], 1e-3 * span))  # (A, G)
    bend = 1.0 + _UNEVEN * _BENDS[:, None] * (late / span)[:, None]  # (A, 3, N)
    x = rate[:, :, None, None] * (bend * late[:, None])[:, None]  # (A, G, 3, N)
    log = np.empty((*x.shape[:3], len(_COSINES)))
    for index, cosine in enumerate(_COSINES):
        expected = level + cosine * common * x + 0.5 * x**2
        variance = np.maximum(2.0 * noise * (expected - 1.5 * noise), 0.0) + 1.5 * noise**2
        skew = variance / expected**2 / 9.0  # the cube root is nearly normal, also where there is hardly a deflection
        middle, spread = np.cbrt(expected) * (1.0 - skew), np.cbrt(expected) ** 2 * skew
        each = -0.5 * ((root - middle) ** 2 / spread + np.log(spread))
        if len(much):
            each[..., -1] = log_ndtr((middle[..., -1] - np.cbrt(_TRUSTED)) / np.sqrt(spread[..., -1]))
        log[..., index] = each.sum(axis=-1)
    return logsumexp(log + np.log(_SHARES)[:, None], axis=(1, 2, 3))


def _by_force(growth: _Growth, at: np.ndarray) -> np.ndarray:
    """(A,) log-likelihood of t₀ by forces on a line from zero, its slope free, a bend and a common error allowed."""
    if len(growth.force_N) < 2 or not growth.force_time_s[-1] > at[-1]:
        return np.zeros(len(at))
    late = growth.force_time_s - at[:, None]  # (A, F)
    span = late[:, -1:]
    rate = growth.force_N[-1] / span  # what the bend is a share of
    bow = _UNEVEN * rate * late * (late / span - 1.0)
    own = (_OWN_SHARE * growth.force_std_N) ** 2 + (_RELATIVE * growth.force_N) ** 2
    common = float(growth.force_std_N[0]) ** 2
    covariance = np.eye(late.shape[1]) * own + common + bow[:, :, None] * bow[:, None]
    weight = np.linalg.inv(covariance)
    pull = (weight @ growth.force_N[:, None])[..., 0]
    slope_weight = (late[:, None] @ weight @ late[..., None])[:, 0, 0]
    slope = (late * pull).sum(axis=-1) / slope_weight
    cost = (growth.force_N * pull).sum(axis=-1) - slope**2 * slope_weight
    # the flat prior of the slope is taken per instant: over the force that it reaches, not over the slope itself
    flat = np.log(slope_weight) - 2.0 * np.log(span[:, 0])
    return -0.5 * (cost + np.linalg.slogdet(covariance)[1] + flat)


def contact_events(table: ContactTable, contacting: ContactStates) -> tuple[Event, ...]:
    """First contacts and losses, timed by the growth of the deflection."""
    told = np.flatnonzero((contacting.state >= 0) & np.isfinite(table.evidence))
    return tuple(_change(table, contacting, change, told) for change in contacting.changes)


def slip_events(table: ContactTable, phase: np.ndarray, strokes: Sequence[np.ndarray]) -> tuple[Event, ...]:
    """Where sticking turns into sliding and back; `strokes` are rows of the table."""
    found = []
    for rows in strokes:
        decided = rows[np.isin(phase[rows], (STICKING, ROLLING, SLIDING))]
        slides = phase[decided] == SLIDING
        for at in np.flatnonzero(slides[1:] != slides[:-1]):
            after = decided[at + 1]
            low, high = table.time_s[decided[at]], table.time_s[after]
            time, std = float(0.5 * (low + high)), float(np.hypot((high - low) / np.sqrt(12.0), 0.3 * HALF_WINDOW_S))
            kind, what = (SLIP_START, "the contact begins to slip") if slides[at + 1] else (SLIP_END, "the slip ends")
            words = f"{what} at {time:.3f} s ± {1e3 * std:.0f} ms"
            found.append(Event(kind, int(table.frame[after]), time, std, float(high - time + HALF_WINDOW_S), words))
    return tuple(found)


def _change(table: ContactTable, contacting: ContactStates, change: Change, told: np.ndarray) -> Event:
    kind, what = (FIRST_CONTACT, "first contact") if change.begins else (LOSS, "contact is lost")
    frame, decided = int(table.frame[change.row]), float(table.time_s[change.row])
    time = std = np.nan
    words = f"in contact from frame {frame} on, the first informative frame: when it began is undetermined"
    if len(change.known_before):
        words = f"{what} with frame {frame}: without usable times"
        growth = _growth(table, contacting, change, told)
        if growth is None:
            low = float(table.time_s[change.known_before[-1]])
            time, std = 0.5 * (low + decided), (decided - low) / np.sqrt(12.0)
            how = "anywhere between that frame and the one before"
        else:
            time, std = _instant(growth)
            time = time if change.begins else -time
            how = "by several frames together" if change.pooled else ""
    if not std > 0.0:
        return Event(kind, frame, np.nan, np.nan, np.nan, words)
    delay = max(decided - time, 0.0)  # noise may end a fading contact a frame too early
    words = f"{what} at {time:.3f} s ± {1e3 * std:.1f} ms, detected {1e3 * delay:.0f} ms later in frame {frame}"
    words += f", {how}" * bool(how)
    return Event(kind, frame, float(time), float(std), float(delay), words)


def _growth(table: ContactTable, contacting: ContactStates, change: Change, told: np.ndarray) -> _Growth | None:
    """The informative frames (T,) around a change; of a loss turned round in time."""
    state, time = contacting.state, table.time_s
    place = int(np.searchsorted(told, change.row))
    if change.begins:
        free = np.array(baseline_candidates(change.known_before.tolist()), int)
        early, late = told[max(place - _BEFORE, 0) : place], told[place : place + _AFTER]
        early = early[state[early] == 0]
    else:
        early, late = told[place : place + _BEFORE], told[max(place - _AFTER, 0) : place][::-1]
        free = early = early[np.cumprod(state[early] == 0).astype(bool)][::-1]
    late = late[np.cumprod(state[late] == 1).astype(bool)]
    if len(early) == 0 or len(late) == 0:
        return None
    rows = np.concatenate([early, late])
    if not (np.isfinite(time[rows]).all() and (np.diff(time[np.sort(rows)]) > 0.0).all()):
        return None
    sign = 1.0 if change.begins else -1.0
    located = late[np.isin(table.status[late], LOCATED) & (np.abs(time[late] - time[late[0]]) <= _FORCE_S)][:_FORCES]
    # the first frame after the instant that is in contact by itself, else the last that is looked at
    certain = late[table.in_contact[late]]
    size = np.hypot(table.force_y_N, table.force_z_N)[located]
    std = np.hypot(table.force_y_N * table.force_y_std_N, table.force_z_N * table.force_z_std_N)[located]
    sound = np.isfinite(size) & (size > 0.0) & np.isfinite(std)
    level = table.evidence[free]
    return _Growth(
        time_s=sign * time[rows],
        evidence=table.evidence[rows],
        free_evidence=level[np.isfinite(level)],
        force_time_s=sign * time[located][sound],
        force_N=size[sound],
        force_std_N=std[sound] / size[sound],
        earliest_s=float(sign * time[early[0]]),
        latest_s=float(sign * time[certain[0] if len(certain) else late[-1]]),
    )
