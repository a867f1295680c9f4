"""Rigs drawn at random: wire, clamp, lens, camera, board, jig, sweep, loads, contacts; what is true and typed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from .mechanics import Wire
from .optics import FAMILIES, Optics
from .pictures import VARIANTS, Sensor

MATERIALS = {
    "stainless steel": (193e9, 7900.0),
    "nitinol": (60e9, 6450.0),
    "carbon fibre": (135e9, 1550.0),
    "brass": (103e9, 8500.0),
    "nylon": (2.8e9, 1140.0),
}
"""Modulus in Pa and density in kg/m³ as a data sheet says them."""
SIZES = {
    (320, 240): 0.14,
    (640, 480): 0.28,
    (1280, 720): 0.2,
    (1280, 1024): 0.16,
    (1920, 1200): 0.12,
    (2448, 2048): 0.06,
    (3840, 2160): 0.04,
}
"""Pictures, and how often they are drawn."""
CROSSWISE = np.array([[pan, tilt] for pan in (-1, 0, 1) for tilt in (-1, 0, 1)])
"""(9, 2) where the joints of a sweep are, in its width."""
GRAVITY = np.array([0.0, 0.0, -9.80665])
_MOST_MEGAPIXELS = 16.0
"""Of all pictures of the board together."""
_LEAST_PITCH_PX = 17.0
"""Of a board's square: smaller markers cannot be read."""


@dataclass(frozen=True, eq=False)
class Place:
    """A rigid pose: p_outer = turn(p_inner) + shift."""

    turn: Rotation
    shift_m: np.ndarray

    def __matmul__(self, other: Place) -> Place:
        return Place(self.turn * other.turn, self.turn.apply(other.shift_m) + self.shift_m)

    def of(self, points: np.ndarray) -> np.ndarray:
        """(N, 3) inner to outer."""
        return np.asarray(self.turn.apply(points) + self.shift_m)

    def inverse(self) -> Place:
        back = self.turn.inv()
        return Place(back, -back.apply(self.shift_m))

    @staticmethod
    def from_dict(known: Mapping[str, Sequence[float]]) -> Place:
        """From what `to_dict` gives."""
        return Place(Rotation.from_quat(known["rotation_xyzw"]), np.array(known["translation_m"]))

    def to_dict(self) -> dict[str, list[float]]:
        """As session.yaml has it."""
        return {"translation_m": self.shift_m.tolist(), "rotation_xyzw": self.turn.as_quat().tolist()}


@dataclass(frozen=True, eq=False)
class Board:
    """A ChArUco board, new pattern, whose markers are `modules`/(modules + 2) of its squares."""

    squares: tuple[int, int]
    square_m: float
    dictionary: str

    @property
    def middle_m(self) -> np.ndarray:
        """(3,) in the board frame."""
        return np.append(np.array(self.squares) * self.square_m / 2, 0.0)

    @property
    def outline_m(self) -> np.ndarray:
        """(4, 3) of the print."""
        x, y = np.array(self.squares) * self.square_m
        return np.array([[0, 0, 0], [x, 0, 0], [x, y, 0], [0, y, 0]], float)


@dataclass(frozen=True)
class Shot:
    """A picture of the antenna: joints, and what acts at an arc length.

    push_N : across the antenna, antenna frame; a load keeps it, an object's force turns with the antenna. Zero: free.
    lean_rad : friction's.
    """

    pan_rad: float
    tilt_rad: float
    distance_m: float = 0.0
    push_N: tuple[float, float] = (0.0, 0.0)
    lean_rad: float = 0.0


