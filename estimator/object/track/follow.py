"""From a table of contacts to what happened in time, and how fast the antenna slips.

The contact point X walks over the object and along the antenna; the antenna's own point under it moves with

    v = dX/dt − t̂·dl/dt,

l the contact's arc length, t̂ the tangent. The calibration's errors are common to neighbouring frames and cancel in the
differences but for how the joints turn them; what differs from frame to frame counts.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from estimator.contact.common_errors import CommonErrors, shared_errors
from estimator.contact.motion import Beam
from estimator.table.contacts import ContactTable
from vbaa_calib.core.robust import NORMAL_QUARTILE
from vbaa_calib.geometry import Kinematics
from vbaa_calib.geometry.independent_axes import largest_std
from vbaa_calib.rig import Rig

from .events import contact_events, ringing_events, ringing_frames, slip_events
from .onset import (
    FREE,
    HALF_WINDOW_S,
    ROLLING,
    SLIDING,
    STICKING,
    TOUCHING,
    UNKNOWN,
    ContactStates,
    Track,
    contact_states,
    median_step,
)

_CLEAR, _STILL_CLEAR = 4.5, 2.5  # deviations by which a slip must stand out to be called one, and for it to go on
# share of the joints' motion below which a slip is not called one: curved paths and rolling leave as much; and that it
# must surely stay below where the contact is said to stick
_NOTHING, _STUCK = 0.05, 0.15
_REST_M_S = 3e-4  # nothing slower is distinguishable from rest
_RADIUS_M = 0.5e-3  # the antenna's if no rig is given: only limits how much a sticking antenna may roll
_GAP_FRAMES = 4.0  # a run of located frames ends where so many frames' time passes without one
_LEAST_SECONDS = 6  # second differences needed for a scatter
_MOST_SCATTER = 3.0  # how many times as much as said the points of a path may scatter across the antenna, at most
# velocities are slopes over the frames within `HALF_WINDOW_S`, and over one neighbour on each side at least
_LEAST_HALF = 1
_SHARE = 0.01  # part of a slip that is left open: the object touches an antenna radius beside the centreline
_LEANING_RAD = 0.35  # how far friction may lean the force from the normal across the antenna: standard deviation
_UPRIGHT_RAD = 0.8  # a slip farther from the plane across the force says nothing about the normal: the object gives way


def follow(
    table: ContactTable,
    rig: Rig | None = None,
    shared: CommonErrors | None = None,
    normal_world: np.ndarray | None = None,
    *,
    events: bool = True,
) -> Track:
    """What happens in a recording: first contact, loss, sticking and sliding, ringing.

    The rig separates calibration errors from noise and gives the joints' motion and the antenna's frequency; `shared`
    is `shared_errors(rig, table)`, where it is known already, `normal_world` (B, 3) the object's outward normals where
    something better than the forces' direction is known; NaN elsewhere. Without `events` only the frames' motion.
    """
    if shared is None:
        shared = CommonErrors.none(table) if rig is None else shared_errors(rig, table)
    ringing = ringing_frames(table)
    contact = contact_states(table, ringing)
    kinematics, radius = (Kinematics(), _RADIUS_M) if rig is None else (rig.kinematics, 0.5 * rig.antenna.diameter_m)
    phase = np.select([contact.state == 1, contact.state == 0], [TOUCHING, FREE], UNKNOWN).astype("<U8")
    count, good = len(table), table.located & (contact.state == 1) & np.isfinite(table.time_s)
    good &= np.isfinite(table.point_world_m).all(axis=1) & np.isfinite(table.tangent_world).all(axis=1)
    strokes = runs(table, np.flatnonzero(good), contact.state == 0, np.empty(0))
    velocity, covariance, std, parts = (np.full((count, *shape), np.nan) for shape in ((3,), (3, 3), (), (2,)))
    for rows in strokes:
        moving = _slip(table, rows, shared, kinematics, None if normal_world is None else normal_world[rows])
        velocity[rows], covariance[rows], parts[rows] = moving.velocity_m_s, moving.covariance_m2_s2, moving.parts_m_s
        std[rows] = largest_std(moving.parts_m2_s2)
        phase[rows] = _phases(moving, radius)
    happened = list(contact_events(table, contact)) if events else []
    for change, event in zip(contact.changes, happened, strict=events):
        if np.isfinite(event.time_s):  # frames between a change and its detection belong to what follows
            late = change.known_before[table.time_s[change.known_before] > event.time_s]
            late = late[np.isin(phase[late], (FREE, TOUCHING))]
            phase[late] = TOUCHING if change.begins else FREE
    happened += slip_events(table, phase, strokes)
    happened += ringing_events(table, ringing, None if rig is None else Beam.of(rig))
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
        notes=tuple(_notes(table, contact, shared)),
    )


def _notes(table: ContactTable, contact: ContactStates, shared: CommonErrors) -> list[str]:
    notes = []
    located = table.located
    if not np.isfinite(table.evidence).any():
        notes.append("no evidence column: contact is decided frame by frame, its instant known only between two frames")
    elif not contact.pooled_test:
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


def _phases(slip: _Slip, antenna_radius_m: float) -> np.ndarray:
    """(P,) what each frame of a stroke does; "touching" if undetermined."""
    speed = np.linalg.norm(slip.velocity_m_s, axis=1)
    # its deviation: along the slip where that is clear, else the larger of all directions
    widest = largest_std(slip.parts_m2_s2)
    toward = slip.velocity_m_s / np.maximum(speed, 1e-12)[:, None]
    own = np.sqrt(np.maximum(np.einsum("pi,pij,pj->p", toward, slip.covariance_m2_s2, toward), 0.0))
    carried = np.where(np.isfinite(slip.carried_m_s), slip.carried_m_s, slip.contact_m_s)
    nothing = _NOTHING * carried + antenna_radius_m * slip.turning_rad_s
    with np.errstate(invalid="ignore"):
        std = np.where(speed > _CLEAR * widest, own, widest)
        surely, still = speed - _CLEAR * std > nothing, speed - _STILL_CLEAR * std > nothing
        fast = speed > _REST_M_S
        held = np.cumsum(~(still & fast))  # one number for each run of frames in which a slip may go on
        sliding = still & fast & np.isin(held, np.unique(held[surely & still & fast]))
        rest = np.maximum(antenna_radius_m * slip.turning_rad_s, _REST_M_S)
        small = speed + 2.0 * std <= np.maximum(_STUCK * carried, rest)
        stuck = ~sliding & small & (speed - _STILL_CLEAR * std <= rest)
        walks = slip.contact_m_s - _CLEAR * slip.contact_std_m_s > 2.0 * np.maximum(speed + 2.0 * std, _REST_M_S)
    found = np.full(len(speed), TOUCHING, dtype=object)
    found[stuck] = STICKING
    found[stuck & walks] = ROLLING
    found[sliding] = SLIDING
    return found.astype(str)


def runs(table: ContactTable, rows: np.ndarray, free: np.ndarray, breaks_s: np.ndarray) -> list[np.ndarray]:
    """Rows of a table, split at gaps in time, at clocks that stand still, at free frames (B,) and at times (K,)."""
    if len(rows) == 0:
        return []
    time = table.time_s[rows]
    steps = np.diff(time)
    ends = (steps > _GAP_FRAMES * median_step(table.time_s)) | (np.diff(np.cumsum(free)[rows]) > 0) | ~(steps > 0.0)
    at = np.searchsorted(time, breaks_s[np.isfinite(breaks_s)], side="right") - 1
    ends[at[(at >= 0) & (at < len(ends))]] = True
    return np.split(rows, np.flatnonzero(ends) + 1)


def _without_walk(point: np.ndarray, tangent: np.ndarray, distance: np.ndarray) -> np.ndarray:
    """(P, 3, K) paths of points (P, 3, K) less their walks along the antenna, by distances (P, K)."""
    walk = 0.5 * (tangent[1:] + tangent[:-1])[..., None] * np.diff(distance, axis=0)[:, None]
    return np.concatenate([point[:1], point[1:] - np.cumsum(walk, axis=0)])


def _material_noise(
    material: np.ndarray, time: np.ndarray, tangent: np.ndarray, own: np.ndarray, known: bool
) -> np.ndarray:
    """(P, 3, 3) noise of the material path: along the antenna its own scatter, since an error of the distance moves
    contact and walk alike; across it the contact's own noise, or the scatter where that is unknown."""
    along = np.einsum("pi,pj->pij", tangent, tangent)
    flat = np.eye(3) - along
    across = flat @ own @ flat
    predicted = np.sqrt(np.maximum(np.trace(across, axis1=1, axis2=2) / 2.0, 0.0))
    # along the antenna and two directions across it, turning as little as the antenna does
    first = np.cross(tangent, np.eye(3)[np.argmin(np.abs(tangent.mean(axis=0)))])
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    frame = np.stack([tangent, first, np.cross(tangent, first)], axis=1)
    path = np.einsum("pki,pi->pk", frame, material - material.mean(axis=0))
    if len(path) < _LEAST_SECONDS + 2:
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
        factor = np.clip(sideways / max(float(np.median(predicted)), 1e-12), 1.0, _MOST_SCATTER) ** 2
        return factor * across + along * seen[0] ** 2
    return along * seen[0] ** 2 + flat * sideways**2


