"""A drawn world as a session folder: `python -m benchmarks.worlds.session SEED NUMBER FOLDER` writes one to look at."""

from __future__ import annotations

import csv
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from scipy.spatial.transform import Rotation

from .mechanics import Bent, hang, press
from .pictures import Layer, Sheet, Tube, bench_of, encoded, photograph, print_board, wire_axis
from .rigs import CROSSWISE, GRAVITY, Place, Shot, World, draw_world

_APART_S = 6.0
"""Between two frames: a person moves the antenna by hand."""


@dataclass(frozen=True, eq=False)
class Truth:
    """Of the recording's F frames: distances (F,) m, NaN without contact, and contact points (F, 3) in the world."""

    distance_m: np.ndarray
    point_world_m: np.ndarray
    force_N: np.ndarray


def bent_of(world: World, shots: Sequence[Shot], loaded: bool) -> list[Bent]:
    """The wire in each shot, under dead loads or pressed by objects."""
    turns = [world.base(one.pan_rad, one.tilt_rad).turn for one in shots]
    gravity = np.array([turn.inv().apply(GRAVITY) for turn in turns])
    push = np.array([[0.0, *one.push_N] for one in shots])
    where = np.array([one.distance_m or world.wire.length_m / 2 for one in shots])
    free = ~push.any(axis=1)
    found = hang(world.wire, gravity, where, push)
    if not loaded and not free.all():
        leans = np.array([one.lean_rad for one in shots])
        pressed = press(world.wire, gravity[~free], where[~free], push[~free], leans[~free])
        for place, one in zip(np.flatnonzero(~free), pressed, strict=True):
            found[place] = one
    return found


