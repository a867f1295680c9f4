"""Contacts of antennas with moving clamps, such as whiskers, from centrelines alone.

The first points of a frame's line give the clamp's position and direction in the picture. Around these the frame is
fitted as for any rig, in a frame of its own: the clamp's offset and angle in the picture are unknowns with a prior far
wider than the first points' uncertainty, so that the fit finds them with the contact and includes their uncertainty.
Depth and rotation out of the picture's plane have the prior of `MovingClamp`.

A clamp moves smoothly. Where a line's first point jumps, the tracker lost the clamp or took another antenna: such
frames are not estimated, until the first point returns to where it was at that angle.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from estimator.solver.linearised import free_antennas
from estimator.solver.rig_arrays import RigArrays
from estimator.table.contacts import FRICTION_RAD, LOCATED, Contact, Measured
from vbaa_calib.core.arrays import neighbours, spread_evenly
from vbaa_calib.geometry import Pose
from vbaa_calib.rig import POSE_PARAMETERS, RIG_PARAMETERS, Rig
from vbaa_calib.session import Frame

from .contacts import MotionCheck, motion_of
from .drift import DriftSettings
from .estimate import ContactEstimator
from .inputs import Batch
from .motion import PIECES, Beam, Shapes
from .recording import FrameContact, measured_lines
from .status import FAILED, LOW, NO_ANTENNA


def _bow() -> int:
    """Index of the rig parameter that is the bow in the picture's plane."""
    return RIG_PARAMETERS.index("bow_about_z_per_m")


@dataclass(frozen=True)
class _ClampSettings:
    """Settings of the clamp's position in a frame, and thresholds from which a tracker's first points are rejected."""

    stretch: float = 0.15  # of the antenna's length, from the first point on, to which place and angle are fitted
    fewest: int = 8  # points of that stretch, at least
    prior: float = 10.0  # times what the stretch leaves uncertain: the fit finds the clamp, its start hardly counts
    oblique: float = 3.0  # deviations of depth and turn out of the plane that this prior leaves room for
    window: int = 7  # steps from frame to frame of which the median is the clamp's motion
    jump_std: float = 8.0  # times a step's usual distance from that median: a jump
    jump_px: float = 3.0  # the same in pixels, at least
    gap: int = 5  # frames across which the clamp goes on as before; beyond, it must come back to where it was
    turn_rad: float = 0.05  # clamps whose angles differ by less should be at the same place
    undetected: float = 3.0  # jumps up to the limit are not seen: so many deviations along the antenna
    free_frames: int = 120  # frames that are searched for the free antenna
    low_signal: float = 0.035  # of the length: less certain distances are withheld, as first order fails beyond
    fewest_free: int = 8  # of these that must be free for the bow to be learnt
    crowd: float = 0.2  # part of the frames that crowd about the free antenna's curvature
    rounds: int = 3  # linearisations of the bow
    bow_rad: float = 0.05  # turn along the antenna by the bow's standard deviation beyond which nothing is estimated
    beyond: float = 4.0  # deviations from their median beyond which a free frame's bow is left out


@dataclass(frozen=True, eq=False)
class _ClampTrack:
    """One antenna's clamp in F frames of a recording, with the bow from its free frames.

    Attributes
    ----------
    rig : of this antenna; its covariance holds the priors of the clamp in each frame, about `places`.
    places : (F, 3) the clamp in plane C, x and y in m and the angle from x, rad; NaN where the line has too few points.
    doubts : (F,) why a frame's first points are not the clamp; "" where they are.
    along_std_m : standard deviation of the first point's place along the antenna, jumps that are not seen included;
        scatter_m : by how much of it successive frames differ.
    free_frames : frames by which the bow was learnt; 0: it is as the rig says.
    """

    rig: Rig
    places: np.ndarray
    doubts: Sequence[str]
    along_std_m: float
    scatter_m: float
    free_frames: int

    @property
    def words(self) -> str:
        """The track's properties in words."""
        bow, std = self.rig.antenna.parameters[_bow() - len(POSE_PARAMETERS)], self.rig.std("bow_about_z_per_m")
        learnt = f"learnt from {self.free_frames} free frames" if self.free_frames else "as stated: no free frames"
        doubtful = sum(bool(each) for each in self.doubts)
        words = f"bow {bow:.3g} ± {std:.2g} /m, {learnt}; first point ± {1e3 * self.along_std_m:.2g} mm"
        return f"{words}; {doubtful} frames without their clamp" if doubtful else words

    def at(self, row: int) -> Rig:
        """The rig with its antenna frame at the clamp in one frame."""
        x, y, angle = self.places[row].tolist()
        T_antenna_clamp = Pose.from_rotvec(np.array([0.0, 0.0, angle]), np.array([x, y, 0.0]))
        joints = self.rig.kinematics
        return replace(
            self.rig,
            T_antenna_camera=T_antenna_clamp.inverse() @ self.rig.T_antenna_camera,
            kinematics=replace(joints, T_actuator_antenna=joints.T_actuator_antenna @ T_antenna_clamp),
        )


