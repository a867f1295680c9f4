"""The objects that the antenna touches: a core grown by a radius, or a body in free form.

The core is a line for the cylinder and the knife, a point for the sphere, a quarter of space for the box's edge. The
free form is a ball with bumps and dents; its surface is F(p) = 0 with p counted from the centre and

    F(p) = |p| − R − Σ height · exp(−|p − R·direction|² / (2·width²))

Gradient and curvature are exact, so that the nearest point of the surface is found by Newton's method.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from vbaa_calib.core.errors import InputError

SHAPES = ("cylinder", "sphere", "knife_edge", "box_edge", "freeform")
LINES = ("cylinder", "knife_edge", "box_edge")
"""Shapes with an axis, along which they end."""
WEDGES = ("knife_edge", "box_edge")
BOX_FACE_M = 0.03
"""How deep a box's two faces are drawn."""

_ITERATIONS = 30
_TOLERANCE = 1e-14
_RADIUS_ITERATIONS = 6
_STEEPEST = 0.5
"""Height over width up to which F still grows from the centre outwards near the surface: |F's slope| > 1 − 0.61·0.5."""


@dataclass(frozen=True, eq=False)
class Bump:
    """A bump, or a dent where its height is negative.

    Attributes
    ----------
    direction_world : (3,) unit vector from the body's centre to its middle.
    height_m : above the ball. width_m : standard deviation of its Gaussian.
    """

    direction_world: np.ndarray
    height_m: float
    width_m: float

    def __post_init__(self) -> None:
        if not abs(float(np.linalg.norm(self.direction_world)) - 1.0) < 1e-6:
            raise InputError("direction_world has not length 1", where="bump", remedy="give a unit vector")
        if not (self.width_m > 0.0 and abs(self.height_m) <= _STEEPEST * self.width_m):
            raise InputError(
                f"a bump {self.height_m} m high and {self.width_m} m wide is too steep",
                where="bump",
                remedy=f"keep its height below {_STEEPEST} of its width",
            )


