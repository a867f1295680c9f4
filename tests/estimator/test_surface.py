"""The reconstructed surface against objects of known shape: what is drawn, how uncertain it is, hostile contacts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse.csgraph import connected_components, minimum_spanning_tree
from scipy.spatial.transform import Rotation
from scipy.special import log_ndtr

from estimator.object.surface import Surface, Touches, reconstruct
from estimator.object.surface.patches import nearest_first
from estimator.object.surface.settings import SurfaceSettings
from vbaa_calib.native import core
from vbaa_calib.simulate.scene.objects import Bump, TouchObject

from ..viz.touching import cylinder

RADIUS_M = 4e-4
"""Of the antenna."""
CENTRE = np.array([0.16, 0.05, 0.0])
ALONG_M, ACROSS_M, TANGENT_RAD = 4e-4, 5e-5, 3e-4
"""Deviations of a contact's own error along the antenna and across it, and of its tangent."""
UP = np.array([0.0, 0.0, 1.0])
CYLINDER = TouchObject("cylinder", CENTRE, UP, 0.015, 0.05)
SPHERE = TouchObject("sphere", CENTRE, UP, 0.02, 0.05)
KNIFE = TouchObject("knife_edge", CENTRE, np.array([0.0, 0.6, 0.8]), 1e-3, 0.05, wedge_world=np.array([0.0, 0.8, -0.6]))


def _bump(along: float, up: float, height_m: float) -> Bump:
    way = np.array([along, -1.0, up])
    return Bump(way / np.linalg.norm(way), height_m, 9e-3)


FREEFORM = TouchObject(
    "freeform",
    CENTRE,
    UP,
    0.03,
    0.05,
    bumps=(_bump(0.3, 0.2, 3e-3), _bump(-0.4, -0.1, 2e-3), _bump(0.1, -0.5, -1.5e-3)),
)


