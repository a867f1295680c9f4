"""Derivatives of contacts against differences of the whole estimator, and the layer that carries them to torch."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from estimator.contact.contacts import Contacts
from estimator.contact.estimate import ContactEstimator

from ..lazy import Lazy
from ..rod_scenes import LENGTH_M, RIG_STD, SIGMA_PX, World, camera_pose, frames, pushing
from .test_uncertainty import another

torch = Lazy("torch")
layers = Lazy("estimator.torch")

WORLD = World(camera_pose(0.7, 0.8))
RIG = WORLD.rig()
ESTIMATOR = ContactEstimator(RIG, jobs=1)
PLACES, ROLLS, TIPS_M = (
    [share * LENGTH_M for share in (0.6, 0.35, 0.8, 0.7)],
    (0.5, -1.0, 2.4, 1.2),
    (0.012, 0.01, 0.02, 0.05),
)
OFF_STD = 0.005
"""Of a derivative times a step of one standard deviation: what second derivatives and convergence leave, noise-free."""


def scene(sigma_px: float = 0.0) -> dict[str, Any]:
    """Four contacts as `estimate_batch` takes them, the points in no order."""
    rng = np.random.default_rng(3)
    lateral = [pushing(*each).tolist() for each in zip(ROLLS, TIPS_M, PLACES, strict=True)]
    several = frames(WORLD, PLACES, lateral, [0.3] * 4, rng, sigma_px=sigma_px, points=120)
    points = np.stack([frame.points_px for frame in several])[:, rng.permutation(120)]
    moments, tilts = (np.array([getattr(frame, name) for frame in several]) for name in ("moment_Nm", "tilt_rad"))
    return {"centrelines_px": points, "moments": moments, "pans": np.full(4, 0.1), "tilts": tilts, "sigma_px": SIGMA_PX}


def values(found: Contacts) -> np.ndarray:
    """(B, 7) as the Jacobian's rows."""
    return np.column_stack([found.distance_m, found.force_N, found.point_world_m])


def stds(found: Contacts) -> np.ndarray:
    """(B, 7) standard deviations of them."""
    point = np.sqrt(np.diagonal(found.covariance_world_m2, axis1=1, axis2=2))
    return np.column_stack([found.distance_std_m, found.force_std_N, point])


def off_std(by: np.ndarray, seen: dict[str, Any], step: dict[str, Any], found: Contacts) -> float:
    """The largest difference of a change (B, 7) from what the estimator makes of a step either way, in deviations."""
    there, back = (
        values(ESTIMATOR.estimate_batch(**seen | {name: seen[name] + sign * size for name, size in step.items()}))
        for sign in (1, -1)
    )
    return float(np.abs((0.5 * (there - back) - by) / stds(found)).max())


class TestAgainstDifferences:
    def test_by_pixels_in_the_order_in_which_they_were_listed(self) -> None:
        seen = scene()
        found = ESTIMATOR.estimate_batch(**seen, jacobian=True)
        points = seen["centrelines_px"]
        along = np.ptp(points[..., 0], axis=1)[:, None]
        for waves in (0, 1):
            wave = np.cos(np.pi * waves * (points[..., :1] - points[..., :1].min(1, keepdims=True)) / along[..., None])
            step = SIGMA_PX * wave * [0.3, 0.7]
            assert found.jacobian is not None
            by = np.einsum("brni,bni->br", found.jacobian.by_pixels, step)
            assert off_std(by, seen, {"centrelines_px": step}, found) < OFF_STD

    def test_by_readings_and_joints(self) -> None:
        seen = scene()
        found = ESTIMATOR.estimate_batch(**seen, jacobian=True)
        assert found.jacobian is not None
        noise = WORLD.sensor.std_Nm
        assert off_std(found.jacobian.by_readings[..., 0] * noise, seen, {"moments": noise}, found) < OFF_STD
        for index, name in enumerate(("pans", "tilts")):
            assert off_std(found.jacobian.by_joints[..., index] * 1e-3, seen, {name: 1e-3}, found) < OFF_STD

    @pytest.mark.parametrize("index", range(len(RIG_STD)), ids=RIG.parameter_names[: len(RIG_STD)])
    def test_by_the_rig(self, index: int) -> None:
        seen, step = scene(), np.zeros(len(RIG_STD))
        step[index] = RIG_STD[index]
        found = ESTIMATOR.estimate_batch(**seen, jacobian=True)
        assert found.jacobian is not None
        there, back = (
            values(ContactEstimator(another(RIG, WORLD.moved(sign * step)), jobs=1).estimate_batch(**seen))
            for sign in (1, -1)
        )
        by = found.jacobian.by_rig[..., index] * step[index]
        assert np.abs((0.5 * (there - back) - by) / stds(found)).max() < OFF_STD


