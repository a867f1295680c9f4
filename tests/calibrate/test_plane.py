"""The ways to plane C: board in the jig, board under the antenna, agreement, and whole sessions of each."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
import yaml

from targets.board import corner_points
from vbaa_calib.calibrate.lens.board_shape import BoardShape
from vbaa_calib.calibrate.lens.intrinsics import LensSolution, solve_intrinsics
from vbaa_calib.calibrate.lens.models import LENS_MODELS
from vbaa_calib.calibrate.lens.models import camera_of as lens_camera
from vbaa_calib.calibrate.plane_c import _corner_bias, find_plane, read_views
from vbaa_calib.calibrate.pose.board_pose import BoardPose, jig_estimate, solve_board_pose
from vbaa_calib.calibrate.pose.fusion import PoseEstimate, differences, inflated, require_agreement
from vbaa_calib.camera import Camera
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import read_yaml
from vbaa_calib.core.robust import chi_square
from vbaa_calib.detect.board.corners import BoardView, detect_folder
from vbaa_calib.geometry import Pose
from vbaa_calib.session import Session, load_session
from vbaa_calib.simulate.scene.scene import SceneSpec, bundled_scene
from vbaa_calib.simulate.scene.scene_file import load_scene
from vbaa_calib.simulate.write import write_session

from ..over_scenes import HEIGHT_STD_M, LENGTH_STD_M, Shown, View, drawn_view, shown
from .photo_sets import detected
from .synthetic_views import CENTRE, SPEC, board_view, pose_towards, project_board

SIZE = (1280, 960)
FLAT = BoardShape.flat(corner_points(SPEC))
WIDE = np.array([600.0, 602.0, 645.0, 476.0, 0.3, 0.05, 4e-4, -6e-4, 0.002, 0.65, 0.12, 0.01])
CAMERAS = {
    "rational": WIDE,
    "fisheye": np.array([420.0, 421.0, 641.0, 478.0, 0.05, -0.01, 0.003, -0.001]),
    "none": np.array([1500.0, 1480.0, 655.0, 470.0]),
}


def camera_of(name: str, intrinsics: np.ndarray) -> Camera:
    return lens_camera(LENS_MODELS[name], intrinsics, SIZE)


def pictures(name: str, pose: Pose, rng: np.random.Generator, sigma_px: float, count: int = 1) -> list[BoardView]:
    pixels = project_board(LENS_MODELS[name], CAMERAS[name], pose)
    return [board_view(f"{index}.png", pixels, SIZE, rng, sigma_px) for index in range(count)]


def facing(rotvec: list[float], distance_m: float = 0.12) -> Pose:
    """The board's centre on the axis, turned as given."""
    turned = Pose.from_rotvec(np.array(rotvec), np.zeros(3))
    return Pose(turned.rotation, np.array([0.0, 0.0, distance_m]) - turned.rotation @ CENTRE)


