"""Rendered pictures: antenna and board are where the lens says, and light, lens and noise what the scene says."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from targets.board import BoardSpec, corner_points, opencv_board
from vbaa_calib.core.errors import InputError
from vbaa_calib.simulate.plan import _board_poses as board_poses
from vbaa_calib.simulate.render.antenna import tube, tube_patches, visible_centreline
from vbaa_calib.simulate.render.board import board_patches, print_sheet
from vbaa_calib.simulate.render.picture import Studio, digitise, expose, surroundings
from vbaa_calib.simulate.scene.lens import Lens, invertible, normalise, project, ray_map
from vbaa_calib.simulate.scene.scene import IntrinsicsSpec

from .studios import LENSES, place, spec


@pytest.mark.parametrize("lens", sorted(LENSES))
def test_rays_lead_back_to_their_pixels(lens: str) -> None:
    rays = ray_map(LENSES[lens])
    pixels = np.random.default_rng(1).uniform(0, [959, 719], (500, 2))
    between = project(rays.lens, np.concatenate([rays.at(pixels), np.ones((500, 1))], axis=1))
    np.testing.assert_allclose(between, pixels, atol=1e-3)
    exact = project(rays.lens, np.concatenate([normalise(rays.lens, pixels), np.ones((500, 1))], axis=1))
    np.testing.assert_allclose(exact, pixels, atol=1e-7)


def test_a_lens_that_folds_inside_the_picture_is_refused() -> None:
    matrix = np.array([[500.0, 0.0, 480.0], [0.0, 500.0, 360.0], [0.0, 0.0, 1.0]])
    folding = Lens("opencv", (960, 720), matrix, np.array([-0.6, 0.1, 0.0, 0.0]))
    assert not invertible(folding)
    assert all(invertible(lens) for lens in LENSES.values())
    with pytest.raises(InputError, match="folds back"):
        ray_map(folding)


def test_noise_has_the_variance_of_shot_and_read_noise() -> None:
    noisy = spec(read_noise=2.0, electrons_per_grey=20.0)
    grey = np.full((600, 800), 120.0, np.float32)
    picture = digitise(noisy, grey, np.random.default_rng(4)).astype(float)
    assert picture.mean() == pytest.approx(120.0, abs=0.02)
    assert picture.var() == pytest.approx(2.0**2 + 120.0 / 20.0 + 1 / 12, rel=0.02)


RADIUS_M = 0.0004
LAMP = np.array([0.3, -0.4, -0.866])


def _curve(slope: float = 0.1, bend: float = 0.6) -> tuple[np.ndarray, np.ndarray]:
    s = np.linspace(0.0, 0.24, 80)
    points = np.stack([s - 0.11, 0.02 + slope * s - bend * s**2, 0.38 - 0.12 * s], axis=1)
    arclength = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    return arclength, points


def _picture(scene: Studio, arclength: np.ndarray, points: np.ndarray, **options: object) -> np.ndarray:
    seen = tube(scene.rays.lens, arclength, points, RADIUS_M, LAMP)
    empty = np.zeros(scene.light.shape, np.float32)
    return expose(scene, empty, tube_patches(scene, seen, 0.9, **options)).astype(float)


def _centroid_offsets(scene: Studio, picture: np.ndarray, arclength: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Intensity centroid of each column less where the projected centreline crosses it."""
    dense = np.stack([np.interp(np.linspace(0, arclength[-1], 20000), arclength, p) for p in points.T], axis=1)
    line = project(scene.rays.lens, dense)
    columns = np.arange(int(line[:, 0].min()) + 8, int(line[:, 0].max()) - 8)
    middle = picture[:, columns]
    centroid = (middle * np.arange(len(picture))[:, None]).sum(axis=0) / middle.sum(axis=0)
    return centroid - np.interp(columns, line[:, 0], line[:, 1])


