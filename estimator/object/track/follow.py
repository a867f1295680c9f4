"""From a table of contacts to what happened in time."""

from __future__ import annotations

import numpy as np

from estimator.contact.common_errors import CommonErrors, shared_errors
from estimator.contact.motion import Beam
from estimator.table.contacts import ContactTable
from vbaa_calib.geometry import Kinematics
from vbaa_calib.rig import Rig

from .events import contact_events, ringing_events, ringing_frames, slip_events
from .onset import ContactStates, contact_states
from .result import FREE, ROLLING, SLIDING, STICKING, TOUCHING, UNKNOWN, Event, Track
from .slip import Slip, slip, strokes, tells_calibration

_CLEAR, _STILL_CLEAR = 4.5, 2.5  # deviations by which a slip must stand out to be called one, and for it to go on
# share of the joints' motion below which a slip is not called one: curved paths and rolling leave as much; and that it
# must surely stay below where the contact is said to stick
_NOTHING, _STUCK = 0.05, 0.15
_REST_M_S = 3e-4  # nothing slower is told from rest
_RADIUS_M = 0.5e-3  # the antenna's, where no rig tells it: of use only for how much a sticking antenna may roll


def _phases(slip: Slip, antenna_radius_m: float) -> np.ndarray:
    """(P,) what each frame of a stroke does; "touching" where it cannot be told."""
    speed = np.linalg.norm(slip.velocity_m_s, axis=1)
    std = _speed_std(slip, speed)
    carried = np.where(np.isfinite(slip.carried_m_s), slip.carried_m_s, slip.contact_m_s)
    nothing = _NOTHING * carried + antenna_radius_m * slip.turning_rad_s
    with np.errstate(invalid="ignore"):
        surely, still = speed - _CLEAR * std > nothing, speed - _STILL_CLEAR * std > nothing
        fast = speed > _REST_M_S
        sliding = _hysteresis(surely & fast, still & fast)
        rest = np.maximum(antenna_radius_m * slip.turning_rad_s, _REST_M_S)
        small = speed + 2.0 * std <= np.maximum(_STUCK * carried, rest)
        stuck = ~sliding & small & (speed - _STILL_CLEAR * std <= rest)
        walks = slip.contact_m_s - _CLEAR * slip.contact_std_m_s > 2.0 * np.maximum(speed + 2.0 * std, _REST_M_S)
    found = np.full(len(speed), TOUCHING, dtype=object)
    found[stuck] = STICKING
    found[stuck & walks] = ROLLING
    found[sliding] = SLIDING
    return found.astype(str)


def _speed_std(slip: Slip, speed: np.ndarray) -> np.ndarray:
    """(P,) standard deviation of the speed: along the slip where that is clear, else the larger of all directions."""
    widest = np.sqrt(np.maximum(np.linalg.eigvalsh(np.nan_to_num(slip.parts_m2_s2, nan=np.inf)).max(axis=-1), 0.0))
    toward = slip.velocity_m_s / np.maximum(speed, 1e-12)[:, None]
    own = np.sqrt(np.maximum(np.einsum("pi,pij,pj->p", toward, slip.covariance_m2_s2, toward), 0.0))
    with np.errstate(invalid="ignore"):
        return np.where(speed > _CLEAR * widest, own, widest)


def _hysteresis(begin: np.ndarray, keep: np.ndarray) -> np.ndarray:
    """(P,) bool: on from a frame that begins it, forward and backward, as long as it is kept."""
    held = np.cumsum(~keep)
    return keep & np.isin(held, np.unique(held[begin & keep]))


def follow(
    table: ContactTable,
    rig: Rig | None = None,
    shared: CommonErrors | None = None,
    normal_world: np.ndarray | None = None,
) -> Track:
    """What happens in a recording: first contact, loss, sticking and sliding, ringing.

    The rig tells calibration from noise, the joints' motion, and the antenna's frequency; `shared` is
    `shared_errors(rig, table)`, where it is known already, `normal_world` (B, 3) the object's outward normals where
    something better than the forces' direction is known; NaN elsewhere.
    """
    if shared is None:
        shared = CommonErrors.none(table) if rig is None else shared_errors(rig, table)
    ringing = ringing_frames(table)
    contact = contact_states(table, ringing)
    kinematics, radius = (Kinematics(), _RADIUS_M) if rig is None else (rig.kinematics, 0.5 * rig.antenna.diameter_m)
    phase = np.select([contact.state == 1, contact.state == 0], [TOUCHING, FREE], UNKNOWN).astype("<U8")
    count, every = len(table), strokes(table, contact.state)
    velocity, covariance, std, parts = (np.full((count, *shape), np.nan) for shape in ((3,), (3, 3), (), (2,)))
    for rows in every:
        moving = slip(table, rows, shared, kinematics, None if normal_world is None else normal_world[rows])
        velocity[rows], covariance[rows], parts[rows] = moving.velocity_m_s, moving.covariance_m2_s2, moving.parts_m_s
        sound = np.isfinite(moving.parts_m2_s2).all(axis=(1, 2))
        widest = np.linalg.eigvalsh(moving.parts_m2_s2[sound]).max(axis=-1)
        std[rows[sound]] = np.sqrt(np.maximum(widest, 0.0))
        phase[rows] = _phases(moving, radius)
    events = contact_events(table, contact)
    phase = _after_onset(table, phase, contact, events)
    events += slip_events(table, phase, every)
    events += ringing_events(table, ringing, None if rig is None else Beam.of(rig))
    time_of = dict(zip(table.frame.tolist(), table.time_s.tolist(), strict=True))
    return Track(
        phase=phase,
        slip_velocity_m_s=velocity,
        slip_std_m_s=std,
        longitudinal_m_s=parts[:, 0],
        lateral_m_s=parts[:, 1],
        slip_covariance_m2_s2=covariance,
        ringing=ringing,
        events=tuple(sorted(events, key=lambda each: each.time_s if np.isfinite(each.time_s) else time_of[each.frame])),
        notes=tuple(_notes(table, contact, shared)),
    )


def _after_onset(
    table: ContactTable, phase: np.ndarray, contact: ContactStates, events: tuple[Event, ...]
) -> np.ndarray:
    """The same phases; frames between a first contact or loss and the frame that told it belong to what follows."""
    phase = phase.copy()
    for change, event in zip(contact.changes, events, strict=True):
        if np.isfinite(event.time_s):
            late = change.known_before[table.time_s[change.known_before] > event.time_s]
            late = late[np.isin(phase[late], (FREE, TOUCHING))]
            phase[late] = TOUCHING if change.begins else FREE
    return phase


def _notes(table: ContactTable, contact: ContactStates, shared: CommonErrors) -> list[str]:
    notes = []
    located = table.located
    if not np.isfinite(table.evidence).any():
        notes.append("no evidence column: contact is told frame by frame alone, and its instant between two frames")
    elif not contact.pooled_test:
        notes.append(
            "no dozen free frames in about one pose: slow approaches are told frame by frame alone"
            if np.isfinite(table.pan_rad + table.tilt_rad).any()
            else "no joint angles: slow approaches are told frame by frame alone"
        )
    if located.any() and not np.isfinite(table.tangent_world[located]).any():
        notes.append("no tangents: slip cannot be told")
    if located.any() and not tells_calibration(shared):
        notes.append("no rig: what noise does to the slip is taken from its scatter")
    return notes
