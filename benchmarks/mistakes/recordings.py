"""Recordings as people take them, and what goes wrong with them: a table of mistakes, each drawn anew."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Generic, TypeVar

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.mistakes.rigs import LINE_PX, Bent, Calibrated, Kind, Line, World, drifted, known_rig, seen
from estimator.contact.recording import measured_lines
from estimator.table.contacts import Measured
from vbaa_calib.geometry import Kinematics
from vbaa_calib.rig import Rig
from vbaa_calib.session import Frame
from vbaa_calib.simulate.scene.lens import normalise

NAMED, DOUBTED, REPORTED, NOTHING = "N", "D", "note", "none"
"""What must be reported: the right cause first; a doubt; the right cause, if only as a note; no alarm."""


@dataclass(frozen=True, eq=False)
class Motion:
    """What a person does with a rig, frame by frame.

    Attributes
    ----------
    time_s, pan_rad, tilt_rad : (F,). distance_m : (F,) of the contact, in arc length. force_N : (F, 3) antenna frame,
    0 where nothing touches; in both, of an antenna of the nominal length and stiffness.
    """

    time_s: np.ndarray
    pan_rad: np.ndarray
    tilt_rad: np.ndarray
    distance_m: np.ndarray
    force_N: np.ndarray

    @property
    def touched(self) -> np.ndarray:
        """(F,) bool."""
        return np.asarray(self.force_N.any(axis=1))


@dataclass(frozen=True, eq=False)
class Truth:
    """Of F frames: where and how they are touched; NaN where nothing touches."""

    distance_m: np.ndarray
    force_N: np.ndarray
    point_world_m: np.ndarray


@dataclass(frozen=True, eq=False)
class Recording:
    """What was recorded on a rig.

    Attributes
    ----------
    rig : as it was calibrated. worlds : as it is, in each frame. seed : of the noise: the same for all that is recorded
    again. moments_z_Nm : (F,) what a sensor about the other axis would read.
    """

    rig: Rig
    frames: list[Measured]
    truth: Truth
    motion: Motion
    worlds: Sequence[World]
    seed: int
    moments_z_Nm: np.ndarray

    @property
    def size(self) -> np.ndarray:
        """(2,) of the pictures."""
        return np.array(self.rig.camera.image_size)

    @property
    def free(self) -> np.ndarray:
        """(F,) bool: frames in which nothing touches the antenna."""
        return ~self.motion.touched

    def again(self, worlds: Sequence[World]) -> Recording:
        """The same done and noted on rigs that differ."""
        return recorded(self.rig, worlds, self.motion, self.seed)


def motion(kind: Kind, frames: int, rng: np.random.Generator, free: bool = True) -> Motion:
    """Free frames first, if so, then strokes at changing places and sides, with changing tilt; free in between."""
    swing_s = 1.0 / (0.56 * np.sqrt(kind.antenna.stiffness_Nm2 / kind.antenna.mass_per_length_kg_m) / kind.length_m**2)
    longest = int(np.clip(frames / rng.uniform(2.5, 4.5), 10, 90))
    # of a camera's pictures every so many-th is kept, where strokes are short in frames: nothing swings
    step_s = max(1.0 / rng.uniform(30.0, 60.0), max(1.5, rng.uniform(20.0, 40.0) * swing_s) / longest)
    time_s = np.cumsum(1.0 + 0.02 * rng.uniform(-1, 1, frames)) * step_s
    turns = 2.0 * np.pi * rng.uniform(0.8, 1.4) * max(time_s[-1] / 20.0, 1.0) * time_s / time_s[-1]
    pan = rng.uniform(0.1, 0.5) * np.sin(0.7 * turns + rng.uniform(0, 6)) + rng.uniform(-0.4, 0.4)
    tilt = rng.uniform(0.25, 0.6) * np.sin(turns + rng.uniform(0, 6)) + rng.uniform(-0.2, 0.2)
    distance, force = np.full(frames, 0.5 * kind.length_m), np.zeros((frames, 3))
    first, begin = int(rng.integers(10, 20)) if free else 0, 0
    if free:
        # the free antenna is swung over 20° or more
        tilt = tilt + rng.choice([-1.0, 1.0]) * 0.45 * np.exp(-((np.arange(frames) / first) ** 2))
        begin = first
    while begin < frames:
        count = min(int(rng.uniform(0.5, 1.0) * longest), frames - begin)
        way = np.linspace(0.0, 1.0, count)
        place = rng.uniform(0.3, 0.92) + rng.uniform(-0.15, 0.15) * way
        at = place.clip(0.25, 0.95) * kind.length_m
        side, roll = rng.uniform(-np.pi, np.pi), rng.uniform(-0.5, 0.5) * way
        # pressed within a third of the stroke, let go at its end; slopes of 2 to 12 degrees
        slope = rng.uniform(0.05, 0.22) * (0.15 + 0.85 * np.sin(np.pi * np.clip(way, 0.03, 0.97)) ** 0.7)
        size = 2.0 * kind.antenna.stiffness_Nm2 * slope / at**2
        friction = rng.uniform(-0.2, 0.2)
        rows = slice(begin, begin + count)
        distance[rows] = at
        along = size * (np.tan(friction) - 0.7 * slope)  # about along the bent antenna's normal
        force[rows] = np.column_stack([along, size * np.cos(side + roll), size * np.sin(side + roll)])
        begin += count + (int(rng.integers(2, 7)) if free else 0)
    return Motion(time_s, pan, tilt, distance, force)


def recorded(rig: Rig, worlds: Sequence[World], done: Motion, seed: int) -> Recording:
    """What a rig records while it is in these worlds, frame by frame; the seed is that of the noise."""
    rng, groups = np.random.default_rng((52, seed)), dict[int, list[int]]()
    for index, world in enumerate(worlds):
        groups.setdefault(id(world), []).append(index)
    count = len(worlds)
    lines: list[Line | None] = [None] * count
    readings, points = np.zeros((count, 2)), np.zeros((count, 3))
    drawn = int(rng.integers(2**31))
    for own in groups.values():
        rows, world = np.array(own), worlds[own[0]]
        at = np.minimum(done.distance_m[rows], world.length_m)
        gravity = world.gravity(done.pan_rad[rows], done.tilt_rad[rows])
        bent = Bent.of(world, gravity, at, done.force_N[rows])
        readings[rows], points[rows] = bent.readings_Nm, bent.contact_m
        for row, line in zip(own, seen(bent, LINE_PX, np.random.default_rng((drawn, own[0]))), strict=True):
            lines[row] = line
    noise = worlds[0].kind.moment_std_Nm * rng.normal(size=(count, 2))
    readings = readings + noise
    rotation, origin = Kinematics().world_antenna(done.pan_rad, done.tilt_rad)
    touched = np.where(done.touched, 1.0, np.nan)
    in_world = np.einsum("fij,fj->fi", rotation, points) + origin
    truth = Truth(done.distance_m * touched, done.force_N * touched[:, None], in_world * touched[:, None])
    frames = [
        Measured(
            line.points_px, line.sigma_px, float(read), float(pan), float(tilt), time_s=float(at), tip_px=line.tip_px
        )
        for line, read, pan, tilt, at in zip(
            lines, readings[:, 0], done.pan_rad, done.tilt_rad, done.time_s, strict=True
        )
        if line is not None
    ]
    return Recording(rig, frames, truth, done, worlds, seed, readings[:, 1])


def clean_recording(kind: Kind, seed: int, frames: int = 60, free: bool = True) -> Recording:
    """A recording without a mistake, on a calibrated rig of a kind that has drifted as rigs do."""
    known = known_rig(kind, seed % 4)
    return recording_on(known, seed, frames, free)


def recording_on(known: Calibrated, seed: int, frames: int = 60, free: bool = True) -> Recording:
    """The same on a rig that is calibrated already."""
    rng = np.random.default_rng((53, seed))
    world, done = drifted(known.world, rng.normal(size=20)), motion(known.world.kind, frames, rng, free)
    return recorded(known.rig, [world] * frames, done, seed)


# --- what goes wrong

Data = TypeVar("Data")
Altered = Callable[[Recording, np.random.Generator], Recording]


@dataclass(frozen=True)
class Mistake(Generic[Data]):
    """A row of the matrix.

    Attributes
    ----------
    what : altered, in words. must : be said. right : names of findings that name its cause.
    altered : a clean recording (or session) and a generator that draws the value, to what is recorded instead.
    says : what the sentence of an error (exit code 2) must match to be as good as such a finding.
    """

    what: str
    must: str
    right: frozenset[str]
    altered: Callable[[Data, np.random.Generator], Data]
    says: str = ""


_READ = ("moment_Nm", "pan_rad", "tilt_rad")


def _noted(was: Recording, names: Sequence[str]) -> np.ndarray:
    """(n, F) what the frames say of each."""
    return np.array([[getattr(one, name) for one in was.frames] for name in names])


def _noting(was: Recording, names: Sequence[str], values: np.ndarray) -> Recording:
    """The recording with other numbers (n, F) in these columns."""
    rows = zip(was.frames, values.T.tolist(), strict=True)
    return replace(was, frames=[replace(one, **dict(zip(names, own, strict=True))) for one, own in rows])


def _readings(change: Callable[[np.ndarray, np.random.Generator, Recording], np.ndarray]) -> Altered:
    """Moments (F,) changed."""
    return lambda was, rng: _noting(was, _READ[:1], change(_noted(was, _READ[:1])[0], rng, was)[None])


def _joints(change: Callable[[np.ndarray, np.random.Generator], np.ndarray]) -> Altered:
    """Pan and tilt (2, F) changed, as they are noted."""
    return lambda was, rng: _noting(was, _READ[1:], change(_noted(was, _READ[1:]), rng))


def _lines(change: Callable[[np.ndarray, Recording, np.random.Generator], np.ndarray]) -> Altered:
    """Points (N, 2) of all pictures changed alike, tips with them."""

    def altered(was: Recording, rng: np.random.Generator) -> Recording:
        seed = int(rng.integers(2**31))
        return replace(was, frames=[_with_points(one, was, seed, change) for one in was.frames])

    return altered


def _with_points(
    one: Measured, was: Recording, seed: int, change: Callable[[np.ndarray, Recording, np.random.Generator], np.ndarray]
) -> Measured:
    points = change(one.points_px, was, np.random.default_rng(seed))
    inside = ((points > 0) & (points < was.size - 1)).all(axis=1)
    tip = change(one.tip_px[None, :2], was, np.random.default_rng(seed))[0]
    tip_px = np.array([*tip, one.tip_px[2]]) if ((tip > 0) & (tip < was.size - 1)).all() else np.full(3, np.nan)
    return replace(one, points_px=points[inside], sigma_px=one.sigma_px[inside], tip_px=tip_px)


def _pictures_of(rows: Callable[[int, np.random.Generator], np.ndarray]) -> Altered:
    """Pictures of other rows: (F,) which."""

    def altered(was: Recording, rng: np.random.Generator) -> Recording:
        pairs = zip(was.frames, rows(len(was.frames), rng).tolist(), strict=True)
        names = ("points_px", "sigma_px", "tip_px")
        frames = [replace(one, **{name: getattr(was.frames[row], name) for name in names}) for one, row in pairs]
        return replace(was, frames=frames)

    return altered


def _rigs(change: Callable[[World, np.random.Generator], World], half: bool = False) -> Altered:
    """Another rig than was calibrated; `half`: from some frame about half way on."""

    def altered(was: Recording, rng: np.random.Generator) -> Recording:
        world, count = was.worlds[0], len(was.worlds)
        other = change(world, rng)
        begin = int(count * rng.uniform(0.35, 0.65)) if half else 0
        return was.again([world] * begin + [other] * (count - begin))

    return altered


def _either(low: float, high: float, rng: np.random.Generator) -> float:
    """A size between two, of either sign."""
    return float(rng.choice([-1.0, 1.0]) * rng.uniform(low, high))


def _direction(rng: np.random.Generator, dimensions: int = 3) -> np.ndarray:
    way = rng.normal(size=dimensions)
    return np.asarray(way / np.linalg.norm(way))


def _about_z(m: np.ndarray, rng: np.random.Generator, was: Recording) -> np.ndarray:
    """The same sensor, turned by 90°."""
    world = was.worlds[0]
    return np.asarray(world.offset_Nm + world.gain * was.moments_z_Nm)


def _stuck(m: np.ndarray, rng: np.random.Generator, was: Recording) -> np.ndarray:
    return np.full(len(m), float(m[rng.integers(len(m))]))


def _compressed(m: np.ndarray, rng: np.random.Generator, was: Recording) -> np.ndarray:
    """An amplifier that is not linear at the end of its range."""
    most = rng.uniform(0.6, 0.9) * np.abs(m).max()
    return np.asarray(most * np.tanh(m / most))


def _part_of_z(m: np.ndarray, rng: np.random.Generator, was: Recording) -> np.ndarray:
    """The same sensor, turned by 20° to 60° about the antenna."""
    angle, zero = np.radians(_either(20.0, 60.0, rng)), was.worlds[0].offset_Nm
    return np.asarray(zero + np.cos(angle) * (m - zero) + np.sin(angle) * (_about_z(m, rng, was) - zero))


def _humming(m: np.ndarray, rng: np.random.Generator, was: Recording) -> np.ndarray:
    size, way = rng.uniform(20.0, 60.0) * was.rig.moment_sensor.std_Nm, rng.uniform(0.06, 2.8)
    return np.asarray(m + size * np.sin(way * np.arange(len(m)) + rng.uniform(0.0, 6.0)))


def _pulled(m: np.ndarray, rng: np.random.Generator, was: Recording) -> np.ndarray:
    """A cable that pulls as the tilt turns."""
    return np.asarray(m + _either(20.0, 60.0, rng) * was.rig.moment_sensor.std_Nm * _noted(was, _READ[2:])[0])


def _warming(m: np.ndarray, rng: np.random.Generator, was: Recording) -> np.ndarray:
    walked = _either(20.0, 50.0, rng) * was.rig.moment_sensor.std_Nm
    return np.asarray(m + walked * (1.0 - np.exp(-np.linspace(0.0, 4.0, len(m)))))


def _reversed_later(m: np.ndarray, rng: np.random.Generator, was: Recording) -> np.ndarray:
    return np.where(np.arange(len(m)) < rng.uniform(0.35, 0.65) * len(m), m, -m)


def _saturated(m: np.ndarray, rng: np.random.Generator, was: Recording) -> np.ndarray:
    most = rng.uniform(0.15, 0.5) * np.abs(m).max()
    return np.clip(m, -most, most)


def _rounded(m: np.ndarray, rng: np.random.Generator, was: Recording) -> np.ndarray:
    step = rng.uniform(15.0, 60.0) * was.rig.moment_sensor.std_Nm
    return step * np.round(m / step)


def _kept(m: np.ndarray, rng: np.random.Generator, was: Recording) -> np.ndarray:
    every = int(rng.integers(2, 6))
    return m[np.arange(len(m)) // every * every]


def _filtered(m: np.ndarray, rng: np.random.Generator, was: Recording) -> np.ndarray:
    """Through a low-pass filter of first order."""
    kept, found = np.exp(-1.0 / rng.uniform(1.5, 6.0)), m.copy()
    for row in range(1, len(m)):
        found[row] = kept * found[row - 1] + (1.0 - kept) * m[row]
    return found


def _dropped(m: np.ndarray, rng: np.random.Generator, was: Recording) -> np.ndarray:
    """A loose contact: no reading in some rows, for which 0 is noted."""
    return np.where(rng.uniform(size=len(m)) < rng.uniform(0.1, 0.4), 0.0, m)


def _dead_zone(m: np.ndarray, rng: np.random.Generator, was: Recording) -> np.ndarray:
    return np.where(np.abs(m) < np.quantile(np.abs(m), rng.uniform(0.1, 0.35)), 0.0, m)


def _drifting(m: np.ndarray, rng: np.random.Generator, was: Recording) -> np.ndarray:
    walked = _either(15.0, 40.0, rng) * was.rig.moment_sensor.std_Nm
    return np.asarray(m + walked * np.linspace(0.0, 1.0, len(m)))


def _spikes(m: np.ndarray, rng: np.random.Generator, was: Recording) -> np.ndarray:
    hit = rng.uniform(size=len(m)) < rng.uniform(0.05, 0.15)
    hit[rng.integers(len(m))] = True
    return np.where(hit, m + rng.uniform(0.5, 2.0) * np.abs(m).max() * rng.choice([-1.0, 1.0], len(m)), m)


def _off(low: float, high: float) -> Callable[[np.ndarray, np.random.Generator], np.ndarray]:
    return lambda joints, rng: joints + np.array([[0.0], [_either(low, high, rng)]])


def _later(values: np.ndarray) -> np.ndarray:
    return np.concatenate([values[..., :1], values[..., :-1]], axis=-1)


def _frozen_rows(count: int, rng: np.random.Generator) -> np.ndarray:
    """(F,) rows of which 8 or more, but fewer than 20, stand for the first of them."""
    rows, begin = np.arange(count), int(count * rng.uniform(0.3, 0.7))
    rows[begin : begin + int(rng.integers(8, 20))] = begin
    return rows


def _swapped_rows(count: int, rng: np.random.Generator) -> np.ndarray:
    """(F,) rows of which two, in the last two thirds, are exchanged."""
    rows = np.arange(count)
    one, other = rng.choice(np.arange(count // 3, count), 2, replace=False)
    rows[[one, other]] = other, one
    return rows


def _neighbour_rows(count: int, rng: np.random.Generator) -> np.ndarray:
    """(F,) each the row before, or each the row after."""
    return np.clip(np.arange(count) + rng.choice([-1, 1]), 0, count - 1)


def _cropped(points: np.ndarray, was: Recording, rng: np.random.Generator) -> np.ndarray:
    # a part of the picture, enlarged to the size of the whole
    part = rng.uniform(0.75, 0.92)
    corner = rng.uniform(0.2, 0.8, 2) * (1.0 - part) * was.size
    return (points - corner) / part


def _rectified(points: np.ndarray, was: Recording, rng: np.random.Generator) -> np.ndarray:
    camera, lens = was.rig.camera, was.worlds[0].lens
    rays = normalise(lens, points)
    return rays * np.diag(camera.matrix)[:2] + camera.matrix[:2, 2]


def _scaled(points: np.ndarray, was: Recording, rng: np.random.Generator) -> np.ndarray:
    return (points + 0.5) * rng.choice([1 / 2, 2 / 3, 0.8, 0.9]) - 0.5


def _other_wire(stiffness: float = 0.0, diameter: float = 0.0) -> Callable[[World, np.random.Generator], World]:
    def change(world: World, rng: np.random.Generator) -> World:
        d = np.log1p(_either(0.6, 1.2, rng) * diameter)
        return world.with_parameters(p6=np.log1p(_either(0.8, 1.4, rng) * stiffness) + 4 * d, p7=2 * d)

    return change


def _bent(low: float, high: float) -> Callable[[World, np.random.Generator], World]:
    def change(world: World, rng: np.random.Generator) -> World:
        y, z = rng.uniform(low, high) * _direction(rng, 2)
        return world.with_parameters(p4=y, p5=z)

    return change


def _kinked(world: World, rng: np.random.Generator) -> World:
    y, z = rng.uniform(0.03, 0.12) * _direction(rng, 2)
    return replace(world, kink=(float(rng.uniform(0.2, 0.7) * world.length_m), float(y), float(z)))


def _slid(world: World, rng: np.random.Generator) -> World:
    """The antenna pushed into its clamp, or pulled out."""
    return replace(world, length_m=world.length_m + _either(1e-3, 3e-3, rng) * min(1.0, world.length_m / 0.1))


def _longer(world: World, rng: np.random.Generator) -> World:
    return replace(world, length_m=world.length_m * (1.0 + _either(0.02, 0.06, rng)))


def _on_a_slope(world: World, rng: np.random.Generator) -> World:
    """The base stands on a slope."""
    around, by_rad = rng.uniform(0.0, 2.0 * np.pi), np.radians(rng.uniform(5.0, 15.0))
    turn = Rotation.from_rotvec(by_rad * np.array([np.cos(around), np.sin(around), 0.0]))
    return replace(world, gravity_world_m_s2=turn.apply(world.gravity_world_m_s2))


def _other_rig(was: Recording, rng: np.random.Generator) -> Recording:
    kind = was.worlds[0].kind
    others = [known_rig(kind, seed).rig for seed in range(4)]
    return replace(was, rig=next(rig for rig in others if rig is not was.rig))


def _knocked(world: World, rng: np.random.Generator) -> World:
    return world.camera_moved(np.radians(rng.uniform(0.25, 0.6)) * _direction(rng), np.zeros(3))


def _shifted(world: World, rng: np.random.Generator) -> World:
    return world.lens_moved(1.0, rng.uniform(5.0, 15.0) * _direction(rng, 2))


def _refocused(world: World, rng: np.random.Generator) -> World:
    return world.lens_moved(1.0 + _either(0.008, 0.03, rng))


def _gross(far_px: tuple[float, float]) -> Altered:
    """One point of one of the frames, or of several, somewhere else."""

    def altered(was: Recording, rng: np.random.Generator) -> Recording:
        frames = list(was.frames)
        for row in rng.choice(len(frames), max(len(frames) // 3, 1), replace=False):
            points = frames[row].points_px.copy()
            far = rng.uniform(*far_px)
            points[rng.integers(len(points))] = [far, far] if far > 6e4 else points[0] + far * _direction(rng, 2)
            frames[row] = replace(frames[row], points_px=points)
        return replace(was, frames=frames)

    return altered


def _sigma(factor: float | None) -> Altered:
    """A tracker's table with other standard deviations; None: without them. There are no tips in it."""

    def altered(was: Recording, rng: np.random.Generator) -> Recording:
        lines, frames = {}, []
        for row, one in enumerate(was.frames):
            sigma = np.nan * one.sigma_px if factor is None else one.sigma_px / factor
            lines[row] = np.column_stack([one.points_px, sigma])
            frames.append(Frame(None, one.pan_rad, one.tilt_rad, one.moment_Nm, row, time_s=one.time_s))
        return replace(was, frames=list(measured_lines(was.rig, frames, lines)))

    return altered


