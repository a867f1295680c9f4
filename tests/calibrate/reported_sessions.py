"""Sessions as they are and as they were reported: rigs of every size, what the static rod does, and one mistake."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from vbaa_calib.antenna.rod import Rod, RodShape, sample_shape, solve_rod
from vbaa_calib.antenna.taper import UNIFORM, Taper
from vbaa_calib.calibrate.antenna.inputs import Observation, Prior
from vbaa_calib.calibrate.antenna.session_rig import prior
from vbaa_calib.calibrate.pose.fusion import PoseEstimate
from vbaa_calib.camera import Camera
from vbaa_calib.geometry import Kinematics, Pose
from vbaa_calib.session import Drift, Load, LoadReadings, NominalAntenna, Session, Still, gravity_antenna

from . import still_faults

G = 9.80665
GRAVITY = np.array([0.0, 0.0, -G])
READINGS = LoadReadings(5e-4, 5e-3)
STEEL = NominalAntenna(0.24, 0.8e-3, 193e9, 7900.0)


@dataclass(frozen=True, eq=False)
class Truth:
    """A rig and its stills as they are.

    change : (9,) of the antenna's parameters from the still `since` on. softer : compliance (y, z) over EI's, and its
    rise from clamp to tip. touched : an unknown force (y, z) at a place on a still, by its index.
    """

    antenna: NominalAntenna
    camera: Camera
    T_antenna_camera: Pose
    parameters: np.ndarray
    stills: Sequence[Still]
    gravity_world: np.ndarray = field(default_factory=lambda: GRAVITY)
    gain: float = 1.0
    change: np.ndarray = field(default_factory=lambda: np.zeros(9))
    since: int = 10_000
    softer: tuple[float, float] = (1.0, 1.0)
    profile: Callable[[np.ndarray], np.ndarray] | None = None
    taper: Taper = UNIFORM
    touched: Mapping[int, tuple[float, float, float]] = field(default_factory=dict)
    points: int = 200
    sigma_px: float = 0.05
    line_px: float = 0.003

    def parameters_of(self, index: int) -> np.ndarray:
        return self.parameters + self.change * (index >= self.since)


@dataclass(frozen=True, eq=False)
class Reported:
    """What was reported of a session, what its pictures show, and the truth."""

    truth: Truth
    session: Session
    observations: Sequence[Observation]
    before: Prior

    def with_stills(self, change: Callable[[int, Still], Still]) -> Reported:
        """With other readings, and gravity as they have it."""
        stills = [change(index, one.still) for index, one in enumerate(self.observations)]
        pulls = gravity_antenna(self.session.kinematics, self.session.gravity_world_m_s2, stills)
        every = zip(self.observations, stills, pulls, strict=True)
        return replace(self, observations=[replace(a, still=b, gravity_m_s2=c) for a, b, c in every])

    def with_gravity(self, gravity: np.ndarray) -> Reported:
        told = replace(self.session, gravity_world_m_s2=np.asarray(gravity, float))
        return replace(self, session=told).with_stills(lambda index, still: still)

    def with_antenna(self, **changes: float) -> Reported:
        """With another nominal antenna."""
        antenna = replace(self.session.antenna, **changes)
        before = prior(antenna, self.before.camera, self.before.poses, readings=READINGS, drift=self.before.drift)
        return replace(self, session=replace(self.session, antenna=antenna), before=before)

    @property
    def loads(self) -> list[int]:
        return [index for index, one in enumerate(self.observations) if isinstance(one.still, Load)]


def drawn_truth(rng: np.random.Generator, length_m: float | None = None) -> Truth:
    """A rig of 60 to 500 mm before a lens of 300 to 2000 px, upright or inclined, and ten to fourteen stills."""
    length = float(np.exp(rng.uniform(np.log(0.06), np.log(0.5)))) if length_m is None else length_m
    sag = np.exp(rng.uniform(np.log(0.006), np.log(0.04)))
    diameter = round(float(np.sqrt(2 * 7900 * G * length**3 / (193e9 * sag))), 5)
    antenna = replace(STEEL, length_m=round(length, 4), diameter_m=diameter)
    focal, away = np.exp(rng.uniform(np.log(300), np.log(2000))), length * rng.uniform(1.3, 2.0)
    incline, azimuth = (0.0 if rng.uniform() < 0.4 else rng.uniform(0.1, 0.9)), rng.uniform(0, 2 * np.pi)
    size = tuple(int(focal * length / away * part) for part in (1.5, 1.2))
    matrix = np.array([[focal, 0, size[0] / 2], [0, focal, size[1] / 2], [0, 0, 1.0]])
    sin = np.sin(incline)
    toward = np.array([sin * np.cos(azimuth), sin * np.sin(azimuth), np.cos(incline)])
    x = np.array([1.0, 0.0, 0.0]) - toward[0] * toward
    x /= np.linalg.norm(x)
    pose = Pose(np.stack([x, np.cross(-toward, x), -toward], axis=1), [0.5 * length, 0, 0] + away * toward)
    parameters = np.zeros(9)
    parameters[:6] = rng.normal(size=6) * [3e-4, 3e-4, 0.01, 0.01, 0.03 / length * 0.24, 0.03 / length * 0.24]
    parameters[6] = np.log(antenna.stiffness_Nm2) + 0.04 * rng.normal()
    parameters[7] = np.log(antenna.mass_per_length_kg_m) + 0.01 * rng.normal()
    camera = Camera("opencv", size, matrix, np.array([-0.1, 0.03, 0.0, 0.0]))
    stills: list[Still] = []
    for index in range(int(rng.integers(4, 7))):
        tilt, pan = (0.0, 0.3, -0.25, *rng.uniform(-0.5, 0.5, 3))[index], rng.uniform(-0.6, 0.6)
        stills.append(Still(Path(f"noload_{index:03d}.png"), float(pan), float(tilt), 0.0))
    hanging = rng.uniform() < 0.3
    for index in range(int(rng.integers(5, 9))):
        at = round(length * rng.uniform(0.45, 0.9), 3 if length > 0.1 else 4)
        turn = -np.pi / 2 if hanging else rng.uniform(0, 2 * np.pi)
        force = 2 * np.exp(parameters[6]) * rng.uniform(0.05, 0.3) / at**2
        y, z = force * np.cos(turn), force * np.sin(turn)
        tilt = 0.0 if hanging else float(rng.uniform(-0.4, 0.4))
        image = Path(f"loads_{index:03d}.png")
        stills.append(Load(image, float(rng.uniform(-0.5, 0.5)), tilt, 0.0, at, float(f"{y:.4g}"), float(f"{z:.4g}")))
    gain = 1.0 + 0.01 * rng.normal()
    return Truth(
        antenna, camera, pose, parameters, stills, gain=gain,
        sigma_px=float(rng.uniform(0.03, 0.1)), points=int(rng.integers(100, 400)),
        line_px=float(rng.choice([0.003, 0.01])),
    )  # fmt: skip


def bent(truth: Truth, index: int, gravity: np.ndarray, at_m: float, force_N: np.ndarray) -> RodShape:
    """The antenna in one still."""
    y, z, about_y, about_z, *bow, log_stiffness, log_mass, _ = truth.parameters_of(index)
    clamp = Pose(Rotation.from_rotvec([0.0, about_y, about_z]).as_matrix(), np.array([0.0, y, z]))
    stiffness = np.exp(log_stiffness)
    rod = Rod(
        truth.antenna.length_m, stiffness, stiffness / 1.3, np.exp(log_mass), clamp, np.array(bow), taper=truth.taper
    )
    uniform = solve_rod(rod, gravity[None], np.array([at_m]), force_N[None])
    if truth.profile is None and truth.softer == (1.0, 1.0) and index not in truth.touched:
        return uniform
    return _uneven(truth, rod, gravity, (at_m, force_N), index)


def _uneven(truth: Truth, rod: Rod, gravity: np.ndarray, load: tuple[float, np.ndarray], index: int) -> RodShape:
    """A rod whose compliance changes along it, or differs between y and z, with further forces: by fixed point."""
    s = np.linspace(0.0, rod.length_m, 801)
    step, softer = s[1], np.ones_like(s) if truth.profile is None else truth.profile(s / rod.length_m)
    compliance = softer[:, None] * np.array([1.0, truth.softer[1], truth.softer[0]]) / rod.bending_stiffness_Nm2
    forces = [load]
    if index in truth.touched:
        at, y, z = truth.touched[index]
        forces.append((at, np.array([0.0, y, z])))
    turn = rod.T_antenna_clamp.rotation
    frames = np.repeat(turn[None], len(s), axis=0)
    points = rod.T_antenna_clamp.translation_m + s[:, None] * turn[:, 0]
    for _ in range(80):
        moment, at_clamp = np.zeros((len(s), 3)), np.zeros(3)
        for place, force in forces:
            hook = np.array([np.interp(place, s, points[:, k]) for k in range(3)])
            moment += np.where((s < place)[:, None], np.cross(hook - points, force), 0.0)
            at_clamp += np.cross(hook, force)
        weight = rod.mass_per_length_kg_m * gravity
        beyond = np.cumsum(points[::-1], axis=0)[::-1] - 0.5 * (points + points[-1])
        left = (rod.length_m - s)[:, None]
        moment += np.cross(beyond * step - left * points, weight)
        at_clamp += np.cross((beyond * step)[0], weight)
        local = np.einsum("nji,nj->ni", frames, moment) * compliance
        local[:, 0] *= 1.3
        local[:, 1:] += rod.natural_curvature_per_m
        middle = 0.5 * (local[1:] + local[:-1]) * step
        turns = [turn]
        for each in Rotation.from_rotvec(middle).as_matrix():
            turns.append(turns[-1] @ each)
        new = np.array(turns)
        tangents = new[:, :, 0]
        moved = points[0] + np.vstack([np.zeros(3), np.cumsum(0.5 * (tangents[1:] + tangents[:-1]) * step, axis=0)])
        change = np.abs(moved - points).max()
        frames, points = new, 0.3 * points + 0.7 * moved
        if change < 1e-9:
            break
    return RodShape(s[None], points[None], tangents[None], at_clamp[None])


def coned(truth: Truth, tip: float) -> Truth:
    """A cone so much thinner at its tip, under lighter loads."""

    def lighter(still: Still) -> Still:
        if not isinstance(still, Load):
            return still
        part = (1.0 - (1.0 - tip) * 0.9 * still.distance_m / truth.antenna.length_m) ** 3
        forces = float(f"{part * still.force_y_N:.4g}"), float(f"{part * still.force_z_N:.4g}")
        return replace(still, force_y_N=forces[0], force_z_N=forces[1])

    stills = [lighter(one) for one in truth.stills]
    return replace(truth, stills=stills, taper=Taper().thinned(float(np.log(tip))))


def reported(truth: Truth, rng: np.random.Generator) -> Reported:
    """The session as an honest and careful person reports it."""
    antenna = truth.antenna
    pulls = gravity_antenna(Kinematics(), truth.gravity_world, truth.stills)
    s = np.linspace(0.01, 1.0, truth.points) * antenna.length_m
    tip_std_m = antenna.tip_std_m or 0.0
    tip_m, found = tip_std_m * rng.normal(), []
    for index, (still, pull) in enumerate(zip(truth.stills, pulls, strict=True)):
        at, force = 0.5 * antenna.length_m, np.zeros(3)
        if isinstance(still, Load):
            at = min(still.distance_m + READINGS.distance_std_m * rng.normal(), antenna.length_m)
            force = np.exp(READINGS.force_std_relative * rng.normal()) * np.array(
                [0.0, still.force_y_N, still.force_z_N]
            )
        shape = bent(truth, index, pull, at, force)
        ends = np.append(s, [antenna.length_m - 1e-3])
        view = truth.T_antenna_camera.inverse()
        turn, _ = cv2.Rodrigues(view.rotation)
        every = sample_shape(shape, ends[None])[0][0]
        pixels = cv2.projectPoints(every, turn, view.translation_m, truth.camera.matrix, truth.camera.distortion)[0][
            :, 0
        ]
        pixels, short = pixels[:-1], pixels[-1]
        onward = (pixels[-1] - short) / 1e-3
        tip = pixels[-1] + tip_m * onward + rng.normal(0.0, 0.1, 2)
        across = np.gradient(pixels, axis=0)[:, ::-1] * [-1.0, 1.0]
        across /= np.linalg.norm(across, axis=1)[:, None]
        light = np.polynomial.legendre.legval(np.linspace(-1, 1, len(s)), truth.line_px * rng.normal(size=3))
        pixels = pixels + (rng.normal(0.0, truth.sigma_px, len(s)) + light)[:, None] * across
        inside = ((pixels > 1) & (pixels < np.array(truth.camera.image_size) - 2)).all(axis=1)
        noted = replace(still, moment_Nm=truth.gain * -float(shape.clamp_moment_Nm[0, 1]))
        seen_tip = {"tip_px": tip, "tip_std_px": 0.1} if inside[-1] else {}
        found.append(Observation(noted, pixels[inside], np.full(inside.sum(), truth.sigma_px), pull, **seen_tip))
    # a sensor that suits the rig
    noise_Nm = 5e-4 * float(np.ptp([one.still.moment_Nm for one in found]))
    read = [one.still.moment_Nm + noise_Nm * (7.0 + rng.normal()) for one in found]
    found = [replace(a, still=replace(a.still, moment_Nm=b)) for a, b in zip(found, read, strict=True)]
    std = np.array([1e-3 * np.linalg.norm(truth.T_antenna_camera.translation_m)] * 3 + [3e-4] * 3)
    std[:3] = np.maximum(1e-4, 0.3 * std[:3])
    start = truth.T_antenna_camera.retract(std * rng.normal(size=6))
    estimate = PoseEstimate("jig", start, np.diag(std**2), np.zeros((6, 4 + len(truth.camera.distortion))))
    told = replace(still_faults.session(), antenna=antenna, load_readings=READINGS, moment_std_Nm=noise_Nm)
    return Reported(
        truth,
        told,
        found,
        prior(antenna, truth.camera, [estimate], readings=READINGS, drift=Drift(line_px=truth.line_px)),
    )


@dataclass(frozen=True)
class Mistake:
    """A row of the matrix: how it is made, and how it is to be named first.

    before : of a truth, another truth; after : of what an honest person reports, what is reported. Each is drawn.
    names : of diagnoses that are right. words : what the first of them says, as the mistake was drawn.
    """

    names: tuple[str, ...]
    before: Callable[[np.random.Generator, Truth], Truth] = lambda rng, truth: truth
    after: Callable[[np.random.Generator, Reported], tuple[Reported, str | float]] = lambda rng, right: (right, "")


def _scaled(load: Load, factor: float) -> Load:
    return replace(load, force_y_N=factor * load.force_y_N, force_z_N=factor * load.force_z_N)


def _turned(load: Load, angle: float) -> Load:
    y, z = load.force_y_N, load.force_z_N
    return replace(
        load, force_y_N=y * np.cos(angle) - z * np.sin(angle), force_z_N=y * np.sin(angle) + z * np.cos(angle)
    )


def _each_load(change: Callable[[Load], Load]) -> Callable[[int, Still], Still]:
    return lambda index, still: change(still) if isinstance(still, Load) else still


def _all_loads(change: Callable[[Load], Load], words: str = "") -> Callable[..., tuple[Reported, str | float]]:
    return lambda rng, right: (right.with_stills(_each_load(change)), words)


def _moments(
    change: Callable[[int, float], float], words: str | float = ""
) -> Callable[..., tuple[Reported, str | float]]:
    def after(rng: np.random.Generator, right: Reported) -> tuple[Reported, str | float]:
        return right.with_stills(lambda index, still: replace(still, moment_Nm=change(index, still.moment_Nm))), words

    return after


def _length(rng: np.random.Generator, right: Reported) -> tuple[Reported, str | float]:
    off = rng.choice([-1.0, 1.0]) * rng.uniform(0.009, 0.012)
    length = right.truth.antenna.length_m
    return right.with_antenna(length_m=length * (1 + off)), 1e3 * length


def _board(low: float, high: float) -> Callable[..., tuple[Reported, str | float]]:
    """The board's squares reported larger by a part: the camera seems so much further from it."""

    def after(rng: np.random.Generator, right: Reported) -> tuple[Reported, str | float]:
        off, (pose,) = rng.uniform(low, high), right.before.poses
        away = pose.T_antenna_camera
        further = replace(pose, T_antenna_camera=Pose(away.rotation, (1 + off) * away.translation_m))
        antenna, camera = right.session.antenna, right.before.camera
        before = prior(antenna, camera, [further], readings=READINGS, drift=right.before.drift)
        return replace(right, before=before), 100 * off

    return after


