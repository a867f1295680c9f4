"""Fig. 7 redone: three slippery knife edges of different normal direction, touched at distances along the antenna."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from benchmarks.estimator.setup import drawn_truth, rod_of
from benchmarks.harness import concatenated, of_any, or_none, rms_known, spread
from estimator import ContactEstimator
from estimator.paper.baselines import press_from_recording, run_method
from vbaa_calib.geometry import Pose, rotation_world_antenna
from vbaa_calib.rig import Rig
from vbaa_calib.simulate.contact.touch import touch
from vbaa_calib.simulate.scene.objects import TouchObject

from .rig import Pictures, free_point, free_shape, paper_rig, taken

NORMALS_DEG = (0.0, 30.0, 60.0)
"""Between the edge's normal and the direction in which the base turns, in the antenna's yz plane."""
DISTANCES_M = np.linspace(0.06, 0.22, 9)
_PUSH_RAD = np.radians(6.0)
SIGMAS_PX = (0.1, 0.3)
TWO_POINTS, ALL_POINTS = "two points, the paper's", "all points, the estimator"
EDGE_RADIUS_M = 2e-4
TRUE_RIGS = 8
"""Rigs that the same calibration may belong to; the draws are shared among them."""


@dataclass(frozen=True)
class SensingRow:
    """One object touched at one distance, over the draws. None where no draw was answered.

    answered : share of the draws. l_mean_mm, l_std_mm, l_rms_mm : of the distances, their scatter and errors.
    l_stated_mm : typical stated deviation. direction_* : of −f in the yz plane from y, in degrees. lean_rms_deg : the
    whole force, in space, from the object's normal at the contact. covered : share of 95 % intervals of l that hold it.
    """

    method: str
    sigma_px: float
    normal_deg: float
    l_true_mm: float
    direction_true_deg: float
    draws: int
    answered: float
    l_mean_mm: float | None
    l_std_mm: float | None
    l_rms_mm: float | None
    l_stated_mm: float | None
    covered: float | None
    direction_mean_deg: float | None
    direction_std_deg: float | None
    direction_rms_deg: float | None
    lean_rms_deg: float | None


@dataclass(frozen=True, eq=False)
class _Edges:
    """One object touched at distances (D,) by one true antenna; forces and outward normals (D, 3), antenna frame."""

    touched: Pictures
    free: Pictures
    distance_m: np.ndarray
    force_N: np.ndarray
    normal: np.ndarray


@dataclass(frozen=True, eq=False)
class Answers:
    """(D,) distances and their deviations, (D, 3) forces; NaN where there are none."""

    distance_m: np.ndarray
    distance_std_m: np.ndarray
    force_N: np.ndarray


def knife_edge(
    normal_deg: float,
    touch_point_m: np.ndarray,
    antenna_radius_m: float,
    *,
    radius_m: float = EDGE_RADIUS_M,
    stiffness_N_m: float = np.inf,
    friction: float = 0.0,
) -> TouchObject:
    """An edge in the world's yz plane that an antenna whose centreline passes `touch_point_m` just touches.

    Its normal towards the antenna is turned by the angle from −y towards −z.
    """
    angle = np.radians(normal_deg)
    outward = np.array([0.0, -np.cos(angle), -np.sin(angle)])
    return TouchObject(
        "knife_edge",
        touch_point_m - (radius_m + antenna_radius_m) * outward,
        np.array([0.0, -np.sin(angle), np.cos(angle)]),
        radius_m,
        half_length_m=0.3,
        stiffness_N_m=stiffness_N_m,
        friction=friction,
        wedge_world=-outward,
    )


def touched_edges(true: Rig, normal_deg: float) -> _Edges:
    """The base stands so that the free antenna just touches at each distance, then turns by `_PUSH_RAD` about z."""
    gravity = true.gravity_world_m_s2
    free = free_shape(true, gravity[None])
    turn = rotation_world_antenna(_PUSH_RAD, 0.0)
    radius = 0.5 * true.antenna.diameter_m
    obj = knife_edge(normal_deg, np.zeros(3), radius)
    poses = [Pose(turn, -point) for point in map(partial(free_point, true), DISTANCES_M)]
    found = touch(rod_of(true), radius, obj, poses, gravity)
    contact = np.array([pose @ point for pose, point in zip(poses, found.contact_antenna_m, strict=True)])
    _, normal = obj.signed_distance(contact)
    return _Edges(taken(true, found.shape), taken(true, free), found.contact_m, found.force_antenna_N, normal @ turn)


def by_camera_a(rig: Rig, pictures: Pictures, free: Pictures, sigma_px: float) -> Answers:
    """The paper's camera A, frame by frame."""
    seen = (pictures.points_px, pictures.moment_Nm), (free.points_px, free.moment_Nm)
    still = np.zeros((2, len(pictures.points_px)))
    press = press_from_recording(rig, *seen, (still[0], still[1]), sigma_px=sigma_px)
    points, moments = np.asarray(press.points_m), np.asarray(press.moment_Nm)
    found = [
        run_method("3D-VBAA, camera A", replace(press, turn_rad=None, moment_Nm=moment[None], points_m=line[None]))
        for line, moment in zip(points, moments, strict=True)
    ]
    return Answers(*(np.array([getattr(each, name) for each in found]) for name in Answers.__annotations__))


