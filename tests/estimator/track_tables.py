"""Tables of contacts made by hand, with a truth that no estimator had a part in."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from estimator.table.contacts import ContactRow, ContactTable
from vbaa_calib.geometry import Kinematics

RATE_HZ = 30.0
TILT_RAD = 0.2


def evidence(x: np.ndarray, common: np.ndarray, noise: float, rng: np.random.Generator) -> np.ndarray:
    """(B,) half the squared size of a deflection x (B,) along one axis, a common error (3,) and noise in three."""
    whole = common + noise * rng.normal(size=(len(x), 3))
    whole[:, 0] += x
    return 0.5 * (whole**2).sum(axis=1)


def evidence_table(values: np.ndarray, *, deep: np.ndarray | None = None, start_s: float = 0.0) -> ContactTable:
    """Frames with this evidence (B,), in contact from 14 on and located from 100 on, with a force along `deep` (B,)."""
    rows = []
    for i, value in enumerate(values):
        row = {
            "frame": i,
            "time_s": start_s + i / RATE_HZ,
            "pan_rad": 3e-4 * i,
            "tilt_rad": TILT_RAD,
            "evidence": value,
        }
        if value < 14.0:
            rows.append(ContactRow(status="no_contact", **row))
        elif value < 100.0 or deep is None:
            rows.append(ContactRow(status="low_signal", in_contact=True, **row))
        else:
            place, force = np.array([0.15, 0.0, 0.0]), np.array([0.0, float(deep[i]), 0.0])
            points = {"point_antenna_m": place, "point_world_m": place, "covariance_world_m2": 1e-6 * np.eye(3)}
            forces = {"force_y_N": force[1], "force_y_std_N": 1.0, "force_z_N": 0.0, "force_z_std_N": 1.0}
            tangent = np.array([1.0, 0.0, 0.0])
            rows.append(located(distance_m=0.15, force_world_N=force, tangent_world=tangent, **points, **forces, **row))
    return ContactTable.from_rows(rows)


def located(**given: Any) -> ContactRow:
    """A located contact; of what is not given the deviations are small."""
    small = dict.fromkeys(("distance_std_m", "force_y_std_N", "force_z_std_N"), 1e-3)
    return ContactRow(**{"status": "ok", "in_contact": True, "tilt_rad": 0.0, "evidence": 1e4} | small | given)


@dataclass(frozen=True, eq=False)
class Rubbed:
    """A wire rubbing over a fixed plane z = 0: its contact walks along it, its own point slips. Truth of B frames."""

    time_s: np.ndarray
    point_m: np.ndarray
    tangent: np.ndarray
    distance_m: np.ndarray
    velocity_m_s: np.ndarray
    pan_rad: np.ndarray


def rubbed(
    longitudinal_m_s: np.ndarray, lateral_m_s: np.ndarray, walk_m_s: np.ndarray, pan_rad_s: float = 0.3
) -> Rubbed:
    """The wire lies in the plane, turned by the pan. v along it and across it (B,), and how fast the contact walks
    along the wire (B,).
    """
    time = np.arange(len(walk_m_s)) / RATE_HZ
    fine = np.linspace(0.0, time[-1], 40 * len(time) + 1)
    pan = pan_rad_s * fine
    tangent = np.column_stack([np.cos(pan), np.sin(pan), 0.0 * pan])
    across = np.column_stack([-np.sin(pan), np.cos(pan), 0.0 * pan])
    along, aside, walk = (np.interp(fine, time, each) for each in (longitudinal_m_s, lateral_m_s, walk_m_s))
    velocity = along[:, None] * tangent + aside[:, None] * across
    path = _summed(velocity + walk[:, None] * tangent, fine) + np.array([0.15, 0.0, 0.0])
    distance = 0.15 + _summed(walk[:, None], fine)[:, 0]
    at = np.searchsorted(fine, time - 1e-9)
    return Rubbed(time, path[at], tangent[at], distance[at], velocity[at], pan[at])


def _summed(rate: np.ndarray, time: np.ndarray) -> np.ndarray:
    middle = 0.5 * (rate[1:] + rate[:-1]) * np.diff(time)[:, None]
    return np.concatenate([np.zeros((1, rate.shape[1])), np.cumsum(middle, axis=0)])


def rubbed_table(
    truth: Rubbed,
    rng: np.random.Generator,
    along_m: float = 5e-4,
    across_m: float = 3e-5,
    common_m: np.ndarray | None = None,
    friction: float = 0.0,
) -> ContactTable:
    """What an estimator would make of it: the distance's error moves the point along the wire, other noise across it.

    `common_m` (3,) moves all points; `friction` leans the force across the wire, against the slip.
    """
    rows = []
    common = np.zeros(3) if common_m is None else common_m
    for i in range(len(truth.time_s)):
        tangent = truth.tangent[i]
        normal = np.array([0.0, 0.0, 1.0])
        across = np.cross(normal, tangent)
        off = along_m * rng.normal()
        point = truth.point_m[i] + common + off * tangent
        point = point + across_m * (rng.normal() * across + rng.normal() * normal)
        covariance = along_m**2 * np.outer(tangent, tangent)
        covariance += across_m**2 * (np.outer(across, across) + np.outer(normal, normal))
        slip = float(truth.velocity_m_s[i] @ across)
        force = 0.1 * (normal - friction * np.sign(slip) * across)
        rotation = Kinematics().T_world_antenna(float(truth.pan_rad[i]), 0.0).rotation
        in_antenna = rotation.T @ force
        rows.append(
            located(
                frame=i,
                time_s=float(truth.time_s[i]),
                distance_m=float(truth.distance_m[i]) + off,
                distance_std_m=along_m,
                force_y_N=in_antenna[1],
                force_z_N=in_antenna[2],
                point_antenna_m=rotation.T @ point,
                point_world_m=point,
                covariance_world_m2=covariance,
                force_world_N=force,
                tangent_world=tangent,
                pan_rad=float(truth.pan_rad[i]),
            )
        )
    return ContactTable.from_rows(rows)