def _one_distance(rng: np.random.Generator, right: Reported) -> tuple[Reported, str | float]:
    which, off = int(rng.choice(right.loads)), rng.choice([-1.0, 1.0]) * 3e-3
    return right.with_stills(
        lambda index, still: replace(still, distance_m=still.distance_m + off) if index == which else still
    ), f"loads_{which - right.loads[0]:03d}"


def _all_distances(rng: np.random.Generator, right: Reported) -> tuple[Reported, str | float]:
    off = rng.choice([-1.0, 1.0]) * 3e-3
    return right.with_stills(_each_load(lambda load: replace(load, distance_m=load.distance_m + off))), 1e3 * abs(off)


def _exchanged(*names: str) -> Callable[..., tuple[Reported, str | float]]:
    """These readings of two clearly different loads are exchanged; none: their pictures."""

    def after(rng: np.random.Generator, right: Reported) -> tuple[Reported, str | float]:
        pairs = [(i, j) for i in right.loads for j in right.loads if i < j]
        stills = [one.still for one in right.observations]

        def differ(pair: tuple[int, int]) -> float:
            a, b = (stills[k] for k in pair)
            force = np.hypot(a.force_y_N, a.force_z_N), np.hypot(b.force_y_N, b.force_z_N)
            if names == ("distance_m",):
                return abs(a.distance_m - b.distance_m) / right.truth.antenna.length_m
            return abs(np.log(force[0] / force[1]))

        i, j = max(pairs, key=differ) if rng.uniform() < 0.3 else pairs[int(rng.integers(len(pairs)))]
        if differ((i, j)) < 0.1:
            i, j = max(pairs, key=differ)
        swap = {i: stills[j], j: stills[i]}
        first = right.loads[0]
        words = f"loads_{i - first:03d}|loads_{j - first:03d}"

        def change(index: int, still: Still) -> Still:
            if index not in swap:
                return still
            other = swap[index]
            if not names:
                return replace(other, image=still.image)
            if names == ("distance_m",):
                return replace(still, distance_m=other.distance_m)
            size = np.hypot(other.force_y_N, other.force_z_N) / np.hypot(still.force_y_N, still.force_z_N)
            return _scaled(still, float(size))

        return right.with_stills(change), words

    return after


