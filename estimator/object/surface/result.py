"""What is known of the touched object: its surface, and how far it yields."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Compliance:
    """How far the object yields under the normal force.

    Attributes
    ----------
    compliance_m_N : normal displacement per normal force, the best guess from the data alone; may come out below zero.
    std_m_N : its standard deviation, calibration included; own_std_m_N, what the frames' own noise has in it.
    stiffness_N_m : 1 / compliance; NaN unless `determined`.
    interval_N_m : (2,) 95 % interval of the stiffness; the upper end is infinite where a rigid object cannot be ruled
        out, and both are NaN where nothing can be said.
    determined : whether the data distinguish the object from a rigid one. Only then is the surface the unpressed one.
    reason : in words, what is known and what is not.
    """

    compliance_m_N: float
    std_m_N: float
    own_std_m_N: float
    stiffness_N_m: float
    interval_N_m: np.ndarray
    determined: bool
    reason: str


@dataclass(frozen=True, eq=False)
class Surface:
    """The touched part of the object, world frame: V vertices of what to draw, and P touches on it.

    Attributes
    ----------
    points_m : (V, 3). normals : (V, 3) unit, out of the object.
    triangles : (T, 3) vertex indices, counter-clockwise seen from outside.
    lines : (E, 2) vertex indices, where the contacts follow an edge or span no area.
    patch : (V,) which patch a vertex belongs to.
    std_m : (V,) standard deviation along the normal, common errors included; NaN where the contacts' is unknown.
    std_across_m : (V,) of a line, in the surface, across the line; NaN where there is an area.
    touched_m : (P, 3) where the antenna's contacts lie on the surface.
    touched_normal : (P, 3) unit, out of the object, from shape and the antenna's tangents; where these tell nothing it
        is the force's direction, and the covariance is 1 rad² in the untold directions.
    touched_normal_covariance : (P, 3, 3) rad², of the normal's turn, common errors included.
    touched_normal_modes : (P, 3, K) that part of the above which the touches have in common: the effect of K
        independent errors of unit deviation.
    touched_std_m : (P,) as `std_m`. touched_patch, touched_row, touched_frame : (P,) patch, row of the table, frame.
    touched_force_N : (P,) size of the force.
    outlier : (P,) touches that lie too far off the surface for their covariance.
    compliance : how far the object yields.
    notes : what a reader of the surface must know, in words.
    """

    points_m: np.ndarray
    normals: np.ndarray
    triangles: np.ndarray
    lines: np.ndarray
    patch: np.ndarray
    std_m: np.ndarray
    std_across_m: np.ndarray
    touched_m: np.ndarray
    touched_normal: np.ndarray
    touched_normal_covariance: np.ndarray
    touched_normal_modes: np.ndarray
    touched_std_m: np.ndarray
    touched_patch: np.ndarray
    touched_row: np.ndarray
    touched_frame: np.ndarray
    touched_force_N: np.ndarray
    outlier: np.ndarray
    compliance: Compliance
    notes: tuple[str, ...]