@dataclass(frozen=True, eq=False)
class TouchObject:
    """An object that stands still in the world.

    Attributes
    ----------
    shape : one of `SHAPES`.
    center_world_m : (3,) a point on the axis, the centre of sphere or free form, a point on the middle of the edge's
        rounding.
    axis_world : (3,) unit vector along the cylinder or the edge; unused for sphere and free form.
    radius_m : of the cylinder, the sphere, the rounding of the edge, the free form without its bumps.
    half_length_m : of the cylinder or the edge, to both sides of the centre; unused for sphere and free form.
    stiffness_N_m : normal force per penetration; `math.inf` is rigid.
    friction : Coulomb's μ.
    wedge_world : (3,) unit vector across the axis, from the edge into the body, for the box between its two faces;
        unused but for the two edges.
    bumps : of the free form.
    """

    shape: str
    center_world_m: np.ndarray
    axis_world: np.ndarray
    radius_m: float
    half_length_m: float
    stiffness_N_m: float = math.inf
    friction: float = 0.0
    wedge_world: np.ndarray = field(default_factory=lambda: np.zeros(3))
    bumps: tuple[Bump, ...] = ()

    def __post_init__(self) -> None:
        if self.shape not in SHAPES:
            raise InputError(f"shape {self.shape!r} is unknown", where="object", remedy=f"give one of {SHAPES}")
        for name in ("radius_m", "half_length_m", "stiffness_N_m"):
            if not getattr(self, name) > 0.0:
                raise InputError(f"{name} is {getattr(self, name)}", where="object", remedy="give a positive number")
        if not 0.0 <= self.friction < math.inf:
            raise InputError(f"friction is {self.friction}", where="object", remedy="give 0 or more")
        units = (("axis_world",) if self.shape in LINES else ()) + (("wedge_world",) if self.shape in WEDGES else ())
        for name in units:
            if not math.isclose(float(np.linalg.norm(getattr(self, name))), 1.0, abs_tol=1e-6):
                raise InputError(f"{name} has not length 1", where="object", remedy="give a unit vector")
        if self.shape in WEDGES and abs(float(np.dot(self.axis_world, self.wedge_world))) > 1e-6:
            raise InputError("wedge_world is not across axis_world", where="object", remedy="give orthogonal vectors")
        if self.bumps and self.shape != "freeform":
            raise InputError(f"a {self.shape} has no bumps", where="object", remedy="take the shape freeform")

    @property
    def across(self) -> np.ndarray:
        """(3, 3) world: projects on the directions across the axis, the identity where there is none."""
        along = np.asarray(self.axis_world, float) if self.shape in LINES else np.zeros(3)
        return np.eye(3) - np.outer(along, along)

    @property
    def into_faces(self) -> np.ndarray:
        """(2, 3) unit vectors into the box, each across one of its two faces."""
        side = np.cross(self.axis_world, self.wedge_world)
        return np.stack([self.wedge_world - side, self.wedge_world + side]) / math.sqrt(2.0)

    def within(self, points_world: np.ndarray) -> np.ndarray:
        """(...) whether points (..., 3) lie between the ends of cylinder or edge."""
        if self.shape not in LINES:
            return np.ones(np.shape(points_world)[:-1], bool)
        along = (np.asarray(points_world, float) - self.center_world_m) @ self.axis_world
        return np.asarray(np.abs(along) <= self.half_length_m)

    def signed_distance(self, points_world: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Distance from the undeformed surface, negative inside, and its outward normal at the nearest point.

        Cylinder and edges count as endless here, and so do the box's faces; the blade is a plate as thick as the edge's
        rounding. On the core, or on the blade's middle plane, where no direction is nearest, the normal is NaN.

        Parameters
        ----------
        points_world : (..., 3) m.

        Returns
        -------
        distance (...,) m and normal (..., 3).
        """
        offset = np.asarray(points_world, float) - self.center_world_m
        if self.shape == "freeform":
            distance, normal = _nearest_distance(offset.reshape(-1, 3), self.radius_m, self.bumps)
            return distance.reshape(offset.shape[:-1]), normal.reshape(offset.shape)
        if self.shape == "box_edge":
            return self._from_box(offset)
        offset = offset @ self.across
        if self.shape == "knife_edge":
            wedge = np.asarray(self.wedge_world, float)
            offset = offset - np.maximum(offset @ wedge, 0.0)[..., None] * wedge
        return self._grown(offset)

    def rough_distance(self, points_world: np.ndarray) -> np.ndarray:
        """(...) what takes less time and tells which of the points (..., 3) is nearest: zero on the surface too."""
        if self.shape != "freeform":
            return self.signed_distance(points_world)[0]
        offset = np.asarray(points_world, float) - self.center_world_m
        return elevation(offset, self.radius_m, self.bumps)

    def _grown(self, offset: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Distance and normal by the offset (..., 3) from the nearest point of the core."""
        away = np.linalg.norm(offset, axis=-1)
        normal = np.divide(offset, away[..., None], out=np.full_like(offset, np.nan), where=(away > 1e-15)[..., None])
        return away - self.radius_m, normal

    def _from_box(self, offset: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        into = self.into_faces
        depth = offset @ into.T
        distance, normal = self._grown(np.minimum(depth, 0.0) @ into)
        # inside the core the nearer face counts
        inside = (depth > 0.0).all(axis=-1)
        nearer = np.argmin(depth, axis=-1)
        return (
            np.where(inside, -depth.min(axis=-1) - self.radius_m, distance),
            np.where(inside[..., None], -into[nearer], normal),
        )


def implicit(points_m: np.ndarray, radius_m: float, bumps: Sequence[Bump]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """F (K,), its gradient (K, 3) and its second derivatives (K, 3, 3) at points (K, 3) from the centre, not on it."""
    away = np.linalg.norm(points_m, axis=1)
    outward = points_m / away[:, None]
    value, slope = away - radius_m, outward.copy()
    bend = (np.eye(3) - outward[:, :, None] * outward[:, None, :]) / away[:, None, None]
    for bump in bumps:
        offset = points_m - radius_m * bump.direction_world
        square = bump.width_m**2
        lift = bump.height_m * np.exp(-0.5 * (offset**2).sum(axis=1) / square)
        value = value - lift
        slope = slope + (lift / square)[:, None] * offset
        outer = offset[:, :, None] * offset[:, None, :] / square
        bend = bend + (lift / square)[:, None, None] * (np.eye(3) - outer)
    return value, slope, bend


def elevation(points_m: np.ndarray, radius_m: float, bumps: Sequence[Bump]) -> np.ndarray:
    """F (...) at points (..., 3) from the centre."""
    value = np.linalg.norm(points_m, axis=-1) - radius_m
    for bump in bumps:
        square = ((points_m - radius_m * bump.direction_world) ** 2).sum(axis=-1)
        value = value - bump.height_m * np.exp(-0.5 * square / bump.width_m**2)
    return np.asarray(value)


def _nearest_distance(points_m: np.ndarray, radius_m: float, bumps: Sequence[Bump]) -> tuple[np.ndarray, np.ndarray]:
    """Signed distance (K,) from the surface, negative inside, and its outward normal (K, 3) at the nearest point.

    Where no nearest point is found, deep inside, they are F over its slope, and the slope's direction; NaN in the
    centre.
    """
    points = np.asarray(points_m, float)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        away = np.linalg.norm(points, axis=1)
        outward = points / away[:, None]
        # the surface along each point's direction from the centre, and the multiplier that belongs to it
        radius = surface_radius(outward, radius_m, bumps)
        foot, share = radius[:, None] * outward, away - radius
        found, rows = np.zeros(len(points), bool), np.arange(len(points))
        for _ in range(_ITERATIONS):
            value, slope, bend = implicit(foot[rows], radius_m, bumps)
            left = np.concatenate([foot[rows] + share[rows, None] * slope - points[rows], value[:, None]], axis=1)
            found[rows] = np.abs(left).max(axis=1) <= _TOLERANCE
            open_rows = ~found[rows]
            rows, left = rows[open_rows], left[open_rows]
            if rows.size == 0:
                break
            step = _solved(share[rows], slope[open_rows], bend[open_rows], left)
            foot[rows] -= step[:, :3]
            share[rows] -= step[:, 3]
        at = np.where(found[:, None], foot, points)
        value, slope, _ = implicit(at, radius_m, bumps)
        steep = np.linalg.norm(slope, axis=1)
        return np.where(found, share * steep, value / steep), slope / steep[:, None]


def surface_radius(directions: np.ndarray, radius_m: float, bumps: Sequence[Bump]) -> np.ndarray:
    """(K,) distance of the surface from the centre along unit vectors (K, 3)."""
    radius = np.full(len(directions), radius_m)
    for _ in range(_RADIUS_ITERATIONS):
        value, slope, _ = implicit(radius[:, None] * directions, radius_m, bumps)
        radius = radius - value / (slope * directions).sum(axis=1)
    return radius


def _solved(share: np.ndarray, slope: np.ndarray, bend: np.ndarray, left: np.ndarray) -> np.ndarray:
    """(K, 4) Newton's steps of foot and multiplier; zero where the system is singular."""
    matrix = np.zeros((len(share), 4, 4))
    matrix[:, :3, :3] = np.eye(3) + share[:, None, None] * bend
    matrix[:, :3, 3] = matrix[:, 3, :3] = slope
    usable = np.isfinite(matrix).all(axis=(1, 2)) & np.isfinite(left).all(axis=1)
    step = np.zeros((len(share), 4))
    try:
        step[usable] = np.linalg.solve(matrix[usable], left[usable, :, None])[..., 0]
    except np.linalg.LinAlgError:
        step[usable] = np.einsum("bij,bj->bi", np.linalg.pinv(matrix[usable]), left[usable])
    return step
