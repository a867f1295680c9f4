"""Contacts that are few, in one place, on a line, without covariance, tangent or sense: no crash, and clear words."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

from estimator.object.surface import Surface, Touches, reconstruct
from vbaa_calib.simulate.scene.objects import TouchObject

from .touched import CYLINDER, RADIUS_M, SPHERE, drawn, spread_touches, touches_at


def picked(touches: Touches, which: np.ndarray | slice) -> Touches:
    """Some of the touches."""
    arrays = {f.name: getattr(touches, f.name)[which] for f in fields(Touches) if f.name != "notes"}
    return Touches(**arrays)


def noisy(obj: TouchObject, count: int = 40, seed: int = 0) -> Touches:
    true = spread_touches(obj, count, np.random.default_rng(seed), common=False)
    return drawn(true, np.random.default_rng(seed + 1))


def sound(surface: Surface, count: int) -> None:
    """Everything is there, finite and of unit length where it should be."""
    assert len(surface.touched_m) == count
    for name in ("points_m", "normals", "touched_m", "touched_normal", "touched_normal_covariance"):
        assert np.isfinite(getattr(surface, name)).all(), name
    for normals in (surface.normals, surface.touched_normal):
        np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-9)
    indices = np.concatenate([surface.triangles.ravel(), surface.lines.ravel()])
    assert ((indices >= 0) & (indices < len(surface.points_m))).all()
    assert len(surface.patch) == len(surface.std_m) == len(surface.points_m) > 0
    assert surface.compliance.reason


def test_without_tangents_a_line_does_not_know_its_normals() -> None:
    height = np.linspace(-0.02, 0.02, 25)
    points = np.array([0.16, 0.035, 0.0]) + np.outer(height, [0.0, 0.0, 1.0])
    normal, lean = np.tile([0.0, -1.0, 0.0], (25, 1)), np.tile([1.0, 0.0, 0.0], (25, 1))
    line = touches_at(points, normal, lean, np.linspace(0.01, 0.05, 25), common=False)
    surface = reconstruct(replace(line, tangent=np.full((25, 3), np.nan)), RADIUS_M)
    sound(surface, 25)
    about_line = surface.touched_normal_covariance[:, 0, 0]
    np.testing.assert_allclose(about_line, 1.0, atol=0.05)


def test_unknown_covariances_are_said_and_give_no_deviations() -> None:
    touches = noisy(CYLINDER)
    surface = reconstruct(replace(touches, own_m2=np.full((40, 3, 3), np.nan)), RADIUS_M)
    sound(surface, 40)
    assert np.isnan(surface.std_m).all()
    assert np.isnan(surface.touched_std_m).all()
    assert "no covariance" in surface.notes[0]
    assert "is undetermined" in surface.compliance.reason
    assert np.sqrt(np.mean(CYLINDER.signed_distance(surface.points_m)[0] ** 2)) < 4e-4


def senseless() -> dict[str, dict[str, np.ndarray]]:
    """What no antenna sees; it must not end in a division by zero."""
    rng, touches = np.random.default_rng(0), noisy(SPHERE)
    along = touches.force_N / np.linalg.norm(touches.force_N, axis=1, keepdims=True)
    some = np.where((np.arange(40) % 2 == 0)[:, None], touches.tangent, np.nan)
    growing = touches.own_m2 * 10.0 ** np.arange(-6, 2, 0.2)[:, None, None]
    unknown = np.where((np.arange(40) % 9 == 0)[:, None, None], np.nan, touches.own_m2)
    return {
        "forces": {"force_N": rng.standard_normal((40, 3))},
        "points": {"point_m": rng.uniform(-1, 1, (40, 3))},
        "huge covariances": {"own_m2": np.tile(np.eye(3), (40, 1, 1))},
        "covariances of all sizes": {"own_m2": growing},
        "unknown covariances": {"own_m2": unknown},
        "tangents along the force": {"tangent": along},
        "tangents of some": {"tangent": some},
    }


@pytest.mark.parametrize("name", list(senseless()))
def test_what_makes_no_sense_gives_a_surface_still(name: str) -> None:
    sound(reconstruct(replace(noisy(SPHERE), **senseless()[name]), RADIUS_M), 40)