@dataclass(frozen=True, eq=False)
class World:
    """All of a rig and of its session that is drawn.

    Attributes
    ----------
    nominal : what session.yaml says of the antenna. tip_std_m, load_std : how well length and loads are known.
    jig : pose of the board in the antenna frame as it is; jig_typed : as session.yaml has it; None without a jig.
    sweep : pose of a board in the world, and joints (N, 2). over : of a board under the antenna.
    reads : gain, offset and noise of the moment sensor; None without one. thread : whether loads' threads are seen.
    paint : brightness of the wire at its axis and edge. bench : level and contrast.
    """

    number: int
    seed: tuple[int, ...]
    wire: Wire
    nominal: dict[str, float | str]
    tip_std_m: float
    load_std: tuple[float, float]
    optics: Optics
    camera: Place
    inclination_deg: float
    sensor: Sensor
    board: Board
    boards: Sequence[Place]
    jig: Place | None
    jig_typed: Place | None
    jig_std: tuple[float, float]
    sweep: tuple[Place, np.ndarray] | None
    over: Place | None
    actuator: Place
    origin_m: np.ndarray
    reads: tuple[float, float, float] | None
    free: Sequence[Shot]
    loads: Sequence[Shot]
    contacts: Sequence[Shot]
    thread: bool
    paint: tuple[float, float]
    bench: tuple[float, float]

    def base(self, pan_rad: float, tilt_rad: float) -> Place:
        """The antenna frame in the world."""
        joints = Place(Rotation.from_euler("ZY", [pan_rad, -tilt_rad]), self.origin_m)
        return joints @ self.actuator

    @property
    def described(self) -> str:
        """In a few words."""
        wire, (width, height) = self.wire, self.optics.size
        ways = [name for name in ("jig", "sweep", "over") if getattr(self, name) is not None]
        return (
            f"{1e3 * wire.length_m:.0f} x {1e3 * wire.diameter_m:.2f} mm {self.nominal['material']}, "
            f"{self.optics.family} {width}x{height} f {self.optics.focal_px[0]:.0f}, "
            f"{self.inclination_deg:.0f} deg, {'+'.join(ways)}, "
            f"{len(self.boards)} boards, {len(self.loads)} loads, {self.sensor.variant}"
        )


def draw_world(seed: int, number: int) -> World:
    """World `number`; the same seed gives the same."""
    rng = np.random.default_rng((seed, number))
    wire, nominal, tip_std = _wire(rng)
    optics = draw_optics(rng)
    inclination = rng.uniform(0.0, 70.0)
    camera = _camera(rng, wire, optics, np.radians(inclination))
    board = _board(rng, optics, float(np.linalg.norm(camera.shift_m - [wire.length_m / 2, 0.0, 0.0])))
    most = max(5, int(_MOST_MEGAPIXELS * 1e6 / np.prod(optics.size)))
    count = min(int(np.exp(rng.uniform(np.log(5.0), np.log(40.99)))), most)
    ways = _ways(rng)
    jig = _before(rng, optics, board, 0.75, (15.0, 35.0), within=True) if ways[0] else None
    jig = None if jig is None else camera @ jig
    jig_std = (min(1e-4, 3e-4 * wire.length_m), 3e-4)
    error = Place(Rotation.from_rotvec(jig_std[1] * rng.normal(size=3)), jig_std[0] * rng.normal(size=3))
    actuator = Place(Rotation.identity(), rng.normal(0.0, 0.05 * wire.length_m, 3))
    origin = rng.uniform(-0.3, 0.3, 3)
    gain_std = float(np.exp(rng.uniform(np.log(2e-3), np.log(1e-2)))) * _moment(wire)
    reads = (1.0 + 0.03 * rng.normal(), 20 * gain_std * rng.normal(), gain_std) if rng.random() < 0.85 else None
    bright = bool(rng.random() < 0.6)
    axis = float(rng.uniform(0.75, 0.92) if bright else rng.uniform(0.06, 0.14))
    loads = int(rng.integers(1, 13))
    world = World(
        number=number,
        seed=(seed, number),
        wire=wire,
        nominal=nominal,
        tip_std_m=tip_std,
        load_std=(min(3e-4, 1.5e-3 * wire.length_m), 3e-3),
        optics=optics,
        camera=camera,
        inclination_deg=inclination,
        sensor=_sensor(rng, optics.size),
        board=board,
        boards=[_before(rng, optics, board, rng.uniform(0.5, 1.0), (12.0, 45.0)) for _ in range(count)],
        jig=jig,
        jig_typed=None if jig is None else Place(error.turn * jig.turn, jig.shift_m + error.shift_m),
        jig_std=jig_std,
        sweep=None,
        over=None,
        actuator=actuator,
        origin_m=origin,
        reads=reads,
        free=[Shot(0.0, 0.0)] + [Shot(*_joints(rng)) for _ in range(int(rng.integers(3, 7)))],
        loads=[_load(rng, wire, camera, place) for place in range(loads)],
        contacts=_contacts(rng, wire),
        thread=bool(rng.random() < 0.4),
        paint=(axis, axis * float(rng.uniform(0.8, 1.0))),
        bench=(float(rng.uniform(0.12, 0.3) if bright else rng.uniform(0.55, 0.75)), float(rng.uniform(0.0, 0.06))),
    )
    return _with(rng, world, sweep=ways[1] or jig is None, over=ways[2] and bright and inclination < 40.0)


