"""Gradients by the implicit function theorem: exact, for every input, also the second ones."""

from __future__ import annotations

import numpy as np
import pytest

from vbaa_calib.camera.lens import Intrinsics

from ..lazy import Lazy
from .lenses import LENSES

torch = Lazy("torch")
tensors = Lazy("vbaa_calib.camera.tensors")

NAMES = ["pinhole", "barrel", "decentred", "rational", "tilted", "fisheye 200"]


def differentiable(name, count=6):
    camera = LENSES[name]
    width, height = camera.image_size
    rng = np.random.default_rng(0)
    pixels = rng.uniform([0.3 * width, 0.3 * height], [0.7 * width, 0.7 * height], (count, 2))
    inputs = (torch.tensor(pixels), torch.tensor(camera.matrix), torch.tensor(camera.distortion))
    return camera, tuple(value.requires_grad_() for value in inputs)


def rays_of(camera):
    def function(pixels, K, c):
        intrinsics = Intrinsics(camera.intrinsics.model, K[0, 0], K[1, 1], K[0, 2], K[1, 2], c)
        return tensors.pixel_to_ray(intrinsics, pixels)[0]

    return function


@pytest.mark.parametrize("name", [pytest.param(name, marks=[pytest.mark.slow] * (name in NAMES[:3])) for name in NAMES])
def test_first_derivatives_in_both_modes(name):
    camera, inputs = differentiable(name)
    assert torch.autograd.gradcheck(rays_of(camera), inputs, eps=1e-5, atol=1e-6, check_forward_ad=True)


@pytest.mark.parametrize("name", ["barrel", "tilted", "fisheye 200"])
def test_second_derivatives(name):
    camera, inputs = differentiable(name, count=2)
    assert torch.autograd.gradgradcheck(rays_of(camera), inputs, eps=1e-5, atol=1e-5)


@pytest.mark.parametrize("name", ["decentred", "tilted", "fisheye 200"])
def test_projection_derivatives(name):
    camera, (pixels, K, c) = differentiable(name)
    rays, _ = camera.unproject(pixels.detach())

    def function(points, K, c):
        intrinsics = Intrinsics(camera.intrinsics.model, K[0, 0], K[1, 1], K[0, 2], K[1, 2], c)
        x, y, _ = tensors._to_chart(camera.intrinsics.model, *points.unbind(-1))
        return torch.stack(tensors._chart_to_pixel(intrinsics, x, y)[:2])

    assert torch.autograd.gradcheck(function, (rays.requires_grad_(), K, c), eps=1e-6, atol=1e-4)


@pytest.mark.parametrize("name", ["barrel folding", "realsense author"])
def test_invalid_points_leave_the_gradients_of_the_others_alone(name):
    camera, (_, K, c) = differentiable(name)
    good, bad = (
        torch.tensor([[600.0, 340.0]]).double(),
        torch.tensor([[float("nan"), 0.0], [9e3, 9e3], [1e300, 0.0]]).double(),
    )

    def gradients(pixels):
        pixels = pixels.clone().requires_grad_()
        intrinsics = Intrinsics(camera.intrinsics.model, K[0, 0], K[1, 1], K[0, 2], K[1, 2], c)
        x, y, valid = tensors._pixel_to_chart(intrinsics, *pixels.unbind(-1))
        assert valid.tolist() == [True] + [False] * (len(pixels) - 1)
        total = (x + 2 * y).sum()
        return torch.autograd.grad(total, (pixels, K, c))

    (pixel_both, K_both, c_both), (pixel, K_one, c_one) = gradients(torch.cat([good, bad])), gradients(good)
    torch.testing.assert_close(pixel_both, torch.cat([pixel, torch.zeros(3, 2).double()]))
    torch.testing.assert_close(K_both, K_one)
    torch.testing.assert_close(c_both, c_one)


def test_a_batch_of_lenses():
    # cameras (3, 1) against points (3, 5) and against shared points (5,)
    names = ["barrel", "decentred", "mustache"]
    coefficients = torch.zeros(3, 1, 5, dtype=torch.float64)
    for row, name in enumerate(names):
        coefficients[row, 0, : LENSES[name].distortion.size] = torch.tensor(LENSES[name].distortion)
    coefficients.requires_grad_()
    model = LENSES["barrel"].intrinsics.model
    pixels = torch.rand(5, 2, dtype=torch.float64, generator=torch.Generator().manual_seed(0)) * 600
    for points in (pixels, pixels.expand(3, 5, 2)):
        rays, valid = tensors.pixel_to_ray(Intrinsics(model, 900.0, 900.0, 320.0, 240.0, coefficients), points)
        assert rays.shape == (3, 5, 3)
        assert valid.all()
        for row in range(3):
            alone, _ = tensors.pixel_to_ray(Intrinsics(model, 900.0, 900.0, 320.0, 240.0, coefficients[row, 0]), pixels)
            torch.testing.assert_close(rays[row], alone)
    by_coefficients = lambda c: tensors.pixel_to_ray(Intrinsics(model, 900.0, 900.0, 320.0, 240.0, c), pixels)[0]  # noqa: E731
    assert torch.autograd.gradcheck(by_coefficients, (coefficients,), atol=1e-6)
