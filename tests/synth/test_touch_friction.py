"""Coulomb friction with sticking against the linear beam, and the laws that it has to keep; objects without a core."""

import math

import numpy as np
import pytest

from vbaa_calib.geometry import Kinematics, Pose
from vbaa_calib.native import core
from vbaa_calib.simulate.contact.touch import touch
from vbaa_calib.simulate.scene.objects import Bump, TouchObject

from .rods import EI, NONE, RADIUS, WEIGHT, X, Y, Z, bare_rod, in_world, real_rod

AXIS = np.array([0.0, 0.28, 0.96])
WEDGE = np.array([0.0, 0.96, -0.28])


def swept(pan_deg: np.ndarray, tilt_deg: np.ndarray) -> list[Pose]:
    pairs = zip(np.radians(pan_deg), np.radians(tilt_deg), strict=True)
    return [Kinematics().T_world_antenna(float(pan), float(tilt)) for pan, tilt in pairs]


def pressed_and_swept(frames: int = 7) -> list[Pose]:
    """Free, pressed by and by, and swept up and down across the press."""
    pan = np.concatenate([[1.0], np.linspace(3.5, 8.0, 3), np.full(frames, 8.0)])
    turn = np.concatenate([np.zeros(4), 4.0 * np.sin(np.linspace(0.0, 1.5 * np.pi, frames + 1)[1:])])
    return swept(pan, turn)


def cylinder(**kwargs: float) -> TouchObject:
    return TouchObject("cylinder", np.array([0.15, 0.018, 0.0]), AXIS, 0.01, 0.1, **kwargs)


def box(**kwargs: float) -> TouchObject:
    return TouchObject("box_edge", np.array([0.15, 0.018, 0.0]), AXIS, 0.01, 0.1, wedge_world=WEDGE, **kwargs)


def freeform(height_m: float = 0.002, **kwargs: float) -> TouchObject:
    bumps = (Bump(-Y, height_m, 0.012), Bump((X - Z) / math.sqrt(2.0), -height_m, 0.012)) if height_m else ()
    return TouchObject("freeform", np.array([0.15, 0.032, -0.004]), Z, 0.025, 1.0, bumps=bumps, **kwargs)


@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_the_grip_keeps_its_law(friction: float) -> None:
    """g = held(g before − K Δu) with the linear way and normal force, whatever they are."""
    rng = np.random.default_rng(4)
    count, stick = 400, 1e3
    root = rng.normal(size=(count, 2, 2))
    give = root @ np.swapaxes(root, 1, 2) + 0.1 * np.eye(2) + 0.1 * rng.normal(size=(count, 1, 1)) * [[0, 1], [-1, 0]]
    now, before = rng.normal(size=(2, count, 2))
    way = rng.normal(size=(count, 2)) * 10.0 ** rng.uniform(-4, 0, (count, 1))
    press, lift = rng.uniform(0.5, 5.0, count), 0.1 * rng.normal(size=(count, 2))
    pull = before - stick * way + stick * np.einsum("bij,bj->bi", give, now)
    each = zip(now, pull, stick * give, press, lift, strict=True)
    grip = np.array([core.simulate.gripped(*one, friction) for one in each])
    moved = way + np.einsum("bij,bj->bi", give, grip - now)
    rim = friction * np.maximum(press + (lift * (grip - now)).sum(axis=1), 0.0)
    pulled = before - stick * moved
    size = np.linalg.norm(pulled, axis=1)
    held = pulled * np.minimum(1.0, rim / size)[:, None]
    np.testing.assert_allclose(grip, held, atol=1e-9)
    if friction:
        assert 0.1 < (size > rim * (1 + 1e-9)).mean() < 0.999


def test_a_pressed_beam_sticks_then_slides_and_back() -> None:
    """A knife edge under a beam pressed by δ and then carried along the edge by u: grip 3EI·u/x³ up to μN, and after
    turning back as much the other way."""
    push, x, mu = 4e-4, 0.16, 0.4
    edge = TouchObject("knife_edge", x * X + (RADIUS + 2e-4) * Y, Z, 2e-4, 0.1, friction=mu, wedge_world=Y)
    along = mu * push * np.array([0.0, 0.25, 0.5, 0.75, 1.5, 1.25, 0.75, 0.0, -0.75, 0.0])
    poses = [Pose(np.eye(3), push * Y + u * Z) for u in along]
    result = touch(bare_rod(), RADIUS, edge, poses, NONE)
    spring = 3.0 * EI / x**3
    rim = mu * spring * push
    # sticking the antenna is drawn along by its base: friction pulls it back
    grip = -result.force_antenna_N[:, 2] / rim
    expected = [0.0, 0.25, 0.5, 0.75, 1.0, 0.75, 0.25, -0.5, -1.0, -0.25]
    np.testing.assert_allclose(grip, expected, atol=3e-3)
    np.testing.assert_array_equal(result.sticks, [False, True, True, True, False, True, True, True, False, True])
    slid = result.slip_world_m[:, 2] / (mu * push)
    np.testing.assert_allclose(slid, [0, 0, 0, 0, 0.5, 0, 0, 0, -0.25, 0], atol=3e-3)
    point = in_world(poses, result)[0][:, 2] / (mu * push)
    np.testing.assert_allclose(point, np.cumsum(slid), atol=1e-2)


