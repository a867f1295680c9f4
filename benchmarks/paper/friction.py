"""Fig. 5 redone: an antenna dragged to and fro over a knife edge; contact points joined, normal, force, friction cone.

The normal ν is across the line through the contact points in the yz plane, ψ the force's direction there. While it
slides the force lies on the cone's one or other side: |ψ − ν| = α = atan μ.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.estimator.setup import drawn_truth, rod_of
from benchmarks.harness import column, of_any, or_none, rms_known, spread
from estimator import ContactEstimator
from estimator.object.estimate import ObjectEstimate
from estimator.paper.two_point import contact_position
from estimator.table.contacts import FRICTION_RAD
from vbaa_calib.rig import Rig
from vbaa_calib.simulate.contact.touch import Touch, touch

from .rig import FELT, Pictures, free_point, free_shape, object_of, paper_rig, taken
from .sensing import ALL_POINTS, SIGMAS_PX, TWO_POINTS, by_camera_a, direction_deg, knife_edge

NORMAL_DEG, DISTANCE_M, EDGE_RADIUS_M = 20.0, 0.15, 1e-3
_PRESSED_RAD, _DRAGGED_RAD = np.radians(4.0), np.radians(4.0)
APPROACH, LEG = 24, 16
"""Frames of the press, and of each of the two legs."""


@dataclass(frozen=True, eq=False)
class _Dragged:
    """One true antenna over one edge, B frames: R_world_antenna (B, 3, 3), joints (B,), contacts (B, 3) m, world."""

    touched: Pictures
    free: Pictures
    pan_rad: np.ndarray
    tilt_rad: np.ndarray
    rotation: np.ndarray
    point_m: np.ndarray


def joints() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pan and tilt (B,), and the part (B,) of each frame: 0 press, 1 there, 2 back."""
    press = np.linspace(-0.15, 1.0, APPROACH) * _PRESSED_RAD
    there = np.linspace(-1.0, 1.0, LEG) * _DRAGGED_RAD
    along = np.concatenate([np.full(APPROACH, there[0]), there, there[::-1][1:]])
    against = np.concatenate([press, np.full(2 * LEG - 1, _PRESSED_RAD)])
    cos, sin = np.cos(np.radians(NORMAL_DEG)), np.sin(np.radians(NORMAL_DEG))
    part = np.repeat([0, 1, 2], [APPROACH, LEG, LEG - 1])
    return cos * against - sin * along, sin * against + cos * along, part


def dragged(true: Rig, friction: float) -> _Dragged:
    """The antenna pressed along the edge's normal, then carried along the edge and back."""
    pan, tilt, _ = joints()
    at = free_point(true, DISTANCE_M)
    radius = 0.5 * true.antenna.diameter_m
    obj = knife_edge(NORMAL_DEG, at, radius, radius_m=EDGE_RADIUS_M, friction=friction)
    poses = [true.kinematics.T_world_antenna(float(p), float(t)) for p, t in zip(pan, tilt, strict=True)]
    found: Touch = touch(rod_of(true), radius, obj, poses, true.gravity_world_m_s2)
    rotation = np.stack([pose.rotation for pose in poses])
    free = free_shape(true, true.gravity_world_m_s2 @ rotation)
    point = np.array([pose @ contact for pose, contact in zip(poses, found.contact_antenna_m, strict=True)])
    return _Dragged(taken(true, found.shape), taken(true, free), pan, tilt, rotation, point)


FRICTIONS = (0.0, 0.1, 0.2, 0.3, 0.4, 0.6)
TRUE_RIGS = 2
SHOWN = 0.3
"""The μ whose contact points are kept."""


@dataclass(frozen=True)
class FrictionRow:
    """One μ, over the draws: the normal in degrees and μ = tan α, each as mean, scatter and rms error.

    `mu_stated` and `mu_covered` (95 % intervals) of the way that states them.
    """

    method: str = column("method")
    sigma_px: float = column("px", ".1f")
    mu_true: float = column("μ", ".1f")
    draws: int = column()
    answered: float = column("answered %", ".1f", 100)
    normal_true_deg: float = column()
    normal_mean_deg: float | None = column()
    normal_rms_deg: float | None = column("normal rms °", ".2f")
    mu_mean: float | None = column("μ mean", ".4f")
    mu_std: float | None = column("scatter", ".4f")
    mu_rms: float | None = column("rms", ".4f")
    mu_stated: float | None = column("stated", ".4f", default=None)
    mu_covered: float | None = column("covered %", ".1f", 100, default=None)


@dataclass(frozen=True)
class PathRow:
    """One contact of the path that Fig. 5 draws, across the antenna's axis in the world; the first one is the origin.

    `direction_deg` is ψ of −f from y, as `normal_deg` is ν's; `part` is press, there or back.
    """

    method: str
    mu_true: float
    part: str
    y_mm: float
    z_mm: float
    y_true_mm: float
    z_true_mm: float
    direction_deg: float
    normal_deg: float


Trace = tuple[np.ndarray, np.ndarray]
"""What a way makes of the frames: contacts (B, 3) m and forces (B, 3) N, world, NaN where it says nothing."""


@dataclass(frozen=True)
class Cone:
    """ν in degrees from y, and α in degrees on the way there and back, positive outwards; NaN where undetermined."""

    normal_deg: float
    there_deg: float
    back_deg: float

    @property
    def mu(self) -> float:
        """tan of half the angle between the cone's sides: ν drops out."""
        return float(np.tan(np.radians(0.5 * (self.there_deg + self.back_deg))))