def _ways(rng: np.random.Generator) -> np.ndarray:
    return np.asarray(rng.random(3) < [0.8, 0.35, 0.2])


def _wire(rng: np.random.Generator) -> tuple[Wire, dict[str, float | str], float]:
    """One that holds itself up: it sags by at most an eighth of its length."""
    while True:
        length = float(np.exp(rng.uniform(np.log(0.05), np.log(0.6))))
        thick = max(2e-4, length / 900), min(3e-3, length / 50)
        diameter = float(np.exp(rng.uniform(*np.log(thick))))
        material = str(rng.choice(list(MATERIALS)))
        modulus, density = MATERIALS[material]
        stiffness, mass = modulus * np.pi * diameter**4 / 64, density * np.pi * diameter**2 / 4
        if mass * 9.81 * length**4 / (8 * stiffness) < 0.12 * length:
            break
    tip_std = min(3e-4, 2e-3 * length)
    wire = Wire(
        length_m=length + tip_std * rng.normal(),
        diameter_m=diameter,
        stiffness_Nm2=stiffness * np.exp(rng.normal(0.0, 0.05)),
        mass_per_length_kg_m=mass * np.exp(rng.normal(0.0, 0.015)),
        clamp_yz_m=rng.normal(0.0, min(4e-4, 2e-3 * length), 2),
        clamp_yz_rad=rng.normal(0.0, 0.015, 2),
        bow_yz_per_m=rng.normal(0.0, 0.04 / length, 2) if rng.random() < 0.7 else np.zeros(2),
        give_m=abs(rng.normal(0.0, 3e-4)),
    )
    sizes = {"length_m": length, "diameter_m": diameter, "youngs_modulus_Pa": modulus, "density_kg_m3": density}
    return wire, {**sizes, "material": material}, tip_std


def _moment(wire: Wire) -> float:
    """A moment that a touch makes at the clamp."""
    return 3.0 * wire.stiffness_Nm2 * 0.06 / (0.6 * wire.length_m)


def draw_optics(rng: np.random.Generator) -> Optics:
    """A lens whose every pixel has one ray; wide ones bend more, and not all families can be wide."""
    sizes = list(SIZES)
    while True:
        size = sizes[rng.choice(len(sizes), p=list(SIZES.values()))]
        width = max(size)
        focal = float(np.exp(rng.uniform(np.log(max(300.0, 0.45 * width)), np.log(min(3000.0, 2.5 * width)))))
        family = str(rng.choice(FAMILIES))
        reach = np.hypot(*size) / 2 / focal
        if family == "fisheye":
            coefficients = np.array([0.08, 0.02, 0.01, 0.003]) * rng.normal(size=4) / max(reach, 0.5) ** np.arange(4)
        elif family == "rational":
            barrel = rng.uniform(0.1, 0.7)
            up = barrel * rng.uniform(0.0, 0.7)
            k = [up, up * rng.uniform(-0.1, 0.2), 0.0, 0.0, 0.0, barrel, barrel * rng.uniform(0.0, 0.2), 0.0]
            coefficients = np.array(k) / reach ** np.array([2, 4, 1, 1, 6, 2, 4, 6])
            coefficients[2:4] = 5e-4 * rng.normal(size=2)
        else:
            bend = rng.uniform(-0.25, 0.12)
            k = [bend, rng.uniform(-0.2, 0.2) * bend, 0.0, 0.0, rng.normal(0.0, 0.02)]
            coefficients = np.array(k) / reach ** np.array([2, 4, 1, 1, 6])
            coefficients[2:4] = 7e-4 * rng.normal(size=2)
            coefficients = coefficients[: {"pinhole": 0, "radial": 2, "brown": 5}[family]]
        off = np.clip(rng.normal(0.0, 0.05, 2), -0.12, 0.12)
        centre = (np.array(size) - 1) / 2 + off * size
        optics = Optics(family, size, focal * np.array([1.0, 1.0 + 1e-3 * rng.normal()]), centre, coefficients)
        if optics.sound:
            return optics


