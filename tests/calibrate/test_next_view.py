"""Uncertainty on plane C by pictures of the board, and which to take next."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.boards import on_plane, pose_by, rms_on_plane_mm
from targets.board import corner_points
from vbaa_calib.calibrate.guide.next_view import lens_progress
from vbaa_calib.calibrate.guide.suggestion import _coarse_poses, _view_candidates, best_next
from vbaa_calib.calibrate.guide.view_uncertainty import LensInformation, WorkPlane, mean_square, plane_sensitivity
from vbaa_calib.calibrate.lens.board_shape import deformations
from vbaa_calib.calibrate.lens.bundle import BoardCorners
from vbaa_calib.calibrate.lens.intrinsics import solve_intrinsics
from vbaa_calib.calibrate.lens.models import LENS_MODELS, camera_of
from vbaa_calib.camera import Camera

from .synthetic_views import SPEC, board_view, pose_towards, project_board

SIZE = (1280, 720)
MODEL = LENS_MODELS["opencv5"]
INTRINSICS = np.array([900.0, 902.0, 645.0, 352.0, -0.12, 0.04, 4e-4, -3e-4, 0.0])
PLANE = WorkPlane.about(0.4, float(np.radians(35.0)), 0.24)


def views(count: int, seed: int = 0, sigma_px: float = 0.1):
    rng = np.random.default_rng(seed)
    poses = [pose_towards(rng, 0.25, 0.7) for _ in range(count)]
    made = [
        board_view(f"{index}.png", project_board(MODEL, INTRINSICS, pose), SIZE, rng, sigma_px)
        for index, pose in enumerate(poses)
    ]
    return made, poses


def test_another_picture_never_harms_and_the_suggested_one_is_best_of_the_set():
    made, _ = views(5)
    known = LensInformation.of(solve_intrinsics(made, SPEC, "opencv5"), made, SPEC)
    functional = plane_sensitivity(known, PLANE, SPEC)
    found = _view_candidates(known, SPEC, _coarse_poses(known, SPEC, 0.24, 0.6))
    poses = np.array([pose.vector for _, pose, _ in found])
    observations = [
        BoardCorners(corner_points(SPEC)[ids], np.zeros((len(ids), 2)), deformations(corner_points(SPEC))[ids])
        for *_, ids in found
    ]
    after = np.sqrt(mean_square(functional, known.information + known.view_blocks(poses, observations)[0]))
    now = np.sqrt(mean_square(functional, known.information))
    suggestion = best_next(known, PLANE, SPEC, functional)
    assert after.max() <= now * (1.0 + 1e-9)
    assert suggestion.std_m / known.inflation <= after.min() * (1.0 + 1e-6)


def true_error_mm(camera: Camera) -> float:
    """Rms on the work plane, its pose found by this lens from the board in the jig."""
    truth, jig = camera_of(MODEL, INTRINSICS, SIZE), PLANE.board_pose(SPEC)
    corners, points = corner_points(SPEC), on_plane(PLANE.points)
    (board_px, on_board), (pixels, valid) = (
        truth.project(each) for each in (jig @ corners, PLANE.T_camera_plane @ points)
    )
    on_board, valid = on_board & truth.in_picture(board_px), valid & truth.in_picture(pixels)
    found = pose_by(camera, jig, BoardCorners(corners[on_board], board_px[on_board]))
    plane = found @ jig.inverse() @ PLANE.T_camera_plane
    return rms_on_plane_mm(camera, plane, PLANE.points[valid], pixels[valid])


@pytest.mark.slow
def test_predicted_deviation_holds_over_seeds():
    off = []
    for seed in range(40):
        progress = lens_progress(views(9, seed)[0], SPEC, PLANE)
        off.append(true_error_mm(progress.solution.camera) / (1e3 * progress.std_m))
    assert 0.6 < np.sqrt(np.mean(np.square(off))) < 1.25