def _by_two_points(rig: Rig, frames: _Dragged, drawn: Pictures, free: Pictures, sigma_px: float) -> Trace:
    """The paper's way: camera A, then its equations 19 to 22 with the mended rotation."""
    found = by_camera_a(rig, drawn, free, sigma_px)
    force = found.force_N
    point = contact_position(found.distance_m, force[:, 1], force[:, 2], rig.antenna.stiffness_Nm2)
    force = np.where(np.arange(3) == 0, 0.0, force)
    return np.einsum("bij,bj->bi", frames.rotation, point), np.einsum("bij,bj->bi", frames.rotation, force)


def cone(trace: Trace) -> Cone:
    """ν across the line through all contacts, ψ over the later half of each leg."""
    (point, force), part = trace, joints()[2]
    known, psi = np.isfinite(point).all(axis=1), direction_deg(force)
    line = point[known & (part > 0), 1:]
    place = [np.cumsum(part == leg) for leg in (1, 2)]
    legs = [known & (part == leg) & (at > 0.5 * at[-1]) for leg, at in zip((1, 2), place, strict=True)]
    if len(line) < 3 or not all(leg.any() for leg in legs):
        return Cone(np.nan, np.nan, np.nan)
    along = np.linalg.svd(line - line.mean(axis=0))[2][0]
    normal = float(np.degrees(np.arctan2(along[0], -along[1])))
    normal = (normal + 90.0) % 180.0 - 90.0
    # against the motion: going there, to +z of the edge, the force leans back towards −z, −f towards +z
    there, back = (float(np.median(psi[leg])) for leg in legs)
    return Cone(normal, there - normal, normal - back)


def run(draws: int, seed: int, frictions: Sequence[float] = FRICTIONS) -> tuple[list[FrictionRow], list[PathRow]]:
    """All coefficients, noises and ways; the path of the first draw at `SHOWN`."""
    rig, rng = paper_rig(), np.random.default_rng(seed)
    trues = [drawn_truth(rig, rng) for _ in range(min(TRUE_RIGS, draws))]
    rows: list[FrictionRow] = []
    shown: list[PathRow] = []
    for friction in frictions:
        frames = [dragged(true, friction) for true in trues]
        for sigma_px in SIGMAS_PX:
            cones: dict[str, list[Cone]] = {TWO_POINTS: [], ALL_POINTS: []}
            estimates = []
            for draw in range(draws):
                used = frames[draw % len(frames)]
                drawn, free = (each.noisy(rig, sigma_px, rng) for each in (used.touched, used.free))
                found = ContactEstimator(rig).estimate_batch(
                    drawn.points_px, drawn.moment_Nm[:, 1], used.pan_rad, used.tilt_rad, sigma_px=sigma_px
                )
                estimates.append(object_of(rig, found, used.pan_rad, used.tilt_rad, FRICTION_RAD))
                traces = {
                    TWO_POINTS: _by_two_points(rig, used, drawn, free, sigma_px),
                    ALL_POINTS: (found.point_world_m, found.force_world_N),
                }
                for method, trace in traces.items():
                    cones[method].append(cone(trace))
                    if friction == SHOWN and sigma_px == SIGMAS_PX[0] and draw == 0:
                        shown += _path(method, friction, used, trace)
            for method, several in cones.items():
                normal, mu = np.array([[each.normal_deg, each.mu] for each in several]).T
                rows.append(_row(method, sigma_px, friction, normal, mu))
            rows.append(_object_row(sigma_px, friction, estimates))
    return rows, shown


def _row(method: str, sigma_px: float, friction: float, normal_deg: np.ndarray, mu: np.ndarray) -> FrictionRow:
    said = np.isfinite(mu)
    normal, _, normal_rms = spread(normal_deg[said], normal_deg[said] - NORMAL_DEG)
    found = spread(mu[said], mu[said] - friction)
    return FrictionRow(method, sigma_px, friction, len(mu), float(said.mean()), NORMAL_DEG, normal, normal_rms, *found)


def _object_row(sigma_px: float, friction: float, found: Sequence[ObjectEstimate]) -> FrictionRow:
    """With the median normal of each recording, turned into the world's yz plane."""
    mu, std = np.array([[each.friction.mu, each.friction.std] for each in found]).T
    interval = np.array([each.friction.interval for each in found])
    normal = np.array([np.median(direction_deg(each.normals.normal)) for each in found])
    said = np.isfinite(mu)
    inside = (interval[said, 0] <= friction) & (friction <= interval[said, 1])
    row = _row(FELT, sigma_px, friction, normal, mu)
    return replace(row, mu_stated=or_none(rms_known(std[said])), mu_covered=of_any(np.mean, inside))


def _path(method: str, friction: float, frames: _Dragged, trace: Trace) -> list[PathRow]:
    (point, force), part, normal = trace, joints()[2], cone(trace).normal_deg
    first = np.nanmean(point[:, 1:] - frames.point_m[:, 1:], axis=0) + frames.point_m[APPROACH, 1:]
    seen = 1e3 * (point[:, 1:] - first)
    true = 1e3 * (frames.point_m[:, 1:] - frames.point_m[APPROACH, 1:])
    numbers = np.column_stack([seen, true, direction_deg(force), np.full(len(part), normal)])
    return [
        PathRow(method, friction, ("press", "there", "back")[leg], *row.tolist())
        for leg, row in zip(part, numbers, strict=True)
        if np.isfinite(row[:2]).all()
    ]