def _camera(rng: np.random.Generator, wire: Wire, optics: Optics, inclination: float) -> Place:
    """The camera in the antenna frame: the antenna, however it bends, fills the picture and is seen at 25° or more."""
    length = wire.length_m
    while True:
        azimuth, roll = rng.uniform(-np.pi, np.pi, 2)
        sin, cos = np.sin(inclination), np.cos(inclination)
        towards = np.array([sin * np.cos(azimuth), sin * np.sin(azimuth), cos])
        if abs(towards[0]) < np.cos(np.radians(25.0)):
            break
    right = np.array([1.0, 0.0, 0.0]) - towards[0] * towards
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(-towards, right), -towards], axis=1)
    turn = Rotation.from_matrix(axes) * Rotation.from_rotvec([0.0, 0.0, roll])
    bent = [[0, 0, 0], [0.5, 0, 0], *([x, y, z] for x in (0.85, 1.0) for y in (-0.2, 0.2) for z in (-0.2, 0.2))]
    ends, size = length * np.array(bent, float), np.array(optics.size)
    middle = length * np.array([0.5, 0.0, 0.0])
    for away in length * np.geomspace(0.45, 12.0, 200):
        place = Place(turn, middle + away * towards)
        seen = place.inverse().of(ends)
        if (seen[:, 2] < 0.2 * away).any():
            continue
        pixels = optics.pixels(seen)
        # the picture's middle, not the lens's: a person points the camera until all is seen
        off = optics.ray((size - 1) / 2)
        off = off - (pixels.max(axis=0) + pixels.min(axis=0) - 2 * optics.centre_px) / (2 * optics.focal_px)
        place = Place(turn, middle + away * (towards - turn.apply([*off, 0.0])))
        seen = place.inverse().of(ends)
        if (seen[:, 2] < 0.2 * away).any():
            continue
        pixels = optics.pixels(seen)
        if ((pixels > 0.03 * size) & (pixels < 0.97 * size)).all():
            return place
    raise ArithmeticError("no place for the camera")


def _board(rng: np.random.Generator, optics: Optics, away_m: float) -> Board:
    """One that fills about half of a picture of what lies as far away as the antenna."""
    width, height = optics.size
    most = int(0.55 * width / _LEAST_PITCH_PX), int(0.6 * height / _LEAST_PITCH_PX)
    squares = min(int(rng.integers(6, 13)), most[0]), min(int(rng.integers(5, 10)), most[1])
    dictionary = str(rng.choice(["DICT_4X4_100", "DICT_5X5_100"]))
    extent = min(0.55 * width / squares[0], 0.6 * height / squares[1]) / optics.focal_px[0] * away_m
    return Board(squares, float(np.round(extent, 4)), dictionary)


def _before(
    rng: np.random.Generator,
    optics: Optics,
    board: Board,
    part: float,
    tilts_deg: tuple[float, float],
    within: bool = False,
) -> Place:
    """The board before the camera, in its frame: it fills about this part of the picture's height, tilted.

    within : all of it in the picture, near its middle.
    """
    size = np.array(optics.size)
    away = np.array(board.squares) * board.square_m * optics.focal_px[0] / (part * size)
    away_m = float(away.max())
    while True:
        about, roll = rng.uniform(-np.pi, np.pi, 2)
        tilt = np.radians(rng.uniform(*tilts_deg))
        turn = Rotation.from_rotvec(tilt * np.array([np.cos(about), np.sin(about), 0.0]))
        turn = turn * Rotation.from_rotvec([0.0, 0.0, roll])
        middle = size * (0.5 + (0.1 if within else 0.37) * rng.uniform(-1.0, 1.0, 2))
        ray = optics.ray(middle)
        place = Place(turn, away_m * np.append(ray, 1.0) - turn.apply(board.middle_m))
        corners = place.of(board.outline_m)
        if (corners[:, 2] > 0.2 * away_m).all():
            if not within or _inside(optics, corners):
                return place
            away_m *= 1.03


def _inside(optics: Optics, points: np.ndarray) -> bool:
    if (points[:, 2] < 1e-3).any():
        return False
    pixels, size = optics.pixels(points), np.array(optics.size)
    return bool(((pixels > 0.01 * size) & (pixels < 0.99 * size)).all())