def clamp_tracks(
    rig: Rig,
    frames: Sequence[Frame],
    lines: Mapping[str, Mapping[int, np.ndarray]],
    settings: _ClampSettings = _ClampSettings(),
) -> dict[str, _ClampTrack]:
    """The clamps of antennas by name, from their lines by frame (N, 3) of u_px, v_px, sigma_px or NaN, each
    beginning at the clamp. Raises InputError for an antenna that the rig does not have."""
    rigs = {name: replace(rig.of_antenna(name), clamp=None) for name in lines}
    found = {name: _places(own, measured_lines(own, frames, lines[name]), settings) for name, own in rigs.items()}
    limits = {name: _limit_m(each, settings) for name, each in found.items()}
    units = {name: np.array([limit, limit, settings.turn_rad, limit]) for name, limit in limits.items()}
    states = {name: each[:, :4] / units[name] for name, each in found.items()}
    kept = {name: _kept(states[name], settings) for name in found}
    return {
        name: _track(rig, rigs[name], (frames, lines[name]), each, _doubts(name, states, kept, limits), settings)
        for name, each in found.items()
    }


def _places(rig: Rig, several: Iterator[Measured], settings: _ClampSettings) -> np.ndarray:
    """(F, 8) for each frame: clamp's x, y, m, and angle, rad, in plane C, the line's length, m, standard deviations
    of the position across the antenna and of the angle, metres per pixel, and the line's mean curvature, 1/m."""
    return np.array([_place(rig, each, settings) for each in several]).reshape(-1, 8)


def _place(rig: Rig, measured: Measured, settings: _ClampSettings) -> np.ndarray:
    nothing = np.full(8, np.nan)
    pixels = measured.points_px[np.isfinite(measured.points_px).all(axis=1)]
    if len(pixels) < settings.fewest:
        return nothing
    eye, rays = rig.T_antenna_camera, rig.camera.unproject(pixels)[0]
    toward = rays @ eye.rotation.T
    points = (eye.translation_m - toward * (eye.translation_m[2] / toward[:, 2:]))[:, :2]
    far = np.linalg.norm(points - points[0], axis=1)
    beyond = far > settings.stretch * rig.antenna.length_m
    count = max(int(np.argmax(beyond)) if beyond.any() else len(points), settings.fewest)
    stretch, first = points[:count], points[0]
    if not np.isfinite(stretch).all() or far[count - 1] <= 0.0:
        return nothing
    along = np.linalg.svd(stretch - stretch.mean(axis=0))[2][0]
    along = along if (stretch[-1] - first) @ along > 0.0 else -along
    across = np.array([-along[1], along[0]])
    t, w = (stretch - first) @ along, (stretch - first) @ across
    scale = float(t.max())
    terms = np.vander(t / scale, 3, increasing=True)
    normal = terms.T @ terms
    if not np.linalg.cond(normal) < 1e10:
        return nothing
    offset, slope, _ = np.linalg.solve(normal, terms.T @ w)
    m_per_px = float(far[count - 1] / np.linalg.norm(pixels[count - 1] - pixels[0]))
    noise_m = m_per_px * float(np.median(measured.sigma_px[: len(pixels)]))
    std = noise_m * np.sqrt(np.diag(np.linalg.inv(normal)))
    angle = math.atan2(along[1], along[0]) + math.atan(slope / scale)
    place = first + offset * across
    coarse = points[np.r_[0 : len(points) : 8, len(points) - 1]]
    length = float(np.linalg.norm(np.diff(coarse, axis=0), axis=1).sum())
    return np.array([*place, angle, length, std[0], std[1] / scale, m_per_px, _curvature(points, along)])