@pytest.mark.parametrize(
    "lens", [pytest.param(name, marks=[pytest.mark.slow] * (name in ("brown", "pinhole"))) for name in sorted(LENSES)]
)
@pytest.mark.parametrize(
    ("slope", "bend"),
    [(0.1, 0.6), *(pytest.param(*one, marks=pytest.mark.slow) for one in ((-0.35, -0.4), (0.0, 0.0)))],
)
def test_the_centroid_across_the_tube_is_the_projected_centreline(lens: str, slope: float, bend: float) -> None:
    scene = place(lens)
    offsets = _centroid_offsets(scene, _picture(scene, *_curve(slope, bend)), *_curve(slope, bend))
    assert len(offsets) > 200
    assert np.abs(offsets).max() < 0.01
    assert np.sqrt((offsets**2).mean()) < 0.003


def test_coverage_is_the_tubes_silhouette() -> None:
    scene = place("pinhole")
    points = np.stack([np.linspace(-0.1, 0.1, 50), np.full(50, 0.013), np.full(50, 0.35)], axis=1)
    seen = tube(scene.rays.lens, points[:, 0] + 0.1, points, RADIUS_M, LAMP)
    covered = sum(patch.alpha.sum() / patch.factor**2 for patch in tube_patches(scene, seen, 0.9))
    fx, fy = np.diag(scene.rays.lens.matrix)[:2]
    silhouette = (0.2 * fx / 0.35) * (2 * RADIUS_M * fy / 0.35)
    assert covered == pytest.approx(silhouette, rel=2e-3)


def test_what_is_nearer_hides_the_tube() -> None:
    scene = place("brown")
    arclength, points = _curve()

    def wall(depth_m: float):
        return lambda pixels: np.where((pixels[:, 0] > 400) & (pixels[:, 0] < 500), depth_m, np.inf)

    free, hidden, behind = (
        _picture(scene, arclength, points, obstacle=obstacle) for obstacle in (None, wall(0.2), wall(0.9))
    )
    assert np.abs(hidden[:, 405:495]).max() < 1e-6
    assert np.abs(hidden[:, :390] - free[:, :390]).max() < 1e-4
    assert np.array_equal(behind, free)
    seen = tube(scene.rays.lens, arclength, points, RADIUS_M, LAMP)
    visible = visible_centreline(scene.rays.lens, seen, wall(0.2))
    assert not ((visible[:, 0] > 401) & (visible[:, 0] < 499)).any()
    assert len(visible) > 300
    np.testing.assert_allclose(np.linalg.norm(visible[:, 2:], axis=1), 1.0)


BOARD = BoardSpec(11, 8, 0.015, 0.011)
DOWNWARD = np.diag([1.0, -1.0, -1.0])


def _corner_errors(lens: str, nearness: float, tilt_rad: float) -> np.ndarray:
    scene = place(lens)
    sheet, detector = print_sheet(BOARD), cv2.aruco.CharucoDetector(opencv_board(BOARD))
    spec = IntrinsicsSpec(5, (0.23 / nearness, 0.40 / nearness), (0.14, tilt_rad))
    errors = []
    for pose in board_poses(scene.rays.lens, BOARD, spec, np.random.default_rng(1)):
        grey = expose(scene, surroundings(scene, DOWNWARD), board_patches(scene, sheet, pose, DOWNWARD))
        picture = digitise(scene.spec, grey, np.random.default_rng(0))
        found, ids, _, _ = detector.detectBoard(picture)
        true = project(scene.rays.lens, pose @ corner_points(BOARD))[ids.ravel()]
        errors.append(found.reshape(-1, 2) - true)
    return np.concatenate(errors)


@pytest.mark.parametrize(
    ("lens", "nearness", "tilt_rad"),
    # OpenCV's detector itself is a pixel off where small squares are strongly bent
    [
        ("pinhole", 1, 0.66),
        ("brown", 1, 0.66),
        pytest.param("rational", 2, 0.4, marks=pytest.mark.slow),
        ("fisheye", 2, 0.4),
    ],
)
def test_detected_corners_lie_on_the_projected_ones(lens: str, nearness: float, tilt_rad: float) -> None:
    errors = _corner_errors(lens, nearness, tilt_rad)
    assert len(errors) > 250
    assert np.linalg.norm(errors, axis=1).mean() < 0.05
    assert np.abs(errors.mean(axis=0)).max() < 0.03
