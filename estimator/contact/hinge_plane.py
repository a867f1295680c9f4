"""The hinge plane: what a picture says about the antenna's planar shape once the roll ξ is supposed.

The deformation plane 𝒟 holds the antenna's x axis and is turned about it by the roll ξ, tan ξ = f_z/f_y. The antenna
lies in it, so the ray of an image point meets 𝒟 in the antenna point itself, whatever the camera's pose and lens. For
each ξ the picture is thus an exact planar shape (x′, y′), and what remains is planar mechanics.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike


@dataclass(frozen=True, eq=False)
class HingeShape:
    """Where rays meet the deformation plane.

    Attributes
    ----------
    x_m, y_m : (..., N) the paper's x′ and y′ in 𝒟; NaN where the ray does not meet 𝒟 in front of the camera.
    incidence_rad : (..., N) angle in [0, π/2] between ray and 𝒟. At 0 the camera looks along 𝒟 and sees nothing of y′;
        an error of the ray's direction by δ moves the point by about δ·distance_m/sin(incidence_rad).
    distance_m : (..., N) from the camera centre to the point.
    """

    x_m: np.ndarray
    y_m: np.ndarray
    incidence_rad: np.ndarray
    distance_m: np.ndarray


def hinge_shape(rays: ArrayLike, center_m: ArrayLike, roll_rad: ArrayLike) -> HingeShape:
    """Intersect rays with 𝒟.

    Parameters
    ----------
    rays : (..., N, 3) unit vectors from the camera centre, antenna frame.
    center_m : (..., 3) camera centre, antenna frame.
    roll_rad : (...) roll ξ of 𝒟 from plane C. The leading axes of all three broadcast: (R,) rolls scan one picture.
    """
    direction = np.asarray(rays, float)
    center = np.asarray(center_m, float)[..., None, :]
    roll = np.asarray(roll_rad, float)[..., None]
    cos, sin = np.cos(roll), np.sin(roll)
    # heights above 𝒟: of the centre in m, of the ray per metre along it
    height = cos * center[..., 2] - sin * center[..., 1]
    approach = cos * direction[..., 2] - sin * direction[..., 1]
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = -height / approach
        distance = np.where((distance > 0.0) & np.isfinite(distance), distance, np.nan)
        # a cross product, in place of the difference of two long vectors
        across = (center[..., 1] * direction[..., 2] - center[..., 2] * direction[..., 1]) / approach
    x = center[..., 0] + distance * direction[..., 0]
    return HingeShape(
        x_m=x,
        y_m=np.where(np.isnan(x), np.nan, across),
        incidence_rad=np.arcsin(np.minimum(np.abs(approach), 1.0)),
        distance_m=distance,
    )


def antenna_points(x_m: ArrayLike, y_m: ArrayLike, roll_rad: ArrayLike) -> np.ndarray:
    """Points (..., N, 3) in m in the antenna frame, of (x′, y′) (..., N) in 𝒟 with roll (...)."""
    roll = np.asarray(roll_rad, float)[..., None]
    y = np.asarray(y_m, float)
    return np.stack(np.broadcast_arrays(np.asarray(x_m, float), y * np.cos(roll), y * np.sin(roll)), axis=-1)


def onto_plane_c(points_m: ArrayLike, roll_rad: ArrayLike) -> np.ndarray:
    """Image (..., 2) on plane C, under the upright camera, of points (x′, y′) (..., 2) in 𝒟: the map T of Eq. (3).

    With f_y = f′_y·cos ξ it turns the beam's shape in 𝒟 into Eq. (4) and Eq. (5), the same shape under f_y.
    """
    points = np.asarray(points_m, float)
    return np.stack(np.broadcast_arrays(points[..., 0], points[..., 1] * np.cos(np.asarray(roll_rad, float))), axis=-1)


def camera_angle(center_m: ArrayLike, roll_rad: ArrayLike, at_m: float = 0.0) -> np.ndarray:
    """Angle (...) in rad, in [0, π/2], between 𝒟 and the line from the camera to the x axis at `at_m`: observability.

    At 0 the camera centre (..., 3) lies in 𝒟 and the antenna looks straight however it bends: no estimate is possible.
    """
    center = np.asarray(center_m, float)
    line = center - np.array([at_m, 0.0, 0.0])
    roll = np.asarray(roll_rad, float)
    height = np.cos(roll) * line[..., 2] - np.sin(roll) * line[..., 1]
    return np.arctan2(np.abs(height), np.sqrt(np.maximum((line**2).sum(axis=-1) - height**2, 0.0)))