def _curvature(points: np.ndarray, along: np.ndarray) -> float:
    """Mean curvature, 1/m, by a parabola, of points (N, 2) from a clamp with direction `along` (2,)."""
    seen = points[np.isfinite(points).all(axis=1)]
    chord = seen[-1] - seen[0]
    chord = (chord if chord @ along > 0.0 else along) / max(float(np.linalg.norm(chord)), 1e-12)
    t, w = (seen - seen.mean(axis=0)) @ chord, (seen - seen.mean(axis=0)) @ np.array([-chord[1], chord[0]])
    bend, slope, _ = np.polyfit(t, w, 2)
    return float(2.0 * bend / (1.0 + slope**2) ** 1.5)


def _limit_m(found: np.ndarray, settings: _ClampSettings) -> float:
    """Smallest deviation of a clamp from its usual motion that counts as a jump, m."""
    known = np.flatnonzero(np.isfinite(found[:, 0]))
    if not len(known):
        return 1.0
    off = _off_motion(found[known, :2], known, settings)
    usual = 1.4826 * float(np.median(off)) if len(off) else 0.0
    return max(settings.jump_std * usual, settings.jump_px * float(np.median(found[known, 6])))


def _off_motion(points: np.ndarray, frame: np.ndarray, settings: _ClampSettings) -> np.ndarray:
    """(K − 1,) deviations of the steps between successive points (K, 2), or (K, 3), from the running median step."""
    if len(points) < 2:
        return np.empty(0)
    gaps = np.diff(frame)[:, None]
    steps = np.diff(points, axis=0) / gaps
    usual = np.median(neighbours(steps, settings.window, "edge"), axis=-1)
    return np.linalg.norm((steps - usual) * gaps, axis=1)


def _kept(states: np.ndarray, settings: _ClampSettings) -> np.ndarray:
    """(F,) mask of the frames in which the first point is the clamp. states : (F, 4) position and line's length over
    the limit of a jump, and angle over the range within which positions are compared.

    The longest run without a jump counts, and every run that goes on from one that counts, or comes back to a place
    where the clamp was at that angle, or to where it can have moved, with as long a line.
    """
    from scipy.spatial import cKDTree

    kept = np.zeros(len(states), bool)
    known = np.flatnonzero(np.isfinite(states).all(axis=1))
    if not len(known):
        return kept
    off = _off_motion(states[known, :2], known, settings)
    runs = np.split(known, 1 + np.flatnonzero((off > 1.0) | (np.diff(known) > settings.gap)))
    main = int(np.argmax([len(each) for each in runs]))
    kept[runs[main]] = True
    steps = np.linalg.norm(np.diff(states[runs[main], :2], axis=0), axis=1)
    speed = 1.5 * float(np.median(steps)) if len(steps) else 0.0
    # outwards from the longest run, the nearest first
    for index in sorted(set(range(len(runs))) - {main}, key=lambda index: abs(index - main)):
        run, counted = runs[index], np.flatnonzero(kept)
        nearest = counted[np.argmin(np.abs(counted[:, None] - [run[0], run[-1]]), axis=0)]
        gaps = np.abs(nearest - [run[0], run[-1]])
        end = int(np.argmin(gaps))
        apart = float(np.linalg.norm(states[nearest[end], :2] - states[run[-end], :2]))
        whole = abs(float(np.median(states[run, 3]) - np.median(states[counted, 3]))) <= 1.0
        joins = apart <= 1.0 if gaps[end] <= settings.gap else whole and apart <= 1.0 + speed * gaps[end]
        kept[run] = joins or float(np.median(cKDTree(states[counted, :3]).query(states[run, :3])[0])) <= 1.0
    return kept