def on_object(obj: TouchObject, near_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points (N, 3) of the surface near some, and outward normals (N, 3) there."""
    points = near_m
    for _ in range(12):
        distance, normal = obj.signed_distance(points)
        points = points - distance[:, None] * normal
    return points, obj.signed_distance(points + 1e-6 * normal)[1]


def spread_touches(
    obj: TouchObject, count: int, rng: np.random.Generator, *, compliance_m_N: float = 0.0, common: bool = True
) -> Touches:
    """Touches without errors, spread over the side that faces −y; forces from 5 to 60 mN along the normal."""
    side = 0.6 * obj.radius_m
    tall = 0.03 if obj.shape == "cylinder" else side
    near = np.column_stack(
        [rng.uniform(-side, side, count), np.full(count, -obj.radius_m), rng.uniform(-tall, tall, count)]
    )
    points, normal = on_object(obj, CENTRE + near)
    lean = np.array([1.0, 0.1, 0.0]) + 0.1 * rng.standard_normal((count, 3))
    return touches_at(points, normal, lean, rng.uniform(0.005, 0.06, count), compliance_m_N, common)


def edge_touches(count: int, rng: np.random.Generator, *, compliance_m_N: float = 0.0) -> Touches:
    """Along the knife's edge, the antenna pivoting about it by ± 0.15 rad."""
    turn = rng.uniform(-0.15, 0.15, count)
    axis, into = KNIFE.axis_world, KNIFE.wedge_world
    normal = -np.cos(turn)[:, None] * into + np.sin(turn)[:, None] * np.cross(axis, into)
    points = CENTRE + KNIFE.radius_m * normal + np.linspace(-0.03, 0.03, count)[:, None] * axis
    lean = np.cross(axis, normal) + 0.2 * axis
    return touches_at(points, normal, lean, rng.uniform(0.005, 0.06, count), compliance_m_N, True)


def touches_at(
    points_m: np.ndarray,
    normal: np.ndarray,
    lean: np.ndarray,
    press_N: np.ndarray,
    compliance_m_N: float = 0.0,
    common: bool = True,
) -> Touches:
    """Without errors: an antenna that leans this way (N, 3), pressed with these forces (N,).

    The common errors are the rig's position and attitude, and its stiffness, which moves forces and points together.
    """
    tangent = lean - np.sum(lean * normal, axis=1, keepdims=True) * normal
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    force, index = press_N[:, None] * normal, np.arange(len(points_m))
    centre = points_m + (RADIUS_M - compliance_m_N * press_N)[:, None] * normal
    modes, forces, tangents = (np.zeros((len(index), 3, 7 if common else 0)) for _ in range(3))
    if common:
        for axis in range(3):
            turn = 1e-3 * np.eye(3)[axis]
            modes[:, axis, axis] = 1e-4
            modes[:, :, 3 + axis], tangents[:, :, 3 + axis] = np.cross(turn, centre), np.cross(turn, tangent)
            forces[:, :, 3 + axis] = np.cross(turn, force)
        forces[:, :, 6] = 0.02 * force
        modes[:, :, 6] = 5e-4 * tangent + 1.5e-3 * force
    return Touches(
        point_m=centre,
        force_N=force,
        tangent=tangent,
        distance_m=np.full(len(index), 0.17),
        own_m2=ALONG_M**2 * tangent[:, :, None] * tangent[:, None, :] + ACROSS_M**2 * np.eye(3),
        modes_m=modes,
        force_modes_N=forces,
        tangent_modes=tangents,
        frame=index,
        row=index,
    )


def drawn(true: Touches, rng: np.random.Generator) -> Touches:
    """The same with errors. Where the distance comes out too long, the force comes out too small."""
    half = np.linalg.cholesky(true.own_m2 + 1e-24 * np.eye(3))
    own = np.einsum("pij,pj->pi", half, rng.standard_normal(true.point_m.shape))
    common = rng.standard_normal(true.modes_m.shape[2])
    tangent = true.tangent + true.tangent_modes @ common + TANGENT_RAD * rng.standard_normal(true.tangent.shape)
    longer = np.nan_to_num(np.sum(own * true.tangent, axis=1))
    return replace(
        true,
        point_m=true.point_m + own + true.modes_m @ common,
        force_N=true.force_N * (1 - 2 * longer / true.distance_m)[:, None] + true.force_modes_N @ common,
        tangent=tangent / np.linalg.norm(tangent, axis=1, keepdims=True),
        distance_m=true.distance_m + longer,
    )


def angles_rad(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """(N,) between unit vectors (N, 3)."""
    return np.arccos(np.clip(np.sum(first * second, axis=1), -1.0, 1.0))


def grid(low_rad: float, high_rad: float, around: int = 7, up: int = 9) -> tuple[np.ndarray, np.ndarray]:
    angle, height = np.meshgrid(np.linspace(low_rad, high_rad, around), np.linspace(-0.03, 0.03, up))
    return cylinder(angle.ravel(), height.ravel())


@pytest.mark.parametrize(("obj", "friction", "seed"), [(CYLINDER, 0.0, 0), (SPHERE, 0.5, 2), (FREEFORM, 0.0, 0)])
def test_a_smooth_object_comes_out_as_one_surface_with_its_normals(
    obj: TouchObject, friction: float, seed: int
) -> None:
    """Whatever way friction leans the forces: shape and tangents tell the normals."""
    true = spread_touches(obj, 60, np.random.default_rng(seed), common=False)
    size = np.linalg.norm(true.force_N, axis=1, keepdims=True)
    normals = true.force_N / size
    leant = replace(true, force_N=true.force_N + friction * size * np.cross(normals, true.tangent))
    surface = reconstruct(drawn(leant, np.random.default_rng(seed + 1)), RADIUS_M)
    distance, normal = obj.signed_distance(surface.points_m)
    assert np.sqrt(np.mean(distance**2)) < 1e-4
    assert np.percentile(np.degrees(angles_rad(surface.normals, normal)), 90) < 6
    assert np.percentile(np.degrees(angles_rad(surface.touched_normal, normals)), 95) < 3
    assert set(surface.patch) == {0}
    assert len(surface.triangles) > 500


def test_an_edge_is_a_line_with_the_normal_of_each_contact() -> None:
    true = edge_touches(60, np.random.default_rng(0))
    surface = reconstruct(drawn(true, np.random.default_rng(1)), RADIUS_M)
    assert len(surface.triangles) == 0
    assert len(surface.lines) > 20
    assert any("too narrow" in note for note in surface.notes)
    distance, _ = KNIFE.signed_distance(surface.points_m)
    assert np.abs(distance).max() < 6e-4
    felt = true.force_N / np.linalg.norm(true.force_N, axis=1, keepdims=True)
    assert np.degrees(angles_rad(surface.touched_normal, felt)).max() < 1.0
    assert (surface.std_across_m > 0).all()


def test_the_result_turns_with_the_world() -> None:
    turn, shift = Rotation.from_rotvec([0.4, -1.1, 0.7]), np.array([0.3, -0.2, 0.5])
    here = drawn(spread_touches(SPHERE, 40, np.random.default_rng(2), common=False), np.random.default_rng(3))
    matrix = turn.as_matrix()
    there = replace(
        here,
        point_m=turn.apply(here.point_m) + shift,
        force_N=turn.apply(here.force_N),
        tangent=turn.apply(here.tangent),
        own_m2=matrix @ here.own_m2 @ matrix.T,
    )
    one, other = reconstruct(here, RADIUS_M), reconstruct(there, RADIUS_M)
    np.testing.assert_allclose(other.touched_m, turn.apply(one.touched_m) + shift, atol=2e-6)
    np.testing.assert_allclose(other.touched_std_m, one.touched_std_m, rtol=0.05)


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


def test_a_rigid_object_is_stiffer_than_so_much() -> None:
    true = spread_touches(CYLINDER, 60, np.random.default_rng(0), common=False)
    soft = reconstruct(drawn(true, np.random.default_rng(2)), RADIUS_M).compliance
    assert not soft.determined
    assert np.isnan(soft.stiffness_N_m)
    assert soft.interval_N_m[0] > 300
    assert soft.interval_N_m[1] == np.inf
    assert soft.reason.startswith("the object is stiffer than")


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


def test_sums_and_trees_are_scipy_s() -> None:
    """What a report computes without SciPy, which would take it a third of a second to load."""
    rng = np.random.default_rng(0)
    at = np.concatenate([np.linspace(-60.0, 8.0, 301), [-1e3, -np.inf, np.inf]])
    assert core.log_normal_cdf(at) == pytest.approx(log_ndtr(at), rel=1e-9)
    for sparse in (0.0, 0.9):
        distance = np.triu(np.where(rng.random((60, 60)) < sparse, 0.0, rng.random((60, 60))), 1)
        distance += distance.T
        order, gaps = nearest_first(np.where(distance > 0.0, distance, np.inf))
        assert np.sort(gaps[np.isfinite(gaps)]) == pytest.approx(np.sort(minimum_spanning_tree(distance).data))
        parts = np.split(order, np.flatnonzero(gaps > 0.1) + 1)
        labels = connected_components(distance * (distance <= 0.1), directed=False)[1]
        assert {tuple(np.sort(part)) for part in parts} == {tuple(np.flatnonzero(labels == one)) for one in set(labels)}
