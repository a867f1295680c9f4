"""The tube's picture is centred on the projected centreline, as wide as the tube, and hidden by what is nearer."""

from __future__ import annotations

import numpy as np
import pytest

from vbaa_calib.simulate.render.antenna import tube, tube_patch, visible_centreline
from vbaa_calib.simulate.render.picture import Studio, expose
from vbaa_calib.simulate.scene.lens import project

from .studios import LENSES, place

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
    return expose(scene, empty, [tube_patch(scene, seen, 0.9, **options)]).astype(float)


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


def test_asymmetric_shading_pulls_the_centroid() -> None:
    scene = place("brown")
    offsets = _centroid_offsets(scene, _picture(scene, *_curve(), asymmetry=0.5), *_curve())
    assert np.abs(offsets).mean() > 0.05


def test_coverage_is_the_tubes_silhouette() -> None:
    scene = place("pinhole")
    points = np.stack([np.linspace(-0.1, 0.1, 50), np.full(50, 0.013), np.full(50, 0.35)], axis=1)
    seen = tube(scene.rays.lens, points[:, 0] + 0.1, points, RADIUS_M, LAMP)
    patch = tube_patch(scene, seen, 0.9)
    fx, fy = np.diag(scene.rays.lens.matrix)[:2]
    silhouette = (0.2 * fx / 0.35) * (2 * RADIUS_M * fy / 0.35)
    assert patch.alpha.sum() / patch.factor**2 == pytest.approx(silhouette, rel=2e-3)


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


def test_a_tube_outside_the_picture_is_not_drawn() -> None:
    scene = place("pinhole")
    arclength, points = _curve()
    seen = tube(scene.rays.lens, arclength, points + np.array([0.0, 1.0, 0.0]), RADIUS_M, LAMP)
    assert tube_patch(scene, seen, 0.9) is None
