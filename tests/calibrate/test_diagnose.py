"""What a session's rows, its sensor, its jig and its lens have wrong, each injected: named, and what is right is not.

Mistakes from pictures to rig, over other rigs: tests/test_mistakes.py.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.mistakes.rigs import drawn_kind, drawn_world, observed, session_of, stills_of
from targets.board import corner_points
from vbaa_calib.calibrate.given_lens import focus_changed
from vbaa_calib.calibrate.lens.intrinsics import solve_intrinsics
from vbaa_calib.calibrate.lens.models import LENS_MODELS
from vbaa_calib.calibrate.pose.board_pose import BoardPose
from vbaa_calib.calibrate.pose.fusion import PoseEstimate
from vbaa_calib.camera import Camera
from vbaa_calib.core.errors import Diagnosis
from vbaa_calib.diagnose.jig import JigEvidence, jig_diagnoses
from vbaa_calib.diagnose.session import failure_causes
from vbaa_calib.diagnose.typed_loads import typed_load_diagnoses
from vbaa_calib.geometry import Kinematics, Pose
from vbaa_calib.session import Still, gravity_antenna

from ..rod_scenes import GRAVITY_WORLD
from . import still_faults as stills
from .synthetic_views import SPEC, pose_towards, views_of


def slow_but(few: int, names: Iterable[object]) -> list[object]:
    """All of these, of which only the first few are quick."""
    return [pytest.param(name, marks=[pytest.mark.slow] * (number >= few)) for number, name in enumerate(names)]


@pytest.mark.parametrize(
    ("factor", "distance_m", "name", "words"),
    [
        (101.97, None, "load_force_unit", "in grams"),
        (1.0, 15.0, "load_distance_unit", "in centimetres"),
        (1.0, 150.0, "load_distance_unit", "in millimetres"),
        (1e-3, None, "load_too_small", "newtons"),
    ],
)
def test_typed_loads_that_are_impossible_are_named(
    factor: float, distance_m: float | None, name: str, words: str
) -> None:
    loads = [
        replace(one, force_y_N=factor * one.force_y_N, force_z_N=factor * one.force_z_N)
        for one in stills.hung_loads(np.random.default_rng(1))
    ]
    loads = [replace(one, distance_m=distance_m or one.distance_m) for one in loads]
    (found,) = typed_load_diagnoses(loads, stills.NOMINAL)
    assert found.name == name
    assert "all 5 rows" in found.words
    assert words in found.remedy


SENSORS: dict[str, tuple[Callable[[int, float], float], str, str]] = {
    "sign": (lambda index, read: -read, "sensor_sign", "wrong sign"),
    "not connected": (lambda index, read: 0.0, "sensor_not_connected", "all 8 moment readings"),
    "noise": (lambda index, read: 2e-5 * np.sin(7.0 * index), "sensor_not_connected", "do not follow"),
    "pounds times inches": (lambda index, read: 8.8507 * read, "sensor_unit", "lbf·in"),
    "kilonewton metres": (lambda index, read: 1e-3 * read, "sensor_unit", "kN·m"),
    "micronewton metres": (lambda index, read: 1e6 * read, "sensor_unit", "µN·m"),
    # or a gain of its own: both are named
    "pounds times feet": (lambda index, read: 0.73756 * read, "sensor_gain", "lbf·ft"),
    "less noise than stated": (lambda index, read: 1e-7 * np.sin(7.0 * index), "sensor_not_connected", "do not follow"),
    "sign and millinewtons": (lambda index, read: -1e3 * read, "sensor_sign", "mN·m"),
    "millinewton metres": (lambda index, read: 1e3 * read, "sensor_unit", "mN·m"),
}


@pytest.mark.parametrize("name", slow_but(4, SENSORS))
def test_a_sensor_that_is_wrong_is_named(name: str) -> None:
    sensor, called, words = SENSORS[name]
    first = session_doubts(0, lambda index, one: replace(one, moment_Nm=sensor(index, one.moment_Nm)))[0]
    assert first.name == called
    assert words in first.words


def test_gravity_whose_sag_a_bow_hides_is_named_by_the_moments() -> None:
    (found,) = session_doubts(11, lambda index, one: one, -GRAVITY_WORLD)
    assert found.name == "gravity_direction"
    assert "look as if gravity pointed to −z" in found.words


def session_doubts(
    seed: int, change: Callable[[int, Still], Still], gravity_world: np.ndarray = GRAVITY_WORLD
) -> list[Diagnosis]:
    """More than notes of a session whose readings were changed, with this gravity."""
    rng = np.random.default_rng(seed)
    world = stills.drawn_world(rng)
    seen = stills.observed(world, [*stills.free_stills(), *stills.hung_loads(rng)], rng)
    pulls = gravity_antenna(Kinematics(), gravity_world, [one.still for one in seen])
    seen = [
        replace(one, still=change(index, one.still), gravity_m_s2=pull)
        for index, (one, pull) in enumerate(zip(seen, pulls, strict=True))
    ]
    found = failure_causes(stills.session(gravity_world), Kinematics(), seen, stills.before(world, rng))
    return [one for one in found if one.severity != "note"]


def jig_of(seed: int) -> JigEvidence:
    """What session.yaml and the pictures say of a rig that is drawn, without a mistake: three free antennas, and a
    board in the jig on any side of the clamp, seen to a tenth of a millimetre."""
    rng = np.random.default_rng((7, seed))
    kind = drawn_kind(rng)
    world, length = drawn_world(kind, rng), kind.length_m
    focal, (width, height), lens = kind.focal_px, kind.image_size, world.lens
    std = np.array([1e-3 * focal, 1e-3 * focal, 1e-3 * width, 1e-3 * width, 2e-3, 4e-3, 2e-4, 2e-4])
    camera = Camera("opencv", (width, height), lens.matrix, lens.distortion[:4], np.diag(std**2))
    place = length * rng.uniform([0.15, 0.12, 0.04], [0.4, 0.3, 0.1]) * rng.choice([-1.0, 1.0], 3)
    turn = Rotation.from_rotvec(0.05 * rng.normal(size=3)) * Rotation.from_rotvec([np.pi, 0.0, 0.0])
    jig = Pose(turn.as_matrix(), place)
    lines = observed([world] * 3, stills_of(kind)[:3], rng)
    seen = (world.T_antenna_camera.inverse() @ jig).retract(BOARD_STD * rng.normal(size=6))
    board = BoardPose(seen, np.diag(BOARD_STD**2), np.zeros((6, 8)), 0.05, 40, 0, None)
    session = replace(session_of(kind), T_antenna_board=jig)
    return JigEvidence(session, camera, board, (), [one.still for one in lines], lines)


Slip = Callable[[Pose, JigEvidence], Pose]
SHIFT_M, BOARD_STD = np.array([0.0, 8e-3, 0.0]), np.array([3e-4] * 3 + [1e-4] * 3)


def half_turn(axis: int, about: Callable[[JigEvidence], np.ndarray] = lambda _: np.zeros(3)) -> Slip:
    """About an axis of the board."""

    def slip(pose: Pose, evidence: JigEvidence) -> Pose:
        rotation, middle = Rotation.from_rotvec(np.pi * np.eye(3)[axis]).as_matrix(), about(evidence)
        return pose @ Pose(rotation, middle - rotation @ middle)

    return slip


def shifted(change: Callable[[np.ndarray], np.ndarray]) -> Slip:
    return lambda pose, _: Pose(pose.rotation, change(pose.translation_m))


SLIPS: dict[str, tuple[str, Slip]] = {
    "sign of y": ("jig_sign", shifted(lambda at: at * [1, -1, 1])),
    "in cm": ("jig_unit", shifted(lambda at: 100.0 * at)),
    "in mm": ("jig_unit", shifted(lambda at: 1000.0 * at)),
    "in inch": ("jig_unit", shifted(lambda at: at / 0.0254)),
    "m for mm": ("jig_unit", shifted(lambda at: 1e-3 * at)),
    "sign of x": ("jig_sign", shifted(lambda at: at * [-1, 1, 1])),
    "sign of z": ("jig_sign", shifted(lambda at: at * [1, 1, -1])),
    "x and y": ("jig_axes_exchanged", shifted(lambda at: at[[1, 0, 2]])),
    "x and z": ("jig_axes_exchanged", shifted(lambda at: at[[2, 1, 0]])),
    "y and z": ("jig_axes_exchanged", shifted(lambda at: at[[0, 2, 1]])),
    "half a turn about its corner": ("jig_turned", half_turn(2)),
    "half a turn about its middle": (
        "jig_turned",
        half_turn(2, lambda evidence: corner_points(evidence.session.board).mean(axis=0) * [1, 1, 0]),
    ),
    "half a turn of the jig": ("jig_turned", lambda pose, _: Pose(np.diag([-1.0, -1.0, 1.0]), np.zeros(3)) @ pose),
    "face down": ("jig_turned", half_turn(0)),
    "inverse": ("jig_inverse", lambda pose, _: pose.inverse()),
}
SHOWN_BY_LOADS = ("sign of z", "x and z")
"""A clamp's angle makes up for a shift along the line of sight, until loads bend the antenna."""


