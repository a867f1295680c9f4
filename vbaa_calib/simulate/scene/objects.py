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
from types import SimpleNamespace
from typing import Annotated, Literal

import numpy as np
from pydantic import AfterValidator, Field, Strict

from vbaa_calib.core.models import Number, array_of, read_as
from vbaa_calib.native import core

SHAPES = ("cylinder", "sphere", "knife_edge", "box_edge", "freeform")
"""In the order of the core's kinds."""
LINES = ("cylinder", "knife_edge", "box_edge")
"""Shapes with an axis, along which they end."""
WEDGES = ("knife_edge", "box_edge")
BOX_FACE_M = 0.03
"""How deep a box's two faces are."""


def _unit(vector: np.ndarray) -> np.ndarray:
    largest = float(np.abs(vector).max())
    if largest < 1e-9:
        raise ValueError("has no length", "a direction in x, y, z is needed")
    # scaled first: the square of a huge number is none
    return vector / largest / np.linalg.norm(vector / largest)


Direction = Annotated[np.ndarray, read_as(Annotated[np.ndarray, array_of(3)], _unit)]
"""A unit vector, in scene files of any length."""


@dataclass(frozen=True, eq=False)
class Bump:
    """A bump of the surface; a dent where its height is negative.

    Attributes
    ----------
    direction_world : (3,) unit vector from the body's centre to its middle.
    height_m : above the ball. width_m : standard deviation of its Gaussian.
    """

    direction_world: Direction
    height_m: Annotated[Number, Field(ge=-0.5, le=0.5)]
    width_m: Annotated[Number, Field(ge=1e-4, le=1)]


def _gentle(bump: Bump) -> Bump:
    # up to such a height over its width `implicit` grows outwards near the surface: its slope there is above
    # 1 − 0.61·0.5
    steepest = 0.5
    if abs(bump.height_m) > steepest * bump.width_m:
        what = f"does not fit: a bump {bump.height_m} m high and {bump.width_m} m wide is too steep"
        raise ValueError(what, f"keep its height below {steepest} of its width", "height_m")
    return bump


_Bumps = Annotated[
    tuple[Bump, ...],
    read_as(Annotated[list[Annotated[Bump, AfterValidator(_gentle)]], Strict(), Field(min_length=1)], tuple),
]


@dataclass(frozen=True, eq=False)
class TouchObject:
    """An object at rest in the world.

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

    shape: Annotated[str, read_as(Literal["cylinder", "sphere", "knife_edge", "box_edge", "freeform"], str)]
    center_world_m: Annotated[np.ndarray, array_of(3)]
    axis_world: Annotated[Direction, Field(default=None)]
    radius_m: Annotated[Number, Field(ge=1e-6, le=1)]
    half_length_m: Annotated[Number, Field(ge=1e-3, le=10, default=0.1)]
    stiffness_N_m: Annotated[Number, Field(ge=1e-3, le=1e12)] = math.inf
    friction: Annotated[Number, Field(ge=0, le=2)] = 0.0
    wedge_world: Direction = field(default_factory=lambda: np.zeros(3))
    bumps: _Bumps = ()

    @property
    def across(self) -> np.ndarray:
        """(3, 3) projection onto the directions across the axis, world frame; the identity where there is no axis."""
        along = np.asarray(self.axis_world, float) if self.shape in LINES else np.zeros(3)
        return np.eye(3) - np.outer(along, along)

    @property
    def into_faces(self) -> np.ndarray:
        """(2, 3) unit vectors into the box, normal to its two faces."""
        side = np.cross(self.axis_world, self.wedge_world)
        return np.stack([self.wedge_world - side, self.wedge_world + side]) / math.sqrt(2.0)

    def within(self, points_world: np.ndarray) -> np.ndarray:
        """(...) mask of points (..., 3) that lie between the ends of cylinder or edge, and on the faces of the box."""
        if self.shape not in LINES:
            return np.ones(np.shape(points_world)[:-1], bool)
        from_centre = np.asarray(points_world, float) - self.center_world_m
        inside = np.abs(from_centre @ self.axis_world) <= self.half_length_m
        if self.shape == "box_edge":
            inside &= (from_centre @ self.into_faces.T <= BOX_FACE_M).all(axis=-1)
        return np.asarray(inside)

    def signed_distance(self, points_world: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Distance from the undeformed surface, negative inside, and its outward normal at the nearest point.

        Cylinder, edges and the box's faces count as endless here (see `within`); the blade is a plate as thick as the
        edge's rounding. On the core, or on the blade's middle plane, where no direction is nearest, the normal is NaN.

        Parameters
        ----------
        points_world : (..., 3) m.

        Returns
        -------
        distance (...,) m and normal (..., 3).
        """
        points = np.asarray(points_world, float)
        distance, normal = core.simulate.signed_distances(self.numbers, points.reshape(-1, 3))
        return distance.reshape(points.shape[:-1]), normal.reshape(points.shape)

    def rough_distance(self, points_world: np.ndarray) -> np.ndarray:
        """(...) a quantity that grows with the distance of points (..., 3) from the surface and is zero on it,
        cheaper than the distance itself."""
        points = np.asarray(points_world, float)
        return core.simulate.rough_distances(self.numbers, points.reshape(-1, 3)).reshape(points.shape[:-1])

    def radius_along(self, directions: np.ndarray) -> np.ndarray:
        """(K,) distance of the surface of a sphere or free form from the centre along unit vectors (K, 3)."""
        return core.simulate.surface_radii(directions, self.numbers.radius_m, self.numbers.bumps)

    @property
    def numbers(self) -> SimpleNamespace:
        """The object as the compiled core reads it: its kind, vectors (3,), and bumps (K, 5): directions, heights,
        widths."""
        center, axis, wedge = (
            np.ascontiguousarray(v, float) for v in (self.center_world_m, self.axis_world, self.wedge_world)
        )
        return SimpleNamespace(
            kind=SHAPES.index(self.shape),
            center_m=center,
            axis=axis,
            wedge=wedge,
            radius_m=float(self.radius_m),
            bumps=_rows(self.bumps),
        )


def _rows(bumps: Sequence[Bump]) -> np.ndarray:
    """(K, 5) directions, heights and widths of the bumps."""
    rows = [[*bump.direction_world, bump.height_m, bump.width_m] for bump in bumps]
    return np.array(rows, float) if rows else np.zeros((0, 5))


def implicit(points_m: np.ndarray, radius_m: float, bumps: Sequence[Bump]) -> tuple[np.ndarray, np.ndarray]:
    """F (...) and its gradient (..., 3) at points (..., 3) relative to the centre; at the centre the gradient is
    NaN."""
    points = np.asarray(points_m, float)
    value, slope = core.simulate.elevations(points.reshape(-1, 3), radius_m, _rows(bumps))
    return value.reshape(points.shape[:-1]), slope.reshape(points.shape)
