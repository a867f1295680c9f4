"""Slopes of normalized points by pixel and by lens: against the rays' derivatives, difference quotients, tensors."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from vbaa_calib.camera import Camera
from vbaa_calib.camera.lens import prepared, ray_derivatives
from vbaa_calib.camera.tensors import solve_on_device

from .lenses import LENSES, border_and_grid
from .lenses import camera as camera_of

EACH_KIND = ["pinhole", "tele", "gopro five", "barrel", "gopro rational", "rational radial", "prism", "tilted"]
EACH_KIND += ["only tilted", "fisheye equidistant", "fisheye 200"]


def by_rays(camera: Camera, pixels: np.ndarray) -> np.ndarray:
    """Slopes by pixel the long way: X/Z by the derivatives of the rays. NaN where not valid."""
    with np.errstate(all="ignore"):
        rays, turned, _, valid = ray_derivatives(camera.intrinsics, pixels)
        depth = rays[..., 2, None, None]
        by_pixel = (turned[..., :2, :] - rays[..., :2, None] / depth * turned[..., 2:, :]) / depth
    return np.where((valid & (rays[..., 2] > 1e-12))[..., None, None], by_pixel, np.nan)


@pytest.mark.parametrize("name", sorted(LENSES))
def test_one_inversion_says_what_two_said(name):
    camera = LENSES[name]
    pixels = np.concatenate([border_and_grid(camera), [[np.nan, 1.0], [np.inf, 1.0], [1e300, 1e300]]])
    points, slopes, valid = camera.normalized_with_slopes(pixels)
    expected, known = camera.unproject_normalized(pixels)
    np.testing.assert_array_equal(valid, known)
    np.testing.assert_allclose(points, expected, rtol=1e-13, atol=1e-15)
    np.testing.assert_array_equal(np.isnan(slopes), np.broadcast_to(~valid[:, None, None], slopes.shape))
    by_pixel = by_rays(camera, pixels[:-3])
    np.testing.assert_array_equal(np.isnan(by_pixel), np.isnan(slopes[:-3]))
    # where the inverse is about to end slopes have no digits left
    sizes = np.linalg.norm(by_pixel, axis=(-1, -2))
    inner = sizes < 30.0 * np.nanmin(sizes)
    scale = np.abs(by_pixel[inner]).max(axis=-2, keepdims=True)
    assert inner.mean() > 0.2
    assert (np.abs(slopes[:-3][inner] - by_pixel[inner]) / scale).max() < 1e-10


@pytest.mark.parametrize("name", EACH_KIND)
def test_slopes_are_difference_quotients(name):
    camera = LENSES[name]
    width, height = camera.image_size
    pixels = np.random.default_rng(0).uniform([0.25 * width, 0.25 * height], [0.75 * width, 0.75 * height], (40, 2))
    points, by_pixel, valid = camera.normalized_with_slopes(pixels)
    assert valid.all()

    def quotient(ends: list[np.ndarray], step: float) -> np.ndarray:
        return (ends[0] - ends[1]) / (2.0 * step)

    for axis, direction in enumerate(np.eye(2) * 1e-3):
        ends = [camera.unproject_normalized(pixels + sign * direction)[0] for sign in (1, -1)]
        np.testing.assert_allclose(by_pixel[..., axis], quotient(ends, 1e-3), rtol=1e-6, atol=1e-10)
    by_lens = camera.lens_slopes_at(points)
    for index in range(len(camera.parameter_names)):
        step = 1e-3 if index < 4 else 1e-6
        moves = [sign * step * np.eye(len(camera.parameters))[index] for sign in (1, -1)]
        ends = [camera.moved(move).unproject_normalized(pixels)[0] for move in moves]
        np.testing.assert_allclose(by_lens[..., index], quotient(ends, step), rtol=1e-6, atol=3e-9)


def test_where_the_lens_is_not_one_to_one_there_is_no_slope():
    # r (1 − 0.35 r²) ends at r² = 1/1.05
    fold = 1.0 / math.sqrt(1.05)
    points = np.array([[0.999 * fold, 0.0], [1.001 * fold, 0.0], [0.0, -2.0], [np.nan, 0.0], [0.0, np.inf]])
    known = np.isfinite(LENSES["barrel folding"].lens_slopes_at(points)).all(axis=(-1, -2))
    assert known.tolist() == [True, False, False, False, False]
    points = np.linspace(0.0, 4.0, 60)[:, None] * [math.cos(0.6), math.sin(0.6)]
    for name, lens in LENSES.items():
        _, seen = lens.project(np.c_[points, np.ones(len(points))])
        known = np.isfinite(lens.lens_slopes_at(points)).all(axis=(-1, -2))
        np.testing.assert_array_equal(known, seen, err_msg=name)


def test_behind_a_tilted_sensor_there_is_nothing():
    steep = camera_of("opencv", (640, 480), 100, 100, 320, 240, (*(0.0,) * 13, 1.3))
    pixels = np.array([[370.0, 240.0], [520.0, 240.0]])
    points, _, valid = steep.normalized_with_slopes(pixels)
    assert valid.tolist() == steep.unproject_normalized(pixels)[1].tolist() == [True, False]
    assert np.isfinite(steep.lens_slopes_at(points)).all(axis=(-1, -2)).tolist() == [True, False]


@pytest.mark.parametrize(
    "name", [*EACH_KIND, "barrel folding", "realsense author", "rational with a pole", "prism strong"]
)
def test_the_search_on_other_devices_is_the_cores(name):
    # the processor's tensors are the core's memory; here the same code runs on them as on a GPU's
    camera = LENSES[name]
    own = camera.distortion[:12].tolist()
    lens = prepared(camera.model == "fisheye", (1.0, 1.0, 0.0, 0.0, *own))
    pixels = np.concatenate([border_and_grid(camera, 15), [[np.nan, 1.0], [np.inf, 1.0]]])
    sensor = (pixels - camera.matrix[:2, 2]) / np.diag(camera.matrix)[:2]
    expected, known = lens.chart(sensor)
    x, y, valid = solve_on_device(camera.intrinsics.model, lens, own, *torch.tensor(sensor).unbind(-1))
    np.testing.assert_array_equal(valid.numpy(), known)
    np.testing.assert_allclose(np.stack([x, y], -1)[known], expected[known], rtol=1e-7, atol=1e-9)