def mistaken(evidence: JigEvidence, slip: Slip) -> JigEvidence:
    """The same with a slip in session.yaml."""
    pose = evidence.session.T_antenna_board
    assert pose is not None
    return replace(evidence, session=replace(evidence.session, T_antenna_board=slip(pose, evidence)))


@pytest.mark.parametrize("slip", slow_but(2, SLIPS))
def test_a_slip_in_the_jigs_pose_is_named(slip: str) -> None:
    """Alone, or with what the free antenna does not tell from it; in one draw of five it may hardly move that."""
    name, change = SLIPS[slip]
    seeds = range(3, 4 + 4 * (slip not in list(SLIPS)[:2]))
    every = [jig_diagnoses(mistaken(jig_of(seed), change)) for seed in seeds]
    for found in filter(None, every):
        (one,) = found
        assert one.grave or slip in SHOWN_BY_LOADS
        assert one.name == name or "; or " in one.words, found
    assert slip in SHOWN_BY_LOADS or every.count([]) <= len(every) // 5


@pytest.mark.parametrize("seed", slow_but(1, range(40)))
def test_a_jig_that_is_right_is_not_blamed(seed: int) -> None:
    assert jig_diagnoses(jig_of(seed)) == []


@pytest.mark.parametrize("seed", slow_but(1, range(8)))
def test_mirrored_pictures_of_the_antenna_are_named(seed: int) -> None:
    evidence = jig_of(seed)
    turn, shift = np.array([-1.0, 1.0]), np.array([evidence.camera.image_size[0] - 1.0, 0.0])
    lines = [
        replace(one, points_px=shift + turn * one.points_px, tip_px=shift + turn * one.tip_px)
        for one in evidence.lines or ()
    ]
    (found,) = jig_diagnoses(replace(evidence, lines=lines))
    # where the antenna lies along the picture's middle, upside down looks the same
    assert found.name in ("pictures_mirrored", "pictures_turned")
    assert "mirrored left to right" in found.words