def _loads_turned(rng: np.random.Generator, right: Reported) -> tuple[Reported, str | float]:
    angle = rng.choice([-1.0, 1.0]) * np.deg2rad(rng.uniform(4.5, 8.0))
    return right.with_stills(_each_load(lambda load: _turned(load, angle))), abs(float(np.rad2deg(angle)))


def _material(modulus: float, density: float) -> Callable[..., tuple[Truth, Truth]]:
    """A wire of another material, as thick as needed to be as stiff as a steel one; reported as steel."""

    def before(rng: np.random.Generator, truth: Truth) -> Truth:
        thicker = (193e9 / modulus) ** 0.25
        antenna = replace(truth.antenna, diameter_m=round(truth.antenna.diameter_m * thicker, 5))
        parameters = truth.parameters.copy()
        true = replace(antenna, youngs_modulus_Pa=modulus * rng.uniform(0.95, 1.05), density_kg_m3=density)
        parameters[6:8] = np.log(true.stiffness_Nm2), np.log(true.mass_per_length_kg_m)
        return replace(truth, antenna=antenna, parameters=parameters)

    return before


def _diameter(rng: np.random.Generator, right: Reported) -> tuple[Reported, str | float]:
    return right.with_antenna(diameter_m=right.session.antenna.diameter_m * rng.choice([0.9, 1.1])), ""


