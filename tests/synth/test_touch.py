"""The contact equilibrium against the linear beam, and the laws it has to keep."""

import math
from collections.abc import Callable

import numpy as np
import pytest

from vbaa_calib.core.errors import SolveError
from vbaa_calib.geometry import Kinematics, Pose
from vbaa_calib.simulate.contact.touch import touch
from vbaa_calib.simulate.scene.objects import TouchObject

from .rods import EI, NONE, RADIUS, WEIGHT, L, X, Y, Z, bare_rod, in_world, real_rod


def knife(x: float, gap: float, *, normal: np.ndarray = -Y, **kwargs: float) -> TouchObject:
    """An edge whose surface is `gap` away from the straight antenna's, which it meets at x; `normal` looks at it."""
    center = x * X - (gap + RADIUS + 2e-4) * normal
    return TouchObject("knife_edge", center, np.cross(X, normal), 2e-4, 0.1, wedge_world=-normal, **kwargs)


def cylinder(x: float, y: float, radius: float = 0.01, **kwargs: float) -> TouchObject:
    return TouchObject("cylinder", np.array([x, y, 0.0]), Z, radius, 0.05, **kwargs)


def panned(start_deg: float, end_deg: float, count: int, tilt_deg: float = 0.0) -> list[Pose]:
    angles = np.radians(np.linspace(start_deg, end_deg, count))
    return [Kinematics().T_world_antenna(float(pan), math.radians(tilt_deg)) for pan in angles]


def shifted(*offsets: np.ndarray) -> list[Pose]:
    return [Pose(np.eye(3), offset) for offset in offsets]


@pytest.mark.parametrize("normal", [-Y, Y, -Z, (Y + Z) / math.sqrt(2.0)])
def test_rigid_knife_edge_is_the_linear_beam(normal: np.ndarray) -> None:
    push, x = 2e-6, 0.16
    result = touch(bare_rod(), RADIUS, knife(x, 0.0, normal=normal), shifted(-push * normal), NONE)
    assert result.in_contact.all()
    np.testing.assert_allclose(result.contact_m, x, rtol=1e-6)
    np.testing.assert_allclose(
        result.force_antenna_N[0], 3 * EI * push / x**3 * normal, atol=1e-4 * 3 * EI * push / x**3
    )
    np.testing.assert_allclose(result.contact_antenna_m[0], x * X + push * normal, atol=1e-9)


@pytest.mark.parametrize("stiffness", [5.0, 50.0, 5000.0])
@pytest.mark.parametrize("make", [knife, lambda x, gap, **k: cylinder(x, gap + 0.01 + RADIUS, **k)])
def test_compliance_is_in_series_with_the_antenna(make: Callable[..., TouchObject], stiffness: float) -> None:
    push, x = 2e-6, 0.16
    result = touch(bare_rod(), RADIUS, make(x, 0.0, stiffness_N_m=stiffness), shifted(push * Y), NONE)
    force = push / (1.0 / stiffness + x**3 / (3 * EI))
    np.testing.assert_allclose(np.linalg.norm(result.force_antenna_N), force, rtol=1e-5)


OBJECTS = {
    "cylinder": cylinder(0.16, 0.015),
    "soft cylinder": cylinder(0.16, 0.015, stiffness_N_m=60.0),
    "leaning cylinder": TouchObject(
        "cylinder", np.array([0.12, 0.015, 0.0]), np.array([0.0, 0.6, 0.8]), 0.01, 0.1, 500.0
    ),
    "knife": TouchObject(
        "knife_edge",
        np.array([0.18, 0.005, 0.0]),
        np.array([0.0, 0.6, 0.8]),
        2e-4,
        0.1,
        wedge_world=np.array([0, 0.8, -0.6]),
    ),
    "near cylinder": cylinder(0.04, 0.006, 0.004),
    "sphere": TouchObject("sphere", np.array([0.15, 0.03, -0.009]), Z, 0.02, 1.0, 400.0),
}