def _doubts(
    name: str, states: Mapping[str, np.ndarray], kept: Mapping[str, np.ndarray], limits: Mapping[str, float]
) -> list[str]:
    """The reason why each frame's first points are not the clamp of an antenna; "" where they are."""
    from scipy.spatial import cKDTree

    own, counted = states[name][:, :2], states[name][kept[name], :2]
    doubts, angle = [""] * len(own), _ClampSettings.turn_rad * states[name][:, 2]
    others = {other: states[other][kept[other]] for other in states if other != name and kept[other].any()}
    for other, each in others.items():
        each[:, :2] *= limits[other] / limits[name]
        if len(counted) and float(np.median(cKDTree(each[:, :3]).query(states[name][kept[name], :3])[0])) <= 1.0:
            return [f"its clamp is where that of {other} is: one of the two was tracked twice"] * len(own)
    mine, trees = cKDTree(counted), {other: cKDTree(each[:, :2]) for other, each in others.items()}
    for row in np.flatnonzero(np.isfinite(states[name]).all(axis=1) & ~kept[name]):
        apart, at = mine.query(own[row])
        nearest = {other: float(tree.query(own[row])[0]) for other, tree in trees.items()}
        other = min(nearest, key=lambda each: nearest[each], default="")
        if other and nearest[other] < 0.5 * apart:
            doubts[row] = f"its line begins where that of {other} does: the two were exchanged"
            continue
        off = own[row] - counted[at]
        lost = off @ [math.cos(angle[row]), math.sin(angle[row])] > 0.7 * apart
        how = "farther along the antenna: its first points are missing" if lost else "from where the clamp can be"
        doubts[row] = f"its line begins {1e3 * limits[name] * apart:.1f} mm {how}"
    return doubts


def _track(
    whole: Rig,
    rig: Rig,
    seen: tuple[Sequence[Frame], Mapping[int, np.ndarray]],
    found: np.ndarray,
    doubts: list[str],
    settings: _ClampSettings,
) -> _ClampTrack:
    """The track with the clamp's priors, and the bow estimated from free frames."""
    usable = np.array([not each for each in doubts]) & np.isfinite(found[:, 0])
    clamp, first = whole.clamp, len(POSE_PARAMETERS)
    assert clamp is not None
    if not usable.any():
        return _ClampTrack(rig, found[:, :3], doubts, 0.0, 0.0, 0)
    across_m, turn_rad = settings.prior * np.quantile(found[usable, 4:6], 0.95, axis=0)
    # what depth and turn out of the plane do to a picture off the lens's axis
    oblique = (
        settings.oblique * math.hypot(*rig.camera.image_size) / (rig.camera.matrix[0, 0] + rig.camera.matrix[1, 1])
    )
    across_m += oblique * math.hypot(clamp.depth_std_m, rig.std("camera_z_m"))
    turn_rad += oblique * clamp.elevation_std_rad
    std = np.array([across_m, clamp.depth_std_m, clamp.elevation_std_rad, turn_rad])
    covariance = rig.covariance.copy()
    covariance[range(first, first + 4), range(first, first + 4)] += std**2
    track = _ClampTrack(rig.with_covariance(covariance), found[:, :3], doubts, 0.0, 0.0, 0)
    track = _with_bow(track, seen, np.flatnonzero(usable), (std, found[:, 7]), settings)
    bow_std = track.rig.std("bow_about_z_per_m")
    if bow_std * rig.antenna.length_m > settings.bow_rad:
        why = f"its bow is known only to {bow_std:.2g} /m: too few frames show it free, or state bow_per_m"
        return replace(track, doubts=[each or why for each in doubts])
    covariance, bow = track.rig.covariance.copy(), track.rig.antenna.parameters[4:6]
    # about its own axis the antenna turns the two bows into one another
    covariance[[_bow() - 1, _bow()], [_bow() - 1, _bow()]] += (clamp.roll_std_rad * bow[::-1]) ** 2
    scatter_m = _along_m(found[:, :3], usable)
    along_m = max(scatter_m, _limit_m(found, settings) / settings.undetected)
    return replace(track, rig=track.rig.with_covariance(covariance), along_std_m=along_m, scatter_m=scatter_m)


