"""Sessions as people take them, and what goes wrong with them: a table of mistakes, each drawn anew.

All of `vbaa calibrate` is run but for the finding of board and antenna in pictures: their places come from the
simulator, and the pictures in the folders are blank.
"""

from __future__ import annotations

import csv
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import cv2
import numpy as np
import yaml
from scipy.spatial.transform import Rotation

from vbaa_calib.antenna.taper import Taper
from vbaa_calib.calibrate import pipeline, plane_c
from vbaa_calib.calibrate.antenna.inputs import Observation
from vbaa_calib.calibrate.pipeline import Calibration, calibrate
from vbaa_calib.detect.board.corners import BoardView
from vbaa_calib.geometry import Pose
from vbaa_calib.session import Load, Still, load_session

from .recordings import NAMED, NOTHING, REPORTED, Mistake, _either
from .rigs import (
    GRAVITY_WORLD_M_S2,
    LINE_PX,
    READINGS,
    Bent,
    Kind,
    World,
    board_views,
    drawn_world,
    observed,
    seen,
    stills_of,
)


@dataclass(frozen=True, eq=False)
class Taken:
    """What was done on a rig, and what is noted of it.

    Attributes
    ----------
    worlds : the rig as it is in each picture of the antenna. stills : these, as they truly are.
    noted : of the pictures' rows, changed. yaml : of session.yaml, changed.
    views, in_jig : of the board. T_antenna_jig : where the jig truly has it.
    lines : changes of the antenna's pictures, by their index. seed : of the noise.
    """

    kind: Kind
    worlds: Sequence[World]
    stills: Sequence[Still]
    views: Sequence[BoardView]
    in_jig: Sequence[BoardView]
    T_antenna_jig: Pose
    seed: int
    noted: Callable[[list[dict[str, Any]]], None] = field(default=lambda rows: None)
    yaml: Callable[[dict[str, Any]], None] = field(default=lambda file: None)
    lines: Callable[[int, Observation], Observation] = field(default=lambda index, one: one)
    order: Sequence[int] = ()

    @property
    def loads(self) -> list[int]:
        """Indices of the loads."""
        return [index for index, still in enumerate(self.stills) if isinstance(still, Load)]


def clean_session(kind: Kind, seed: int) -> Taken:
    """A session without a mistake."""
    rng = np.random.default_rng((54, seed))
    world, stills = drawn_world(kind, rng), stills_of(kind)
    views, in_jig, T_antenna_jig = board_views(world, rng)
    return Taken(kind, [world] * len(stills), stills, views, in_jig, T_antenna_jig, seed)


def calibrated(taken: Taken) -> Calibration:
    """What `vbaa calibrate` makes of it. Raises VbaaError as it does."""
    found = observed(list(taken.worlds), list(taken.stills), np.random.default_rng((55, taken.seed)))
    found = [taken.lines(index, one) for index, one in enumerate(found)]
    if taken.order:
        found = [found[index] for index in taken.order]
    with tempfile.TemporaryDirectory() as folder, _pictures(taken, found, Path(folder)):
        return calibrate(load_session(Path(folder)), "opencv5")