def test_a_second_way_shows_by_how_much_the_jig_is_off() -> None:
    """Without the antenna either may be off; its line says which."""
    evidence = jig_of(0)
    at = evidence.session.T_antenna_board @ evidence.board.T_camera_board.inverse()
    other = PoseEstimate("sweep", at, np.diag(np.array([2e-4] * 3 + [1e-4] * 3) ** 2), np.zeros((6, 8)))
    off = mistaken(replace(evidence, others=[other]), shifted(lambda place: place + SHIFT_M))
    (found,) = jig_diagnoses(off)
    assert found.name == "jig_off"
    assert float(found.words.split(", ")[2].split()[0]) == pytest.approx(-8.0, abs=1.0)
    (found,) = jig_diagnoses(replace(off, lines=[]))
    assert "jig.T_antenna_board has it, by" in found.words
    assert "the sweep puts the camera off" in found.words


@pytest.mark.parametrize("factor", [1.0, 0.97, 1.03])
def test_a_refocus_between_the_lens_pictures_and_the_jigs_is_named(factor: float) -> None:
    rng, lens = np.random.default_rng(5), LENS_MODELS["opencv4"]
    intrinsics = np.array([1100.0, 1102.0, 640.0, 362.0, -0.18, 0.06, 7e-4, -5e-4])
    views = views_of(lens, intrinsics, (1280, 720), [pose_towards(rng, 0.16, 0.8) for _ in range(12)], rng, 0.06)
    solution = solve_intrinsics(views, SPEC, "opencv4")
    intrinsics[:2] *= factor
    jig = views_of(lens, intrinsics, (1280, 720), [pose_towards(rng, 0.2, 0.9, 0.1)], rng, 0.06)
    what = Diagnosis("refocused", "the lens is not that of", "take them anew")
    found = focus_changed(solution.camera, [("plane", one) for one in jig], solution.board_shape, what)
    assert [one.grave for one in found] == [True] * (factor != 1.0)
