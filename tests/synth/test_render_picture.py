"""Lens, light and noise of the simulated camera."""

from __future__ import annotations

import numpy as np
import pytest

from vbaa_calib.core.errors import InputError
from vbaa_calib.simulate.render.picture import Patch, digitise, expose
from vbaa_calib.simulate.scene.lens import Lens, invertible, normalise, project, ray_map
from vbaa_calib.simulate.scene.scene import camera_pose

from .studios import LENSES, MATRIX, place, spec


@pytest.mark.parametrize("lens", sorted(LENSES))
def test_rays_lead_back_to_their_pixels(lens: str) -> None:
    rays = ray_map(LENSES[lens])
    pixels = np.random.default_rng(1).uniform(0, [959, 719], (500, 2))
    between = project(rays.lens, np.concatenate([rays.at(pixels), np.ones((500, 1))], axis=1))
    np.testing.assert_allclose(between, pixels, atol=1e-3)
    exact = project(rays.lens, np.concatenate([normalise(rays.lens, pixels), np.ones((500, 1))], axis=1))
    np.testing.assert_allclose(exact, pixels, atol=1e-7)


@pytest.mark.parametrize("corner", [(0, 0), (955, 715)])
def test_subpixel_rays_are_those_of_their_places(corner: tuple[int, int]) -> None:
    rays, (left, top) = ray_map(LENSES["brown"]), corner
    block = rays.block(left, top, left + 5, top + 5, 3)
    assert block.shape == (15, 15, 2)
    steps = (np.arange(15) + 0.5) / 3 - 0.5
    u, v = np.meshgrid(left + steps, top + steps)
    exact = normalise(rays.lens, np.stack([u, v], axis=-1).reshape(-1, 2)).reshape(15, 15, 2)
    np.testing.assert_allclose(block, exact, atol=2e-7)


def test_a_lens_that_folds_inside_the_picture_is_refused() -> None:
    matrix = np.array([[500.0, 0.0, 480.0], [0.0, 500.0, 360.0], [0.0, 0.0, 1.0]])
    folding = Lens("opencv", (960, 720), matrix, np.array([-0.6, 0.1, 0.0, 0.0]))
    assert not invertible(folding)
    assert all(invertible(lens) for lens in LENSES.values())
    with pytest.raises(InputError, match="folds back"):
        ray_map(folding)


def test_points_behind_the_camera_have_no_pixel() -> None:
    pixels = project(LENSES["brown"], np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]]))
    assert np.isnan(pixels[0]).all()
    np.testing.assert_allclose(pixels[1], MATRIX[:2, 2])


def test_noise_has_the_variance_of_shot_and_read_noise() -> None:
    noisy = spec(read_noise=2.0, electrons_per_grey=20.0)
    grey = np.full((600, 800), 120.0, np.float32)
    picture = digitise(noisy, grey, np.random.default_rng(4)).astype(float)
    assert picture.mean() == pytest.approx(120.0, abs=0.02)
    assert picture.var() == pytest.approx(2.0**2 + 120.0 / 20.0 + 1 / 12, rel=0.02)


def test_a_patch_is_blurred_before_it_is_sampled() -> None:
    scene = place("pinhole", blur_px=1.0, background=0.2)
    canvas = np.full((720, 960), 0.2, np.float32)
    square = np.zeros((160, 160), np.float32)
    square[60:100, 70:90] = 1.0
    grey = expose(scene, canvas, [Patch(100, 50, 4, 0.8 * square, square)]) / 255 - 0.2
    # what it adds in all, and where its middle is: sub-pixel i of pixel p lies at p + (i + 0.5)/4 - 0.5
    assert grey.sum() == pytest.approx(0.6 * 40 * 20 / 16, rel=1e-4)
    rows, columns = np.mgrid[:720, :960]
    assert (grey * columns).sum() / grey.sum() == pytest.approx(100 + 80 / 4 - 0.5, abs=1e-3)
    assert (grey * rows).sum() / grey.sum() == pytest.approx(50 + 80 / 4 - 0.5, abs=1e-3)


@pytest.mark.parametrize(("inclination", "azimuth"), [(0.0, 0.0), (0.6, np.pi), (0.8, 2.0), (0.3, -1.0)])
def test_the_camera_looks_at_its_point_from_the_side_it_leans_to(inclination: float, azimuth: float) -> None:
    point = np.array([0.12, 0.01, 0.0])
    pose = camera_pose(inclination, azimuth, 0.0, 0.4, point)
    np.testing.assert_allclose(pose.inverse() @ point, [0.0, 0.0, 0.4], atol=1e-12)
    lean = pose.translation_m - point
    assert np.arccos(lean[2] / 0.4) == pytest.approx(inclination, abs=1e-7)
    assert np.hypot(*lean[:2]) == pytest.approx(0.4 * np.sin(inclination), abs=1e-9)
    assert lean[:2] @ [np.cos(azimuth), np.sin(azimuth)] == pytest.approx(0.4 * np.sin(inclination), abs=1e-9)
    np.testing.assert_allclose(pose.rotation.T @ pose.rotation, np.eye(3), atol=1e-12)
    assert np.linalg.det(pose.rotation) == pytest.approx(1.0)
    right = pose.inverse().rotation @ [1.0, 0.0, 0.0]
    assert right[0] > 0.5
    assert right[1] == pytest.approx(0.0, abs=1e-12)