@contextmanager
def _pictures(taken: Taken, found: Sequence[Observation], root: Path) -> Iterator[None]:
    """A folder with blank pictures; what is found in them is known."""
    width, height = taken.kind.image_size
    blank = root / "blank.png"
    cv2.imwrite(str(blank), np.zeros((height, width), np.uint8))

    def files(name: str, count: int) -> list[str]:
        (root / name).mkdir()
        names = [f"{name}_{index:03d}.png" for index in range(count)]
        for each in names:
            (root / name / each).hardlink_to(blank)
        return names

    lens_names, jig_names = files("intrinsics", len(taken.views)), files("plane", len(taken.in_jig))
    rows = []
    for one, still in zip(found, taken.stills, strict=True):
        row = {"image": "", "pan_rad": still.pan_rad, "tilt_rad": still.tilt_rad, "moment_Nm": one.still.moment_Nm}
        if isinstance(still, Load):
            row |= {"distance_m": still.distance_m, "force_y_N": still.force_y_N, "force_z_N": still.force_z_N}
        rows.append(row)
    taken.noted(rows)
    for name in ("noload", "loads"):
        own = [row for row in rows if ("distance_m" in row) == (name == "loads")]
        for row, image in zip(own, files(name, len(own)), strict=True):
            row["image"] = image
        with (root / name / f"{name}.csv").open("w", newline="") as file:
            writer = csv.DictWriter(file, own[0])
            writer.writeheader()
            writer.writerows(own)
    settings = _session_yaml(taken)
    taken.yaml(settings)
    (root / "session.yaml").write_text(yaml.safe_dump(settings))
    boards = {"intrinsics": (taken.views, lens_names), "plane": (taken.in_jig, jig_names)}

    def boards_in(path: Path, *_: Any) -> list[BoardView]:
        return [replace(view, name=name) for view, name in zip(*boards[path.name], strict=True)]

    def antennas_in(session: Any, kinematics: Any, *_: Any) -> list[Observation]:
        stills = [*pipeline.read_noload(session), *pipeline.read_loads(session)]
        pulls = [
            kinematics.world_antenna(one.pan_rad, one.tilt_rad)[0].T @ session.gravity_world_m_s2 for one in stills
        ]
        return [
            replace(one, still=still, gravity_m_s2=pull) for one, still, pull in zip(found, stills, pulls, strict=True)
        ]

    with (
        patch.object(pipeline, "detect_folder", boards_in),
        patch.object(plane_c, "detect_folder", boards_in),
        patch.object(pipeline, "observe_stills", antennas_in),
    ):
        yield


def _session_yaml(taken: Taken) -> dict[str, Any]:
    antenna, board, jig = taken.kind.antenna, taken.kind.board, taken.T_antenna_jig
    return {
        "schema": "vbaa.session/1",
        "board": {name: getattr(board, name) for name in ("squares_x", "squares_y", "square_m", "marker_m")},
        "antenna": {
            name: getattr(antenna, name) for name in ("length_m", "diameter_m", "youngs_modulus_Pa", "density_kg_m3")
        },
        "jig": {
            "T_antenna_board": {
                "translation_m": jig.translation_m.tolist(),
                "rotation_xyzw": Rotation.from_matrix(jig.rotation).as_quat().tolist(),
            }
        },
        "gravity_world": GRAVITY_WORLD_M_S2.tolist(),
        "moment_sensor": {"std_Nm": taken.kind.moment_std_Nm},
        "load_readings": {"distance_std_m": READINGS.distance_std_m, "force_std_relative": READINGS.force_std_relative},
        "drift": "lab",
    }


# --- what goes wrong

Changed = Callable[[Taken, np.random.Generator], Taken]


def _rows(change: Callable[[list[dict[str, Any]], np.random.Generator], None], loads: bool = True) -> Changed:
    """Rows of loads.csv, or of all tables, changed in place."""

    def altered(was: Taken, rng: np.random.Generator) -> Taken:
        seed = int(rng.integers(2**31))

        def noted(rows: list[dict[str, Any]]) -> None:
            change([row for row in rows if not loads or "distance_m" in row], np.random.default_rng(seed))

        return replace(was, noted=noted)

    return altered


def _typed(change: Callable[[dict[str, Any], Taken, np.random.Generator], None]) -> Changed:
    """session.yaml changed in place."""

    def altered(was: Taken, rng: np.random.Generator) -> Taken:
        seed = int(rng.integers(2**31))
        return replace(was, yaml=lambda file: change(file, was, np.random.default_rng(seed)))

    return altered


