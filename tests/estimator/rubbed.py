"""A wire that slides and sticks on a ball, written down from Coulomb's law, without the estimator's code."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimator.contact.common_errors import CommonErrors
from estimator.object.track.onset import Track
from estimator.table.contacts import ContactTable

from .track_tables import located

RADIUS_M, WIRE_M, PRESS_N, SPEED_M_S = 0.04, 4e-4, 0.1, 0.02
CENTRE_M = np.array([0.16, 0.0, -0.05])
PRIOR_RAD = 0.2


@dataclass(frozen=True)
class Errors:
    """Standard deviations: the force's direction about the wire, own and common, the friction angle, points, slip."""

    own_rad: float = 0.005
    common_rad: float = 0.01
    lean_rad: float = 0.15
    point_m: float = 5e-5
    speed_m_s: float = 1e-3


@dataclass(frozen=True, eq=False)
class Rubbed:
    """What there is to judge, and the truth: mu, normals (P, 3)."""

    table: ContactTable
    track: Track
    shared: CommonErrors
    mu: float
    normal: np.ndarray


def rubbed(
    mu: float,
    rng: np.random.Generator,
    *,
    count: int = 60,
    slips: bool | np.ndarray = True,
    slip_rad: float = 0.0,
    both_ways: bool = True,
    errors: Errors = Errors(),
    turn: np.ndarray | None = None,
) -> Rubbed:
    """The wire lies along x and goes over the ball from one side to the other, and back if `both_ways`.

    Parameters
    ----------
    slips : which frames slide; in the others friction is anything below the cone's rim.
    slip_rad : of the slip from straight across the wire, towards its tip.
    turn : (3, 3) rotation (or reflection) of the whole world.
    """
    half = count // 2 if both_ways else count
    way = np.where(np.arange(count) < half, 1.0, -1.0)
    share = np.concatenate([np.linspace(-1, 1, half), np.linspace(1, -1, count - half)])
    beta, zero = 0.5 * share, np.zeros(count)
    normal = np.stack([zero, np.sin(beta), np.cos(beta)], axis=1)
    along = np.tile([1.0, 0.0, 0.0], (count, 1))
    across = np.cross(normal, along)
    # across the wire the path over the ball climbs in the sense of −β̇ along n × t
    slip = np.stack([np.sign(across[:, 1]) * way * np.cos(slip_rad), np.full(count, np.sin(slip_rad))], axis=1)
    slides = np.broadcast_to(slips, (count,))
    held = np.where(slides, 1.0, rng.uniform(-1.0, 1.0, count))
    friction = -mu * held[:, None] * (slip[:, :1] * across + slip[:, 1:] * along)
    force = PRESS_N * (normal + friction)
    lean = np.arctan2(-(force * along).sum(1), np.linalg.norm(np.cross(force, along), axis=1))
    roll = errors.common_rad * rng.normal() + errors.own_rad * rng.normal(size=count)
    cos, sin = np.cos(roll), np.sin(roll)
    pushed = np.stack([zero, cos * force[:, 1] - sin * force[:, 2], sin * force[:, 1] + cos * force[:, 2]], axis=1)
    known = 1.0 / errors.lean_rad**2
    std = np.full(count, (known + 1.0 / PRIOR_RAD**2) ** -0.5)
    lean = std**2 * known * (lean + errors.lean_rad * rng.normal(size=count))
    pushed[:, 0] = -np.tan(lean) * np.hypot(pushed[:, 1], pushed[:, 2])
    points = CENTRE_M + (RADIUS_M + WIRE_M) * normal + errors.point_m * rng.normal(size=(count, 3))
    velocity = np.where(slides, SPEED_M_S, 0.0)[:, None] * (slip[:, :1] * across + slip[:, 1:] * along)
    velocity += errors.speed_m_s * rng.normal(size=(count, 3))
    quarter = np.cross(along, pushed)
    modes = np.stack([errors.common_rad * quarter, 0.0 * quarter], axis=2)
    turn = np.eye(3) if turn is None else turn
    size = np.hypot(errors.own_rad, errors.common_rad) * np.hypot(pushed[:, 1], pushed[:, 2])
    rows = [
        located(
            frame=i,
            time_s=i / 30,
            distance_m=0.16,
            force_y_N=pushed[i, 1],
            force_y_std_N=size[i],
            force_z_N=pushed[i, 2],
            force_z_std_N=size[i],
            point_antenna_m=points[i],
            point_world_m=turn @ points[i],
            covariance_world_m2=errors.point_m**2 * np.eye(3),
            force_world_N=turn @ pushed[i],
            friction_angle_rad=lean[i],
            friction_angle_std_rad=std[i],
            tangent_world=turn @ along[i],
            pan_rad=0.0,
        )
        for i in range(count)
    ]
    table = ContactTable.from_rows(rows)
    shared = CommonErrors(0.0 * modes, turn @ modes, 0.0 * modes, table.covariance_world_m2)
    track = followed(np.where(slides, "sliding", "sticking"), velocity @ turn.T, errors.speed_m_s)
    return Rubbed(table, track, shared, mu, normal @ turn.T)


def followed(phase: np.ndarray, velocity_m_s: np.ndarray, std_m_s: float) -> Track:
    """A track without events."""
    count = len(phase)
    return Track(
        phase=phase,
        slip_velocity_m_s=velocity_m_s,
        slip_std_m_s=np.full(count, std_m_s),
        longitudinal_m_s=np.full(count, np.nan),
        lateral_m_s=np.full(count, np.nan),
        slip_covariance_m2_s2=np.tile(std_m_s**2 * np.eye(3), (count, 1, 1)),
        ringing=np.zeros(count, bool),
        events=(),
        notes=(),
    )