def _clock(low_s: float, high_s: float, names: Sequence[str] = _READ, in_rows: bool = False) -> Altered:
    """Readings with stamps that are so late: each picture gets those of an earlier moment. in_rows : the times are
    multiples of the time between rows."""

    def altered(was: Recording, rng: np.random.Generator) -> Recording:
        times = was.motion.time_s
        unit_s = float(np.median(np.diff(times))) if in_rows else 1.0
        late = times - rng.choice([-1.0, 1.0]) * np.exp(rng.uniform(*np.log([low_s, high_s]))) * unit_s
        return _noting(was, names, np.array([np.interp(late, times, values) for values in _noted(was, names)]))

    return altered


def _times(factor: float) -> Altered:
    return lambda was, rng: _noting(was, ["time_s"], factor * _noted(was, ["time_s"]))


def _no_free(was: Recording, rng: np.random.Generator) -> Recording:
    kept = np.flatnonzero(was.motion.touched)
    truth = Truth(*(values[kept] for values in vars(was.truth).values()))
    done = Motion(*(values[kept] for values in vars(was.motion).values()))
    frames, worlds = [was.frames[row] for row in kept], [was.worlds[row] for row in kept.tolist()]
    return replace(was, frames=frames, truth=truth, motion=done, worlds=worlds, moments_z_Nm=was.moments_z_Nm[kept])