def _with(rng: np.random.Generator, world: World, sweep: bool, over: bool) -> World:
    """With a board fixed in the world where the joints can turn by a tenth and all of it is seen, or one under it."""
    if sweep:
        # as small as can be read
        part = max(0.5, _LEAST_PITCH_PX / float(np.min(np.array(world.optics.size) / world.board.squares)))
        for _ in range(60):
            at = world.camera @ _before(rng, world.optics, world.board, part, (10.0, 35.0), within=True)
            fixed = world.base(0.0, 0.0) @ at
            for most in (0.3, 0.2, 0.14, 0.1):
                steps = most * CROSSWISE
                views = [(world.base(p, t) @ world.camera).inverse() @ fixed for p, t in steps]
                if all(_inside(world.optics, view.of(world.board.outline_m)) for view in views):
                    return _with(rng, replace(world, sweep=(fixed, steps)), False, over)
    if world.sweep is None and world.jig is None:
        jig = world.camera @ _before(rng, world.optics, world.board, 0.75, (15.0, 35.0), within=True)
        error = Rotation.from_rotvec(world.jig_std[1] * rng.normal(size=3)), world.jig_std[0] * rng.normal(size=3)
        world = replace(world, jig=jig, jig_typed=Place(error[0] * jig.turn, jig.shift_m + error[1]))
    if over:
        wire = world.wire
        # a person mounts it so high that it hangs free
        sag = 9.81 * wire.mass_per_length_kg_m * wire.length_m**4 / (8 * wire.stiffness_Nm2)
        height = 0.05 * wire.length_m + sag
        turn = Rotation.from_rotvec([np.pi, 0.0, 0.0]) * Rotation.from_rotvec([0.0, 0.0, rng.uniform(-0.3, 0.3)])
        middle = np.array([0.6 * world.wire.length_m, 0.0, -height])
        world = replace(world, over=Place(turn, middle - turn.apply(world.board.middle_m)))
    return world


def _sensor(rng: np.random.Generator, size: tuple[int, int]) -> Sensor:
    variant = VARIANTS[0] if rng.random() < 0.4 else str(rng.choice(VARIANTS[1:]))
    return Sensor(
        variant=variant,
        blur_px=float(rng.uniform(0.5, 0.9)),
        read_noise=float(rng.uniform(0.6, 2.0)),
        electrons=float(rng.uniform(30.0, 80.0)),
        quality=int(rng.integers(70, 96)),
        fine=4 if np.prod(size) < 5e5 else 3 if np.prod(size) < 1.5e6 else 2,
    )


def _joints(rng: np.random.Generator, most_rad: float = 1.05) -> tuple[float, float]:
    pan, tilt = rng.uniform(-most_rad, most_rad, 2)
    return float(pan), float(tilt)


def _load(rng: np.random.Generator, wire: Wire, camera: Place, place: int) -> Shot:
    """A weight over a pulley that bends the antenna by 5° to 20° where it hangs: along y, along z, and to all sides."""
    distance = float(np.round(wire.length_m * rng.uniform(0.4, 0.95), 3))
    slope = np.radians(rng.uniform(5.0, 20.0))
    roll = [0.0, np.pi / 2][place] if place < 2 else rng.uniform(-np.pi, np.pi)
    size = 2.0 * wire.stiffness_Nm2 * slope / distance**2
    push = (float(size * np.cos(roll)), float(size * np.sin(roll)))
    return Shot(*_joints(rng, 0.3), distance, push)


def _contacts(rng: np.random.Generator, wire: Wire) -> list[Shot]:
    """Four frames of the free antenna, and sixteen touched ones."""
    shots = [Shot(*_joints(rng)) for _ in range(4)]
    for _ in range(16):
        distance = wire.length_m * rng.uniform(0.3, 0.92)
        deflection = wire.length_m * rng.uniform(0.02, 0.08) * (distance / wire.length_m) ** 1.5
        size = 3.0 * wire.stiffness_Nm2 * deflection / distance**3
        roll = rng.uniform(-np.pi, np.pi)
        push = (float(size * np.cos(roll)), float(size * np.sin(roll)))
        shots.append(Shot(*_joints(rng), float(distance), push, float(rng.normal(0.0, 0.1))))
    return shots