@pytest.mark.parametrize("name", OBJECTS)
def test_laws_of_a_frictionless_contact(name: str) -> None:
    """Pushed up to 20° past first touch (the sphere 8°): the antenna's own rest line is then far inside or beyond."""
    obj = OBJECTS[name]
    poses = panned(-3.0, 10.0 if name == "sphere" else 22.0, 40, tilt_deg=1.0)
    result = touch(real_rod(), RADIUS, obj, poses, WEIGHT)
    touching = result.in_contact
    first = int(np.argmax(touching))
    assert 3 < first < 30
    assert touching[first:].all()
    at, tangent, force = in_world(poses, result)
    size = np.linalg.norm(force, axis=1)
    assert (size[~touching] == 0.0).all()
    assert np.isnan(result.contact_m[~touching]).all()
    assert np.isnan(result.contact_antenna_m[~touching]).all()
    assert (np.diff(size[touching]) > 0.0).all()
    # frictionless: across the antenna
    assert np.abs((force * tangent).sum(axis=1))[touching].max() <= 1e-6 * size.max()
    # the surfaces touch, indented by N/k
    distance, normal = obj.signed_distance(at[touching])
    np.testing.assert_allclose(distance, RADIUS - size[touching] / obj.stiffness_N_m, atol=1e-9)
    # along the object's normal, and never turning round: the antenna stays on its side
    direction = (force / np.maximum(size, 1e-30)[:, None])[touching]
    np.testing.assert_allclose(direction, normal, atol=1e-6)
    assert ((direction[1:] * direction[:-1]).sum(axis=1) > 0.7).all()
    # nowhere else is the antenna deeper
    everywhere = obj.signed_distance(
        np.stack([pose @ points for pose, points in zip(poses, result.shape.points_m, strict=True)])
    )[0].min(axis=1)
    assert (everywhere[touching] >= distance - 1e-9).all()
    assert (everywhere[~touching] > RADIUS).all()


@pytest.mark.parametrize("name", [name for name in OBJECTS if name != "sphere"])
def test_without_friction_the_way_to_a_contact_does_not_matter(name: str) -> None:
    poses = panned(-3.0, 22.0, 40, tilt_deg=1.0)
    step_by_step = touch(real_rod(), RADIUS, OBJECTS[name], poses, WEIGHT)
    in_one = touch(real_rod(), RADIUS, OBJECTS[name], poses[::39], WEIGHT)
    np.testing.assert_allclose(in_one.force_antenna_N[-1], step_by_step.force_antenna_N[-1], atol=1e-8)
    np.testing.assert_allclose(in_one.contact_m[-1], step_by_step.contact_m[-1], atol=1e-9)


def test_both_sides_mirror_each_other() -> None:
    left = touch(bare_rod(), RADIUS, cylinder(0.16, 0.015), panned(0.0, 15.0, 10), NONE)
    right = touch(bare_rod(), RADIUS, cylinder(0.16, -0.015), panned(0.0, -15.0, 10), NONE)
    mirror = np.array([1.0, -1.0, 1.0])
    np.testing.assert_allclose(right.force_antenna_N, mirror * left.force_antenna_N, atol=1e-9)
    np.testing.assert_allclose(right.contact_m, left.contact_m, atol=1e-9)


def test_tip_contact_need_not_push_across_the_antenna() -> None:
    obj = cylinder(L + 0.004, 0.0085, 0.01)
    result = touch(bare_rod(), RADIUS, obj, shifted(NONE, 5e-4 * Y), NONE)
    assert result.in_contact.all()
    np.testing.assert_array_equal(result.contact_m, L)
    assert (result.force_antenna_N[:, 0] < -0.05 * np.linalg.norm(result.force_antenna_N, axis=1)).all()
    distance, normal = obj.signed_distance(in_world(shifted(NONE, 5e-4 * Y), result)[0])
    np.testing.assert_allclose(distance, RADIUS, atol=1e-9)
    size = np.linalg.norm(result.force_antenna_N, axis=1, keepdims=True)
    np.testing.assert_allclose(result.force_antenna_N / size, normal, atol=1e-6)


def test_frames_without_an_answer_are_named() -> None:
    with pytest.raises(SolveError, match=r"frame 1: .*slip off round the sphere"):
        touch(bare_rod(), RADIUS, TouchObject("sphere", 0.16 * X, Z, 0.02, 1.0), panned(-8.0, 8.0, 2), NONE)
    with pytest.raises(SolveError, match="frame 0: the antenna would pass through"):
        touch(bare_rod(), RADIUS, TouchObject("cylinder", 0.1 * X, X, 0.01, 0.1), shifted(NONE), NONE)
    with pytest.raises(SolveError, match=r"frame 1: .*slipped off"):
        touch(bare_rod(), RADIUS, cylinder(0.2395, 0.0, 0.002), panned(-1.0, 60.0, 2), NONE)
