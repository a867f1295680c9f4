"""The metric layer: rays and planes, pixels to metres, with gradients and covariance."""

from __future__ import annotations

import numpy as np
import pytest

from vbaa_calib.camera import intersect_hinge_plane, intersect_plane
from vbaa_calib.geometry import PLANE_C, Plane, Pose, hinge_plane

from ..lazy import Lazy
from .lenses import LENSES, border_and_grid

on_plane = Lazy("vbaa_calib.camera.on_plane")
torch = Lazy("torch")

# 0.4 m above plane C, looking down on it at a tilt
POSE = Pose.from_rotvec(np.array([np.pi - 0.5, 0.2, 0.1]), np.array([0.12, 0.02, 0.4]))
NAMES = ["pinhole", "barrel", "decentred", "gopro rational", "tilted", "fisheye 170"]


def middle(camera, count=8, seed=0):
    width, height = camera.image_size
    rng = np.random.default_rng(seed)
    return rng.uniform([0.25 * width, 0.25 * height], [0.75 * width, 0.75 * height], (count, 2))


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("plane", [PLANE_C, hinge_plane(0.3), Plane(np.array([0.6, 0.0, 0.8]), -0.05)])
def test_points_on_the_plane_are_found_again(name, plane):
    camera = LENSES[name]
    layer = on_plane.CameraOnPlane(camera, POSE, plane)
    pixels = border_and_grid(camera, 15)
    points, valid = layer.points(pixels)
    assert valid.mean() > 0.3
    np.testing.assert_allclose((points @ plane.normal)[valid], plane.offset_m, atol=1e-12)
    # coordinates on the plane keep its distances, and on plane C they are x and y
    plane_xy = layer.project(pixels)[0][valid]
    apart = np.linalg.norm(np.diff(points[valid], axis=0), axis=1)
    np.testing.assert_allclose(np.linalg.norm(np.diff(plane_xy, axis=0), axis=1), apart, atol=1e-12)
    if plane is PLANE_C:
        np.testing.assert_allclose(plane_xy, points[valid][:, :2], atol=1e-15)
    again, seen = camera.project(POSE.inverse() @ points[valid])
    assert seen.all()
    np.testing.assert_allclose(again, pixels[valid], atol=1e-8)


@pytest.mark.parametrize("name", [pytest.param(name, marks=[pytest.mark.slow] * (name != "tilted")) for name in NAMES])
def test_gradients_by_pixels_lens_and_pose(name):
    camera = LENSES[name]
    layer = on_plane.CameraOnPlane(camera, POSE)
    names = ("matrix", "distortion", "rotation", "translation_m")

    def function(pixels, *values):
        return torch.func.functional_call(layer, dict(zip(names, values, strict=True)), (pixels,))[0]

    inputs = (torch.tensor(middle(camera, 4)), *(getattr(layer, name).clone() for name in names))
    assert torch.autograd.gradcheck(function, tuple(value.requires_grad_() for value in inputs), eps=1e-6, atol=1e-6)


@pytest.mark.parametrize("name", sorted(LENSES))
def test_a_gpu_gives_the_answers_of_the_processor(name):
    if not torch.cuda.is_available():
        pytest.skip("needs a GPU")
    camera = LENSES[name]
    layer = on_plane.CameraOnPlane(camera, POSE)
    pixels = np.concatenate([border_and_grid(camera), [[np.nan, 1.0], [np.inf, 1.0], [1e7, -1e7]]])
    rays = POSE.inverse() @ np.nan_to_num(layer.points(pixels)[0], nan=-1.0)

    def answers(device):
        there, given, directions = layer.to(device), torch.tensor(pixels).to(device), torch.tensor(rays).to(device)
        results = [there.project(given), there.points(given), camera.project(directions)]
        results += [camera.unproject_normalized(given), (there.pixel_jacobian(given), there.project(given)[1])]
        points, slopes, seen = camera.normalized_with_slopes(given)
        results += [(slopes, seen), (there.calibration_jacobian(given), there.project(given)[1])]
        results += [(there.covariance(given, 0.1), there.project(given)[1]), (camera.lens_slopes_at(points), seen)]
        buffers = {each: value.detach().clone().requires_grad_() for each, value in there.named_buffers()}
        inner = torch.tensor(middle(camera)).to(device).requires_grad_()
        torch.func.functional_call(there, buffers, (inner,))[0].square().sum().backward()
        gradients = [inner.grad, *(each.grad for each in buffers.values() if each.grad is not None)]
        results += [(each, torch.ones_like(each, dtype=torch.bool)) for each in gradients]
        assert {each.device.type for result in results for each in result} == {device}
        return [(values.detach().cpu().numpy(), valid.cpu().numpy()) for values, valid in results]

    for (ours, known), (expected, valid) in zip(answers("cuda"), answers("cpu"), strict=True):
        assert (known != valid).mean() < 1e-3  # where the lens ends, the last digit decides
        both = known & valid
        scale = np.abs(np.nan_to_num(expected[both])).max(initial=1.0)
        np.testing.assert_allclose(ours[both], expected[both], rtol=1e-7, atol=1e-9 * scale)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("plane", [PLANE_C, hinge_plane(-0.4)])
