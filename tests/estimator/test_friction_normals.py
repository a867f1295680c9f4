"""Normals that the force has confirmed, and the force's directions in the antenna's frame."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from estimator.object.friction import Friction, friction
from estimator.object.friction.angles import Axes
from estimator.object.surface import Surface, reconstruct, touches_of

from .rubbed import PRIOR_RAD, WIRE_M, Errors, Rubbed, rubbed


def shaped(given: Rubbed) -> Surface:
    return reconstruct(touches_of(given.table, given.shared), WIRE_M)


def judged(given: Rubbed, surface: Surface) -> Friction:
    return friction(given.table, surface, given.track, given.shared, PRIOR_RAD)


def tilted(given: Rubbed, surface: Surface, tilt_rad: float, std_rad: float) -> Surface:
    """A surface whose normals are all turned about the antenna, which lies along x, and said to be that unsure."""
    cos, sin = np.cos(tilt_rad), np.sin(tilt_rad)
    turn = np.array([[1.0, 0.0, 0.0], [0.0, cos, -sin], [0.0, sin, cos]])
    normal = given.normal @ turn.T
    across = np.cross(normal, [1.0, 0.0, 0.0])
    return replace(
        surface,
        touched_normal=normal,
        touched_normal_covariance=std_rad**2 * across[:, :, None] * across[:, None, :],
        touched_normal_modes=std_rad * across[:, :, None],
    )


def error_rad(given: Rubbed, normal: np.ndarray) -> np.ndarray:
    return np.arccos(np.clip((given.normal * normal).sum(axis=1), -1.0, 1.0))


@pytest.mark.parametrize("mu", [0.0, 0.4])
def test_the_force_sets_tilted_normals_upright(mu: float) -> None:
    given = rubbed(mu, np.random.default_rng(1))
    surface = tilted(given, shaped(given), 0.06, 0.06)
    found = judged(given, surface)
    assert found.mu == pytest.approx(mu, abs=0.01)
    assert error_rad(given, surface.touched_normal).min() > 0.05
    assert np.sqrt((error_rad(given, found.normals.normal) ** 2).mean()) < 0.015
    assert np.median(found.normals.std_rad) < 0.015
    np.testing.assert_allclose(np.linalg.norm(found.normals.normal, axis=1), 1.0, atol=1e-9)


def test_deviations_of_the_normals_hold() -> None:
    """Over draws of the common tilt and of the force's errors."""
    squares = []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        given = rubbed(0.3, rng, count=40)
        found = judged(given, tilted(given, shaped(given), 0.05 * rng.normal(), 0.05))
        squares.append((error_rad(given, found.normals.normal) / found.normals.std_rad) ** 2)
    assert 0.3 < np.mean(squares) < 2.0


def test_a_force_that_only_sticks_leaves_the_normals_alone() -> None:
    given = rubbed(0.6, np.random.default_rng(2), slips=False)
    surface = tilted(given, shaped(given), 0.0, 0.01)
    found = judged(given, surface)
    assert np.abs(error_rad(given, found.normals.normal) - error_rad(given, surface.touched_normal)).max() < 0.003
    assert np.median(found.normals.std_rad) > 0.0095


def test_unknown_normals_lie_in_the_cone_about_the_force() -> None:
    given = rubbed(0.2, np.random.default_rng(3))
    surface = shaped(given)
    vague = np.arange(60) < 6
    covariance = np.where(vague[:, None, None], np.eye(3), surface.touched_normal_covariance)
    modes = np.where(vague[:, None, None], 0.0, surface.touched_normal_modes)
    wrong = np.where(vague[:, None], [0.0, 0.6, 0.8], surface.touched_normal)
    found = judged(
        given,
        replace(surface, touched_normal=wrong, touched_normal_covariance=covariance, touched_normal_modes=modes),
    )
    assert (found.used_as[vague] == "unused").all()
    error = error_rad(given, found.normals.normal)[vague]
    assert error.max() < np.arctan(0.2) + 0.05
    assert (error / found.normals.std_rad[vague]).max() < 2.5


def test_angles_in_three_dimensions() -> None:
    """With a friction angle that is seen, the force leans from the normal by the cone's half angle."""
    given = rubbed(0.5, np.random.default_rng(6), slip_rad=0.8, errors=Errors(0.001, 0.001, 0.005))
    found = judged(given, shaped(given))
    np.testing.assert_allclose(found.angle_rad, np.arctan(0.5), atol=0.03)
    assert (np.abs(found.angle_rad - np.arctan(0.5)) < 5 * found.angle_std_rad).mean() > 0.95


def test_axes_are_orthonormal_on_the_side_and_at_the_tip() -> None:
    rng = np.random.default_rng(7)
    normal, tangent = (v / np.linalg.norm(v, axis=1, keepdims=True) for v in rng.normal(size=(2, 20, 3)))
    at_tip = np.arange(20) < 10
    axes = Axes.of(normal, tangent, at_tip)
    frame = np.stack([axes.normal, axes.along, axes.lateral], axis=1)
    np.testing.assert_allclose(frame @ np.swapaxes(frame, 1, 2), np.tile(np.eye(3), (20, 1, 1)), atol=1e-12)
    np.testing.assert_array_equal(axes.normal[at_tip], normal[at_tip])
    np.testing.assert_array_equal(axes.along[~at_tip], tangent[~at_tip])
    np.testing.assert_allclose(axes.lateral, np.cross(axes.normal, axes.along), atol=1e-12)
