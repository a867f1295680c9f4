"""First contact in time: how often the free antenna is taken for a touching one, and how late and how well P₀ is found.

The antenna is turned at constant speed against a knife edge that stands still; rigs are known exactly, or off by a draw
of an ordinary calibration's covariance. The instant of first touch is where the true force, run back, is zero.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.estimator.setup import Setup, drawn_truth, rod_of
from benchmarks.harness import Draws, column, mean, of_any, rms, row_of, table
from estimator.contact.settings import ContactSettings
from estimator.object.track import follow
from estimator.table.contacts import ContactTable
from vbaa_calib.core.console import progress
from vbaa_calib.rig import Rig
from vbaa_calib.simulate.joint_paths import sweep_joints
from vbaa_calib.simulate.scene.objects import TouchObject
from vbaa_calib.simulate.scene.scene import Joints, Sweep

from .scenes import RATE_HZ, SIGMA_PX, Truth, contacts, place_of, record

SPEEDS_M_S = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05)
"""Of the antenna at the contact, towards the edge."""
RIGS = ("exact", "calibrated")
_MOTIONS = ("at rest", "steady", "rest, move, rest")
_BEFORE, _LEAST_AFTER, _MOST_AFTER, _DEEPEST_M = 45, 8, 40, 0.012
"""Free frames; frames in contact, as many as a press of that depth takes."""
_FREE_FRAMES = 200
"""Of one recording without contact."""


@dataclass(frozen=True)
class AlarmRow:
    """Recordings of the free antenna: first contacts reported, and frames that pass for contacts by themselves."""

    rig: str = column("rig")
    motion: str = column("motion")
    recordings: int = column("recordings", "d")
    frames: int = column("frames", "d")
    alarms: int = column("alarms", "d")
    alone: int = column("frames beyond the threshold by themselves", "d")


@dataclass(frozen=True, eq=False)
class Approach:
    """A recording's contacts, the rig as it is known, and the time of the first touch."""

    table: ContactTable
    given: Rig
    touch_s: float


@dataclass(frozen=True)
class _Told:
    """Of one approach whose contact was reported: error and deviation of P₀, delays from touch to decision, s."""

    error_s: float
    std_s: float
    delay_s: float
    alone_s: float


def _normalised(told: Draws) -> np.ndarray:
    with np.errstate(invalid="ignore", divide="ignore"):
        return told.error_s / told.std_s


@dataclass(frozen=True)
class OnsetRow:
    """Approaches at one speed.

    found : approaches whose contact was reported once, and not before it was.
    error_ms, rms_ms : mean and root mean square error of P₀'s time. std_ms : its own median deviation.
    normalised : root mean square of error over deviation, 1 where the deviation is right.
    covered : share of true instants within 1.96 deviations.
    delay_ms : mean time from touch to decision. alone_ms : the same by single frames.
    """

    rig: str = column("rig")
    speed_mm_s: float = column("mm/s", ".0f")
    draws: int = column("draws", "d")
    found: int = column("found", "d", of=len)
    error_ms: float = column("error", ".1f", of=lambda told: 1e3 * mean(told.error_s))
    rms_ms: float = column("rms", ".1f", of=lambda told: 1e3 * rms(told.error_s))
    std_ms: float = column("std", ".1f", of=lambda told: 1e3 * (of_any(np.median, told.std_s) or np.nan))
    normalised: float = column("rms/std", ".2f", of=lambda told: rms(_normalised(told)))
    covered: float = column("within 95 %", ".2f", of=lambda told: mean(np.abs(_normalised(told)) < 1.96))
    delay_ms: float = column("delay", ".0f", of=lambda told: 1e3 * mean(told.delay_s))
    alone_ms: float = column("by single frames", ".0f", of=lambda told: 1e3 * mean(told.alone_s))