def run(draws: int, seed: int) -> list[SensingRow]:
    """All objects, noises and both ways."""
    rig, rows = paper_rig(), list[SensingRow]()
    rng = np.random.default_rng(seed)
    trues = [drawn_truth(rig, rng) for _ in range(min(TRUE_RIGS, draws))]
    for normal_deg in NORMALS_DEG:
        edges = [touched_edges(true, normal_deg) for true in trues]
        for sigma_px in SIGMAS_PX:
            used = [edges[draw % len(edges)] for draw in range(draws)]
            drawn = [each.touched.noisy(rig, sigma_px, rng) for each in used]
            answers = {
                TWO_POINTS: [
                    by_camera_a(rig, pictures, each.free.noisy(rig, sigma_px, rng), sigma_px)
                    for pictures, each in zip(drawn, used, strict=True)
                ],
                ALL_POINTS: _by_all_points(rig, drawn, sigma_px),
            }
            for method, several in answers.items():
                rows += _rows(method, sigma_px, normal_deg, used, several)
    return rows


def direction_deg(force_N: np.ndarray) -> np.ndarray:
    """(...) angle of −f (..., 3) in the yz plane from y."""
    return np.degrees(np.arctan2(-force_N[..., 2], -force_N[..., 1]))


def _by_all_points(rig: Rig, drawn: list[Pictures], sigma_px: float) -> list[Answers]:
    """The estimator without friction, all draws in one batch."""
    together = concatenated(drawn)
    count = len(together.points_px)
    found = ContactEstimator(rig, friction=0.0).estimate_batch(
        together.points_px, together.moment_Nm[:, 1], np.full(count, _PUSH_RAD), np.zeros(count), sigma_px=sigma_px
    )
    columns = found.distance_m, found.distance_std_m, found.force_N
    return [Answers(*parts) for parts in zip(*(np.split(values, len(drawn)) for values in columns), strict=True)]


def _rows(
    method: str, sigma_px: float, normal_deg: float, used: list[_Edges], several: list[Answers]
) -> Iterator[SensingRow]:
    distance, std, force = (np.array([getattr(each, name) for each in several]) for name in Answers.__annotations__)
    true, pushed = np.array([each.distance_m for each in used]), np.array([each.force_N for each in used])
    normal = np.array([each.normal for each in used])
    off = 1e3 * (distance - true)
    turned = direction_deg(force) - direction_deg(pushed)
    with np.errstate(invalid="ignore"):
        along = np.einsum("rdi,rdi->rd", force, normal) / np.linalg.norm(force, axis=-1)
        lean = np.degrees(np.arccos(np.clip(along, -1.0, 1.0)))
    for place in range(len(DISTANCES_M)):
        said = np.isfinite(off[:, place])
        missed, stated = off[said, place], 1e3 * std[said, place]
        yield SensingRow(
            *(method, sigma_px, normal_deg),
            float(1e3 * true[:, place].mean()),
            float(direction_deg(pushed[:, place]).mean()),
            len(said),
            float(said.mean()),
            *spread(1e3 * distance[said, place], missed),
            or_none(rms_known(stated)),
            of_any(np.mean, np.abs(missed) <= 1.96 * stated),
            *spread(direction_deg(force[said, place]), turned[said, place]),
            or_none(rms_known(lean[said, place])),
        )
