"""What happened, from the states and phases of a recording's frames."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..table import LOCATED, ContactTable
from .onset import Change, Contacting, settled
from .result import FIRST_CONTACT, LOSS, ROLLING, SLIDING, SLIP_END, SLIP_START, STICKING, Event
from .slip import HALF_WINDOW_S
from .touchdown import FORCES, Growth, instant

BEFORE, AFTER = 45, 12
"""Frames around a change whose evidence is looked at."""
FORCE_S = 0.5
"""Forces later than this after a change do not tell when it was."""


def contact_events(table: ContactTable, contacting: Contacting) -> tuple[Event, ...]:
    """First contacts and losses, with the times that the growth of the deflection tells."""
    told = np.flatnonzero((contacting.state >= 0) & np.isfinite(table.evidence))
    return tuple(_change(table, contacting, change, told) for change in contacting.changes)


def slip_events(table: ContactTable, phase: np.ndarray, strokes: Sequence[np.ndarray]) -> tuple[Event, ...]:
    """Where sticking turns into sliding and back; `strokes` are rows of the table."""
    found = []
    for rows in strokes:
        told = rows[np.isin(phase[rows], (STICKING, ROLLING, SLIDING))]
        slides = phase[told] == SLIDING
        for at in np.flatnonzero(slides[1:] != slides[:-1]):
            found.append(_slips(table, int(told[at]), int(told[at + 1]), bool(slides[at + 1])))
    return tuple(found)


def _slips(table: ContactTable, before: int, after: int, starts: bool) -> Event:
    low, high = table.time_s[before], table.time_s[after]
    time, std = float(0.5 * (low + high)), float(np.hypot((high - low) / np.sqrt(12.0), 0.3 * HALF_WINDOW_S))
    what = "the contact begins to slip" if starts else "the slip ends"
    kind = SLIP_START if starts else SLIP_END
    delay = float(high - time + HALF_WINDOW_S)
    words = f"{what} at {time:.3f} s ± {1e3 * std:.0f} ms"
    return Event(kind, int(table.frame[after]), time, std, delay, words)


def _change(table: ContactTable, contacting: Contacting, change: Change, told: np.ndarray) -> Event:
    kind, what = (FIRST_CONTACT, "first contact") if change.begins else (LOSS, "contact is lost")
    frame, decided = int(table.frame[change.row]), float(table.time_s[change.row])
    if len(change.known_before) == 0:
        words = f"in contact from frame {frame} on, the first that tells: when it began cannot be told"
        return Event(kind, frame, np.nan, np.nan, np.nan, words)
    growth = _growth(table, contacting, change, told)
    if growth is None:
        low = float(table.time_s[change.known_before[-1]])
        time, std = 0.5 * (low + decided), (decided - low) / np.sqrt(12.0)
        how = "between two frames, no evidence tells it closer"
    else:
        time, std = instant(growth)
        time = time if change.begins else -time
        how = "seen in several frames together" if change.pooled else "seen in one frame"
    if not std > 0.0:
        words = f"{what} with frame {frame}: its times do not tell when"
        return Event(kind, frame, np.nan, np.nan, np.nan, words)
    delay = max(decided - time, 0.0)  # noise may end a fading contact a frame too early
    words = f"{what} at {time:.3f} s ± {1e3 * std:.1f} ms, known with frame {frame}, {1e3 * delay:.0f} ms later, {how}"
    return Event(kind, frame, float(time), float(std), float(delay), words)


def _growth(table: ContactTable, contacting: Contacting, change: Change, told: np.ndarray) -> Growth | None:
    """The frames about a change, of those that tell (T,); of a loss turned round in time."""
    state, time = contacting.state, table.time_s
    place = int(np.searchsorted(told, change.row))
    if change.begins:
        free = np.array(settled(change.known_before.tolist()), int)
        early = told[max(place - BEFORE, 0) : place]
        early = early[state[early] == 0]
        late = told[place : place + AFTER]
        late = late[np.cumprod(state[late] == 1).astype(bool)]
    else:
        late = told[max(place - AFTER, 0) : place][::-1]
        late = late[np.cumprod(state[late] == 1).astype(bool)]
        early = told[place : place + BEFORE]
        early = early[np.cumprod(state[early] == 0).astype(bool)][::-1]
        free = early
    if len(early) == 0 or len(late) == 0 or not _in_order(time[np.sort([*early, *late])]):
        return None
    sign = 1.0 if change.begins else -1.0
    rows = np.concatenate([early, late])
    located = late[np.isin(table.status[late], LOCATED) & (np.abs(time[late] - time[late[0]]) <= FORCE_S)][:FORCES]
    size = np.hypot(table.force_y_N[located], table.force_z_N[located])
    std = np.hypot(
        table.force_y_N[located] * table.force_y_std_N[located], table.force_z_N[located] * table.force_z_std_N[located]
    )
    sound = np.isfinite(size) & (size > 0.0) & np.isfinite(std)
    level = table.evidence[free]
    return Growth(
        time_s=sign * time[rows],
        evidence=table.evidence[rows],
        free_evidence=level[np.isfinite(level)],
        force_time_s=sign * time[located][sound],
        force_N=size[sound],
        force_std_N=std[sound] / size[sound],
        earliest_s=float(sign * time[early[0]]),
        latest_s=float(sign * time[_surely(table, contacting, late)]),
    )


def _surely(table: ContactTable, contacting: Contacting, late: np.ndarray) -> int:
    """The first frame after the instant that is in contact by itself, else the last that is looked at."""
    alone = late[table.in_contact[late]]
    return int(alone[0] if len(alone) else late[-1])


def _in_order(time_s: np.ndarray) -> bool:
    return bool(np.isfinite(time_s).all() and (np.diff(time_s) > 0.0).all())