@dataclass(frozen=True, eq=False)
class _Slip:
    """Velocities in a stroke of P frames, world frame; the slip is in the plane of contact."""

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
    """The slip in each frame of a stroke, rows (P,) of the table; NaN in strokes of under three frames. Without the
    object's outward normals (P, 3) the force and the slip determine them."""
    time, point, tangent = table.time_s[rows], table.point_world_m[rows], table.tangent_world[rows]
    material = _without_walk(point[..., None], tangent, table.distance_m[rows, None])[..., 0]
    modes, own = np.nan_to_num(shared.point_m[rows]), shared.own_m2[rows]
    # what moves a contact along the antenna moves its distance too
    modes = _without_walk(modes, tangent, np.einsum("pi,pis->ps", tangent, modes))
    noise = _material_noise(material, time, tangent, own, shared.known)
    kernel = _slopes(time)
    moved, modes = kernel @ material, _sloped(kernel, modes)
    covariance = _sloped(kernel.power(2), noise) + modes @ np.swapaxes(modes, 1, 2)
    covariance = covariance + np.eye(3) * (_SHARE**2 * (moved**2).sum(axis=1))[:, None, None]
    across, upward = _tilted_axes(moved, covariance, *_axes(table.force_world_N[rows], tangent))
    if normal is not None:
        known = np.isfinite(normal).all(axis=1)[:, None]
        exact = _axes(normal, tangent)
        across, upward = np.where(known, exact[0], across), np.where(known, exact[1], upward)
    axes = np.stack([tangent, across], axis=1)  # (P, 2, 3)
    plane = np.swapaxes(axes, 1, 2) @ axes
    contact = kernel @ point
    contact -= upward * np.einsum("pi,pi->p", contact, upward)[:, None]
    speed = np.linalg.norm(contact, axis=1)
    toward = contact / np.maximum(speed, 1e-12)[:, None]
    contact_variance = np.einsum("pi,pij,pj->p", toward, _sloped(kernel.power(2), own), toward)
    pan, tilt, held = table.pan_rad[rows], table.tilt_rad[rows], table.point_antenna_m[rows]
    carried = np.full(len(rows), np.nan)
    if np.isfinite(pan).all() and np.isfinite(tilt).all() and np.isfinite(held).all():
        rotation, translation = kinematics.world_antenna(pan, tilt)
        carried = np.linalg.norm(
            np.einsum("pab,pb->pa", _sloped(kernel, rotation), held) + kernel @ translation, axis=1
        )
    return _Slip(
        velocity_m_s=np.einsum("pij,pj->pi", plane, moved),
        covariance_m2_s2=plane @ covariance @ plane,
        parts_m_s=np.einsum("pki,pi->pk", axes, moved),
        parts_m2_s2=axes @ covariance @ np.swapaxes(axes, 1, 2),
        contact_m_s=speed,
        contact_std_m_s=np.sqrt(np.maximum(contact_variance, 0.0)),
        carried_m_s=carried,
        turning_rad_s=np.linalg.norm(kernel @ tangent, axis=1),
    )


