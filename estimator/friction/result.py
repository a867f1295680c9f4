"""Friction of an object, with its uncertainty, or why it cannot be told."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .normals import Normals


@dataclass(frozen=True, eq=False)
class Friction:
    """What P touches say of the friction between antenna and object, one μ for both sticking and sliding.

    Attributes
    ----------
    mu, std : coefficient of friction and its standard deviation; NaN unless `told`.
    interval : (2,) of 95 %, common errors included. Where μ is not told, its one-sided bounds at 95 %: 0 and inf where
        there is none.
    cone_half_angle_rad : the paper's α = atan μ; NaN unless `told`.
    told : whether the data tell μ. reason : in words, what it rests on, or why it is not told.
    scatter : how much more the sliding touches scatter than they should; the deviations were widened where above 1.
    used_as : (P,) "sliding": friction is μN against the slip; "sticking": at most that; "unused".
    row : (P,) of the table.
    angle_rad, angle_std_rad : (P,) between force and shape's normal. Never negative, so about as large as its deviation
        where nothing rubs.
    lateral_rad, lateral_std_rad : (P,) its part about the antenna, from the shape's normal towards normal × tangent.
    longitudinal_rad, longitudinal_std_rad : (P,) its part along the antenna, towards the clamp: the estimator's
        friction angle, which is as good as unknown where its deviation is about what was said before.
    psi_rad, psi_std_rad : (P,) direction of the force in the antenna's yz plane (Fig. 5).
    nu_rad, nu_std_rad : (P,) the shape's normal's in the same; NaN without the rig.
    lateral_slip : (P,) share of the slip that is across the antenna, signed; NaN where nothing slides.
    normals : of shape, tangents and force together.
    """

    mu: float
    std: float
    interval: np.ndarray
    cone_half_angle_rad: float
    told: bool
    reason: str
    scatter: float
    used_as: np.ndarray
    row: np.ndarray
    angle_rad: np.ndarray
    angle_std_rad: np.ndarray
    lateral_rad: np.ndarray
    lateral_std_rad: np.ndarray
    longitudinal_rad: np.ndarray
    longitudinal_std_rad: np.ndarray
    psi_rad: np.ndarray
    psi_std_rad: np.ndarray
    nu_rad: np.ndarray
    nu_std_rad: np.ndarray
    lateral_slip: np.ndarray
    normals: Normals
