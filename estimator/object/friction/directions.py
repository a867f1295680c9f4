"""The force of each touch against the object's normal and across the antenna: which way, and how surely (Fig. 5)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.distance import cdist

from estimator.contact.common_errors import Shared
from estimator.table.contacts import ContactTable
from estimator.table.joint_angles import joint_angles
from vbaa_calib.geometry import Kinematics

LEAST_STD_RAD = 1e-4
"""No direction is known better than that: rigs that are said to be exact would else be believed without limit."""
LEAST_OWN = 0.2
"""So much of a deviation at least is taken for the frame's own."""


@dataclass(frozen=True, eq=False)
class Axes:
    """At P touches, world frame: (P, 3) each, orthonormal; NaN where the antenna's tangent is not known.

    `normal` is the shape's; where the antenna's side touches, less its part along the antenna, since a smooth wire lies
    flat on whatever it touches. `along` is the antenna's tangent, at its tip less its part along the normal.
    `lateral` = normal × along.
    """

    normal: np.ndarray
    along: np.ndarray
    lateral: np.ndarray

    @staticmethod
    def of(normal: np.ndarray, tangent: np.ndarray, at_tip: np.ndarray) -> Axes:
        """From unit vectors (P, 3), and where (P,) the tip touches."""
        lateral = unit(np.cross(normal, tangent))
        flat = unit(np.cross(tangent, lateral))
        return Axes(
            np.where(at_tip[:, None], normal, flat),
            np.where(at_tip[:, None], np.cross(lateral, normal), tangent),
            lateral,
        )


@dataclass(frozen=True, eq=False)
class Directions:
    """Directions of P forces. Angles in rad; NaN where unknown.

    Attributes
    ----------
    lateral_rad : (P,) of the force from the normal about the antenna, positive along `Axes.lateral`.
    lateral_std_rad, lateral_modes_rad : (P,), (P, S) the force's own and common errors in it.
    longitudinal_rad, longitudinal_std_rad : (P,) the friction angle as estimated, see `ContactTable`; in all.
    """

    lateral_rad: np.ndarray
    lateral_std_rad: np.ndarray
    lateral_modes_rad: np.ndarray
    longitudinal_rad: np.ndarray
    longitudinal_std_rad: np.ndarray


def unit(vectors: np.ndarray) -> np.ndarray:
    """(..., 3) of length 1; NaN in place of nothing."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.where(length > 1e-9, length, np.nan)


def dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(P,) of vectors (P, 3)."""
    return np.sum(a * b, axis=1)


def directions(table: ContactTable, shared: Shared, rows: np.ndarray, axes: Axes) -> Directions:
    """Of the forces in these rows (P,) of the table: what is not common in their deviations is each one's own."""
    force = table.force_world_N[rows]
    across = np.hypot(dot(force, axes.normal), dot(force, axes.lateral))
    across, whole = np.where(across > 0.0, across, np.nan), roll_std_rad(table)[rows]
    angle = np.arctan2(dot(force, axes.lateral), dot(force, axes.normal))
    if shared.point_m.shape[2]:
        modes = np.einsum("pi,pis->ps", axes.lateral, shared.force_N[rows]) / across[:, None]
        own = np.sqrt(np.maximum(whole**2 - np.sum(modes**2, axis=1), (LEAST_OWN * whole) ** 2))
    else:  # how much is common is not known: it counts as both, as a turn of all forces and as a stretch
        stretch = np.hypot(table.force_y_std_N, table.force_z_std_N)[rows] / across
        own, modes = whole, np.stack([whole, 0.5 * np.sin(2.0 * angle) * stretch], axis=1)
    return Directions(
        angle,
        np.maximum(own, LEAST_STD_RAD),
        modes,
        table.friction_angle_rad[rows],
        table.friction_angle_std_rad[rows],
    )


def roll_rad(table: ContactTable) -> np.ndarray:
    """(B,) the paper's ψ: direction of the force in the antenna's yz plane, from y towards z (Fig. 5)."""
    return np.arctan2(table.force_z_N, table.force_y_N)


def roll_std_rad(table: ContactTable) -> np.ndarray:
    """(B,) its standard deviation in all, as if the two components erred independently."""
    y, z = table.force_y_N, table.force_z_N
    square = y**2 + z**2
    return np.hypot(z * table.force_y_std_N, y * table.force_z_std_N) / np.where(square > 0.0, square, np.nan)


def roll_of(kinematics: Kinematics, table: ContactTable, rows: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """(P,) direction of world vectors (P, 3) in the antenna's yz plane, as `roll_rad`; the paper's ν for normals."""
    pan, tilt = joint_angles(kinematics, table)
    rotation, _ = kinematics.world_antenna(pan[rows], tilt[rows])
    local = np.einsum("pji,pj->pi", rotation, vectors)
    return np.arctan2(local[:, 2], local[:, 1])


NEAR = 0.3
"""Touches within so much of the patch's extent of each are looked at: where it stuck there may be many in one place."""
SHARE = 0.2
"""They must spread across the antenna by so much of what they spread along it: a shape that was only felt along the
antenna has no slope across it, and small errors of the points along it pass for one."""
NOISE = 4.0
"""And by so many of the deviations that they usually have."""


def side_by_side(point_m: np.ndarray, own_m2: np.ndarray, axes: Axes, patch: np.ndarray) -> np.ndarray:
    """(P,) bool, of points (P, 3) with own covariances (P, 3, 3) on patches (P,); False where these are not known."""
    same = patch[:, None] == patch
    apart = np.where(same, cdist(point_m, point_m), 0.0)
    extent = np.array([apart[patch == label].max() for label in patch])
    near = same & (apart <= NEAR * extent[:, None])
    offset = point_m - point_m[:, None]
    across, along = (_spread(np.einsum("pni,pi->pn", offset, axis), near) for axis in (axes.lateral, axes.along))
    noise = np.sqrt(np.maximum(np.einsum("pi,pij,pj->p", axes.lateral, own_m2, axes.lateral), 0.0))
    usual = np.array([np.median(noise[each]) for each in near])
    return (across > SHARE * along) & (across > NOISE * usual)


def _spread(values: np.ndarray, counted: np.ndarray) -> np.ndarray:
    """(P,) standard deviations of the counted ones of (P, N)."""
    number = counted.sum(axis=1)
    mean = np.where(counted, values, 0.0).sum(axis=1) / number
    return np.sqrt(np.where(counted, (values - mean[:, None]) ** 2, 0.0).sum(axis=1) / number)
