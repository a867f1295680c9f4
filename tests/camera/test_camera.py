"""What goes in and comes out of a Camera: kinds, shapes, dtypes, files, errors."""

from __future__ import annotations

import json
import pickle

import numpy as np
import pytest

from vbaa_calib.camera import Camera
from vbaa_calib.core.files import write_json

from ..lazy import Lazy
from .lenses import LENSES

torch = Lazy("torch")

K = np.array([[900.0, 0, 640], [0, 900, 360], [0, 0, 1]])


@pytest.mark.parametrize("shape", [(), (1,), (7,), (2, 3), (4, 0), (0,), (2, 1, 3)])
@pytest.mark.parametrize("name", ["pinhole", "barrel", "decentred", "tilted", "fisheye 200"])
def test_shapes_kinds_and_precision_are_kept(name, shape):
    camera = LENSES[name]
    pixels = np.random.default_rng(0).uniform(300, 500, (*shape, 2))
    for given in (pixels, pixels.astype(np.float32), torch.tensor(pixels), torch.tensor(pixels).float()):
        rays, valid = camera.unproject(given)
        again, seen = camera.project(rays)
        ideal, _ = camera.unproject_normalized(given)
        assert type(rays) is type(again) is type(given)
        points, slopes, _ = camera.normalized_with_slopes(given)
        assert rays.dtype == again.dtype == ideal.dtype == slopes.dtype == given.dtype
        assert tuple(rays.shape) == (*shape, 3)
        assert tuple(valid.shape) == tuple(seen.shape) == shape
        assert tuple(again.shape) == tuple(ideal.shape) == (*shape, 2)
        assert tuple(slopes.shape) == (*shape, 2, 2)
        assert tuple(camera.lens_slopes_at(points).shape) == (*shape, 2, len(camera.parameters))
        np.testing.assert_allclose(np.asarray(again), pixels, atol=1e-3)


def test_the_picture_ends_at_its_pixels_outer_edges():
    camera = Camera("opencv", (640, 480), K, np.zeros(0))
    edge = np.array([[-0.5, 0.0], [-0.4, 0.0], [639.4, 479.4], [639.5, 10.0], [10.0, 479.5], [np.nan, 10.0]])
    assert camera.in_picture(edge).tolist() == [False, True, True, False, False, False]


@pytest.mark.parametrize("name", LENSES)
def test_parameters_are_in_the_order_of_their_names_and_move_as_such(name):
    camera = LENSES[name]
    named = dict(zip(camera.parameter_names, camera.parameters.tolist(), strict=True))
    assert (named["fx"], named["cy"]) == (camera.matrix[0, 0], camera.matrix[1, 2])
    step = np.linspace(0.5, 1.0, len(named)) * 1e-5
    there = camera.moved(step)
    np.testing.assert_allclose(there.parameters - camera.parameters, step, rtol=1e-6)
    np.testing.assert_allclose(there.moved(-step).parameters, camera.parameters, rtol=1e-15, atol=1e-15)
    assert there.covariance is camera.covariance


def test_the_numbers_cannot_be_changed_behind_the_cameras_back():
    matrix = K.copy()
    camera = Camera("opencv", (1280, 720), matrix, np.zeros(4))
    matrix[0, 0] = 1.0
    assert camera.matrix[0, 0] == 900.0
    with pytest.raises(ValueError, match="read-only"):
        camera.distortion[0] = 1.0


@pytest.mark.parametrize("name", sorted(LENSES))
def test_to_a_file_and_back(name, tmp_path):
    camera = LENSES[name]
    count = 4 + camera.distortion.size
    root = np.random.default_rng(0).normal(size=(count, count))
    known = Camera(camera.model, camera.image_size, camera.matrix, camera.distortion, root @ root.T)
    path = tmp_path / "camera.json"
    write_json(path, known.to_dict() | {"rms_px": 0.3, "views": []})
    again = Camera.load(path)
    assert json.dumps(again.to_dict()) == json.dumps(known.to_dict())
    assert again.parameter_names[:4] == ("fx", "fy", "cx", "cy")
    np.testing.assert_array_equal(again.covariance, known.covariance)
    assert pickle.loads(pickle.dumps(camera)).to_dict() == camera.to_dict()
