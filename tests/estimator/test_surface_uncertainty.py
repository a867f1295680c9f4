"""Stiffness, and predicted deviations of surface and normals against sampling, with own and with common errors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from estimator.object.surface import Surface, Touches, reconstruct
from estimator.object.surface.settings import SurfaceSettings
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
    parts, stds = [], []
    for seed in range(6):
        true = spread_touches(SPHERE, 50, np.random.default_rng(seed), common=False)
        surface = reconstruct(drawn(true, np.random.default_rng(50 + seed)), RADIUS_M)
        parts.append(SPHERE.signed_distance(surface.touched_m)[0] / surface.touched_std_m)
        stds.append(surface.touched_std_m)
    assert 0.85 < inside(np.concatenate(parts)) < 0.995
    assert 0.7 < np.sqrt(np.mean(np.concatenate(parts) ** 2)) < 1.3
    assert np.median(stds) < 5e-5


def test_common_errors_do_not_average_out() -> None:
    """The surface is not better known than the rig's position; the normals' common part is part of their covariance."""
    surface = reconstruct(
        drawn(spread_touches(SPHERE, 60, np.random.default_rng(0)), np.random.default_rng(1)), RADIUS_M
    )
    assert surface.touched_std_m.min() > 1e-4
    modes = surface.touched_normal_modes
    rest = surface.touched_normal_covariance - modes @ np.swapaxes(modes, 1, 2)
    assert np.linalg.eigvalsh(rest).min() > -1e-9
    assert np.trace(modes @ np.swapaxes(modes, 1, 2), axis1=1, axis2=2).max() > 0


def test_wrong_contacts_are_left_out() -> None:
    noisy = drawn(spread_touches(SPHERE, 60, np.random.default_rng(0), common=False), np.random.default_rng(1))
    point = noisy.point_m.copy()
    point[[7, 31]] += 2e-3 * noisy.force_N[[7, 31]] / np.linalg.norm(noisy.force_N[[7, 31]], axis=1, keepdims=True)
    surface = reconstruct(replace(noisy, point_m=point), RADIUS_M)
    assert np.flatnonzero(surface.outlier).tolist() == [7, 31]
    assert "2 contacts were left out" in " ".join(surface.notes)
    assert np.abs(SPHERE.signed_distance(surface.points_m)[0]).max() < 3e-4


def test_a_soft_ball_s_stiffness_and_its_unpressed_shape() -> None:
    stiffness_N_m = 20.0
    true = spread_touches(SPHERE, 60, np.random.default_rng(0), compliance_m_N=1 / stiffness_N_m, common=False)
    surface = reconstruct(drawn(true, np.random.default_rng(1)), RADIUS_M)
    soft = surface.compliance
    assert soft.determined
    assert soft.stiffness_N_m == pytest.approx(stiffness_N_m, rel=0.1)
    assert soft.interval_N_m[0] < stiffness_N_m < soft.interval_N_m[1]
    # nothing is common, but the model is not exact
    assert SurfaceSettings.model_share / stiffness_N_m < soft.std_m_N < 1e-3
    # pressed in by up to 3 mm, drawn where it is when nobody touches it
    assert np.sqrt(np.mean(SPHERE.signed_distance(surface.touched_m)[0] ** 2)) < 1e-4


def test_common_errors_widen_the_interval() -> None:
    """An error of the antenna's stiffness moves points with the forces: that looks like yielding."""
    true = spread_touches(SPHERE, 60, np.random.default_rng(0), compliance_m_N=0.01)
    true.modes_m[:, :, 6] = 1.5e-3 * true.force_N
    soft = reconstruct(drawn(true, np.random.default_rng(1)), RADIUS_M).compliance
    assert soft.std_m_N > 1.5e-3


def test_a_rigid_object_is_stiffer_than_so_much() -> None:
    true = spread_touches(CYLINDER, 60, np.random.default_rng(0), common=False)
    soft = reconstruct(drawn(true, np.random.default_rng(2)), RADIUS_M).compliance
    assert not soft.determined
    assert np.isnan(soft.stiffness_N_m)
    assert soft.interval_N_m[0] > 300
    assert soft.interval_N_m[1] == np.inf
    assert soft.reason.startswith("the object is stiffer than")


def test_forces_that_are_all_alike_tell_nothing() -> None:
    true = spread_touches(SPHERE, 40, np.random.default_rng(0), common=False)
    force = 0.03 * true.force_N / np.linalg.norm(true.force_N, axis=1, keepdims=True)
    surface = reconstruct(drawn(replace(true, force_N=force), np.random.default_rng(1)), RADIUS_M)
    assert not surface.compliance.determined
    assert "is undetermined" in surface.compliance.reason
    assert np.isnan(surface.compliance.interval_N_m).all()