@dataclass(frozen=True, eq=False)
class Photographer:
    """Takes a world's pictures, each with its own noise and its own part of the bench."""

    world: World

    @cached_property
    def _bench(self) -> np.ndarray:
        """Larger than a picture, which shows a part of it: the joints carry the camera over it."""
        width, height = self.world.optics.size
        return bench_of(
            (width * 4 // 3, height * 4 // 3), *self.world.bench, np.random.default_rng((*self.world.seed, 3))
        )

    def board(self, board_in_camera: Place, rng: np.random.Generator) -> bytes:
        """Of the board alone."""
        return self._taken([self._sheet(board_in_camera)], rng)

    def antenna(self, bent: Bent, rng: np.random.Generator, load: str = "", under: Place | None = None) -> bytes:
        """Of the antenna; `load` : an "object" or a "thread" that acts on it. `under` : a board, camera frame."""
        world, to_camera = self.world, self.world.camera.inverse()
        wire, radius = world.wire, world.wire.diameter_m / 2
        layers: list[Layer] = [] if under is None else [self._sheet(under)]
        holder = max(4 * radius, 0.01 * wire.length_m)
        tubes = [(wire_axis(bent, -0.05 * wire.length_m, 0.0), holder, (0.35, 0.2))]
        tubes.append((wire_axis(bent, 0.0, wire.length_m), radius, world.paint))
        if load:
            tubes.append(self._touching(bent, load))
        seen = [(to_camera.of(axis), size, paint) for axis, size, paint in tubes]
        # a thread that is pulled towards the camera passes it
        seen = [(axis[axis[:, 2] > 0.2 * axis[0, 2]], size, paint) for axis, size, paint in seen]
        for axis, size, paint in sorted(seen, key=lambda one: -float(np.median(np.linalg.norm(one[0], axis=1)))):
            layers.append(Tube.of(world.optics, axis, size, paint))
        return self._taken(layers, rng)

    def _touching(self, bent: Bent, load: str) -> tuple[np.ndarray, float, tuple[float, float]]:
        """A pin that pushes, or the thread that pulls."""
        world, force = self.world, bent.force_N / np.linalg.norm(bent.force_N)
        radius, place = world.wire.diameter_m / 2, self._load_m(bent)
        if load == "thread":
            way = np.linspace(0.0, 0.4 * world.wire.length_m, 60)[:, None]
            return bent.at(np.array(place)) + way * force, min(6e-5, radius / 2), (0.45, 0.45)
        size = 0.012 * world.wire.length_m
        along = np.cross(bent.along(place), force)
        way = np.linspace(-0.06, 0.06, 60)[:, None] * world.wire.length_m
        return bent.at(np.array(place)) - (size + radius) * force + way * along, size, (0.5, 0.4)

    def _load_m(self, bent: Bent) -> float:
        """The load is the one arc length at which two parts of the solution meet."""
        return float(bent.arclength_m[len(bent.arclength_m) // 2])

    def _sheet(self, board_in_camera: Place) -> Sheet:
        texture, texel, margin = _printed(self.world)
        return Sheet(self.world.optics, texture, texel, margin, board_in_camera.turn, board_in_camera.shift_m)

    def _taken(self, layers: Sequence[Layer], rng: np.random.Generator) -> bytes:
        world = self.world
        (width, height), large = world.optics.size, self._bench
        left, top = rng.integers(0, (large.shape[1] - width, large.shape[0] - height))
        bench = large[top : top + height, left : left + width]
        return encoded(world.sensor, photograph(world.optics, world.sensor, bench, layers, rng))


def _sweep(take: Photographer, folder: Path, sweep: tuple[Place, np.ndarray], rng: np.random.Generator) -> None:
    """Pictures and table of a board fixed in the world at joints (N, 2)."""
    world, (fixed, joints), rows = take.world, sweep, list[dict[str, Any]]()
    for index, (pan, tilt) in enumerate(joints):
        rows.append({"image": f"sweep_{index}{world.sensor.suffix}", "pan_rad": pan, "tilt_rad": tilt})
        view = (world.base(pan, tilt) @ world.camera).inverse() @ fixed
        _write(folder / "sweep" / rows[-1]["image"], take.board(view, rng))
    _table(folder / "sweep/sweep.csv", rows)


def _printed(world: World) -> tuple[np.ndarray, float, float]:
    board, sensor = world.board, world.sensor
    side = 8 if "4X4" in board.dictionary else 9
    across = board.squares[0] * board.square_m * world.optics.focal_px[0]
    away = np.median([one.of(board.middle_m[None])[0, 2] for one in world.boards])
    texels = across / away / board.squares[0] * sensor.fine / side
    return print_board(board.squares, board.dictionary, board.square_m, max(2, round(float(texels))))


def write_session(world: World, folder: Path) -> Truth:
    """All pictures and tables of a session, but nothing of the truth, which is returned."""
    rng, take = np.random.default_rng((*world.seed, 1)), Photographer(world)
    suffix, to_camera = world.sensor.suffix, world.camera.inverse()
    for index, place in enumerate(world.boards):
        _write(folder / f"intrinsics/board_{index:02d}{suffix}", take.board(place, rng))
    if world.jig is not None:
        for index in range(2):
            _write(folder / f"plane/jig_{index}{suffix}", take.board(to_camera @ world.jig, rng))
    if world.sweep is not None:
        _sweep(take, folder, world.sweep, rng)
    if world.over is not None:
        bent = bent_of(world, [Shot(0.0, 0.0)], True)[0]
        _write(folder / f"over/over{suffix}", take.antenna(bent, rng, under=to_camera @ world.over))
    typed = np.random.default_rng((*world.seed, 2))
    for name, shots in (("noload", world.free), ("loads", world.loads)):
        _table(folder / f"{name}/{name}.csv", _statics(take, folder / name, shots, (rng, typed)))
    bents = bent_of(world, world.contacts, False)
    rows = []
    for index, (shot, bent) in enumerate(zip(world.contacts, bents, strict=True)):
        row: dict[str, Any] = {"frame": index, "time_s": _APART_S * index, "image": f"frame_{index:02d}{suffix}"}
        rows.append(row | _readings(world, shot, bent, rng))
        _write(folder / "recording" / row["image"], take.antenna(bent, rng, "object" if any(shot.push_N) else ""))
    _table(folder / "recording/recording.csv", rows)
    (folder / "session.yaml").write_text(yaml.safe_dump(_session(world), sort_keys=False), encoding="utf-8")
    return truth_of(world, bents)


def _statics(
    take: Photographer,
    folder: Path,
    shots: Sequence[Shot],
    rngs: tuple[np.random.Generator, np.random.Generator],
    first: int = 0,
) -> list[dict[str, Any]]:
    """Rows of free antennas or loads, numbered from `first`; writes their pictures. rngs : of the pictures, and
    of what is typed."""
    world, (rng, typed) = take.world, rngs
    found, scales, name = list[dict[str, Any]](), dict[str, float](), folder.name
    for index, (shot, bent) in enumerate(zip(shots, bent_of(world, shots, True), strict=True), first):
        row: dict[str, Any] = {"image": f"{name}_{index:02d}{world.sensor.suffix}", **_readings(world, shot, bent, rng)}
        if name == "loads":
            # nobody misreads a ruler by four of its deviations; what is noted as the same weight is the same
            off = np.array(world.load_std) * typed.normal(size=2).clip(-2.5, 2.5)
            scale = scales.setdefault(f"{(1.0 + off[1]) * np.hypot(*shot.push_N):.3g}", 1.0 + off[1])
            row["distance_m"] = float(shot.distance_m + off[0])
            row |= {"force_y_N": float(scale * shot.push_N[0]), "force_z_N": float(scale * shot.push_N[1])}
        found.append(row)
        _write(folder / row["image"], take.antenna(bent, rng, "thread" if name == "loads" and world.thread else ""))
    return found


def follow(world: World, folder: Path, advised: Sequence[Mapping[str, Any]]) -> None:
    """Add to a session what its calibration advises to observe, as `guide` in rig.json has it."""
    take, rngs = Photographer(world), tuple(np.random.default_rng((*world.seed, 4, part)) for part in range(2))
    rng, typed = rngs
    for number, one in enumerate(advised):
        kind = one["kind"]
        if kind in ("free", "load"):
            name = {"free": "noload", "load": "loads"}[kind]
            push = (one.get("force_y_N", 0.0), one.get("force_z_N", 0.0))
            shot = Shot(one["pan_rad"], one["tilt_rad"], one.get("distance_m", 0.0), push)
            path = folder / f"{name}/{name}.csv"
            with path.open(encoding="utf-8", newline="") as stream:
                rows: list[dict[str, Any]] = list(csv.DictReader(stream))
            _table(path, rows + _statics(take, folder / name, [shot] * one.get("pictures", 1), (rng, typed), len(rows)))
        elif kind == "board":
            for index, pose in enumerate(one["T_camera_board"]):
                name = f"intrinsics/further_{number}_{index}{world.sensor.suffix}"
                _write(folder / name, take.board(Place.from_dict(pose), rng))
        elif kind == "jig" and world.jig is not None:
            error = Place(Rotation.from_rotvec(one["rotation_std_rad"] * typed.normal(size=3)), np.zeros(3))
            shift = world.jig.shift_m + one["translation_std_m"] * typed.normal(size=3)
            session = yaml.safe_load((folder / "session.yaml").read_text(encoding="utf-8"))
            stds = {key: one[key] for key in ("translation_std_m", "rotation_std_rad")}
            session["jig"] = {"T_antenna_board": Place(error.turn * world.jig.turn, shift).to_dict(), **stds}
            (folder / "session.yaml").write_text(yaml.safe_dump(session, sort_keys=False), encoding="utf-8")
        else:
            fixed = world.base(0.0, 0.0) @ world.camera @ Place.from_dict(one["T_camera_board"])
            _sweep(take, folder, (fixed, one["turn_rad"] * CROSSWISE), rng)


def truth_of(world: World, bents: Sequence[Bent]) -> Truth:
    """Of the recording."""
    touched = np.array([any(shot.push_N) for shot in world.contacts])
    points = [
        world.base(shot.pan_rad, shot.tilt_rad).of(bent.at(np.array([shot.distance_m])))[0]
        for shot, bent in zip(world.contacts, bents, strict=True)
    ]
    distance = np.where(touched, [shot.distance_m for shot in world.contacts], np.nan)
    force = np.array([bent.force_N for bent in bents])
    return Truth(distance, np.where(touched[:, None], points, np.nan), force)


def _readings(world: World, shot: Shot, bent: Bent, rng: np.random.Generator) -> dict[str, float]:
    joints = {"pan_rad": shot.pan_rad, "tilt_rad": shot.tilt_rad}
    if world.reads is None:
        return joints
    gain, offset, noise = world.reads
    return joints | {"moment_Nm": float(-gain * bent.moment_Nm[1] + offset + noise * rng.normal())}


def _session(world: World) -> dict[str, Any]:
    board, modules = world.board, 6 if "4X4" in world.board.dictionary else 7
    description: dict[str, Any] = {
        "schema": "vbaa.session/1",
        "board": {
            "type": "charuco",
            "squares_x": board.squares[0],
            "squares_y": board.squares[1],
            "square_m": board.square_m,
            "marker_m": board.square_m * modules / (modules + 2),
            "dictionary": board.dictionary,
        },
        "antenna": {**world.nominal, "tip": {"length_std_m": world.tip_std_m}},
        "kinematics": {"T_actuator_antenna": world.actuator.to_dict(), "position_world_m": world.origin_m.tolist()},
        "gravity_world": GRAVITY.tolist(),
        "moment_sensor": None if world.reads is None else {"std_Nm": float(world.reads[2])},
        "load_readings": dict(zip(("distance_std_m", "force_std_relative"), world.load_std, strict=True)),
    }
    if world.jig_typed is not None:
        std = dict(zip(("translation_std_m", "rotation_std_rad"), world.jig_std, strict=True))
        description["jig"] = {"T_antenna_board": world.jig_typed.to_dict(), **std}
    if world.over is not None:
        clamp = world.optics.pixels(world.camera.inverse().of(np.zeros((1, 3))))[0]
        description["over"] = {
            "height_m": -float(world.over.of(world.board.middle_m[None])[0, 2]),
            "pan_rad": 0.0,
            "tilt_rad": 0.0,
            "clamp_px": np.round(clamp, -1).tolist(),
        }
    return description


def _write(path: Path, data: bytes) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)


def _table(path: Path, rows: Sequence[dict[str, Any]]) -> None:
    with path.open("w", encoding="utf-8", newline="") as stream:
        table = csv.DictWriter(stream, list(rows[0]), lineterminator="\n")
        table.writeheader()
        table.writerows(rows)


if __name__ == "__main__":
    drawn = draw_world(int(sys.argv[1]), int(sys.argv[2]))
    print(drawn.described)
    write_session(drawn, Path(sys.argv[3]))
