"""Predicted deviations of surface, normals and stiffness against sampling, with own and with common errors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from estimator.object.surface import Surface, Touches, reconstruct
from vbaa_calib.simulate.scene.objects import TouchObject

from .touched import CYLINDER, FREEFORM, KNIFE, RADIUS_M, SPHERE, drawn, edge_touches, spread_touches

SOFT_M_N = 0.01


def scaled(surface: Surface, true: Touches, obj: TouchObject, compliance_m_N: float) -> list[np.ndarray]:
    felt = true.force_N / np.linalg.norm(true.force_N, axis=1, keepdims=True)
    across = np.cross(felt, true.tangent)
    turn = np.sum((surface.touched_normal - felt) * across, axis=1)
    turn_std = np.sqrt(np.einsum("pi,pij,pj->p", across, surface.touched_normal_covariance, across))
    soft = surface.compliance
    return [
        obj.signed_distance(surface.points_m)[0] / surface.std_m,
        obj.signed_distance(surface.touched_m)[0] / surface.touched_std_m,
        turn / turn_std,
        np.array([(soft.compliance_m_N - compliance_m_N) / soft.std_m_N]),
        np.array([soft.determined]),
    ]


def sampled(obj: TouchObject, draws: int, compliance_m_N: float, count: int = 50) -> list[np.ndarray]:
    """Errors of vertices, touches, the normals' turn about the tangent and compliance over their predicted deviations;
    and whether the object was called soft."""
    parts = []
    for seed in range(draws):
        rng = np.random.default_rng(seed)
        if obj is KNIFE:
            true = edge_touches(count, rng, compliance_m_N=compliance_m_N)
        else:
            true = spread_touches(obj, count, rng, compliance_m_N=compliance_m_N)
        surface = reconstruct(drawn(true, np.random.default_rng(1000 + seed)), RADIUS_M)
        parts.append(scaled(surface, true, obj, compliance_m_N))
    return [np.concatenate(part) for part in zip(*parts, strict=True)]


def inside(errors: np.ndarray) -> float:
    return float(np.mean(np.abs(errors) < 1.96))


@pytest.mark.slow
@pytest.mark.parametrize("compliance_m_N", [0.0, SOFT_M_N])
@pytest.mark.parametrize("obj", [CYLINDER, SPHERE, FREEFORM, KNIFE], ids=lambda obj: obj.shape)
def test_intervals_cover(obj: TouchObject, compliance_m_N: float) -> None:
    mesh, touched, normal, compliance, soft = sampled(obj, 60, compliance_m_N)
    assert 0.88 < inside(mesh) < 0.99
    assert 0.88 < inside(touched) < 0.99
    assert inside(normal) > 0.9
    assert inside(compliance) > 0.88
    # one in twenty rigid objects may pass for soft, and hardly any soft one for rigid
    assert np.mean(soft) > 0.95 if compliance_m_N else np.mean(soft) < 0.12


def test_own_errors_alone_cover_in_each_surface() -> None:
    """Without common errors the vertices of one surface are many samples, as far as they lie apart."""
    parts = []
    for seed in range(6):
        true = spread_touches(SPHERE, 50, np.random.default_rng(seed), common=False)
        surface = reconstruct(drawn(true, np.random.default_rng(50 + seed)), RADIUS_M)
        parts.append(SPHERE.signed_distance(surface.touched_m)[0] / surface.touched_std_m)
    assert 0.85 < inside(np.concatenate(parts)) < 0.995
    assert 0.7 < np.sqrt(np.mean(np.concatenate(parts) ** 2)) < 1.3


def test_common_errors_do_not_average_out() -> None:
    """However many contacts there are, the surface is not better known than the rig's position."""
    true = spread_touches(SPHERE, 100, np.random.default_rng(0))
    surface = reconstruct(drawn(true, np.random.default_rng(1)), RADIUS_M)
    assert surface.touched_std_m.min() > 1e-4
    alone = replace(true, modes_m=true.modes_m[:, :, :0], force_modes_N=true.force_modes_N[:, :, :0])
    alone = replace(alone, tangent_modes=true.tangent_modes[:, :, :0])
    own = reconstruct(drawn(alone, np.random.default_rng(1)), RADIUS_M)
    assert np.median(own.touched_std_m) < 3.5e-5


def test_the_common_part_of_the_normals_is_part_of_their_covariance() -> None:
    true = spread_touches(FREEFORM, 40, np.random.default_rng(0))
    surface = reconstruct(drawn(true, np.random.default_rng(1)), RADIUS_M)
    modes = surface.touched_normal_modes
    rest = surface.touched_normal_covariance - modes @ np.swapaxes(modes, 1, 2)
    assert np.linalg.eigvalsh(rest).min() > -1e-9
    assert np.trace(modes @ np.swapaxes(modes, 1, 2), axis1=1, axis2=2).max() > 0


def test_too_small_covariances_are_noticed() -> None:
    true = spread_touches(SPHERE, 60, np.random.default_rng(0), common=False)
    noisy = drawn(true, np.random.default_rng(1))
    surface = reconstruct(replace(noisy, own_m2=noisy.own_m2 / 25), RADIUS_M)
    assert "all were widened" in " ".join(surface.notes)
    honest = reconstruct(noisy, RADIUS_M)
    assert np.median(surface.touched_std_m) > 0.5 * np.median(honest.touched_std_m)


def test_wrong_contacts_are_left_out() -> None:
    noisy = drawn(spread_touches(SPHERE, 60, np.random.default_rng(0), common=False), np.random.default_rng(1))
    point = noisy.point_m.copy()
    point[[7, 31]] += 2e-3 * noisy.force_N[[7, 31]] / np.linalg.norm(noisy.force_N[[7, 31]], axis=1, keepdims=True)
    surface = reconstruct(replace(noisy, point_m=point), RADIUS_M)
    assert np.flatnonzero(surface.outlier).tolist() == [7, 31]
    assert "2 contacts were left out" in " ".join(surface.notes)
    assert np.abs(SPHERE.signed_distance(surface.points_m)[0]).max() < 3e-4