def _along_m(places: np.ndarray, usable: np.ndarray) -> float:
    """Scatter of first points along the antenna, m, by third differences, since the clamp's motion is smooth."""
    rows = np.flatnonzero(usable[3:] & usable[2:-1] & usable[1:-2] & usable[:-3])
    if len(rows) < 8:
        return 0.0
    third = places[rows + 3] - 3.0 * places[rows + 2] + 3.0 * places[rows + 1] - places[rows]
    angle = places[rows + 1, 2]
    along = third[:, 0] * np.cos(angle) + third[:, 1] * np.sin(angle)
    return 1.4826 * float(np.median(np.abs(along))) / math.sqrt(20.0)


def _with_bow(
    track: _ClampTrack,
    seen: tuple[Sequence[Frame], Mapping[int, np.ndarray]],
    usable: np.ndarray,
    known: tuple[np.ndarray, np.ndarray],
    settings: _ClampSettings,
) -> _ClampTrack:
    """The track with the bow in the picture common to its free frames, and its variation between them.

    In each frame bow and clamp are fitted together; frames that a force explains better are not free. known : prior
    standard deviations (4,) of the clamp, and the frames' curvatures (F,); the search begins where most of them lie.
    """
    (frames, lines), (std, curvature) = seen, known
    wide, first = float(track.rig.std("bow_about_z_per_m")), len(POSE_PARAMETERS)
    if not wide > 0.0:
        return track
    chosen = usable[spread_evenly(len(usable), settings.free_frames)]
    measured = list(measured_lines(track.rig, [frames[int(row)] for row in chosen], lines))
    axes = np.zeros((len(track.rig.covariance), 5))
    axes[range(first, first + 4), range(4)], axes[_bow(), 4] = std, wide
    spread, mean, count = wide, _crowded(curvature[usable], settings.crowd), 0
    for _ in range(settings.rounds):
        values = [
            _own_bow(_with(track, mean), int(row), each, axes) for row, each in zip(chosen, measured, strict=True)
        ]
        table = np.array([each for each in values if each is not None]).reshape(-1, 2)
        if len(table) < settings.fewest_free:
            return track
        middle = float(np.median(table[:, 0]))
        scatter = max(1.4826 * float(np.median(np.abs(table[:, 0] - middle))), float(np.sqrt(np.median(table[:, 1]))))
        agreeing = table[np.abs(table[:, 0] - middle) <= settings.beyond * scatter]
        mean, count = mean + wide * float(agreeing[:, 0].mean()), len(agreeing)
        own = max(float(agreeing[:, 0].var()) - float(agreeing[:, 1].mean()), 0.0)
        spread = wide * math.sqrt(own + float(agreeing[:, 0].var()) / count)
    covariance = track.rig.covariance.copy()
    covariance[_bow(), :] = covariance[:, _bow()] = 0.0
    covariance[_bow(), _bow()] = spread**2
    learnt = _with(track, mean)
    return replace(learnt, rig=learnt.rig.with_covariance(covariance), free_frames=count)


def _crowded(values: np.ndarray, share: float) -> float:
    """Midpoint of the shortest interval that contains this share of values (N,)."""
    ordered = np.sort(values)
    count = max(int(share * len(ordered)), 1)
    widths = ordered[count - 1 :] - ordered[: len(ordered) - count + 1]
    begin = int(np.argmin(widths))
    return float(np.median(ordered[begin : begin + count]))


def _with(track: _ClampTrack, bow_per_m: float) -> _ClampTrack:
    """The track with another bow in the picture."""
    antenna, at = track.rig.antenna, _bow() - len(POSE_PARAMETERS)
    parameters = antenna.parameters.copy()
    parameters[at] = bow_per_m
    return replace(track, rig=replace(track.rig, antenna=replace(antenna, parameters=parameters)))


