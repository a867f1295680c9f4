"""Ringing: frames in which the antenna swings, and how fast where the frames are many enough to tell."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from scipy.signal import lombscargle

from estimator.contact.motion import Beam
from estimator.table.contacts import ContactTable

from .result import RINGING, Event
from .strokes import usual_step

JOINED_S = 0.15
"""Swinging frames that are no further apart belong together, the frames between them too: at its turning points an
antenna swings, half way between them it looks at rest."""
AROUND_S = 0.3
"""Frames before and after that tell the frequency as well."""
LEAST_FRAMES, LEAST_PERIODS = 8, 1.5
CHANCE = 1e-3
"""Probability that noise alone shows a line as strong, at most."""
_TRIALS = 400


def swinging(table: ContactTable) -> np.ndarray:
    """(B,) bool: the frame is `not_quasistatic`, or between two such."""
    swings = np.flatnonzero(table.status == "not_quasistatic")
    found = np.zeros(len(table), bool)
    found[swings] = True
    for first, second in pairwise(swings):
        if table.time_s[second] - table.time_s[first] <= JOINED_S:
            found[first : second + 1] = True
    return found


def ringing_events(table: ContactTable, ringing: np.ndarray, beam: Beam | None) -> tuple[Event, ...]:
    """One for each run of swinging frames."""
    ends = np.flatnonzero(np.diff(np.concatenate([[False], ringing, [False]]).astype(int)))
    step = usual_step(table.time_s)
    # a frame without a time stands where the one before it does
    clock = np.nan_to_num(np.fmax.accumulate(table.time_s), nan=-np.inf)
    return tuple(_event(table, slice(*run), beam, step, clock) for run in ends.reshape(-1, 2))


def _event(table: ContactTable, run: slice, beam: Beam | None, step: float, clock: np.ndarray) -> Event:
    time = table.time_s[run]
    first = np.searchsorted(clock, time[0] - AROUND_S)
    pace = _pace(table, slice(first, np.searchsorted(clock, time[-1] + AROUND_S, side="right")), beam, step)
    words = f"the antenna swings from {time[0]:.3f} s to {time[-1]:.3f} s; {pace}"
    std = step / np.sqrt(12.0) if np.isfinite(step) else np.nan
    return Event(RINGING, int(table.frame[run][0]), float(time[0]), float(std), 0.0, words)


def _pace(table: ContactTable, near: slice, beam: Beam | None, step: float) -> str:
    told = np.isfinite(table.evidence[near]) & np.isfinite(table.time_s[near])
    time, signal = table.time_s[near][told], np.sqrt(2.0 * np.clip(table.evidence[near][told], 0.0, None))
    if len(time) < LEAST_FRAMES or not np.isfinite(step):
        return "too few frames to tell how fast"
    fastest = 0.5 / step
    if beam is not None:
        free_Hz = float(beam.first_mode_rad_s(np.zeros(()))) / (2.0 * np.pi)
        if free_Hz > 0.9 * fastest:
            return f"its first mode, {free_Hz:.1f} Hz or more, is too fast for {1.0 / step:.0f} frames a second to tell"
    found = frequency(time, signal, fastest)
    if found is None:
        return "no one frequency stands out"
    pace, std = found
    doubt = " (or, of a free antenna that swings about rest, half of it)"
    return f"its bend comes and goes at {pace:.1f} ± {std:.1f} Hz{doubt}, told up to {fastest:.0f} Hz"


def frequency(time_s: np.ndarray, signal: np.ndarray, fastest_Hz: float) -> tuple[float, float] | None:
    """Frequency in Hz and standard deviation of the strongest line in a signal (N,); None where none stands out.

    The line beside constant and slope, by Lomb and Scargle; what noise would show, by the beta distribution of the
    power's share.
    """
    time = time_s - time_s.mean()
    away = signal - np.polyval(np.polyfit(time, signal, 1), time)
    span, count = float(np.ptp(time)), len(time)
    slowest = LEAST_PERIODS / span if span > 0.0 else np.inf
    if not slowest < fastest_Hz or count < LEAST_FRAMES or not (away @ away) > 0.0:
        return None
    trials = np.linspace(slowest, fastest_Hz, _TRIALS)
    share = lombscargle(time, away, 2.0 * np.pi * trials, normalize=True)
    best = int(np.argmax(share))
    independent = max(span * (fastest_Hz - slowest), 1.0)
    if independent * (1.0 - min(share[best], 1.0)) ** (0.5 * (count - 3)) > CHANCE:
        return None
    left = max(1.0 - float(share[best]), 1e-6)
    std = np.sqrt(6.0 * left / (float(share[best]) * count)) / (np.pi * span)
    return float(trials[best]), float(np.hypot(std, (trials[1] - trials[0]) / np.sqrt(12.0)))