def test_calibration_jacobian_is_the_difference_quotient(name, plane):
    camera = LENSES[name]
    pixels = middle(camera)
    jacobian = on_plane.CameraOnPlane(camera, POSE, plane).calibration_jacobian(pixels)
    lens = 4 + camera.distortion.size
    steps = np.r_[np.full(4, 1e-3), np.full(lens - 4, 1e-6), np.full(6, 1e-6)]
    assert jacobian.shape == (8, 2, lens + 6)
    for index, step in enumerate(np.diag(steps)):
        ends = [
            on_plane.CameraOnPlane(camera.moved(sign * step[:lens]), POSE.retract(sign * step[lens:]), plane).project(
                pixels
            )[0]
            for sign in (1, -1)
        ]
        quotient = (ends[0] - ends[1]) / (2 * steps[index])
        np.testing.assert_allclose(jacobian[..., index], quotient, rtol=1e-5, atol=1e-7)


def test_pixel_noise_against_sampling():
    camera = LENSES["gopro five"]
    layer = on_plane.CameraOnPlane(camera, POSE)
    pixels, rng = middle(camera, 5), np.random.default_rng(1)
    samples, _ = layer.project(pixels + 0.3 * rng.normal(size=(20_000, 5, 2)))
    for predicted, drawn in zip(layer.covariance(pixels, 0.3), samples.swapaxes(0, 1), strict=True):
        sampled = np.cov(drawn.T)
        np.testing.assert_allclose(np.sqrt(np.diag(predicted)), np.sqrt(np.diag(sampled)), rtol=0.03)
        np.testing.assert_allclose(predicted, sampled, atol=0.03 * np.trace(sampled))
    each = layer.covariance(pixels, np.arange(5) * 0.1)
    np.testing.assert_allclose(each, layer.covariance(pixels, 1.0) * (np.arange(5) * 0.1)[:, None, None] ** 2)


RNG = np.random.default_rng(0)


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def test_points_lie_on_plane_and_ray():
    plane = Plane(unit(np.array([0.3, -0.4, 0.8])), 0.2)
    origins, directions = RNG.normal(size=(5, 1, 3)), unit(RNG.normal(size=(40, 3)))
    points, valid = intersect_plane(origins, directions, plane)
    assert points.shape == (5, 40, 3)
    assert 0.2 < valid.mean() < 0.8
    np.testing.assert_allclose((points @ plane.normal)[valid], 0.2, atol=1e-12)
    along = (points - origins)[valid]
    forward = np.broadcast_to(directions, (5, 40, 3))[valid]
    np.testing.assert_allclose(unit(along), forward, atol=1e-10)
    assert np.isnan(points[~valid]).all()


@pytest.mark.parametrize(
    ("origin", "direction"),
    [
        ((0, 0, 0.4), (1.0, 0.0, 0.0)),
        ((0, 0, 0.4), (0.0, 0.0, 1.0)),
        ((0, 0, 0.4), (1.0, 0.0, -0.0005)),
        ((0, 0, 0.0), (0.0, 0.0, -1.0)),
        ((0, 0, 0.0), (1.0, 0.0, 0.0)),
        ((0, 0, 0.4), (np.nan, 0.0, -1.0)),
        ((0, np.inf, 0.4), (0.0, 0.0, -1.0)),
    ],
    ids=["parallel", "behind", "grazing", "plane through the camera", "in the plane", "not a ray", "not an origin"],
)
def test_no_answer_is_nan_and_never_the_origin(origin, direction):
    for kind in (np.array, torch.tensor):
        points, valid = intersect_plane(kind([float(v) for v in origin]), kind(list(direction)), PLANE_C)
        assert not valid.any()
        assert np.isnan(np.asarray(points)).all()


@pytest.mark.parametrize("roll", [-2.0, -0.7, 0.0, 0.4, 1.2, np.pi / 2])
def test_the_hinge_plane_at_any_roll(roll):
    origin, directions = np.array([0.1, 0.05, 0.4]), unit(RNG.normal(size=(50, 3)))
    points, valid = intersect_hinge_plane(origin, directions, np.array(roll))
    expected, also = intersect_plane(origin, directions, hinge_plane(roll))
    np.testing.assert_array_equal(valid, also)
    np.testing.assert_allclose(points, expected, atol=1e-12)
    # tan ξ = z/y on the hinge plane
    np.testing.assert_allclose((points[:, 2] * np.cos(roll) - points[:, 1] * np.sin(roll))[valid], 0.0, atol=1e-12)
