"""The pose of the board in the jig from corners that are exactly known; several ways to plane C: agreement, fusion."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from targets.board import corner_points
from vbaa_calib.calibrate.lens.board_shape import BoardShape
from vbaa_calib.calibrate.lens.intrinsics import solve_intrinsics
from vbaa_calib.calibrate.lens.models import LENS_MODELS
from vbaa_calib.calibrate.lens.models import camera_of as lens_camera
from vbaa_calib.calibrate.pose.board_pose import BoardPose, jig_estimate, mirrored, solve_board_pose
from vbaa_calib.calibrate.pose.fusion import PoseEstimate, differences, fused, require_agreement
from vbaa_calib.camera import Camera
from vbaa_calib.core.errors import InputError
from vbaa_calib.detect.board.corners import BoardView
from vbaa_calib.geometry import Pose

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


@pytest.mark.parametrize("rotvec", [[0, 0, 0], [1e-6, 0, 0], [0, 0, 3.1], [1e-3, 0, 3]])
def test_a_board_parallel_to_the_picture_is_solved(rotvec: list[float]) -> None:
    rng, true = np.random.default_rng(3), facing(rotvec)
    solved = solve_board_pose(pictures("rational", true, rng, 0.05), FLAT, camera_of("rational", WIDE))
    assert np.linalg.norm(solved.T_camera_board.tangent_from(true)[3:]) < 5e-4
    assert solved.T_camera_board.translation_m[2] > 0


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


def test_many_pictures_average_their_noise_and_not_what_they_share() -> None:
    rng, camera, true = np.random.default_rng(5), camera_of("rational", WIDE), facing([0.5, 0.2, 0.1])
    one = solve_board_pose(pictures("rational", true, rng, 0.2), FLAT, camera)
    many = solve_board_pose(pictures("rational", true, rng, 0.2, count=16), FLAT, camera)
    shared = pictures("rational", true, rng, 0.2)
    repeated = solve_board_pose(shared * 16, FLAT, camera)
    std = [np.sqrt(np.trace(pose.covariance[3:, 3:])) for pose in (one, many, repeated)]
    assert std[1] == pytest.approx(std[0] / 4, rel=0.4)
    assert std[2] == pytest.approx(std[0], rel=0.4)


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


def test_the_second_solution_of_a_distant_board_is_reported() -> None:
    rng = np.random.default_rng(8)
    long_lens = np.array([120000.0, 120000.0, 640.0, 480.0])
    camera = camera_of("none", long_lens)
    true = facing([0.35, 0.1, 0.0], 18.0)
    pixels = project_board(LENS_MODELS["none"], long_lens, true)
    solved = solve_board_pose([board_view("0.png", pixels, SIZE, rng, 0.3)], FLAT, camera)
    assert solved.second_ratio >= 1.0
    assert solved.is_ambiguous
    both = (true, mirrored(true, corner_points(SPEC)))
    turns = [np.linalg.norm(solved.T_camera_board.tangent_from(pose)[:3]) for pose in both]
    assert min(turns) < 0.05
    assert max(turns) > 0.4


def test_the_lens_sensitivity_tells_how_a_wrong_lens_moves_the_board() -> None:
    rng, camera = np.random.default_rng(9), camera_of("rational", WIDE)
    views = pictures("rational", facing([0.5, 0.2, 0.1]), rng, 0.0)
    solved = solve_board_pose(views, FLAT, camera)
    change = np.array([0.3, -0.2, 0.4, 0.25, 1e-4, -1e-4, 1e-5, 2e-5, 0.0, 0.0, 0.0, 0.0])
    moved = solve_board_pose(views, FLAT, camera_of("rational", WIDE + change))
    step = moved.T_camera_board.tangent_from(solved.T_camera_board)
    np.testing.assert_allclose(step, solved.lens_sensitivity @ change, atol=0.02 * np.abs(step).max())


def bent_picture(true: Pose, sagittas_m: np.ndarray, rng: np.random.Generator, sigma_px: float) -> BoardView:
    """A board that is a parabola along x and along y about its mean plane, seen by `WIDE`; straight from OpenCV."""
    points = corner_points(SPEC)
    x, y = (points[:, :2] - CENTRE[:2]).T / (CENTRE[:2] - points[0, :2])[:, None]
    points = points + np.outer(sagittas_m[0] * (x**2 - 1 / 3) + sagittas_m[1] * (y**2 - 1 / 3), [0, 0, 1])
    matrix = camera_of("rational", WIDE).matrix
    pixels, _ = cv2.projectPoints(points, true.rotvec_rad, true.translation_m, matrix, WIDE[4:])
    return board_view("bent.png", pixels.reshape(-1, 2), SIZE, rng, sigma_px)


def bent_board(sagittas_m: np.ndarray, spread: np.ndarray | None = None) -> BoardShape:
    covariance = np.zeros((5, 5))
    covariance[:2, :2] = 0.0 if spread is None else spread
    return BoardShape(corner_points(SPEC), np.array([*sagittas_m, 0.0, 0.0, 0.0]), covariance)


def test_a_bent_board_is_predicted_bent() -> None:
    rng, camera, true = np.random.default_rng(11), camera_of("rational", WIDE), facing([0.5, 0.2, 0.1])
    sagittas = np.array([8e-4, -3e-4])
    view = bent_picture(true, sagittas, rng, 0.0)
    solved = solve_board_pose([view], bent_board(sagittas), camera)
    assert np.abs(solved.T_camera_board.tangent_from(true)).max() < 1e-8
    flat = solve_board_pose([view], FLAT, camera)
    assert np.linalg.norm(flat.T_camera_board.tangent_from(true)[3:]) > 1e-4
    assert flat.rms_px > 0.3


def test_the_covariance_carries_how_well_the_bend_is_known() -> None:
    """What it gains is what the pose moves by when the bend is told wrong."""
    rng, camera, true = np.random.default_rng(12), camera_of("rational", WIDE), facing([0.5, 0.2, 0.1], 0.15)
    sagittas, spread = np.array([8e-4, -3e-4]), np.array([[4.0, 1.0], [1.0, 9.0]]) * 1e-10
    view = bent_picture(true, sagittas, rng, 0.02)
    known, exact = (solve_board_pose([view], bent_board(sagittas, share * spread), camera) for share in (1.0, 0.0))
    moved = [solve_board_pose([view], bent_board(sagittas + step), camera) for step in np.eye(2) * 1e-6]
    by_sagitta = np.stack([other.T_camera_board.tangent_from(known.T_camera_board) / 1e-6 for other in moved], axis=1)
    gained = known.covariance - exact.covariance
    expected = by_sagitta @ spread @ by_sagitta.T
    np.testing.assert_allclose(gained, expected, atol=0.02 * np.abs(expected).max())
    assert np.trace(gained[3:, 3:]) > np.trace(exact.covariance[3:, 3:]), "here the bend is most of it"


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


def test_fusing_weighs_each_way_by_what_it_is_worth() -> None:
    rng = np.random.default_rng(3)
    scores = []
    for _ in range(300):
        ways = [drawn(way, rng, np.zeros(4)) for way in ("jig", "sweep", "over board")]
        covariance = np.linalg.inv(np.sum([np.linalg.inv(way.covariance) for way in ways], axis=0))
        off = fused(ways).tangent_from(TRUE)
        scores.append(off @ np.linalg.solve(covariance, off))
    assert np.mean(scores) == pytest.approx(6.0, abs=0.7)


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