def _own_bow(track: _ClampTrack, row: int, measured: Measured, axes: np.ndarray) -> tuple[float, float] | None:
    """Change of bow that a free frame indicates, and its variance, in units of the last of `axes` (17 + P, 5); the
    other axes are the clamp's; None for a frame that is not free."""
    rig = track.at(row)
    frames = Batch.of(rig, [measured]).frames(replace(RigArrays.from_rig(rig, 0.0), axes=axes, line=np.empty((1, 0))))
    free = free_antennas(frames)
    if frames.usable.sum() < DriftSettings.fewest_points or not free.gain[0] < DriftSettings.free_gain:
        return None
    whole, side = free.information[0], free.side[0]
    by_clamp = np.linalg.solve(whole[:4, :4], np.column_stack([whole[:4, 4], side[:4]]))
    information = whole[4, 4] - 1.0 - whole[4, :4] @ by_clamp[:, 0]
    return (
        (float(side[4] - whole[4, :4] @ by_clamp[:, 1]) / information, 1.0 / information) if information > 0 else None
    )


def estimate_antennas(
    tracks: Mapping[str, _ClampTrack],
    frames: Sequence[Frame],
    lines: Mapping[str, Mapping[int, np.ndarray]],
    *,
    model: str = "auto",
    friction: float = FRICTION_RAD,
) -> Iterator[FrameContact]:
    """The contacts of every antenna, frame by frame, tested for motion. The world frame is the rig's, in which the
    camera is at rest."""
    streams = [
        _estimated(name, track, frames, measured_lines(track.rig, frames, lines[name]), (model, friction))
        for name, track in tracks.items()
    ]
    for several in zip(*streams, strict=True):
        yield from several


def _estimated(
    name: str, track: _ClampTrack, frames: Sequence[Frame], several: Iterator[Measured], how: tuple[str, float]
) -> Iterator[FrameContact]:
    """The contacts of one antenna's frames, in order."""
    beam = Beam.of(track.rig)
    motion, waiting = MotionCheck(beam), list[tuple[int, Frame, Measured]]()
    model, friction = how

    def finished(contacts: Iterator[Contact]) -> Iterator[FrameContact]:
        for contact in contacts:
            row, frame, measured = waiting.pop(0)
            x, y, angle = track.places[row].tolist()
            origin = track.rig.kinematics.T_world_antenna(frame.pan_rad, frame.tilt_rad) @ np.array([x, y, 0.0])
            yield FrameContact(frame, contact, measured, antenna=name, clamp=np.array([*origin, angle]))

    for row, (frame, measured) in enumerate(zip(frames, several, strict=True)):
        waiting.append((row, frame, measured))
        doubt = track.doubts[row]
        if doubt or not np.isfinite(track.places[row]).all():
            why = (
                Contact(status=FAILED, reason=doubt)
                if doubt
                else Contact(status=NO_ANTENNA, reason="too few points to find the clamp by")
            )
            unknown = np.full((1, PIECES, 3), np.nan)
            shapes = Shapes(np.array([measured.time_s]), unknown, unknown[..., 0], np.array([np.nan]))
            push = np.zeros((1, PIECES, 3))
        else:
            rig = track.at(row)
            estimator = ContactEstimator(rig, model, friction=friction, jobs=1)
            batch = Batch.of(rig, [measured])
            part = estimator._contacts(batch, beam)
            push, shapes = motion_of(rig, batch, part)
            # places along the antenna are counted from its first point
            shapes = replace(shapes, std_m=np.hypot(shapes.std_m, track.scatter_m))
            why = _widened(part[0], track)
        yield from finished(motion.push([why], push, shapes))
    yield from finished(motion.finish())


def _widened(contact: Contact, track: _ClampTrack) -> Contact:
    """The contact with the first point's position uncertainty added to the distance, and without shared errors,
    which are unknown for a clamp that moves."""
    unknown = np.full(3, np.nan)
    contact = replace(contact, distance_shared_std_m=np.nan, point_shared_std_m=unknown, force_shared_std_N=unknown)
    if contact.status not in LOCATED:
        return contact
    # turned out of the picture's plane the antenna looks shorter, to second order: not in the linear covariance
    shortened = contact.distance_m * math.sqrt(0.75) * float(track.rig.std("clamp_about_y_rad")) ** 2
    std_m = math.hypot(contact.distance_std_m, track.along_std_m, shortened)
    if std_m > _ClampSettings.low_signal * track.rig.antenna.length_m:
        why = f"the contact distance is known only to {1e3 * std_m:.1f} mm"
        return Contact(status=LOW, reason=why, model=contact.model, in_contact=True)
    return replace(contact, distance_std_m=std_m)