def _slopes(time_s: np.ndarray) -> csr_array:
    """(P, P) rows that make the slope at each time of the line through its neighbours, as many on either side where
    there are; NaN rows for P < 3."""
    count = len(time_s)
    if count < 3:
        return csr_array(np.full((count, count), np.nan))
    row = np.arange(count)
    before = row - np.searchsorted(time_s, time_s - HALF_WINDOW_S - 1e-9)
    after = np.searchsorted(time_s, time_s + HALF_WINDOW_S + 1e-9, side="right") - 1 - row
    half = np.maximum(np.minimum(before, after), _LEAST_HALF)
    low, high = np.maximum(row - half, 0), np.minimum(row + half, count - 1)
    short = high - low < 2
    high = np.minimum(np.where(short, low + 2, high), count - 1)
    low = np.where(short, np.clip(low, 0, count - 3), low)
    size = high - low + 1
    rows = np.repeat(row, size)
    columns = np.arange(size.sum()) - np.repeat(np.cumsum(size) - size, size) + np.repeat(low, size)
    middle = np.bincount(rows, time_s[columns] - time_s[rows]) / size
    away = time_s[columns] - time_s[rows] - middle[rows]
    return csr_array((away / np.bincount(rows, away**2)[rows], (rows, columns)), shape=(count, count))


def _sloped(kernel: csr_array, values: np.ndarray) -> np.ndarray:
    """(P, ...) the slopes of values (P, ...)."""
    return (kernel @ values.reshape(len(values), -1)).reshape(values.shape)


def _axes(force: np.ndarray, tangent: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(P, 3) normal × tangent, and the normal itself: the force, square to the tangent. NaN without a force."""
    upward = force - tangent * np.einsum("pi,pi->p", force, tangent)[:, None]
    size = np.linalg.norm(upward, axis=1, keepdims=True)
    upward = np.where(size > 0.0, upward / np.where(size > 0.0, size, 1.0), np.nan)
    return np.cross(upward, tangent), upward


def _tilted_axes(
    moved: np.ndarray, covariance: np.ndarray, across: np.ndarray, upward: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The same axes turned about the tangent: where a material point seems to leave the plane of contact, the plane is
    another, within what friction can do, and in the measure in which the slip's direction is known."""
    sideways, away = (np.einsum("pi,pi->p", axis, moved) for axis in (across, upward))
    noise = np.einsum("pi,pij,pj->p", upward, covariance, upward)
    with np.errstate(divide="ignore", invalid="ignore"):
        lean = np.arctan(away / sideways)
        variance = noise / (sideways**2 + away**2) + 0.05**2
        turn = lean * _LEANING_RAD**2 / (_LEANING_RAD**2 + variance)
    turn = np.where(np.abs(lean) < _UPRIGHT_RAD, turn, 0.0)[:, None]
    return np.cos(turn) * across + np.sin(turn) * upward, np.cos(turn) * upward - np.sin(turn) * across
