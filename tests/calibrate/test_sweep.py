"""Plane C by the sweep: exact corners give the exact pose, noise what is predicted, wrong rows are found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from targets.board import corner_points
from vbaa_calib.calibrate.lens.board_shape import BoardShape
from vbaa_calib.calibrate.lens.models import LENS_MODELS, camera_of
from vbaa_calib.calibrate.pose.sweep import SweepSolution, solve_sweep
from vbaa_calib.camera import Camera
from vbaa_calib.detect.board.corners import BoardView, detect_files
from vbaa_calib.geometry import Kinematics, Pose
from vbaa_calib.session import Still
from vbaa_calib.simulate.plan import stream
from vbaa_calib.simulate.render.board import print_sheet
from vbaa_calib.simulate.render.picture import studio
from vbaa_calib.simulate.scene.scene import SceneSpec, bundled_scene
from vbaa_calib.simulate.scene.scene_file import load_scene
from vbaa_calib.simulate.write import _drawn_pictures, _write_sweep

from ..csv_files import read_rows
from .synthetic_views import CENTRE, SPEC, board_view, project_board

SIZE = (1280, 960)
LENSES = {
    "opencv4": np.array([1100.0, 1098.0, 645.0, 476.0, -0.18, 0.06, 5e-4, -6e-4]),
    "rational": np.array([600.0, 602.0, 645.0, 476.0, 0.3, 0.05, 4e-4, -6e-4, 0.002, 0.65, 0.12, 0.01]),
    "fisheye": np.array([420.0, 421.0, 641.0, 478.0, 0.05, -0.01, 0.003, -0.001]),
}
T_ANTENNA_CAMERA = Pose.from_rotvec(np.array([2.6, 0.3, -0.4]), np.array([0.03, -0.02, 0.3]))
RIG = Kinematics(
    Pose.from_rotvec(np.array([0.02, -0.3, 0.1]), np.array([0.012, 0.004, 0.006])), np.array([0.1, 0.2, 0.15])
)
FEW = [(0.0, 0.0), (0.25, 0.0), (0.0, 0.2), (-0.2, 0.0), (0.0, -0.2), (0.2, 0.2)]
GRID = [(pan, tilt) for pan in (-0.25, 0.0, 0.25) for tilt in (-0.2, 0.0, 0.2)] + [(0.12, 0.1), (-0.12, -0.1)]
Sweep = tuple[list[BoardView], list[Still]]


def camera(lens: str = "opencv4", change: np.ndarray | float = 0.0) -> Camera:
    return camera_of(LENS_MODELS[lens], LENSES[lens] + change, SIZE)


def T_world_board() -> Pose:
    """In the middle of the picture with the joints at zero, leaning."""
    turn = Pose.from_rotvec(np.array([0.45, -0.25, 0.1]), np.zeros(3)).rotation
    return RIG.T_world_antenna(0.0, 0.0) @ T_ANTENNA_CAMERA @ Pose(turn, np.array([0.0, 0.0, 0.22]) - turn @ CENTRE)


def sweep(
    rig: Kinematics = RIG,
    angles: Sequence[tuple[float, float]] = GRID,
    sigma_px: float = 0.1,
    angle_std_rad: float = 0.0,
    seed: int = 0,
    lens: str = "opencv4",
) -> Sweep:
    """The board in every picture, and the readings, which scatter about the true angles."""
    rng = np.random.default_rng(seed)
    views, pictures = [], []
    for index, (pan, tilt) in enumerate(angles):
        true = np.array([pan, tilt]) + angle_std_rad * rng.standard_normal(2)
        T_camera_board = (rig.T_world_antenna(*true) @ T_ANTENNA_CAMERA).inverse() @ T_world_board()
        pixels = project_board(LENS_MODELS[lens], LENSES[lens], T_camera_board)
        views.append(board_view(f"{index}.png", pixels, SIZE, rng, sigma_px))
        pictures.append(Still(Path(f"{index}.png"), pan, tilt, np.nan))
    return views, pictures


def misread(taken: Sweep, index: int, pan_rad: float = 0.0, tilt_rad: float = 0.0) -> Sweep:
    """The same with one row wrong by so much."""
    views, pictures = taken
    row = pictures[index]
    wrong = replace(row, pan_rad=row.pan_rad + pan_rad, tilt_rad=row.tilt_rad + tilt_rad)
    return views, [*pictures[:index], wrong, *pictures[index + 1 :]]


def solve(taken: Sweep, rig: Kinematics = RIG, lens: Camera | None = None, zero_std: float = 0.0) -> SweepSolution:
    return solve_sweep(*taken, BoardShape.flat(corner_points(SPEC)), lens or camera(), rig, zero_std)


def error(solved: SweepSolution) -> np.ndarray:
    """(6,) step from the true pose to the one found."""
    return solved.estimate.T_antenna_camera.tangent_from(T_ANTENNA_CAMERA)


def squared(solved: SweepSolution) -> float:
    """Normalised squared error; 6 on average."""
    off = error(solved)
    return float(off @ np.linalg.solve(solved.estimate.covariance, off))


class TestExact:
    @pytest.mark.parametrize("lens", ["opencv4", "rational", "fisheye"])
    def test_exact_corners_give_the_exact_pose(self, lens: str) -> None:
        rig = replace(RIG, axis_skew_rad=0.004, axis_offset_m=-0.002, tilt_zero_rad=0.05)
        solved = solve(sweep(rig, sigma_px=0.0, lens=lens), replace(RIG, tilt_zero_rad=0.05), camera(lens))
        assert np.abs(error(solved)).max() < 1e-8
        assert np.abs(solved.T_world_board.tangent_from(T_world_board())).max() < 1e-8
        assert solved.kinematics.axis_skew_rad == pytest.approx(0.004, abs=1e-8)
        assert solved.kinematics.axis_offset_m == pytest.approx(-0.002, abs=1e-8)
        assert solved.rms_px < 1e-6
        assert solved.estimate.way == "sweep"
        assert (solved.pictures, solved.left_out) == (len(GRID), ())
        # the closed form of Robot-World/Hand-Eye calibration, from the boards' true poses
        views = [(rig.T_world_antenna(*at) @ T_ANTENNA_CAMERA).inverse() @ T_world_board() for at in GRID]
        joints = [(rig.T_world_antenna(*at) @ rig.T_actuator_antenna.inverse()).inverse() for at in GRID]
        arrays = [[pose.rotation for pose in views], [pose.translation_m for pose in views]]
        arrays += [[pose.rotation for pose in joints], [pose.translation_m for pose in joints]]
        _, _, turn, shift = cv2.calibrateRobotWorldHandEye(*arrays)
        theirs = rig.T_actuator_antenna.inverse() @ Pose(turn, shift.ravel()).inverse()
        assert np.abs(solved.estimate.T_antenna_camera.tangent_from(theirs)).max() < 1e-6


def assert_as_predicted(solutions: list[SweepSolution]) -> None:
    """Sampled against predicted, within three standard errors of the sample."""
    errors = np.array([error(solved) for solved in solutions])
    predicted = np.mean([np.diag(solved.estimate.covariance) for solved in solutions], axis=0)
    allowed = 3.0 / np.sqrt(2.0 * len(solutions))
    np.testing.assert_allclose(np.sqrt((errors**2).mean(axis=0) / predicted), 1.0, atol=allowed)
    assert np.mean([squared(solved) for solved in solutions]) == pytest.approx(6.0, abs=3 * np.sqrt(12 / len(errors)))


class TestUncertainty:
    def test_the_covariance_is_that_of_repeated_noise_and_of_the_doubt_about_the_zero(self) -> None:
        doubt, rng = 5e-4, np.random.default_rng(11)
        rigs = [replace(RIG, tilt_zero_rad=doubt * rng.standard_normal()) for _ in range(12)]
        taken = [sweep(rig, FEW, seed=100 + seed) for seed, rig in enumerate(rigs)]
        assert_as_predicted([solve(one, zero_std=doubt) for one in taken])

    @pytest.mark.slow
    def test_angles_that_scatter_count_a_picture_once(self) -> None:
        rounds = 300
        solutions = [solve(sweep(angle_std_rad=5e-4, seed=seed)) for seed in range(rounds)]
        assert_as_predicted(solutions)
        assert np.mean([solved.angle_std_rad for solved in solutions]) == pytest.approx(5e-4, rel=0.15)
        assert sum(len(solved.left_out) for solved in solutions) <= rounds * len(GRID) / 1000

    def test_the_lens_sensitivity_tells_how_a_wrong_lens_moves_the_camera(self) -> None:
        taken = sweep()
        change = 0.1 * np.array([0.3, -0.2, 0.4, 0.25, 1e-4, -1e-4, 1e-5, 2e-5])
        true, moved = solve(taken), solve(taken, lens=camera(change=change))
        step = moved.estimate.T_antenna_camera.tangent_from(true.estimate.T_antenna_camera)
        expected = true.estimate.lens_sensitivity @ change
        np.testing.assert_allclose(step, expected, atol=0.03 * np.abs(expected).max())


class TestAxes:
    @pytest.mark.parametrize(("skew", "offset"), [(0.003, 0.001), (-0.1, 0.02)])
    def test_skew_and_offset_are_found(self, skew: float, offset: float) -> None:
        solved = solve(sweep(replace(RIG, axis_skew_rad=skew, axis_offset_m=offset)))
        assert abs(solved.axis_skew_rad - skew) < 4 * solved.axis_skew_std_rad < 0.002
        assert abs(solved.axis_offset_m - offset) < 4 * solved.axis_offset_std_m < 2e-4
        assert solved.axes_free == (abs(skew) > 0.05)
        assert solved.kinematics.axis_offset_m == pytest.approx(offset, abs=2e-4)
        assert squared(solved) < 25


class TestWrongRows:
    def test_a_wrong_row_is_found_and_what_it_should_say(self) -> None:
        solved = solve(misread(sweep(), 4, pan_rad=0.05))
        (left_out,) = solved.left_out
        assert left_out.name == "4.png"
        assert "it looks like pan 0.000, tilt 0.000, its row says 0.050, 0.000" in left_out.reason.replace(
            "-0.0", "0.0"
        )
        assert squared(solved) < 25


@pytest.fixture(scope="module")
def small_scene() -> SceneSpec:
    """The demo's rig with small pictures."""
    scene = load_scene(bundled_scene("demo"))
    matrix = np.array([[669.4, 0.0, 317.0], [0.0, 667.4, 241.4], [0.0, 0.0, 1.0]])
    return replace(scene, lens=replace(scene.lens, image_size=(640, 480), matrix=matrix))