@pytest.mark.parametrize("name", CAMERAS)
@pytest.mark.parametrize("seed", range(2))
def test_exact_corners_give_the_exact_pose(name: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    true = pose_towards(rng, 0.1 * CAMERAS[name][0] / 600, 0.9, offset=0.3)
    solved = solve_board_pose(pictures(name, true, rng, 0.0), FLAT, camera_of(name, CAMERAS[name]))
    assert np.abs(solved.T_camera_board.tangent_from(true)).max() < 1e-8
    assert solved.rms_px < 1e-5


@pytest.mark.parametrize("name", ["rational", pytest.param("fisheye", marks=pytest.mark.slow)])
def test_the_covariance_is_that_of_repeated_noise(name: str) -> None:
    rng, camera = np.random.default_rng(4), camera_of(name, CAMERAS[name])
    true = facing([0.5, 0.2, 0.1], 0.15)
    normalized = []
    for _ in range(30):
        solved = solve_board_pose(pictures(name, true, rng, 0.2), FLAT, camera)
        step = solved.T_camera_board.tangent_from(true)
        normalized.append(step @ np.linalg.solve(solved.covariance, step))
    # six degrees of freedom; the mean of 30 draws has a standard deviation of 0.63
    assert np.mean(normalized) == pytest.approx(6.0, abs=2.0)


def test_a_board_that_moved_is_refused() -> None:
    rng, camera = np.random.default_rng(6), camera_of("rational", WIDE)
    views = pictures("rational", facing([0.5, 0.2, 0.1]), rng, 0.1, count=3)
    views[2] = replace(views[2], name="moved.png", corners_px=views[2].corners_px + 5.0)
    with pytest.raises(InputError, match=r"moved\.png: the board is 7\.\d px"):
        solve_board_pose(views, FLAT, camera)


def test_a_gross_corner_does_not_pull() -> None:
    rng, camera, true = np.random.default_rng(7), camera_of("rational", WIDE), facing([0.5, 0.2, 0.1])
    (view,) = pictures("rational", true, rng, 0.1)
    spoilt = view.corners_px.copy()
    spoilt[[3, 17]] += np.array([25.0, -12.0])
    solved = solve_board_pose([replace(view, corners_px=spoilt)], FLAT, camera)
    step = solved.T_camera_board.tangent_from(true)
    assert solved.left_out == 2
    assert step @ np.linalg.solve(solved.covariance, step) < 25


def test_the_lens_sensitivity_tells_how_a_wrong_lens_moves_the_board() -> None:
    rng, camera = np.random.default_rng(9), camera_of("rational", WIDE)
    views = pictures("rational", facing([0.5, 0.2, 0.1]), rng, 0.0)
    solved = solve_board_pose(views, FLAT, camera)
    change = np.array([0.3, -0.2, 0.4, 0.25, 1e-4, -1e-4, 1e-5, 2e-5, 0.0, 0.0, 0.0, 0.0])
    moved = solve_board_pose(views, FLAT, camera_of("rational", WIDE + change))
    step = moved.T_camera_board.tangent_from(solved.T_camera_board)
    np.testing.assert_allclose(step, solved.lens_sensitivity @ change, atol=0.02 * np.abs(step).max())


@pytest.mark.parametrize(("name", "model"), [("gopro", "fisheye"), ("realsense", "radial")])
def test_real_views_get_the_pose_of_the_joint_solve(name: str, model: str) -> None:
    views, spec = detected(name)
    solution = solve_intrinsics(views, spec, model)
    for view, used in list(zip(views, solution.views, strict=True))[:4]:
        good = ~np.isin(view.ids, used.outlier_ids)
        inliers = replace(view, ids=view.ids[good], corners_px=view.corners_px[good])
        solved = solve_board_pose([inliers], solution.board_shape, solution.camera)
        assert np.abs(solved.T_camera_board.tangent_from(used.T_camera_board)).max() < 1e-4
        assert solved.rms_px == pytest.approx(used.rms_px, rel=1e-3)
        assert solved.corners == used.corners <= len(corner_points(spec))


TRUE = Pose.from_rotvec(np.array([2.9, 0.2, -0.4]), np.array([0.1, 0.02, 0.35]))
LENS = np.diag([0.5, 0.5, 0.8, 0.8]) ** 2


def spread(rng: np.random.Generator) -> np.ndarray:
    """A covariance of a tenth of a millimetre and of a milliradian, with correlations."""
    root = np.diag([1e-3] * 3 + [1e-4] * 3) @ (np.eye(6) + 0.3 * rng.normal(size=(6, 6)))
    return root @ root.T


def drawn(way: str, rng: np.random.Generator, lens_step: np.ndarray) -> PoseEstimate:
    """An estimate that is off as it says, by its own noise and by the lens."""
    covariance, sensitivity = spread(rng), 1e-4 * rng.normal(size=(6, 4))
    off = np.linalg.cholesky(covariance) @ rng.normal(size=6) + sensitivity @ lens_step
    return PoseEstimate(way, TRUE.retract(off), covariance, sensitivity)


def test_honest_ways_differ_as_predicted() -> None:
    rng = np.random.default_rng(0)
    found = []
    for _ in range(400):
        step = np.sqrt(np.diag(LENS)) * rng.normal(size=4)
        one, other = (drawn(way, rng, step) for way in ("jig", "sweep"))
        found.append(differences([one, other], LENS)[0].statistic)
    # χ² of 6 degrees of freedom: its mean over 400 draws has a deviation of 0.17
    assert np.mean(found) == pytest.approx(6.0, abs=0.6)


def test_the_way_that_stands_alone_is_named() -> None:
    rng = np.random.default_rng(2)
    ways = [drawn(way, rng, np.zeros(4)) for way in ("jig", "sweep", "over board")]
    require_agreement(differences(ways, LENS), "session")
    moved = replace(ways[1], T_antenna_camera=ways[1].T_antenna_camera.retract(np.array([0, 0, 0, 0, 5e-3, 0])))
    with pytest.raises(InputError, match="sweep disagrees with the others") as caught:
        require_agreement(differences([ways[0], moved, ways[2]], LENS), "session")
    assert "jig and sweep differ by" in str(caught.value)
    with pytest.raises(InputError, match="one of them is wrong"):
        require_agreement(differences([ways[0], moved], LENS), "session")


def test_the_jig_carries_board_lens_and_its_own_doubt_to_the_camera() -> None:
    rng = np.random.default_rng(5)
    T_antenna_board = Pose.from_rotvec(rng.normal(size=3), 0.1 * rng.normal(size=3))
    T_camera_board = Pose.from_rotvec(rng.normal(size=3), np.array([0.02, -0.01, 0.4]))
    covariance, sensitivity = spread(rng), 1e-4 * rng.normal(size=(6, 4))
    board = BoardPose(T_camera_board, covariance, sensitivity, 0.1, 40, 0, None)
    found = jig_estimate(board, T_antenna_board, translation_std_m=2e-4, rotation_std_rad=1e-3)
    off, by_lens = [], []
    for _ in range(4000):
        moved = T_camera_board.retract(np.linalg.cholesky(covariance) @ rng.normal(size=6))
        held = T_antenna_board.retract(np.repeat([1e-3, 2e-4], 3) * rng.normal(size=6))
        off.append((held @ moved.inverse()).tangent_from(found.T_antenna_camera))
    for column in sensitivity.T:
        step = T_camera_board.retract(1e-3 * column)
        by_lens.append((T_antenna_board @ step.inverse()).tangent_from(found.T_antenna_camera) / 1e-3)
    sampled = np.cov(np.array(off).T)
    scale = np.sqrt(np.outer(np.diag(sampled), np.diag(sampled)))
    np.testing.assert_allclose(found.covariance / scale, sampled / scale, atol=0.08)
    np.testing.assert_allclose(found.lens_sensitivity, np.array(by_lens).T, atol=1e-6)


PLAIN = View()
VIEWS = {
    "inclined": PLAIN,
    "from above": View(inclination=4.0),
    "oblique": View(inclination=52.0, azimuth=120.0),
    "along, board askew": View(inclination=45.0, azimuth=180.0, over=replace(PLAIN.over, turn_rad=-2.3)),
    "dark": View(paint=0.05),
    "6 px": View(diameter=0.0022),
    "1.5 px, noisy": View(diameter=0.00055, noise=4.0),
    "blurred": View(blur=1.5),
}


def nees(scene: Shown, **changes: object) -> float:
    """Squared error of the pose over its covariance, with the corners' common shift in it: 6 on average."""
    estimate = scene.solved(**changes)
    estimate = inflated(estimate, *_corner_bias(estimate, scene.camera))
    step = estimate.T_antenna_camera.tangent_from(scene.truth)
    return chi_square(step, estimate.covariance)


def draw(seed: int, paint: float) -> float:
    rng, scene = np.random.default_rng([7, seed]), shown.__wrapped__(drawn_view(seed, paint), seed)
    length_m = scene.antenna.length_m + LENGTH_STD_M * rng.normal()
    height_m = scene.over.height_m + HEIGHT_STD_M * rng.normal()
    return nees(scene, antenna=replace(scene.antenna, length_m=length_m), height_m=height_m)


QUICK = ("oblique",)


@pytest.mark.parametrize("name", [pytest.param(n, marks=() if n in QUICK else pytest.mark.slow) for n in VIEWS])
def test_the_pose_is_found_within_its_uncertainty(name: str) -> None:
    scene = shown(VIEWS[name])
    solution = scene.solved()
    step = solution.T_antenna_camera.tangent_from(scene.truth)
    assert np.abs(step / np.sqrt(np.diag(solution.covariance))).max() < 4.5
    # the antenna is as it is said to be: what is left is the picture's
    assert np.abs(step[:2]).max() < 1.2e-3
    assert abs(step[2]) < 1.5e-3
    assert np.linalg.norm(step[3:]) < 6e-4
    assert solution.way == "over board"


@pytest.mark.slow
@pytest.mark.parametrize("paint", [0.92, 0.05])
def test_the_covariance_is_that_of_many_draws(paint: float) -> None:
    found = []
    for seed in range(24):
        with suppress(InputError):  # in about one draw the antenna is not found as it is, and said so
            found.append(draw(seed, paint))
    values = np.array(found)
    assert len(values) >= 23
    # a bright tip over white print is misjudged, by millimetres, in about one draw of these 24
    assert np.sum(values > 30.0) <= 1
    # six degrees of freedom; the mean of 24 has a standard deviation of 0.7
    assert np.mean(values[values <= 30.0]) == pytest.approx(6.0, abs=2.1)


WAYS = {
    "kinematics": {"axis_offset_m": 0.002, "axis_skew_deg": 0.3, "tilt_zero_deg": 0.25},
    "sweep": True,
    "over": {"height_m": 0.012, "center_m": [0.13, 0.0], "turn_deg": 8.0, "pictures": 1},
}


@dataclass(frozen=True, eq=False)
class Rendered:
    """A session that shows plane C in three ways, what is true of it, and its lens."""

    scene: SceneSpec
    session: Session
    lens: LensSolution
    views: dict[str, Any]


@pytest.fixture(scope="module")
def rendered(tmp_path_factory: pytest.TempPathFactory) -> Rendered:
    folder = tmp_path_factory.mktemp("ways")
    data = read_yaml(bundled_scene("upright_knife")) | WAYS
    # two thirds of the picture, and fewer of the board
    data["camera"]["image_size"] = [640, 480]
    data["camera"]["matrix"] = [[645.3, 0.0, 321.9], [0.0, 646.7, 236.8], [0.0, 0.0, 1.0]]
    data["intrinsics"]["pictures"] = 10
    (folder / "scene.yaml").write_text(yaml.safe_dump(data), encoding="utf-8")
    scene = load_scene(folder / "scene.yaml")
    stroke = replace(scene.recording.sweeps[0], frames=1, free_frames=0)
    scene = replace(scene, recording=replace(scene.recording, sweeps=(stroke,)))
    write_session(scene, folder / "session", recording_pictures=False)
    session = load_session(folder / "session")
    lens = solve_intrinsics(detect_folder(session.root / "intrinsics", session.board), session.board, "opencv4")
    return Rendered(scene, session, lens, read_views(session))


def test_three_ways_agree_and_the_joints_are_found(rendered: Rendered) -> None:
    lens = rendered.lens
    plane = find_plane(rendered.session, lens.camera, lens.board_shape, **rendered.views)
    assert [estimate.way for estimate in plane.estimates] == ["jig", "sweep", "over board"]
    assert all(difference.agrees for difference in plane.differences)
    for estimate in plane.estimates:
        covariance = lens.camera.covariance
        whole = estimate.covariance + estimate.lens_sensitivity @ covariance @ estimate.lens_sensitivity.T
        off = estimate.T_antenna_camera.tangent_from(rendered.scene.T_antenna_camera) / np.sqrt(np.diag(whole))
        assert np.abs(off).max() < 4.0, (estimate.way, off)
    true = rendered.scene.kinematics
    assert plane.kinematics.axis_skew_rad == pytest.approx(true.axis_skew_rad, abs=4e-4)
    assert plane.kinematics.axis_offset_m == pytest.approx(true.axis_offset_m, abs=2e-4)
    # what the sweep and the pose leave open of the axes holds what they are off
    names = ("axis_skew_rad", "axis_offset_m", "tilt_zero_rad")
    missed = np.array([getattr(plane.kinematics, name) - getattr(true, name) for name in names])
    assert (np.abs(missed) < 4.0 * plane.kinematics.axes_std).all()
    assert (plane.kinematics.axes_std < [4e-3, 4e-4, 4e-3]).all()
    # the zero of the tilt is what sweep and jig say together
    assert plane.kinematics.tilt_zero_rad == pytest.approx(true.tilt_zero_rad, abs=8e-4)