def _joints(change: Callable[[Still], Still], words: str) -> Callable[..., tuple[Reported, str | float]]:
    def after(rng: np.random.Generator, right: Reported) -> tuple[Reported, str | float]:
        return right.with_stills(lambda index, still: change(still)), words

    return after


def _tilted(angle_deg: float) -> Callable[[np.random.Generator, Truth], Truth]:
    """A base that is not level."""

    def before(rng: np.random.Generator, truth: Truth) -> Truth:
        about = rng.uniform(0, 2 * np.pi)
        turn = Rotation.from_rotvec(np.deg2rad(angle_deg) * np.array([np.cos(about), np.sin(about), 0.0]))
        return replace(truth, gravity_world=turn.apply(GRAVITY))

    return before


def _changed(names: Sequence[int], sizes: Callable[[Truth], float]) -> Callable[[np.random.Generator, Truth], Truth]:
    """Parameters that change by so much in a drawn direction, from a drawn still on."""

    def before(rng: np.random.Generator, truth: Truth) -> Truth:
        turn, change = rng.uniform(0, 2 * np.pi), np.zeros(9)
        change[list(names)] = sizes(truth) * np.array([np.cos(turn), np.sin(turn)])
        free = sum(not isinstance(one, Load) for one in truth.stills)
        return replace(truth, change=change, since=int(rng.integers(free - 1, len(truth.stills) - 1)))

    return before