def alarms(frames: int, seed: int) -> list[AlarmRow]:
    """Free antennas of random poses, cameras and rigs, at least so many frames, a third of them in each motion."""
    count = -(-frames // (_FREE_FRAMES * len(RIGS) * len(_MOTIONS)))
    rows = []
    for rig in RIGS:
        for number, motion in enumerate(_MOTIONS):
            counts = np.zeros(2, int)
            for draw in progress(range(count), f"free, {rig}, {motion}", count):
                table = _free_recording(rig, motion, (seed, RIGS.index(rig), number, draw))
                told = sum(event.kind == "first_contact" for event in follow(table).events)
                counts += told, int((table.evidence >= ContactSettings.contact_evidence).sum())
            rows.append(AlarmRow(rig, motion, count, count * _FREE_FRAMES, *counts.tolist()))
    return rows


def _free_recording(rig: str, motion: str, seed: Sequence[int]) -> ContactTable:
    """One recording of an antenna that touches nothing."""
    rng = np.random.default_rng(list(seed))
    azimuth = float(rng.uniform(-np.pi, np.pi))
    given = Setup(real=True, exact=rig == "exact", tilt_rad=float(rng.uniform(0.0, 1.0)), azimuth_rad=azimuth).rig()
    true = given if rig == "exact" else drawn_truth(given, rng)
    time = np.arange(_FREE_FRAMES) / RATE_HZ
    share = np.clip((time - time[len(time) // 2]) / rng.uniform(0.3, 2.0), 0.0, 1.0)
    way = {"at rest": 0.0 * time, "steady": 0.3 * time, "rest, move, rest": 0.8 * share**2 * (3.0 - 2.0 * share)}[
        motion
    ]
    start, toward = rng.uniform(-0.8, 0.8, 2), rng.uniform(-1.0, 1.0, 2)
    angles = start + toward * way[:, None]
    far = TouchObject("sphere", np.array([0.0, 0.0, 9.0]), np.zeros(3), 0.01, 0.01)
    return contacts(record(true, far, [[Joints(*pair) for pair in angles.tolist()]], rng, given=given))


def approach(rig: str, speed_m_s: float, seed: Sequence[int]) -> Approach:
    """The antenna turned against a knife edge at constant speed, frames at a random phase."""
    rng = np.random.default_rng(list(seed))
    given = Setup(real=True, exact=rig == "exact", tilt_rad=float(rng.uniform(0.2, 0.8)), azimuth_rad=2.6).rig()
    true = given if rig == "exact" else drawn_truth(given, rng)
    away = float(rng.uniform(0.09, 0.19))
    edge = TouchObject(
        "knife_edge",
        np.array([away, 0.0, 0.0]),
        np.array([0.0, 0.0, 1.0]),
        5e-4,
        0.07,
        wedge_world=np.array([0.0, 1.0, 0.0]),
    )
    tilt = float(rng.uniform(-0.15, 0.15))
    sweep = Sweep("pan", 1, 1, 1, 0.02, (0.0, 0.0), 0.0, (tilt, tilt))
    touch_rad = sweep_joints(place_of(true, edge), rod_of(true), sweep)[1].pan_rad
    rate = speed_m_s / away
    after = int(np.clip(_DEEPEST_M / speed_m_s * RATE_HZ, _LEAST_AFTER, _MOST_AFTER))
    time = (np.arange(_BEFORE + after) + rng.uniform()) / RATE_HZ
    pan = touch_rad + rate * (time - _BEFORE / RATE_HZ)
    recorded = record(true, edge, [[Joints(float(angle), tilt) for angle in pan]], rng, given=given)
    return Approach(contacts(replace(recorded, time_s=time)), given, _touch_s(recorded.truth, time))


def _touch_s(truth: Truth, time_s: np.ndarray) -> float:
    """When the true force was zero: the parabola of the time over the force through the first three pressed frames."""
    first = np.flatnonzero(truth.in_contact)[:3]
    size = np.linalg.norm(truth.force_antenna_N[first], axis=1)
    return float(np.polyval(np.polyfit(size / size[-1], time_s[first] - time_s[first[0]], 2), 0.0) + time_s[first[0]])


def onsets(draws: int, seed: int, speeds_m_s: Sequence[float] = SPEEDS_M_S) -> list[OnsetRow]:
    """So many approaches at each speed, with each kind of rig."""
    rows = []
    for place, rig in enumerate(RIGS):
        for speed in speeds_m_s:
            runs = progress(range(draws), f"approach, {rig}, {1e3 * speed:g} mm/s", draws)
            found = [_told(approach(rig, speed, (seed, place, round(1e6 * speed), draw))) for draw in runs]
            told = Draws([one for one in found if one is not None])
            rows.append(row_of(OnsetRow, told, rig, 1e3 * speed, draws))
    return rows


def _told(one: Approach) -> _Told | None:
    """What was said of an approach's one first contact; None where that was not told, twice, or before it was."""
    events = [event for event in follow(one.table, one.given).events if event.kind == "first_contact"]
    late = all(event.time_s + event.delay_s >= one.touch_s for event in events)
    if len(events) != 1 or not late or not np.isfinite(events[0].time_s):
        return None
    error, alone = events[0].time_s - one.touch_s, one.table.time_s[one.table.in_contact]
    single = alone[0] - one.touch_s if len(alone) else np.nan
    return _Told(error, events[0].time_std_s, error + events[0].delay_s, single)


def as_text(free: Sequence[AlarmRow], rows: Sequence[OnsetRow]) -> str:
    """Both tables as text."""
    approaches = f"approaches at {RATE_HZ:g} frames/s, {SIGMA_PX} px: times in ms"
    return "\n".join((table(free, "the free antenna"), table(rows, approaches)))
