"""The chain in metres: pixels through the metric layer to plane C, and from there the contact that the pixels give."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from benchmarks.estimator.scenes import Scenes
from estimator import ContactEstimator
from estimator.contact.contacts import Contacts
from estimator.contact.inputs import Batch, FrameOptions
from estimator.solver.rig_arrays import RigArrays
from vbaa_calib.camera import Camera
from vbaa_calib.core.errors import InputError
from vbaa_calib.geometry import Pose
from vbaa_calib.rig import Rig

from ..lazy import Lazy
from ..rod_scenes import World, camera_pose
from .contact_scenes import RIG, rubbed

torch = Lazy("torch")

SQUARE = np.array([[640.0, 0.0, 480.0], [0.0, 640.0, 360.0], [0.0, 0.0, 1.0]])
FISHEYE = Camera("fisheye", (960, 720), SQUARE, np.array([-0.02, 0.01, -0.004, 0.001]))
DISTORTED = Camera("opencv", (960, 720), SQUARE, np.array([-0.32, 0.13, 1e-3, -8e-4, -0.02]))
POSES = {
    "upright": (0.0, 0.0, None),
    "inclined by 60°": (60.0, 1.0, None),
    "and from the clamp's side": (60.0, -2.0, None),
    "fisheye": (30.0, 0.5, FISHEYE),
    "strongly distorted": (20.0, 2.0, DISTORTED),
}


def seen(pose: str, seed: int = 3) -> tuple[Rig, Scenes]:
    """A rig with that camera, and six noisy frames of it, free, touched and rubbed, of any roll."""
    incline_deg, azimuth_rad, camera = POSES[pose]
    rig = World(camera_pose(np.radians(incline_deg), azimuth_rad)).rig()
    rig = rig if camera is None else replace(rig, camera=camera)
    rng = np.random.default_rng(seed)
    slopes = np.r_[0.0, rng.uniform(2.0, 30.0, 5)]
    rolls, friction = rng.uniform(-np.pi, np.pi, 6), np.r_[0.0, rng.uniform(-0.3, 0.3, 5)]
    return rig, rubbed(rig, rng.uniform(0.3, 0.95, 6), slopes, friction, rolls).noisy(rng)


def the_same(found: Contacts, pixels: Contacts) -> None:
    """Statuses equal; numbers within 1e-5 standard deviations, and these within 1e-5; 3e-2 without a contact, where
    they are not reported."""
    assert list(found.status) == list(pixels.status)
    std, rounding = pixels.numbers.std, np.where(np.isfinite(pixels.distance_m), 1e-5, 3e-2)[:, None]
    off = np.abs(found.numbers.unknowns - pixels.numbers.unknowns) / std
    assert (np.nan_to_num(off) <= rounding).all()
    assert (np.abs(found.numbers.std - std) <= rounding * std).all()
    np.testing.assert_allclose(found.covariance_world_m2, pixels.covariance_world_m2, rtol=1e-5, atol=1e-5 * 1e-8)
    assert (found.outside_points == pixels.outside_points).all()


@pytest.mark.parametrize("pose", POSES)
@pytest.mark.parametrize(("model", "friction"), [("auto", 0.2), ("auto", 0.0), ("linear", 0.2)])
def test_points_on_the_plane_give_the_contact_of_their_pixels(pose: str, model: str, friction: float) -> None:
    rig, scenes = seen(pose)
    estimator, layer = ContactEstimator(rig, model, friction=friction), rig.camera_on_plane()
    joints: dict[str, Any] = {"moments": scenes.moment_Nm, "pans": scenes.pan_rad, "tilts": scenes.tilt_rad}
    stated = estimator.estimate_batch(scenes.points_px, **joints, sigma_px=scenes.sigma_px)
    xy, valid = layer(scenes.points_px)
    assert type(xy) is np.ndarray
    assert valid.all()
    the_same(estimator.estimate_batch(plane_xy_m=xy, **joints, sigma_px=scenes.sigma_px), stated)
    spread = layer.covariance(scenes.points_px, scenes.sigma_px)
    the_same(estimator.estimate_batch(plane_xy_m=xy, covariance_m2=spread, **joints), stated)
    # tensors, still in the graph, and frames of their own lengths
    pixels = torch.tensor(scenes.points_px, requires_grad=True)
    tensors = layer(pixels)[0]
    the_same(estimator.estimate_batch(plane_xy_m=tensors, covariance_m2=torch.tensor(spread), **joints), stated)
    ragged: dict[str, Any] = {"plane_xy_m": list(tensors), "covariance_m2": list(spread)}
    the_same(estimator.estimate_batch(**ragged, **joints), stated)
    # without covariance the pixels' own
    plain = estimator.estimate_batch(scenes.points_px, **joints)
    the_same(estimator.estimate_batch(plane_xy_m=xy, **joints), plain)


def test_a_covariance_of_any_shape_reaches_the_fit() -> None:
    """In normalized coordinates it is the plane's through the pinhole, whatever the lens; by finite differences."""
    rig, scenes = seen("fisheye")
    rng = np.random.default_rng(1)
    xy = rig.camera_on_plane()(scenes.points_px)[0]
    half = 1e-4 * rng.normal(size=(*xy.shape, 2))
    spread = half @ np.swapaxes(half, -1, -2) + 1e-9 * np.eye(2)
    readings, joints = {"moments": None, "moments_z": None}, {"pans": np.zeros(6), "tilts": np.zeros(6)}
    batch = Batch.checked(
        rig, None, readings, joints, None, FrameOptions(plane_xy_m=xy[:, ::-1], covariance_m2=spread[:, ::-1])
    )
    frames = batch.frames(RigArrays.from_rig(rig, 0.2))

    def pinhole(xy: np.ndarray) -> np.ndarray:
        points = rig.T_antenna_camera.inverse() @ np.concatenate([xy, np.zeros((*xy.shape[:-1], 1))], axis=-1)
        return points[..., :2] / points[..., 2:]

    slopes = np.stack([(pinhole(xy + step) - pinhole(xy - step)) / 2e-6 for step in 1e-6 * np.eye(2)], axis=-1)
    expected = slopes @ spread @ np.swapaxes(slopes, -1, -2)
    xx, xy_, yy = np.moveaxis(frames.covariance, -1, 0)
    ours = np.stack([np.stack([xx, xy_], -1), np.stack([xy_, yy], -1)], -1)
    order = [
        np.argmin(np.linalg.norm(pinhole(own)[:, None] - kept, axis=-1), axis=0)
        for own, kept in zip(xy, frames.points, strict=True)
    ]
    expected = np.stack([own[rows] for own, rows in zip(expected, order, strict=True)])
    size = np.sqrt(np.linalg.det(expected))[..., None, None]
    widened = np.sqrt(np.linalg.det(ours))[..., None, None]
    np.testing.assert_allclose(ours / widened, expected / size, rtol=0, atol=1e-5)
    # but for those that a frame's median holds up
    assert (widened / size > 1.0 - 1e-5).all()
    assert (np.isclose(widened, size, rtol=1e-5)).mean() > 0.8


def test_what_the_layer_cannot_have_given_is_outside() -> None:
    """Behind the camera and beyond its horizon; the reason is the one for points outside the picture."""
    level = replace(
        RIG, T_antenna_camera=Pose.from_rotvec(np.array([np.pi / 2 + 0.2, 0, 0]), np.array([0.1, -0.3, 0.06]))
    )
    behind = np.column_stack([np.linspace(0.0, 0.2, 50), np.full(50, 0.6)])
    contact = ContactEstimator(level).estimate(
        plane_xy_m=behind, covariance_m2=1e-8 * np.eye(2), moment=None, pan=0, tilt=0
    )
    assert (contact.status, contact.outside_points) == ("no_antenna", 50)
    flat = replace(RIG, T_antenna_camera=Pose(RIG.T_antenna_camera.rotation, np.array([0.1, 0.2, 0.0])))
    with pytest.raises(InputError, match="the camera lies in plane C"):
        ContactEstimator(flat).estimate(plane_xy_m=behind, moment=None, pan=0.0, tilt=0.0)
