"""Friction of an object from its touches (Fig. 5)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from estimator.table.contacts import ContactTable

from .coefficient import coefficient, enough, verdict
from .directions import Axes, Directions, dot, roll_of, roll_rad, roll_std_rad, unit
from .evidence import Evidence
from .normals import Friction, normals_of
from .touches import rubs_of

if TYPE_CHECKING:
    from estimator.contact.common_errors import Shared
    from estimator.object.surface import Surface
    from estimator.object.track.result import Track
    from vbaa_calib.rig import Rig


def friction(
    table: ContactTable, surface: Surface, track: Track, shared: Shared, friction_rad: float, rig: Rig | None = None
) -> Friction:
    """One μ for the object; forces against normals; normals by the force.

    Parameters
    ----------
    surface, track : of the same table.
    shared : what the frames' errors have in common; `Shared.none` where the rig is not known, which then counts
        every error as common and as the frame's own.
    friction_rad : standard deviation of the friction angle that the contacts were estimated with.
    rig : for ν, the normals' direction in the antenna's yz plane.
    """
    rubs, axes, found = rubs_of(table, surface, track, shared, friction_rad)
    evidence = Evidence.of(rubs if enough(rubs) else rubs.at_rest())
    mu = coefficient(evidence) if len(evidence.angle_rad) else None
    said = verdict(rubs, mu)
    rows, normal = surface.touched_row, surface.touched_normal
    covariance = surface.touched_normal_covariance + _untold(axes, ~rubs.beside)
    whole = np.sqrt(
        found.lateral_std_rad**2
        + np.sum(found.lateral_modes_rad**2, axis=1)
        + np.einsum("pi,pij,pj->p", axes.lateral, covariance, axes.lateral)
    )
    angle, angle_std = _angles(table.force_world_N[rows], axes, found, whole)
    unknown = np.full(len(rows), np.nan)
    nu = unknown if rig is None else roll_of(rig.kinematics, table, rows, normal)
    nu_std = unknown if rig is None else np.sqrt(np.einsum("pi,pij,pj->p", axes.lateral, covariance, axes.lateral))
    return Friction(
        mu=mu.mu if mu is not None and said.told else np.nan,
        std=mu.std if mu is not None and said.told else np.nan,
        interval=said.interval,
        cone_half_angle_rad=float(np.arctan(mu.mu)) if mu is not None and said.told else np.nan,
        told=said.told,
        reason=said.reason,
        scatter=np.nan if mu is None else mu.scatter,
        used_as=rubs.used_as,
        row=rows,
        angle_rad=angle,
        angle_std_rad=angle_std,
        lateral_rad=found.lateral_rad,
        lateral_std_rad=whole,
        longitudinal_rad=found.longitudinal_rad,
        longitudinal_std_rad=found.longitudinal_std_rad,
        psi_rad=roll_rad(table)[rows],
        psi_std_rad=_roll_std(table, shared, rows, found),
        nu_rad=nu,
        nu_std_rad=nu_std,
        lateral_slip=rubs.slip[:, 0],
        normals=normals_of(normal, covariance, axes, rubs, found, mu if said.stands else None, said.interval[1]),
    )


def _untold(axes: Axes, where: np.ndarray) -> np.ndarray:
    """(P, 3, 3) 1 rad² of turn about the antenna, where (P,) the shape cannot tell it."""
    turn = np.where(where[:, None], np.nan_to_num(axes.lateral), 0.0)
    return turn[:, :, None] * turn[:, None, :]


def _roll_std(table: ContactTable, shared: Shared, rows: np.ndarray, found: Directions) -> np.ndarray:
    """(P,) of ψ: with a rig the two components' errors are known together, without one they are not."""
    if not shared.point_m.shape[2]:
        return roll_std_rad(table)[rows]
    return np.sqrt(found.lateral_std_rad**2 + np.sum(found.lateral_modes_rad**2, axis=1))


def _angles(force: np.ndarray, axes: Axes, found: Directions, lateral_std: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Angle (P,) between forces and normals and its deviation (P,); of its two parts the larger one counts most."""
    direction = unit(force)
    parts = np.stack([dot(direction, axes.lateral), dot(direction, axes.along)], axis=1)
    sideways = np.linalg.norm(parts, axis=1)
    angle = np.arctan2(sideways, dot(direction, axes.normal))
    share = parts / np.where(sideways > 1e-12, sideways, 1.0)[:, None]
    variance = (share[:, 0] * lateral_std) ** 2 + (share[:, 1] * found.longitudinal_std_rad) ** 2
    return angle, np.sqrt(variance)