def _bent_by_last(rng: np.random.Generator, truth: Truth) -> Truth:
    change, turn = np.zeros(9), rng.uniform(0, 2 * np.pi)
    change[4:6] = 0.3 * 0.24 / truth.antenna.length_m * np.array([np.cos(turn), np.sin(turn)])
    return replace(truth, change=change, since=len(truth.stills) - int(rng.integers(2, 4)))


def _touching(rng: np.random.Generator, truth: Truth) -> Truth:
    """A no-load frame whose antenna is pushed aside by a few hundredths of its length."""
    free = [index for index, one in enumerate(truth.stills) if not isinstance(one, Load)]
    length, turn = truth.antenna.length_m, rng.uniform(0, 2 * np.pi)
    at = rng.uniform(0.5, 0.95) * length
    force = 3 * np.exp(truth.parameters[6]) * rng.uniform(0.02, 0.05) * length / at**3
    which = int(rng.choice(free[1:]))
    return replace(truth, touched={which: (at, force * np.cos(turn), force * np.sin(turn))})


def _resting(rng: np.random.Generator, truth: Truth) -> Truth:
    """A load part of which something else carries."""
    loads = [index for index, one in enumerate(truth.stills) if isinstance(one, Load)]
    which, part = int(rng.choice(loads)), rng.uniform(0.3, 0.7)
    load = truth.stills[which]
    assert isinstance(load, Load)
    return replace(truth, touched={which: (load.distance_m, -part * load.force_y_N, -part * load.force_z_N)})


