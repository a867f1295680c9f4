"""From a table of contacts to what happened in time, and how fast the antenna slips.

The contact point X walks over the object and along the antenna; the antenna's own point under it moves with

    v = dX/dt − t̂·dl/dt,

l the contact's arc length, t̂ the tangent. The calibration's errors are common to neighbouring frames and cancel in the
differences but for how the joints turn them; what differs from frame to frame counts.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise

import numpy as np

from estimator.contact.common_errors import CommonErrors, shared_errors
from estimator.contact.motion import Beam
from estimator.object.track.onset import ContactChange, Event, Track, TrackSettings, baseline_candidates, contact_states
from estimator.table.contacts import LOCATED, ContactTable
from vbaa_calib.core.robust import NORMAL_QUARTILE
from vbaa_calib.geometry import Kinematics
from vbaa_calib.geometry.covariance import largest_std, variance_along
from vbaa_calib.native import core
from vbaa_calib.rig import Rig

_Rows = Callable[[np.ndarray], np.ndarray]


def _ringing_frames(table: ContactTable) -> np.ndarray:
    """(B,) mask of the frames that are `not_quasistatic`, or lie between two such."""
    swings = np.flatnonzero(table.status == "not_quasistatic")
    found = np.zeros(len(table), bool)
    found[swings] = True
    for first, second in pairwise(swings):
        if table.time_s[second] - table.time_s[first] <= TrackSettings.joined_s:
            found[first : second + 1] = True
    return found


def _ringing_events(table: ContactTable, ringing: np.ndarray, beam: Beam | None) -> tuple[Event, ...]:
    """One event for each run of vibrating frames."""
    ends = np.flatnonzero(np.diff(np.concatenate([[False], ringing, [False]]).astype(int)))
    step = _median_step(table.time_s)
    std = step / np.sqrt(12.0) if np.isfinite(step) else np.nan
    # a frame without a time stands where the one before it does
    clock = np.nan_to_num(np.fmax.accumulate(table.time_s), nan=-np.inf)
    events = []
    for begin, end in ends.reshape(-1, 2):
        time = table.time_s[begin:end]
        first, last = (
            np.searchsorted(clock, time[0] - TrackSettings.around_s),
            np.searchsorted(clock, time[-1] + TrackSettings.around_s, "right"),
        )
        pace = _frequency_words(table, slice(first, last), beam, step)
        words = f"the antenna swings from {time[0]:.3f} s to {time[-1]:.3f} s; {pace}"
        events.append(Event("ringing", int(table.frame[begin]), float(time[0]), std, 0.0, words))
    return tuple(events)


def _frequency_words(table: ContactTable, near: slice, beam: Beam | None, step: float) -> str:
    known = np.isfinite(table.evidence[near]) & np.isfinite(table.time_s[near])
    time, signal = table.time_s[near][known], np.sqrt(2.0 * np.clip(table.evidence[near][known], 0.0, None))
    if len(time) < TrackSettings.fewest_frames or not np.isfinite(step):
        return "too few frames for a frequency"
    fastest = 0.5 / step
    free_Hz = 0.0 if beam is None else float(beam.first_mode_rad_s(np.zeros(()))) / (2.0 * np.pi)
    if free_Hz > 0.9 * fastest:
        return f"its first mode, {free_Hz:.1f} Hz or more, is too fast for {1.0 / step:.0f} frames a second"
    found = _frequency(time, signal, fastest)
    if found is None:
        return "no one frequency stands out"
    doubt = "(or, of a free antenna that swings about rest, half of it)"
    return f"its bend comes and goes at {found[0]:.1f} ± {found[1]:.1f} Hz {doubt}, observable up to {fastest:.0f} Hz"


def _frequency(time_s: np.ndarray, signal: np.ndarray, fastest_Hz: float) -> tuple[float, float] | None:
    """Frequency, Hz, of the strongest line in a signal (N,) on a slope (Lomb–Scargle), and its standard deviation;
    None where noise would have as strong a line (beta distribution of the power's share)."""
    time = time_s - time_s.mean()
    away = signal - np.polyval(np.polyfit(time, signal, 1), time)
    span, count = float(np.ptp(time)), len(time)
    slowest = TrackSettings.fewest_periods / span if span > 0.0 else np.inf
    if not slowest < fastest_Hz or count < TrackSettings.fewest_frames or not (away @ away) > 0.0:
        return None
    from scipy.signal import lombscargle  # takes a quarter of a second to load

    trials = np.linspace(slowest, fastest_Hz, TrackSettings.trial_frequencies)
    share = lombscargle(time, away, 2.0 * np.pi * trials, normalize=True)
    best = int(np.argmax(share))
    independent = max(span * (fastest_Hz - slowest), 1.0)
    if independent * (1.0 - min(share[best], 1.0)) ** (0.5 * (count - 3)) > TrackSettings.chance:
        return None
    unexplained = max(1.0 - float(share[best]), 1e-6)
    std = np.sqrt(6.0 * unexplained / (float(share[best]) * count)) / (np.pi * span)
    return float(trials[best]), float(np.hypot(std, (trials[1] - trials[0]) / np.sqrt(12.0)))


@dataclass(frozen=True, eq=False)
class _Growth:
    """The frames around a change, in order of time; reversed for a loss."""

    time_s: np.ndarray  # (N,) of frames before and after
    evidence: np.ndarray  # (N,)
    free_evidence: np.ndarray  # (K,) of frames that are free for certain
    force_time_s: np.ndarray  # (F,) of the first located frames
    force_N: np.ndarray  # (F,)
    force_std_N: np.ndarray  # (F,)
    earliest_s: float  # bounds of the instant
    latest_s: float


def _instant(growth: _Growth) -> tuple[float, float]:
    """The time at which the growth began, s, and its standard deviation."""
    low, high = growth.earliest_s, growth.latest_s
    mean, std = 0.5 * (low + high), (high - low) / np.sqrt(12.0)
    likeliest = None
    for _ in range(3):  # each time on a finer grid about what was found
        step = (high - low) / TrackSettings.instants
        at = low + (np.arange(TrackSettings.instants) + 0.5) * step
        by_force = _by_force(growth, at)
        likeliest = by_force.max() if likeliest is None else likeliest
        log = _by_evidence(growth, at) + np.logaddexp(
            np.log1p(-TrackSettings.stepped_p) + by_force - likeliest, np.log(TrackSettings.stepped_p)
        )
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
    trusted = after[growth.evidence[after] <= TrackSettings.trusted_evidence]
    last = trusted[-1] if len(trusted) else after[0]
    more = max(float(growth.evidence[last]) - _free_level(growth.free_evidence)[0], 1.0)
    rate_per_s = float(np.sqrt(2.0 * more) / (growth.time_s[last] - mean))
    return mean, float(np.hypot(std, TrackSettings.hidden_share * _common(growth) / rate_per_s))


def _common(growth: _Growth) -> float:
    """The shared error in standard deviations."""
    level, noise = _free_level(growth.free_evidence)
    return float(np.sqrt(max(2.0 * level - 3.0 * noise, 0.0)))


def _free_level(evidence: np.ndarray) -> tuple[float, float]:
    """Mean evidence E₀ of free frames (K,), and ε² of their noise alone; theoretical values where there are too few."""
    if len(evidence) < 5:
        return 1.5, 1.0
    mean, variance = max(float(evidence.mean()), 0.05), float(evidence.var(ddof=1))
    inside = max(4.0 * mean**2 - 6.0 * variance, 0.0)
    return mean, max(float(2.0 * mean - np.sqrt(inside)) / 3.0, 0.01)


def _by_evidence(growth: _Growth, at: np.ndarray) -> np.ndarray:
    """(A,) log-likelihoods of onset times t₀ by the evidence, up to the first frame with evidence known only to be
    large."""
    much = np.flatnonzero(growth.evidence > TrackSettings.trusted_evidence)
    end = int(much[0]) + 1 if len(much) else len(growth.evidence)
    # frames before that carry no information
    telling = np.isfinite(growth.evidence[:end]) & (growth.time_s[:end] > at[0])
    used = np.flatnonzero(telling)
    if len(used) == 0:
        return np.zeros(len(at))
    time, evidence = growth.time_s[used], np.minimum(growth.evidence[used], TrackSettings.trusted_evidence)
    root = np.cbrt(np.clip(evidence, 0.0, None)).astype(np.float32)
    (level, noise), common = _free_level(growth.free_evidence), _common(growth)
    late = np.clip(time - at[:, None], 0.0, None)  # (A, N)
    span = max(float(time[-1] - at[0]), 1e-9)
    reached = np.sqrt(2.0 * max(float(evidence[-1]) - level, 1.0))
    # trial rates of growth over the one that the last frame alone would ask for
    rate = np.geomspace(0.3, 30.0, 36) * (reached / np.maximum(late[:, -1:], 1e-3 * span))  # (A, G)
    # trial changes of the rate over the frames used
    bend = 1.0 + TrackSettings.uneven_share * np.array([-1.4, 0.0, 1.4])[:, None] * (late / span)[:, None]  # (A, 3, N)
    # (A, G, 3, N); of log-likelihoods single precision has digits enough, and takes half the time
    x = (rate[:, :, None, None] * (bend * late[:, None])[:, None]).astype(np.float32)
    cosines = np.linspace(-0.8, 0.8, 5)
    log = np.empty((*x.shape[:3], len(cosines)))
    for index, cosine in enumerate(cosines.tolist()):
        expected = (0.5 * x + cosine * common) * x + level
        variance = np.maximum(2.0 * noise * (expected - 1.5 * noise), 0.0) + 1.5 * noise**2
        # the cube root is nearly normal, also where there is hardly a deflection; `np.cbrt` takes ten times as long
        middle, skew = np.exp(np.log(expected) / 3.0), variance / (9.0 * expected**2)
        spread = middle**2 * skew
        middle -= middle * skew
        each = -0.5 * ((root - middle) ** 2 / spread + np.log(spread))
        if len(much):
            above = (middle[..., -1] - np.cbrt(TrackSettings.trusted_evidence)) / np.sqrt(spread[..., -1])
            each[..., -1] = core.log_normal_cdf(above.ravel().astype(float)).reshape(above.shape)
        log[..., index] = each.sum(axis=-1)
    # with their probabilities
    return np.logaddexp.reduce(log + np.log(np.array([0.25, 0.5, 0.25]))[:, None], axis=(1, 2, 3))


def _by_force(growth: _Growth, at: np.ndarray) -> np.ndarray:
    """(A,) log-likelihoods of onset times t₀ (A,), s, by the forces, which grow linearly from zero, with a free
    slope, a curvature and a shared error."""
    if len(growth.force_N) < 2 or not growth.force_time_s[-1] > at[-1]:
        return np.zeros(len(at))
    late = growth.force_time_s - at[:, None]  # (A, F)
    span = late[:, -1:]
    rate = growth.force_N[-1] / span  # what the bend is a share of
    bow = TrackSettings.uneven_share * rate * late * (late / span - 1.0)
    own = (TrackSettings.own_share * growth.force_std_N) ** 2 + (TrackSettings.relative_force * growth.force_N) ** 2
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


def _slip_events(table: ContactTable, phase: np.ndarray, strokes: Sequence[np.ndarray]) -> tuple[Event, ...]:
    """Transitions between sticking and sliding. strokes : rows of the table."""
    found = []
    for rows in strokes:
        decided = rows[np.isin(phase[rows], ("sticking", "rolling", "sliding"))]
        slides = phase[decided] == "sliding"
        for at in np.flatnonzero(slides[1:] != slides[:-1]):
            after = decided[at + 1]
            low, high = table.time_s[decided[at]], table.time_s[after]
            time, std = (
                float(0.5 * (low + high)),
                float(np.hypot((high - low) / np.sqrt(12.0), 0.3 * TrackSettings.half_window_s)),
            )
            kind, what = (
                ("slip_start", "the contact begins to slip") if slides[at + 1] else ("slip_end", "the slip ends")
            )
            words = f"{what} at {time:.3f} s ± {1e3 * std:.0f} ms"
            found.append(
                Event(kind, int(table.frame[after]), time, std, float(high - time + TrackSettings.half_window_s), words)
            )
    return tuple(found)


def _change(table: ContactTable, state: np.ndarray, change: ContactChange, decisive: np.ndarray) -> Event:
    """A first contact or a loss, timed by the growth of the deflection. decisive : (T,) informative frames."""
    row, begins, known_before, pooled = change
    kind, what = ("first_contact", "first contact") if begins else ("loss", "contact is lost")
    frame, decided = int(table.frame[row]), float(table.time_s[row])
    time = std = np.nan
    words = f"in contact from frame {frame} on, the first informative frame: when it began is undetermined"
    if len(known_before):
        words = f"{what} with frame {frame}: without usable times"
        growth = _growth(table, state, change, decisive)
        if growth is None:
            low = float(table.time_s[known_before[-1]])
            time, std = 0.5 * (low + decided), (decided - low) / np.sqrt(12.0)
            how = "anywhere between that frame and the one before"
        else:
            time, std = _instant(growth)
            time = time if begins else -time
            how = "by several frames together" if pooled else ""
    if not std > 0.0:
        return Event(kind, frame, np.nan, np.nan, np.nan, words)
    delay = max(decided - time, 0.0)  # noise may end a fading contact a frame too early
    words = f"{what} at {time:.3f} s ± {1e3 * std:.1f} ms, detected {1e3 * delay:.0f} ms later in frame {frame}"
    words += f", {how}" * bool(how)
    return Event(kind, frame, float(time), float(std), float(delay), words)


def _growth(table: ContactTable, state: np.ndarray, change: ContactChange, decisive: np.ndarray) -> _Growth | None:
    """The growth of contact over the informative frames (T,) around a change; time-reversed for a loss."""
    time, (row, begins, known_before, _) = table.time_s, change
    place = int(np.searchsorted(decisive, row))
    if begins:
        free = np.array(baseline_candidates(known_before.tolist()), int)
        early, late = (
            decisive[max(place - TrackSettings.frames_before, 0) : place],
            decisive[place : place + TrackSettings.frames_after],
        )
        early = early[state[early] == 0]
    else:
        early, late = (
            decisive[place : place + TrackSettings.frames_before],
            decisive[max(place - TrackSettings.frames_after, 0) : place][::-1],
        )
        free = early = early[np.cumprod(state[early] == 0).astype(bool)][::-1]
    late = late[np.cumprod(state[late] == 1).astype(bool)]
    if len(early) == 0 or len(late) == 0:
        return None
    rows = np.concatenate([early, late])
    if not (np.isfinite(time[rows]).all() and (np.diff(time[np.sort(rows)]) > 0.0).all()):
        return None
    sign = 1.0 if begins else -1.0
    located = late[
        np.isin(table.status[late], LOCATED) & (np.abs(time[late] - time[late[0]]) <= TrackSettings.force_s)
    ][: TrackSettings.most_forces]
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


def follow(
    table: ContactTable,
    rig: Rig | None = None,
    shared: CommonErrors | None = None,
    normal_world: np.ndarray | None = None,
    *,
    events: bool = True,
) -> Track:
    """Events of a recording: first contact, loss, sticking and sliding, vibration; and the slip.

    The rig separates calibration errors from noise and gives the joints' motion and the antenna's frequency; `shared`
    is `shared_errors(rig, table)`, where it is known already, `normal_world` (B, 3) the object's outward normals where
    something better than the forces' direction is known; NaN elsewhere. Without `events` only the frames' motion.
    """
    if shared is None:
        shared = CommonErrors.none(table) if rig is None else shared_errors(rig, table)
    ringing = _ringing_frames(table)
    state, changes, pooled = contact_states(table, ringing)
    kinematics = Kinematics() if rig is None else rig.kinematics
    phase = np.select([state == 1, state == 0], ["touching", "free"], "unknown").astype("<U8")
    count = len(table)
    radius = np.full(count, TrackSettings.radius_m) if rig is None else rig.antenna.radius_at(table.distance_m)
    good = table.located & (state == 1) & np.isfinite(table.time_s)
    good &= np.isfinite(table.point_world_m).all(axis=1) & np.isfinite(table.tangent_world).all(axis=1)
    strokes = runs(table, np.flatnonzero(good), state == 0, np.empty(0))
    velocity, covariance, std, parts = (np.full((count, *shape), np.nan) for shape in ((3,), (3, 3), (), (2,)))
    for rows in strokes:
        moving = _slip(table, rows, shared, kinematics, None if normal_world is None else normal_world[rows])
        velocity[rows], covariance[rows], parts[rows] = moving.velocity_m_s, moving.covariance_m2_s2, moving.parts_m_s
        std[rows] = largest_std(moving.parts_m2_s2)
        phase[rows] = _phases(moving, radius[rows])
    # in which there is evidence
    decisive = np.flatnonzero((state >= 0) & np.isfinite(table.evidence))
    happened = [_change(table, state, change, decisive) for change in changes] if events else []
    for (_, begins, known_before, _), event in zip(changes, happened, strict=events):
        if np.isfinite(event.time_s):  # frames between a change and its detection belong to what follows
            late = known_before[table.time_s[known_before] > event.time_s]
            late = late[np.isin(phase[late], ("free", "touching"))]
            phase[late] = "touching" if begins else "free"
    happened += _slip_events(table, phase, strokes)
    happened += _ringing_events(table, ringing, None if rig is None else Beam.of(rig))
    time_of = dict(zip(table.frame.tolist(), table.time_s.tolist(), strict=True))
    return Track(
        phase=phase,
        slip_velocity_m_s=velocity,
        slip_std_m_s=std,
        longitudinal_m_s=parts[:, 0],
        lateral_m_s=parts[:, 1],
        slip_covariance_m2_s2=covariance,
        ringing=ringing,
        events=tuple(
            sorted(happened, key=lambda each: each.time_s if np.isfinite(each.time_s) else time_of[each.frame])
        ),
        notes=tuple(_notes(table, pooled, shared)),
    )


def _notes(table: ContactTable, pooled: bool, shared: CommonErrors) -> list[str]:
    """What the recording leaves undetermined, in words. pooled : as from `contact_states`."""
    notes = []
    located = table.located
    if not np.isfinite(table.evidence).any():
        notes.append("no evidence column: contact is decided frame by frame, its instant known only between two frames")
    elif not pooled:
        notes.append(
            "fewer than twelve free frames near one pose: slow approaches are decided frame by frame"
            if np.isfinite(table.pan_rad + table.tilt_rad).any()
            else "no joint angles: slow approaches are decided frame by frame"
        )
    if located.any() and not np.isfinite(table.tangent_world[located]).any():
        notes.append("no tangents: slip is undetermined")
    if located.any() and not shared.known:
        notes.append("no rig: what noise does to the slip is taken from its scatter")
    return notes


def _phases(slip: _Slip, antenna_radius_m: np.ndarray) -> np.ndarray:
    """(P,) phase of each frame of a stroke; "touching" if undetermined. antenna_radius_m : (P,) at the contacts."""
    speed = np.linalg.norm(slip.velocity_m_s, axis=1)
    # its deviation: along the slip where that is clear, else the larger of all directions
    widest = largest_std(slip.parts_m2_s2)
    toward = slip.velocity_m_s / np.maximum(speed, 1e-12)[:, None]
    own = np.sqrt(np.maximum(variance_along(slip.covariance_m2_s2, toward), 0.0))
    carried = np.where(np.isfinite(slip.carried_m_s), slip.carried_m_s, slip.contact_m_s)
    nothing = TrackSettings.no_slip_share * carried + antenna_radius_m * slip.turning_rad_s
    with np.errstate(invalid="ignore"):
        std = np.where(speed > TrackSettings.slip_std * widest, own, widest)
        surely = speed - TrackSettings.slip_std * std > nothing
        continues = speed - TrackSettings.static_slip_std * std > nothing
        fast = speed > TrackSettings.rest_m_s
        run = np.cumsum(~(continues & fast))  # one number for each run of frames in which a slip may go on
        sliding = continues & fast & np.isin(run, np.unique(run[surely & continues & fast]))
        rest = np.maximum(antenna_radius_m * slip.turning_rad_s, TrackSettings.rest_m_s)
        small = speed + 2.0 * std <= np.maximum(TrackSettings.stuck_share * carried, rest)
        stuck = ~sliding & small & (speed - TrackSettings.static_slip_std * std <= rest)
        walks = slip.contact_m_s - TrackSettings.slip_std * slip.contact_std_m_s > 2.0 * np.maximum(
            speed + 2.0 * std, TrackSettings.rest_m_s
        )
    found = np.full(len(speed), "touching", dtype=object)
    found[stuck] = "sticking"
    found[stuck & walks] = "rolling"
    found[sliding] = "sliding"
    return found.astype(str)


def runs(table: ContactTable, rows: np.ndarray, free: np.ndarray, breaks_s: np.ndarray) -> list[np.ndarray]:
    """Runs of rows of a table, split at gaps in time, at clocks that stop, at free frames (B,) and at times (K,)."""
    if len(rows) == 0:
        return []
    time = table.time_s[rows]
    steps = np.diff(time)
    ends = (
        (steps > TrackSettings.gap_frames * _median_step(table.time_s))
        | (np.diff(np.cumsum(free)[rows]) > 0)
        | ~(steps > 0.0)
    )
    at = np.searchsorted(time, breaks_s[np.isfinite(breaks_s)], side="right") - 1
    ends[at[(at >= 0) & (at < len(ends))]] = True
    return np.split(rows, np.flatnonzero(ends) + 1)


def _without_walk(point: np.ndarray, tangent: np.ndarray, distance: np.ndarray) -> np.ndarray:
    """(P, 3, K) paths of points (P, 3, K) without their motion along the antenna, by distances (P, K)."""
    walk = 0.5 * (tangent[1:] + tangent[:-1])[..., None] * np.diff(distance, axis=0)[:, None]
    return np.concatenate([point[:1], point[1:] - np.cumsum(walk, axis=0)])


def _material_noise(
    material: np.ndarray, time: np.ndarray, tangent: np.ndarray, own: np.ndarray, known: bool
) -> np.ndarray:
    """(P, 3, 3) noise covariance of the material path: along the antenna its own scatter, since an error of the
    distance moves contact and walk alike; across it the contact's own noise, or the scatter where that is unknown."""
    along = np.einsum("pi,pj->pij", tangent, tangent)
    flat = np.eye(3) - along
    across = flat @ own @ flat
    predicted = np.sqrt(np.maximum(np.trace(across, axis1=1, axis2=2) / 2.0, 0.0))
    # along the antenna and two directions across it, turning as little as the antenna does
    first = np.cross(tangent, np.eye(3)[np.argmin(np.abs(tangent.mean(axis=0)))])
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    frame = np.stack([tangent, first, np.cross(tangent, first)], axis=1)
    path = np.einsum("pki,pi->pk", frame, material - material.mean(axis=0))
    if len(path) < TrackSettings.fewest_bends + 2:
        return across + along * (predicted**2)[:, None, None]
    # by which a smooth path scatters, from its second differences' median
    before, after = np.diff(time)[:-1, None], np.diff(time)[1:, None]
    share = after / (before + after)
    off = path[1:-1] - share * path[:-2] - (1.0 - share) * path[2:]
    seen = np.median(np.abs(off / np.sqrt(1.0 + share**2 + (1.0 - share) ** 2)), axis=0) / NORMAL_QUARTILE
    if np.isnan(seen).any():
        return across + along * (predicted**2)[:, None, None]
    sideways = float(np.hypot(seen[1], seen[2]) / np.sqrt(2.0))
    if known and np.isfinite(predicted).all():
        # what swings more than this is motion, not noise
        factor = np.clip(sideways / max(float(np.median(predicted)), 1e-12), 1.0, TrackSettings.most_scatter) ** 2
        return factor * across + along * seen[0] ** 2
    return along * seen[0] ** 2 + flat * sideways**2


@dataclass(frozen=True, eq=False)
class _Slip:
    """Velocities in a stroke of P frames, world frame; the slip lies in the plane of contact."""

    velocity_m_s: np.ndarray  # (P, 3)
    covariance_m2_s2: np.ndarray  # (P, 3, 3)
    parts_m_s: np.ndarray  # (P, 2) along the tangent and along normal × tangent
    parts_m2_s2: np.ndarray  # (P, 2, 2)
    contact_m_s: np.ndarray  # (P,) of the contact over the object
    contact_std_m_s: np.ndarray  # (P,)
    carried_m_s: np.ndarray  # (P,) if the joints carried the contact along; NaN without their angles
    turning_rad_s: np.ndarray  # (P,) of the antenna at the contact


def _slip(
    table: ContactTable,
    rows: np.ndarray,
    shared: CommonErrors,
    kinematics: Kinematics,
    normal: np.ndarray | None = None,
) -> _Slip:
    """The slip in each frame of a stroke, rows (P,) of the table; NaN in strokes of under three frames. normal : (P,
    3) outward normals of the object; without them force and slip determine these."""
    time, point, tangent = table.time_s[rows], table.point_world_m[rows], table.tangent_world[rows]
    material = _without_walk(point[..., None], tangent, table.distance_m[rows, None])[..., 0]
    modes, own = np.nan_to_num(shared.point_m[rows]), shared.own_m2[rows]
    # what moves a contact along the antenna moves its distance too
    modes = _without_walk(modes, tangent, np.einsum("pi,pis->ps", tangent, modes))
    noise = _material_noise(material, time, tangent, own, shared.known)
    slopes, variances = _slopes(time)
    moved, modes = slopes(material), slopes(modes)
    covariance = variances(noise) + modes @ np.swapaxes(modes, 1, 2)
    covariance = covariance + np.eye(3) * (TrackSettings.open_share**2 * (moved**2).sum(axis=1))[:, None, None]
    across, upward = _tilted_axes(moved, covariance, *_axes(table.force_world_N[rows], tangent))
    if normal is not None:
        known = np.isfinite(normal).all(axis=1)[:, None]
        exact = _axes(normal, tangent)
        across, upward = np.where(known, exact[0], across), np.where(known, exact[1], upward)
    axes = np.stack([tangent, across], axis=1)  # (P, 2, 3)
    plane = np.swapaxes(axes, 1, 2) @ axes
    contact = slopes(point)
    contact -= upward * np.einsum("pi,pi->p", contact, upward)[:, None]
    speed = np.linalg.norm(contact, axis=1)
    toward = contact / np.maximum(speed, 1e-12)[:, None]
    contact_variance = variance_along(variances(own), toward)
    pan, tilt, run = table.pan_rad[rows], table.tilt_rad[rows], table.point_antenna_m[rows]
    carried = np.full(len(rows), np.nan)
    if np.isfinite(pan).all() and np.isfinite(tilt).all() and np.isfinite(run).all():
        rotation, translation = kinematics.world_antenna(pan, tilt)
        carried = np.linalg.norm(np.einsum("pab,pb->pa", slopes(rotation), run) + slopes(translation), axis=1)
    return _Slip(
        velocity_m_s=np.einsum("pij,pj->pi", plane, moved),
        covariance_m2_s2=plane @ covariance @ plane,
        parts_m_s=np.einsum("pki,pi->pk", axes, moved),
        parts_m2_s2=axes @ covariance @ np.swapaxes(axes, 1, 2),
        contact_m_s=speed,
        contact_std_m_s=np.sqrt(np.maximum(contact_variance, 0.0)),
        carried_m_s=carried,
        turning_rad_s=np.linalg.norm(slopes(tangent), axis=1),
    )


def _slopes(time_s: np.ndarray) -> tuple[_Rows, _Rows]:
    """Functions of values (P, ...): the slope at each time (P,) of the line through its neighbours, as many on either
    side as there are; and from independent variances those of the slopes. NaN for P < 3."""
    count = len(time_s)
    if count < 3:
        return (lambda values: np.full(values.shape, np.nan),) * 2
    row = np.arange(count)
    before = row - np.searchsorted(time_s, time_s - TrackSettings.half_window_s - 1e-9)
    after = np.searchsorted(time_s, time_s + TrackSettings.half_window_s + 1e-9, side="right") - 1 - row
    half = np.maximum(np.minimum(before, after), TrackSettings.least_neighbours)
    low, high = np.maximum(row - half, 0), np.minimum(row + half, count - 1)
    short = high - low < 2
    high = np.minimum(np.where(short, low + 2, high), count - 1)
    low = np.where(short, np.clip(low, 0, count - 3), low)
    size = high - low + 1
    rows, begin = np.repeat(row, size), np.cumsum(size) - size
    columns = np.arange(size.sum()) - begin[rows] + low[rows]
    middle = np.bincount(rows, time_s[columns] - time_s[rows]) / size
    away = time_s[columns] - time_s[rows] - middle[rows]
    weights = away / np.bincount(rows, away**2)[rows]

    def summed(weights: np.ndarray, values: np.ndarray) -> np.ndarray:
        taken = weights[:, None] * values.reshape(count, -1)[columns]
        return np.add.reduceat(taken, begin, axis=0).reshape(values.shape)

    return partial(summed, weights), partial(summed, weights**2)


def _axes(force: np.ndarray, tangent: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(P, 3) normal × tangent, and the normal: the force's component perpendicular to the tangent. NaN without a
    force."""
    upward = force - tangent * np.einsum("pi,pi->p", force, tangent)[:, None]
    size = np.linalg.norm(upward, axis=1, keepdims=True)
    upward = np.where(size > 0.0, upward / np.where(size > 0.0, size, 1.0), np.nan)
    return np.cross(upward, tangent), upward


def _tilted_axes(
    moved: np.ndarray, covariance: np.ndarray, across: np.ndarray, upward: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The axes rotated about the tangent: where a material point appears to leave the plane of contact, that plane
    is corrected, within what friction allows and in proportion to the certainty of the slip's direction."""
    sideways, away = (np.einsum("pi,pi->p", axis, moved) for axis in (across, upward))
    noise = variance_along(covariance, upward)
    with np.errstate(divide="ignore", invalid="ignore"):
        inclination = np.arctan(away / sideways)
        variance = noise / (sideways**2 + away**2) + 0.05**2
        turn = inclination * TrackSettings.friction_rad**2 / (TrackSettings.friction_rad**2 + variance)
    turn = np.where(np.abs(inclination) < TrackSettings.inclined_rad, turn, 0.0)[:, None]
    return np.cos(turn) * across + np.sin(turn) * upward, np.cos(turn) * upward - np.sin(turn) * across


def _median_step(time_s: np.ndarray) -> float:
    """Median time between frames; infinite where there is none."""
    steps = np.diff(time_s[np.isfinite(time_s)])
    steps = steps[steps > 0.0]
    return float(np.median(steps)) if len(steps) else np.inf