def test_a_drawn_sweep_gives_the_scenes_camera(small_scene: SceneSpec, tmp_path: Path) -> None:
    scene = small_scene
    place = studio(scene.lens, scene.picture, stream(scene, "bench"))
    sheet = print_sheet(scene.board)
    true_board = _write_sweep(scene, _drawn_pictures(scene, place, sheet), sheet, tmp_path)
    rows = read_rows(tmp_path / "sweep" / "sweep.csv")
    pictures = [
        Still(tmp_path / "sweep" / row["image"], float(row["pan_rad"]), float(row["tilt_rad"]), np.nan) for row in rows
    ]
    views = detect_files([picture.image for picture in pictures], scene.board)
    lens = Camera(scene.lens.model, scene.lens.image_size, scene.lens.matrix, scene.lens.distortion)
    solved = solve_sweep(views, pictures, BoardShape.flat(corner_points(scene.board)), lens, scene.kinematics, 0.0)
    off = solved.estimate.T_antenna_camera.tangent_from(scene.T_antenna_camera)
    assert off @ np.linalg.solve(solved.estimate.covariance, off) < 25
    assert np.linalg.norm(off[3:]) < 3e-4
    assert np.linalg.norm(solved.T_world_board.tangent_from(true_board)[3:]) < 3e-4
    assert solved.rms_px < 0.1
    assert not solved.left_out