MISTAKES: dict[str, Mistake] = {
    "length 1 %": Mistake(("antenna_length",), after=_length),
    "board + 1 %": Mistake(("board_scale", "antenna_length"), after=_board(0.009, 0.012)),
    "board - 4 %": Mistake(("board_scale",), after=_board(-0.045, -0.03)),
    "board + 2.5 %": Mistake(("board_scale",), after=_board(0.02, 0.03)),
    "one distance 3 mm": Mistake(("load_distance_mistyped",), after=_one_distance),
    "all distances 3 mm": Mistake(("load_distances_shifted",), after=_all_distances),
    "two weights exchanged": Mistake(("load_rows_exchanged",), after=_exchanged("force")),
    "two pictures exchanged": Mistake(("load_rows_exchanged",), after=_exchanged()),
    "two distances exchanged": Mistake(("load_rows_exchanged",), after=_exchanged("distance_m")),
    "loads turned by 5 deg": Mistake(("loads_turned",), after=_loads_turned),
    "y and z exchanged": Mistake(
        ("load_force_mistyped",),
        after=_all_loads(lambda load: replace(load, force_y_N=load.force_z_N, force_z_N=load.force_y_N), "exchanged"),
    ),
    "sign": Mistake(("load_force_mistyped",), after=_all_loads(lambda load: _scaled(load, -1.0), "sign")),
    "grams": Mistake(
        ("load_force_mistyped", "load_force_unit"), after=_all_loads(lambda one: _scaled(one, 1e3 / G), "grams")
    ),
    "times 9.81": Mistake(
        ("load_force_mistyped", "load_force_unit"), after=_all_loads(lambda one: _scaled(one, G), "9.81 twice")
    ),
    "kilograms": Mistake(
        ("load_force_mistyped", "load_force_unit"), after=_all_loads(lambda one: _scaled(one, 1 / G), "kilograms")
    ),
    "pounds": Mistake(
        ("load_force_mistyped", "load_force_unit"), after=_all_loads(lambda one: _scaled(one, 1 / 4.4482), "pounds")
    ),
    "nitinol as steel": Mistake(("stiffness_not_nominal",), before=_material(65e9, 6450.0)),
    "nylon as steel": Mistake(("stiffness_not_nominal",), before=_material(3e9, 1140.0)),
    "carbon as steel": Mistake(("stiffness_not_nominal", "density_not_nominal"), before=_material(140e9, 1600.0)),
    "diameter 10 %": Mistake(("stiffness_not_nominal",), after=_diameter),
    "moment: sign": Mistake(("sensor_sign",), after=_moments(lambda index, read: -read)),
    "moment: mN m": Mistake(("sensor_unit",), after=_moments(lambda index, read: 1e3 * read, "mN·m")),
    "moment: gain 5 %": Mistake(("sensor_gain",), after=_moments(lambda index, read: 1.07 * read)),
    "moment: dead": Mistake(("sensor_not_connected",), after=_moments(lambda index, read: 0.0)),
    "moment: dead, noisy": Mistake(
        ("sensor_not_connected",), after=_moments(lambda index, read: 1e-7 * float(np.sin(7.0 * index)))
    ),
    "pan and tilt exchanged": Mistake(
        ("joint_readings_wrong",),
        after=_joints(lambda one: replace(one, pan_rad=one.tilt_rad, tilt_rad=one.pan_rad), "exchanged"),
    ),
    "tilt's sign": Mistake(
        ("joint_readings_wrong",), after=_joints(lambda one: replace(one, tilt_rad=-one.tilt_rad), "the other way")
    ),
    "tilt in degrees": Mistake(
        ("joint_readings_wrong",), after=_joints(lambda one: replace(one, tilt_rad=np.rad2deg(one.tilt_rad)), "degrees")
    ),
    "pan's sign": Mistake((), after=_joints(lambda one: replace(one, pan_rad=-one.pan_rad), "")),
    "gravity tilted by 3 deg": Mistake(
        ("gravity_tilted",), _tilted(3.5), lambda rng, right: (right.with_gravity(GRAVITY), 3.5)
    ),
    "gravity tilted by 10 deg": Mistake(
        ("gravity_tilted",), _tilted(10.0), lambda rng, right: (right.with_gravity(GRAVITY), 10.0)
    ),
    "no gravity": Mistake(("gravity_direction",), after=lambda rng, right: (right.with_gravity(np.zeros(3)), "−z")),
    "gravity upward": Mistake(("gravity_direction",), after=lambda rng, right: (right.with_gravity(-GRAVITY), "−z")),
    "bent by the last loads": Mistake(("antenna_bent_between",), before=_bent_by_last),
    "clamp slipped 1 mm": Mistake(("clamp_slipped",), before=_changed((0, 1), lambda truth: 1e-3)),
    "clamp slipped 3 mm": Mistake(("clamp_slipped",), before=_changed((0, 1), lambda truth: 3e-3)),
    "clamp turned 1 mrad": Mistake(("clamp_slipped",), before=_changed((2, 3), lambda truth: 1e-3)),
    "clamp turned 10 mrad": Mistake(("clamp_slipped",), before=_changed((2, 3), lambda truth: 1e-2)),
    "tapered": Mistake(
        ("stiffness_varies",),
        before=lambda rng, truth: replace(truth, profile=lambda x: (1.0 - 0.3 * x) ** -4),
    ),
    "cone": Mistake(("stiffness_varies",), before=lambda rng, truth: coned(truth, 0.5)),
    "two materials": Mistake(
        ("stiffness_varies",), before=lambda rng, truth: replace(truth, profile=lambda x: np.where(x < 0.5, 1.0, 1.6))
    ),
    "EI y/z 5 %": Mistake(("stiffness_uneven",), before=lambda rng, truth: replace(truth, softer=(1.0, 1.05))),
    "no-load frame touches": Mistake(("noload_touched",), before=_touching),
    "load rests": Mistake(("load_force_mistyped", "load_supported"), before=_resting),
    "clean": Mistake(()),
}


def session_with(name: str, seed: int) -> tuple[Reported, str | float]:
    """A session of a drawn rig with this mistake, and what its diagnosis has to contain."""
    rng = np.random.default_rng((51, seed))
    mistake = MISTAKES[name]
    truth = mistake.before(rng, drawn_truth(rng))
    return mistake.after(rng, reported(truth, rng))