class TestWhatIsNotKnown:
    def test_a_free_antenna_has_no_derivatives(self) -> None:
        seen = {name: each[:1] if isinstance(each, np.ndarray) else each for name, each in scene().items()}
        silent = frames(WORLD, PLACES[:1], [[0.0, 0.0]], [0.3], np.random.default_rng(0), points=120)[0]
        seen |= {"centrelines_px": silent.points_px[None], "moments": [silent.moment_Nm]}
        found = ESTIMATOR.estimate_batch(**seen, jacobian=True)
        assert found.status.tolist() == ["no_contact"]
        assert found.jacobian is not None
        assert np.isnan(found.jacobian.by_pixels).all()
        assert found[0].jacobian is not None
        assert found[0].jacobian.by_rig.shape == (7, len(RIG.parameter_names))

    def test_missing_and_gross_points_count_nothing(self) -> None:
        seen = scene()
        points = seen["centrelines_px"].copy()
        points[:, 7] = np.nan
        points[:, 11] += 2.0
        found = ESTIMATOR.estimate_batch(**seen | {"centrelines_px": points}, jacobian=True)
        assert found.jacobian is not None
        assert not found.jacobian.by_pixels[:, :, [7, 11]].any()
        assert found.jacobian.by_pixels.any(axis=(0, 1, 3)).sum() == 118


class TestLayer:
    def tensors(self) -> tuple[Any, Any, Any]:
        """Centrelines, moments and joint angles that ask for gradients."""
        seen = scene()
        joints = np.column_stack([seen["pans"], seen["tilts"]])
        pixels, moments, angles = (
            torch.tensor(each, requires_grad=True) for each in (seen["centrelines_px"], seen["moments"], joints)
        )
        return pixels, moments, angles

    def test_it_is_the_estimator(self) -> None:
        found = layers.ContactLayer(ESTIMATOR)(*self.tensors(), sigma_px=SIGMA_PX)
        expected = ESTIMATOR.estimate_batch(**scene())
        np.testing.assert_array_equal(found.distance_m.detach().numpy(), expected.distance_m)
        np.testing.assert_array_equal(found.point_world_m.detach().numpy(), expected.point_world_m)
        assert found.located.all()

    def test_gradcheck(self) -> None:
        layer, (pixels, moments, angles) = layers.ContactLayer(ESTIMATOR), self.tensors()
        few = pixels.detach()[:2, ::6].clone().requires_grad_()
        read, joints = moments.detach()[:2].clone().requires_grad_(), angles.detach()[:2].clone().requires_grad_()

        def in_mm(*each: Any) -> Any:
            found = layer(*each, sigma_px=SIGMA_PX)
            return torch.cat([1e3 * found.distance_m[:, None], 1e3 * found.point_world_m, 1e3 * found.force_N], dim=1)

        assert torch.autograd.gradcheck(in_mm, (few, read, joints), eps=1e-3, atol=1e-2, rtol=0.05, nondet_tol=1e-6)

    def test_pixels_to_metres_to_the_contact(self) -> None:
        """Through the metric layer the gradient is that of the pixels."""
        layer, (pixels, moments, angles) = layers.ContactLayer(ESTIMATOR), self.tensors()
        (direct,) = torch.autograd.grad(layer(pixels, moments, angles, sigma_px=SIGMA_PX).distance_m.sum(), pixels)
        xy, valid = RIG.camera_on_plane()(pixels)
        assert valid.all()
        found = layer(None, moments, angles, plane_xy_m=xy, sigma_px=SIGMA_PX)
        (through,) = torch.autograd.grad(found.distance_m.sum(), pixels)
        np.testing.assert_allclose(through.numpy(), direct.numpy(), atol=1e-6 * float(direct.abs().max()))