def _worlds(change: Callable[[World, np.random.Generator], World], since: str = "antenna") -> Changed:
    """Another rig in all pictures of the antenna, in those of loads, or in the last of these."""

    def altered(was: Taken, rng: np.random.Generator) -> Taken:
        other = change(was.worlds[0], rng)
        loads = was.loads
        first = {"antenna": 0, "loads": loads[0], "last": loads[int(rng.integers(len(loads) // 2, len(loads) - 1))]}[
            since
        ]
        return replace(was, worlds=[*was.worlds[:first], *[other] * (len(was.worlds) - first)])

    return altered


def _column(name: str, change: Callable[[np.ndarray, np.random.Generator], np.ndarray], loads: bool = True) -> Changed:
    """A column of the tables changed."""

    def altered(rows: list[dict[str, Any]], rng: np.random.Generator) -> None:
        values = change(np.array([row[name] for row in rows], float), rng)
        for row, value in zip(rows, values.tolist(), strict=True):
            row[name] = value

    return _rows(altered, loads)


def _one(values: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """One of them 3 mm less."""
    values = values.copy()
    values[rng.integers(len(values))] -= 3e-3
    return values


def _forces(change: Callable[[np.ndarray, np.random.Generator], np.ndarray]) -> Changed:
    """Forces (F, 2) along y and z changed."""

    def altered(rows: list[dict[str, Any]], rng: np.random.Generator) -> None:
        forces = change(np.array([[row["force_y_N"], row["force_z_N"]] for row in rows]), rng)
        for row, (y, z) in zip(rows, forces.tolist(), strict=True):
            row["force_y_N"], row["force_z_N"] = y, z

    return _rows(altered)


def _turned(angle: float) -> Callable[[np.ndarray, np.random.Generator], np.ndarray]:
    def change(forces: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        by = angle * rng.choice([-1.0, 1.0]) * rng.uniform(0.8, 1.5)
        return forces @ np.array([[np.cos(by), np.sin(by)], [-np.sin(by), np.cos(by)]])

    return change


def _exchanged(names: Sequence[str]) -> Changed:
    """Cells of two rows that differ."""

    def altered(rows: list[dict[str, Any]], rng: np.random.Generator) -> None:
        one, other = (rows[index] for index in rng.choice(len(rows) // 2, 2, replace=False) * 2)
        for name in names:
            one[name], other[name] = other[name], one[name]

    return _rows(altered)


def _pictures_exchanged(was: Taken, rng: np.random.Generator) -> Taken:
    order = list(range(len(was.stills)))
    one, other = (was.loads[index] for index in rng.choice(len(was.loads) // 2, 2, replace=False) * 2)
    order[one], order[other] = other, one
    # the readings stay with their rows
    readings = order

    def noted(rows: list[dict[str, Any]]) -> None:
        moments = [row["moment_Nm"] for row in rows]
        for row, index in zip(rows, readings, strict=True):
            row["moment_Nm"] = moments[index]

    return replace(was, order=order, noted=noted)


def _joints_exchanged(rows: list[dict[str, Any]], rng: np.random.Generator) -> None:
    for row in rows:
        row["pan_rad"], row["tilt_rad"] = row["tilt_rad"], row["pan_rad"]


def _length(file: dict[str, Any], was: Taken, rng: np.random.Generator) -> None:
    file["antenna"]["length_m"] *= 1.0 + _either(0.01, 0.02, rng)


def _squares(file: dict[str, Any], was: Taken, rng: np.random.Generator) -> None:
    by = 1.0 + _either(0.02, 0.05, rng)
    file["board"]["square_m"] *= by
    file["board"]["marker_m"] *= by


def _material(file: dict[str, Any], was: Taken, rng: np.random.Generator) -> None:
    """Nitinol, nylon, carbon or glass that is called steel, or steel that is called nitinol."""
    steel = file["antenna"]["density_kg_m3"] == 7900.0
    names = {True: [(60e9, 6450.0), (3e9, 1140.0), (110e9, 1600.0), (40e9, 1950.0)], False: [(193e9, 7900.0)]}[steel]
    file["antenna"]["youngs_modulus_Pa"], file["antenna"]["density_kg_m3"] = names[rng.integers(len(names))]


def _diameter(file: dict[str, Any], was: Taken, rng: np.random.Generator) -> None:
    file["antenna"]["diameter_m"] *= 1.0 + _either(0.08, 0.15, rng)


def _gravity(angle_deg: tuple[float, float]) -> Callable[[dict[str, Any], Taken, np.random.Generator], None]:
    def change(file: dict[str, Any], was: Taken, rng: np.random.Generator) -> None:
        around, by = rng.uniform(0, 2 * np.pi), np.radians(rng.uniform(*angle_deg))
        turn = Rotation.from_rotvec(by * np.array([np.cos(around), np.sin(around), 0.0]))
        file["gravity_world"] = turn.apply(GRAVITY_WORLD_M_S2).tolist()

    return change


def _jig(change: Callable[[Pose, np.random.Generator], Pose]) -> Changed:
    def altered(file: dict[str, Any], was: Taken, rng: np.random.Generator) -> None:
        pose = change(was.T_antenna_jig, rng)
        file["jig"]["T_antenna_board"] = {
            "translation_m": pose.translation_m.tolist(),
            "rotation_xyzw": Rotation.from_matrix(pose.rotation).as_quat().tolist(),
        }

    return _typed(altered)


def _half_turn(pose: Pose, rng: np.random.Generator) -> Pose:
    return Pose(pose.rotation @ np.diag([-1.0, -1.0, 1.0]), pose.translation_m)


def _sign(pose: Pose, rng: np.random.Generator) -> Pose:
    signs = np.ones(3)
    signs[rng.integers(2)] = -1.0
    return Pose(pose.rotation, pose.translation_m * signs)


def _moved(by_m: float) -> Callable[[Pose, np.random.Generator], Pose]:
    def change(pose: Pose, rng: np.random.Generator) -> Pose:
        way = rng.normal(size=3)
        return Pose(pose.rotation, pose.translation_m + by_m * way / np.linalg.norm(way))

    return change


def _scaled_jig(by: float) -> Changed:
    return _jig(lambda pose, rng: Pose(pose.rotation, by * pose.translation_m))


def _camera_turned(world: World, rng: np.random.Generator) -> World:
    way = rng.normal(size=3)
    return world.camera_moved(np.radians(rng.uniform(0.25, 0.5)) * way / np.linalg.norm(way), np.zeros(3))


def _refocused(low: float, high: float) -> Callable[[World, np.random.Generator], World]:
    return lambda world, rng: world.lens_moved(1.0 + _either(low, high, rng))


def _clamp_turned(world: World, rng: np.random.Generator) -> World:
    by = rng.uniform(1.5e-3, 5e-3) * _on_circle(rng)
    return world.with_parameters(p2=by[0], p3=by[1])


def _clamp_shifted(world: World, rng: np.random.Generator) -> World:
    by = rng.uniform(1e-3, 3e-3) * _on_circle(rng) * min(1.0, world.length_m / 0.1)
    return world.with_parameters(p0=by[0], p1=by[1])


def _bent(world: World, rng: np.random.Generator) -> World:
    by = rng.uniform(0.05, 0.3) * _on_circle(rng)
    return world.with_parameters(p4=by[0], p5=by[1])


def _tapered(world: World, rng: np.random.Generator) -> World:
    return replace(world, taper=Taper().thinned(float(np.log(rng.uniform(0.5, 0.6)))))


def _without_hanger(forces: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A part of each load is not noted: the same for all, 15 to 35 % of the lightest."""
    size = np.linalg.norm(forces, axis=1, keepdims=True)
    return np.asarray(forces * (1.0 - rng.uniform(0.15, 0.35) * size.min() / size))


def _resting(forces: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Something else carries a part of one load, of which the whole is noted."""
    forces = forces.copy()
    forces[rng.integers(len(forces))] /= rng.uniform(0.3, 0.7)
    return forces


def _on_circle(rng: np.random.Generator) -> np.ndarray:
    around = rng.uniform(0, 2 * np.pi)
    return np.array([np.cos(around), np.sin(around)])


def _touched(was: Taken, rng: np.random.Generator) -> Taken:
    """A free picture in which the antenna rests on something."""
    row = int(rng.integers(1, was.loads[0]))
    world, still = was.worlds[row], was.stills[row]
    at = rng.uniform(0.5, 0.9) * world.length_m
    force = 2.0 * was.kind.antenna.stiffness_Nm2 * rng.uniform(0.01, 0.1) / at**2 * _on_circle(rng)
    gravity = world.gravity(np.array([still.pan_rad]), np.array([still.tilt_rad]))
    bent = Bent.of(world, gravity, np.array([at]), np.array([[0.0, *force]]))
    line = seen(bent, LINE_PX, rng)[0]

    def lines(index: int, one: Observation) -> Observation:
        if index != row:
            return one
        tip_px, tip_std_px = line.tip_px[:2], float(line.tip_px[2])
        touched = replace(one.still, moment_Nm=float(bent.readings_Nm[0, 0]))
        return replace(
            one, still=touched, points_px=line.points_px, sigma_px=line.sigma_px, tip_px=tip_px, tip_std_px=tip_std_px
        )

    return replace(was, lines=lines)


def _uneven(world: World, rng: np.random.Generator) -> World:
    """An antenna that is some per cent softer to z than to y."""
    return replace(world, softer_z=rng.uniform(0.04, 0.08))


def _cropped(was: Taken, rng: np.random.Generator) -> Taken:
    """The board's pictures are parts of the camera's, enlarged to the same size."""
    part, size = rng.uniform(0.8, 0.95), np.array(was.kind.image_size)
    corner = (1.0 - part) * size / 2

    def cropped(view: BoardView) -> BoardView:
        pixels = (view.corners_px - corner) / part
        inside = ((pixels > 0) & (pixels < size - 1)).all(axis=1)
        return replace(view, ids=view.ids[inside], corners_px=pixels[inside])

    return replace(was, views=[cropped(view) for view in was.views])


def _other_axis(rows: list[dict[str, Any]], rng: np.random.Generator) -> None:
    """Moments about z: of the loads alone, for the weight has none there."""
    noise = 0.01 * np.ptp([row["moment_Nm"] for row in rows]) * rng.normal(size=len(rows) + 1)
    for row, own in zip(rows, noise[1:], strict=True):
        row["moment_Nm"] = float(row.get("distance_m", 0.0) * row.get("force_y_N", 0.0) + noise[0] + 0.01 * own)


def _other_lens(was: Taken, rng: np.random.Generator) -> Taken:
    """The board's pictures by another camera of the same size."""
    other = was.worlds[0].lens_moved(1.0 + _either(0.05, 0.12, rng), 0.02 * was.kind.image_size[0] * _on_circle(rng))
    return replace(was, views=board_views(other, rng)[0])


def _mirrored(was: Taken, rng: np.random.Generator) -> Taken:
    """The antenna's pictures are mirrored, the board's are not."""
    last = was.kind.image_size[0] - 1

    def lines(index: int, one: Observation) -> Observation:
        tip_px = np.array([last - one.tip_px[0], one.tip_px[1]])
        return replace(one, points_px=np.column_stack([last - one.points_px[:, 0], one.points_px[:, 1]]), tip_px=tip_px)

    return replace(was, lines=lines)


def _row(what: str, right: str, altered: Changed, must: str = NAMED) -> Mistake[Taken]:
    kinds = [pattern for name, pattern in SAYS.items() if name in right]
    return Mistake(what, must, frozenset(right.split()), altered, "|".join(kinds))


SAYS = {
    "load_force_unit": r"gram|pound|unit|9\.81",
    "load_distance": "distance",
    "load_rows": "exchanged|shows a load",
    "loads_turned": "turned|exchanged|sign",
    "antenna_length": "length",
    "board_scale": "squares|board's size",
    "stiffness_not_nominal": "material|diameter|EI",
    "stiffness_varies": "tapered|two materials",
    "sensor_": "moment",
    "joint_readings_wrong": "pan|tilt",
    "gravity": "gravity",
    "mirrored": "mirrored",
    "jig_unit": r"jig.*(cm|mm|inch|turn|sign|unit|exchange|metres)",
    "camera_moved": "camera.*(moved|turned)",
    "focus_changed": "focus|focal",
    "clamp_slipped": "clamp",
    "antenna_bent_between": "bent",
}
"""What an error must say that names the cause of such a finding."""
FORCE = "load_force_unit load_force_mistyped"
ROWS = "load_rows_exchanged load_force_mistyped load_distance_mistyped"
MATERIAL = "stiffness_not_nominal material diameter"
JIG = "jig_unit jig_sign jig_axes_exchanged jig_turned jig_rotation_order jig_inverse"
MOVED = "camera_moved camera_turned"
SESSION = (
    _row("length_m by 1 to 2 %", "antenna_length", _typed(_length)),
    _row("board's squares by 2 to 5 %", "board_scale", _typed(_squares)),
    _row("one load's distance by 3 mm", "load_distance_mistyped", _column("distance_m", _one)),
    _row("all loads' distances by 3 mm", "load_distances_shifted", _column("distance_m", lambda x, rng: x - 3e-3)),
    _row("two weights exchanged", ROWS, _exchanged(("force_y_N", "force_z_N"))),
    _row("two distances exchanged", ROWS, _exchanged(("distance_m",))),
    _row("two pictures exchanged", ROWS, _pictures_exchanged),
    _row("loads turned by 4 to 8°", "loads_turned", _forces(_turned(0.09))),
    _row("loads' y and z exchanged", "loads_turned load_force_mistyped", _forces(lambda f, rng: f[:, ::-1])),
    _row("loads' sign", "loads_turned load_force_mistyped", _forces(lambda f, rng: -f)),
    _row("loads in grams", FORCE, _forces(lambda f, rng: f / 9.80665e-3)),
    _row("loads × 9.81", FORCE, _forces(lambda f, rng: f * 9.80665)),
    _row("loads in pounds", FORCE, _forces(lambda f, rng: f / 4.4482)),
    _row("another material", MATERIAL, _typed(_material)),
    _row("diameter by 8 to 15 %", MATERIAL, _typed(_diameter)),
    _row("moment's sign", "sensor_sign", _column("moment_Nm", lambda m, rng: -m, loads=False)),
    _row("moment in mN·m", "sensor_unit", _column("moment_Nm", lambda m, rng: 1e3 * m, loads=False)),
    _row("moment dead", "sensor_not_connected", _column("moment_Nm", lambda m, rng: 0.0 * m, loads=False)),
    _row(
        "no sensor, but noise",
        "sensor_not_connected",
        _column("moment_Nm", lambda m, rng: 1e-2 * np.ptp(m) * rng.normal(size=len(m)), loads=False),
    ),
    _row("moment about the other axis", "sensor_axis", _rows(_other_axis, loads=False)),
    _row("pan and tilt exchanged", "joint_readings_wrong", _rows(_joints_exchanged, loads=False)),
    _row(
        "tilt's sign",
        "joint_readings_wrong joints_untested",
        _column("tilt_rad", lambda t, rng: -t, loads=False),
        REPORTED,
    ),
    _row("jig off by 1 mm", "", _jig(_moved(1e-3)), NOTHING),
    _row("gravity tilted by 3 to 10°", "gravity_tilted gravity_direction", _typed(_gravity((3.5, 10.0)))),
    _row("gravity upward", "gravity_direction gravity_tilted", _typed(_gravity((180.0, 180.0)))),
    _row("no gravity", "weightless gravity_direction", _typed(lambda file, was, rng: file.update(gravity_world=None))),
    _row("jig turned by 180°", JIG, _jig(_half_turn)),
    _row("jig: one sign", JIG, _jig(_sign)),
    _row("jig: x and y exchanged", JIG, _jig(lambda pose, rng: Pose(pose.rotation, pose.translation_m[[1, 0, 2]]))),
    _row("jig in cm", JIG, _scaled_jig(100.0)),
    _row("jig in mm", JIG, _scaled_jig(1000.0)),
    _row("jig in inch", JIG, _scaled_jig(1.0 / 0.0254)),
    _row("camera turned after the jig", MOVED, _worlds(_camera_turned)),
    _row("camera turned between loads", f"{MOVED} clamp_slipped", _worlds(_camera_turned, "last")),
    _row("refocused after the jig by 1 to 3 %", "focus_changed refocused", _worlds(_refocused(0.01, 0.03))),
    _row("board's pictures cropped", "picture_cropped lens_contradicted focus_changed refocused", _cropped),
    _row("antenna's pictures mirrored", "pictures_mirrored picture_mirrored mirrored", _mirrored),
    _row("lens of another camera", "lens_contradicted other_camera focus_changed refocused", _other_lens),
    _row("antenna bent by the last loads", "antenna_bent_between", _worlds(_bent, "last")),
    _row("clamp turned by 1.5 to 5 mrad", "clamp_slipped", _worlds(_clamp_turned, "last")),
    _row("clamp shifted by 1 to 3 mm", "clamp_slipped", _worlds(_clamp_shifted, "last")),
    _row("EI 4 to 8 % softer to z", "stiffness_uneven", _worlds(_uneven)),
    _row("a free picture that touches", "noload_touched noload_row_unexplained", _touched),
    _row("loads in kilograms", FORCE, _forces(lambda f, rng: f / 9.80665)),
    _row("tilt in degrees", "joint_readings_wrong", _column("tilt_rad", lambda t, rng: np.rad2deg(t), False)),
    _row("a load that rests on something", f"load_supported {ROWS}", _forces(_resting)),
    _row("a hanger that was not weighed", "loads_shifted", _forces(_without_hanger)),
    _row("an antenna that tapers by a half", "stiffness_varies", _worlds(_tapered)),
)
"""The matrix's column of sessions. Edit the names of the findings here."""
