"""Whether the shape can tell the normal's turn about the antenna."""

from __future__ import annotations

import numpy as np

from estimator.object.friction.angles import Axes, spread_across

OWN_M2 = 1e-5**2 * np.eye(3)


def beside(points: np.ndarray, own_m2: np.ndarray = OWN_M2, patch: np.ndarray | None = None) -> np.ndarray:
    """Of an antenna along x on a plane z = const."""
    count = len(points)
    axes = Axes.of(np.tile([0.0, 0.0, 1.0], (count, 1)), np.tile([1.0, 0.0, 0.0], (count, 1)), np.zeros(count, bool))
    return spread_across(points, np.tile(own_m2, (count, 1, 1)), axes, np.zeros(count, int) if patch is None else patch)


def row(along_m: float, across_m: float, count: int = 30) -> np.ndarray:
    way = np.linspace(0.0, 1.0, count)
    return np.stack([along_m * way, across_m * way, 0.0 * way], axis=1)


def test_a_stroke_across_is_one() -> None:
    assert beside(row(0.0, 0.02)).all()
    assert beside(row(0.02, 0.01)).all()


def test_a_stroke_along_is_none_however_it_wavers() -> None:
    points = row(0.02, 0.0)
    points[:, 1] += 3e-4 * np.random.default_rng(0).normal(size=30)
    assert not beside(points).any()


def test_noise_in_one_place_is_none() -> None:
    points = 1e-5 * np.random.default_rng(1).normal(size=(30, 3))
    assert not beside(points).any()


def test_several_strokes_along_side_by_side() -> None:
    points = np.concatenate([row(0.02, 0.0) + np.array([0.0, 0.005 * k, 0.0]) for k in range(5)])
    assert beside(points).all()


def test_where_it_stuck_its_neighbours_count() -> None:
    points = np.concatenate([np.tile(row(0.0, 0.02)[:1], (20, 1)), row(0.0, 0.02)])
    assert beside(points).all()


def test_patches_are_looked_at_one_by_one() -> None:
    points = np.concatenate([row(0.02, 0.0), row(0.0, 0.02)])
    patch = np.repeat([0, 1], 30)
    np.testing.assert_array_equal(beside(points, patch=patch), patch == 1)


def test_unknown_covariances_tell_nothing() -> None:
    assert not beside(row(0.0, 0.02), np.full((3, 3), np.nan)).any()