def _unread(was: Recording, rng: np.random.Generator) -> Recording:
    return _noting(was, _READ, np.repeat([[np.nan], [0.0], [0.0]], len(was.frames), axis=1))


def _row(what: str, right: str, altered: Altered, must: str = NAMED, says: str = "") -> Mistake[Recording]:
    return Mistake(what, must, frozenset(right.split()), altered, says)


LATE = "pictures_late clock_offset"
MOVED = "picture_moved camera_turned"
UNLIKE = "moment_dead moment_unexplained"
RECORDING = (
    _row("moment all 0", "moment_dead", _readings(lambda m, rng, was: 0.0 * m)),
    _row("moment stuck at a value", "moment_stuck", _readings(_stuck)),
    _row("moment saturated", "moment_saturated", _readings(_saturated)),
    _row("moment reversed", "moment_sign", _readings(lambda m, rng, was: -m)),
    _row("moment's absolute value", "moment_absolute", _readings(lambda m, rng, was: np.abs(m))),
    _row("moment × 0.1", "moment_unit", _readings(lambda m, rng, was: 0.1 * m)),
    _row("moment in mN·m", "moment_unit", _readings(lambda m, rng, was: 1e3 * m), says="N·m"),
    _row("moment in N·cm", "moment_unit", _readings(lambda m, rng, was: 1e2 * m), says="N·m"),
    _row("moment × 10", "moment_unit", _readings(lambda m, rng, was: 10.0 * m)),
    _row("moment about the other axis", "moment_axis", _readings(_about_z)),
    _row("moment one row late", "moment_late", _readings(lambda m, rng, was: _later(m))),
    _row("moment drifts by 15 to 40 std", "moment_drift moment_zero", _readings(_drifting)),
    _row("moment has spikes", "moment_spikes", _readings(_spikes), DOUBTED),
    _row("pan and tilt exchanged", "joints_exchanged joints_untested", _joints(lambda q, rng: q[::-1]), REPORTED),
    _row("tilt's sign", "tilt_sign joints_untested", _joints(lambda q, rng: q * np.array([[1.0], [-1.0]])), REPORTED),
    _row("joints in degrees", "joints_degrees", _joints(lambda q, rng: np.degrees(q)), says="radians"),
    _row("joints frozen", "joints_frozen joints_untested", _joints(lambda q, rng: q[:, :1] + 0.0 * q), REPORTED),
    _row("joints one row late", "joints_late joints_untested", _joints(lambda q, rng: _later(q)), REPORTED),
    _row("tilt off by 1°", "joint_offset joints_untested", _joints(_off(0.014, 0.03)), REPORTED),
    _row("pictures of the neighbour rows", f"{LATE} moment_late", _pictures_of(_neighbour_rows)),
    _row("two pictures exchanged", "pictures_exchanged", _pictures_of(_swapped_rows), DOUBTED),
    _row("camera frozen for 8 to 20 frames", "camera_frozen", _pictures_of(_frozen_rows)),
    _row(
        "pictures mirrored",
        "picture_mirrored",
        _lines(lambda p, was, rng: np.column_stack([was.size[0] - 1 - p[:, 0], p[:, 1]])),
    ),
    _row("pictures turned by 180°", "picture_turned", _lines(lambda p, was, rng: was.size - 1 - p)),
    _row("pictures reduced within their size", "picture_scaled picture_cropped", _lines(_scaled)),
    _row("pictures cropped and enlarged", "picture_cropped picture_scaled", _lines(_cropped)),
    _row("pictures rectified", "picture_rectified picture_scaled picture_cropped", _lines(_rectified)),
    _row("pictures shifted by 5 to 15 px", MOVED, _rigs(_shifted)),
    _row("camera turned by 0.25° to 0.6°", MOVED, _rigs(_knocked)),
    _row("camera turned half way", MOVED, _rigs(_knocked, half=True)),
    _row("refocused by 0.8 to 3 %", "focus_changed picture_scaled", _rigs(_refocused)),
    _row("antenna bent by 0.1 to 0.6 per m", "antenna_bent", _rigs(_bent(0.1, 0.6))),
    _row("antenna bent half way", "antenna_bent", _rigs(_bent(0.2, 0.6), half=True)),
    _row("antenna kinked", "antenna_bent", _rigs(_kinked)),
    _row("antenna slid by 1 to 3 mm", "antenna_slid other_length", _rigs(_slid)),
    _row("antenna slid half way", "antenna_slid other_length", _rigs(_slid, half=True)),
    _row("another antenna: EI by 4 to 7 %", "other_stiffness other_diameter", _rigs(_other_wire(stiffness=0.05))),
    _row("another antenna: diameter by 6 to 12 %", "other_diameter other_stiffness", _rigs(_other_wire(diameter=0.1))),
    _row("another antenna: length by 2 to 6 %", "other_length antenna_slid", _rigs(_longer)),
    _row("rig of another camera of the same size", f"other_rig {MOVED}", _other_rig),
    _row("points at (65535, 65535)", "points_outside", _gross((65535.0, 65535.0)), NOTHING),
    _row("points 3,000 px off", "points_outside", _gross((2500.0, 3500.0)), NOTHING),
    _row("u and v exchanged", "points_exchanged", _lines(lambda p, was, rng: p[:, ::-1])),
    _row("sigma_px absent", "", _sigma(None), NOTHING),
    _row("sigma_px 5 times too small", "sigma_too_small", _sigma(5.0)),
    _row("no free frame", "no_free_frame", _no_free, REPORTED),
    _row("no readings at all", "no_readings", _unread, REPORTED),
    _row("clock off by 0.1 s", f"{LATE} joints_late moment_late", _clock(0.07, 0.13)),
    _row("stamps in ms", "time_unit", _times(1e3)),
    _row("stamps in ns", "time_unit", _times(1e9)),
    _row("clock off by 0.3 to 12 rows", f"{LATE} joints_late moment_late", _clock(0.3, 12.0, in_rows=True)),
    _row("moment 0.3 to 12 rows late or early", f"{LATE} moment_late", _clock(0.3, 12.0, _READ[:1], True)),
    _row("tilt off by 3 to 20°", "joint_offset joints_untested", _joints(_off(0.05, 0.35)), REPORTED),
    _row("moment in steps of 15 to 60 std", "moment_rounded", _readings(_rounded)),
    _row("moment of every 2nd to 5th row", "moment_kept", _readings(_kept)),
    _row("moment rows shuffled", f"moment_noise {UNLIKE}", _readings(lambda m, rng, was: rng.permutation(m))),
    _row("moment 0 in 10 to 40 % of the rows", "moment_stuck", _readings(_dropped)),
    _row("moment's smallest tenth to third 0", "moment_stuck moment_kept", _readings(_dead_zone)),
    _row("moment through a filter of 1.5 to 6 rows", f"{LATE} moment_late {UNLIKE}", _readings(_filtered)),
    _row("pictures shuffled", "pictures_shuffled", _pictures_of(lambda count, rng: rng.permutation(count))),
    _row("moments backwards in time", f"moment_late {UNLIKE}", _readings(lambda m, rng, was: m[::-1]), DOUBTED),
    _row("moment not linear", f"moment_nonlinear {UNLIKE}", _readings(_compressed), DOUBTED),
    _row("moment about an axis 20° to 60° off", "moment_turned moment_axis", _readings(_part_of_z), DOUBTED),
    _row("moment with hum", f"moment_noise {UNLIKE}", _readings(_humming), DOUBTED),
    _row("moment with a cable's pull", f"moment_by_joints {UNLIKE}", _readings(_pulled), DOUBTED),
    _row("moment warms up by 20 to 50 std", f"moment_drift moment_zero {UNLIKE}", _readings(_warming), DOUBTED),
    _row("moment reversed half way", f"moment_sign {UNLIKE}", _readings(_reversed_later), DOUBTED),
    _row("gravity tilted by 5 to 15°", "gravity_tilted joints_untested", _rigs(_on_a_slope), REPORTED),
)
"""The matrix's column of recordings. Edit the names of the findings here."""