def test_a_rounded_edge_is_a_cylinder_between_its_faces_and_a_ball_without_bumps_a_sphere() -> None:
    poses = pressed_and_swept(2)
    sphere = TouchObject("sphere", freeform().center_world_m, Z, 0.025, 1.0)
    for other, same in ((box(), cylinder()), (freeform(0.0), sphere)):
        found, expected = (touch(real_rod(), RADIUS, obj, poses, WEIGHT) for obj in (other, same))
        np.testing.assert_array_equal(found.in_contact, expected.in_contact)
        assert found.in_contact.sum() >= 4
        np.testing.assert_allclose(found.force_antenna_N, expected.force_antenna_N, atol=1e-8)
        np.testing.assert_allclose(found.contact_m, expected.contact_m, atol=1e-8)


OBJECTS = {
    "cylinder": cylinder(friction=0.3),
    "soft box edge": box(friction=0.5, stiffness_N_m=200.0),
    "soft free form": freeform(friction=0.2, stiffness_N_m=400.0),
}


@pytest.mark.parametrize("name", OBJECTS)
def test_laws_of_a_contact_with_friction(name: str) -> None:
    obj, poses = OBJECTS[name], pressed_and_swept()
    result = touch(real_rod(), RADIUS, obj, poses, WEIGHT)
    on = result.in_contact
    assert not on[0]
    assert on.sum() >= 7
    point, tangent, force = (values[on] for values in in_world(poses, result))
    distance, normal = obj.signed_distance(point)
    np.testing.assert_allclose(normal, result.normal_world[on], atol=1e-7)
    press = (force * normal).sum(axis=1)
    np.testing.assert_allclose(distance, RADIUS - press / obj.stiffness_N_m, atol=1e-9)
    np.testing.assert_allclose(obj.signed_distance(result.touched_world_m[on])[0], 0.0, atol=1e-9)
    assert np.abs((normal * tangent).sum(axis=1)).max() < 1e-7
    grip = force - press[:, None] * normal
    ratio = np.linalg.norm(grip, axis=1) / press
    assert ratio.max() <= obj.friction * (1.0 + 1e-5)
    slip, sticks = result.slip_world_m[on], result.sticks[on]
    assert np.abs(slip[sticks]).max(initial=0.0) < 1e-6
    slides = np.linalg.norm(slip, axis=1) > 5e-4
    assert slides.sum() >= 4
    np.testing.assert_allclose(ratio[slides], obj.friction, rtol=1e-4)
    # against the slip; a frame's slip may turn on its way, the grip is that of its end
    against = -(grip * slip).sum(axis=1) / np.linalg.norm(grip, axis=1) / np.linalg.norm(slip, axis=1).clip(1e-12)
    assert against[slides].min() > 0.9
    # the way is what the contact point and its arc length say
    whole, middle, _ = in_world(poses, result)
    middle = middle[1:] + middle[:-1]
    middle /= np.linalg.norm(middle, axis=1, keepdims=True)
    way = np.diff(whole, axis=0) - np.diff(result.contact_m)[:, None] * middle
    both = on[1:] & on[:-1]
    across = way - (way * result.normal_world[1:]).sum(axis=1, keepdims=True) * result.normal_world[1:]
    # a long way over a curved surface is not its chord
    miss, size = (np.linalg.norm(v[both], axis=1) for v in (result.slip_world_m[1:] - across, across))
    assert (miss < 3e-5 + size**2 / 0.02).all()


def test_lifting_off_ends_the_contact_and_forgets_its_grip() -> None:
    poses = swept(np.array([1.0, 4.0, 7.0, 4.0, 1.0, 4.0, 7.0]), np.zeros(7))
    result = touch(real_rod(), RADIUS, cylinder(friction=0.4), poses, WEIGHT)
    np.testing.assert_array_equal(result.in_contact, [False, True, True, True, False, True, True])
    np.testing.assert_allclose(result.force_antenna_N[5:], result.force_antenna_N[1:3], atol=1e-6)
