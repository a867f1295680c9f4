"""What numbers a call takes: every kind that is a number, in sizes that its unit allows."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from estimator import ContactEstimator, Measured, next_touch, refine
from estimator.live import LiveEstimator
from estimator.object.estimate import estimate_object
from estimator.paper.baselines import Press, Wire, run_method
from estimator.paper.inclined import eq29_baseline, inclined_two_point_contact
from estimator.paper.two_point import force_z, two_point_contact
from estimator.table.files import read_contacts, write_contacts
from vbaa_calib import Camera, Rig, calibrate_lens
from vbaa_calib.antenna.rungs import curves
from vbaa_calib.calibrate.given_lens import read_lens
from vbaa_calib.calibrate.pipeline import calibrate
from vbaa_calib.calibrate.pose.hand_eye import solve_hand_eye
from vbaa_calib.camera import in_plane_axes, intersect_hinge_plane, intersect_plane
from vbaa_calib.core.arrays import as_floats
from vbaa_calib.core.errors import InputError, VbaaError
from vbaa_calib.geometry import Kinematics, Plane, Pose, hinge_plane, rotation_world_antenna
from vbaa_calib.session import load_session
from vbaa_calib.streams import Reading, Synchronizer, Taken, Timing

from .estimator.contact_scenes import RIG

SOUND: tuple[Any, ...] = (
    *(1, 1.0, np.float32(1.0), np.int8(1), np.array(1.0, np.float16), [1, 2.0, None], (1, np.float64(2.0))),
    *(np.ma.array([1.0, 2.0], mask=[True, False]), [], np.array([1, None], object)),
)
WRONG: tuple[Any, ...] = (
    *("1", True, 1j, ["1"], [True, 1.0], [1j], b"1", np.array(["1"]), np.array([True]), np.array([1j]), {}, {1: 2}),
    *([[1.0], [1.0, 2.0]], object(), [np.datetime64(0, "s")], np.array([10**400], object), lambda: 1.0),
)


@pytest.mark.parametrize("values", SOUND, ids=lambda value: type(value).__name__)
def test_numbers_of_every_kind_are_taken(values: Any) -> None:
    found = as_floats(values, "it", "give numbers")
    assert found.dtype == np.float64
    assert type(found) is np.ndarray


@pytest.mark.parametrize("values", WRONG, ids=lambda value: type(value).__name__)
def test_what_is_no_number_is_refused(values: Any) -> None:
    with pytest.raises(InputError, match="it is"):
        as_floats(values, "it", "give numbers")


POINTS = np.column_stack([np.linspace(100.0, 500.0, 60), np.full(60, 240.0)])


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"pan": 12.0}, "pans.0. is 12.*radians"),
        ({"tilt": -57.3}, "tilts.0. is -57.3.*radians"),
        ({"moment": 1020.0}, "moments.0. is 1020.*N·m"),
        ({"moment_z": -np.inf}, "moments_z.* is -inf"),
        ({"centreline_px": np.zeros((3, 5))}, "centreline_px has shape"),
        ({"centreline_px": 1e9 * POINTS}, "centrelines_px"),
        ({"sigma_px": -0.1}, "sigma_px"),
        ({"sigma_px": np.full(7, 0.1)}, "sigma_px has shape"),
        ({"sigma_px": 0.0}, "not everywhere positive"),
    ],
    ids=lambda value: next(iter(value)) if isinstance(value, dict) else None,
)
def test_the_estimator_takes_nothing_in_silence(changed: dict[str, Any], words: str) -> None:
    call: dict[str, Any] = {"centreline_px": POINTS, "moment": 0.001, "pan": 0.1, "tilt": 0.0} | changed
    with pytest.raises(InputError, match=words):
        ContactEstimator(RIG).estimate(call.pop("centreline_px"), **call)


LINE: dict[str, Any] = {"xp_m": [0.05, 0.1], "y_m": [0.001, 0.003]}
TIMING, POSE, PLANE = Timing(), Pose.identity(), Plane(np.array([0.0, 0.0, 1.0]), 1.0)
SHAPES = {"gravity_m_s2": np.zeros((1, 3)), "contact_m": np.full(1, 0.1), "force_N": np.zeros((1, 2))}


def estimate_on_plane(**given: Any) -> Any:
    """Of points in metres on plane C."""
    return ContactEstimator(RIG).estimate(**given)


PUBLIC: dict[Callable[..., Any], dict[str, Any]] = {
    Camera: {"model": "opencv", "image_size": (640, 480), "matrix": RIG.camera.matrix, "distortion": np.zeros(4)},
    **{key: {"pixels": POINTS} for key in (RIG.camera.unproject, RIG.camera.in_picture)},
    **{RIG.camera.project: {"points": np.ones((1, 3))}, RIG.camera.moved: {"step": 0.0 * RIG.camera.parameters}},
    **{key: {"path": "none"} for key in (Camera.load, Rig.load, read_lens, read_contacts)},
    **{key: {"data": POSE.to_dict()} for key in (Camera.from_dict, Rig.from_dict, Pose.from_dict)},
    **{load_session: {"root": "none"}, calibrate: {"session": None}, write_contacts: {"path": "a.csv", "rows": None}},
    **{RIG.std: {"parameter": "moment_gain"}, RIG.drifted: {"part": 1.0}, RIG.moved: {"step": np.zeros(17)}},
    **{RIG.with_covariance: {"covariance": RIG.covariance}, RIG.camera_on_plane: {"plane": PLANE}},
    Pose: {"rotation": np.eye(3), "translation_m": np.zeros(3)},
    Pose.from_rotvec: {"rotvec_rad": np.zeros(3), "translation_m": np.zeros(3)},
    **{POSE.retract: {"tangent": np.zeros(6)}, POSE.tangent_from: {"other": POSE}, POSE.__matmul__: {"other": POSE}},
    **{Plane: {"normal": np.array([0.0, 0.0, 1.0]), "offset_m": 0.0}, hinge_plane: {"roll_rad": 0.0}},
    Kinematics: {"T_actuator_antenna": POSE, "position_world_m": np.zeros(3), "axis_skew_rad": 0.0},
    **{key: {"pan_rad": 0.0, "tilt_rad": 0.0} for key in (RIG.kinematics.T_world_antenna, rotation_world_antenna)},
    intersect_plane: {"origins": np.zeros((1, 3)), "directions": np.ones((1, 3)), "plane": PLANE},
    intersect_hinge_plane: {"origins": np.zeros((1, 3)), "directions": np.ones((1, 3)), "roll_rad": np.zeros(1)},
    in_plane_axes: {"plane": PLANE},
    calibrate_lens: {"views": [], "image_size": (640, 480), "board_points": np.zeros((5, 3))},
    solve_hand_eye: {"views": [], "robot_poses": [], "board_points": np.zeros((9, 3)), "camera": RIG.camera},
    ContactEstimator: {"rig": RIG, "model": "auto", "friction": 0.1, "jobs": 1},
    ContactEstimator(RIG).run: {"recording": []},
    ContactEstimator(RIG).estimate: {"centreline_px": POINTS, "moment": 0.0, "pan": 0.1, "tilt": 0.0, "sigma_px": 0.1},
    estimate_on_plane: {"plane_xy_m": 1e-4 * POINTS, "covariance_m2": None, "moment": 0.0, "pan": 0.1, "tilt": 0.0},
    Measured: {"points_px": POINTS, "sigma_px": np.full(60, 0.1), "moment_Nm": 0.0, "pan_rad": 0.1, "tilt_rad": 0.0},
    **{refine: {"contacts": None, "rig": RIG, "recording": []}, next_touch: {"contacts": None, "rig": RIG}},
    **{estimate_object: {"table": None, "rig": RIG}},
    two_point_contact: {"x_m": LINE["xp_m"], "y_m": LINE["y_m"], "stiffness_Nm2": 0.004},
    **dict.fromkeys(
        (inclined_two_point_contact, eq29_baseline),
        LINE | {"moment_Nm": 0.01, "stiffness_Nm2": 0.004, "camera_tilt_rad": 0.5},
    ),
    force_z: {"moment_Nm": 0.01, "contact_m": 0.1},
    curves: {"rung": "rod", "parameters": RIG.antenna.parameters[None], "length_m": 0.2} | SHAPES,
    **{run_method: {"name": "2D-VBAA", "press": None}, Press: {"wire": Wire(0.2, 0.004)}},
    Wire: {"length_m": 0.2, "stiffness_Nm2": 0.004},
    Timing: {"offset_s": 0.0, "gap_s": 0.1, "wait_s": 0.1, "joints_rad": (0.0, 0.0), "moment_std_Nm": (0.0, 0.0)},
    Synchronizer: {"timing": TIMING, "channels": ["moment_Nm"]},
    Reading: {"time_s": 0.0, "channel": "moment_Nm", "value": 0.0, "arrived_s": 0.0},
    Taken: {"time_s": 0.0, "image": np.zeros((9, 9), np.uint8), "arrived_s": 0.0, "received_s": 0.0},
    LiveEstimator: {"estimator": ContactEstimator(RIG), "synchronizer": Synchronizer(TIMING)},
}
"""Public calls, and for each argument something that it takes, or None where this file has nothing such."""
NEVER: tuple[Any, ...] = ("abc", object(), 1j, [1j], lambda: 1.0, np.zeros(2, [("a", float)]), np.array(["a", "b"]))
"""No call takes these, but for `LISTS`, which look at what is in them when they come to it, and names and paths."""
PERHAPS: tuple[Any, ...] = (
    *(None, True, np.nan, np.inf, 1e300, 12, "1", [], {}, np.zeros(7), np.zeros((1,) * 5), np.zeros((0, 3))),
    *(np.ma.array([1.0, 2.0], mask=[True, False]), np.matrix([[1.0, 2.0]]), np.array([True]), [[1.0], [1.0, 2.0]]),
)
LISTS = ("recording", "rows", "views", "robot_poses", "channels", "image_size", "joints_rad", "moment_std_Nm")


@pytest.mark.parametrize("call", PUBLIC, ids=lambda call: call.__qualname__)
def test_public_calls_say_what_they_need(
    call: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One line that names the argument or its value, whatever it is."""
    monkeypatch.chdir(tmp_path)
    for name, good in PUBLIC[call].items():
        for value in (*NEVER, *PERHAPS):
            refused = ""
            try:
                with np.errstate(all="ignore"):
                    call(**(PUBLIC[call] | {name: value}))
            except VbaaError as error:
                refused = str(error)
            never = any(value is each for each in NEVER) and name not in LISTS
            assert refused or not never, f"{name} = {value!r} of {good!r:.60}"
            assert "\n" not in refused


def test_tensors_are_numbers() -> None:
    torch = pytest.importorskip("torch")
    given = torch.ones(3, requires_grad=True)
    np.testing.assert_array_equal(as_floats(given, "it", "give numbers"), np.ones(3))
    with pytest.raises(InputError):
        as_floats([torch.tensor(True)], "it", "give numbers")


def test_masked_points_and_readings_are_missing_ones() -> None:
    estimator = ContactEstimator(RIG)
    few = POINTS.copy()
    few[::2] = np.nan
    masked = np.ma.array(POINTS, mask=np.isnan(few))
    plain, same = (estimator.estimate(points, moment=None, pan=0.1, tilt=0.0) for points in (few, masked))
    assert (plain.status, plain.distance_m) == (same.status, same.distance_m) or np.isnan(plain.distance_m)
