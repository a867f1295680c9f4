"""The objects that the antenna touches: a core grown by a radius, or a body in free form.

The core is a line for the cylinder and the knife, a point for the sphere, a quarter of space for the box's edge.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from vbaa_calib.core.errors import InputError

from .bumps import Bump, elevation, implicit, nearest_distance

SHAPES = ("cylinder", "sphere", "knife_edge", "box_edge", "freeform")
LINES = ("cylinder", "knife_edge", "box_edge")
"""Shapes with an axis, along which they end."""
WEDGES = ("knife_edge", "box_edge")


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
            distance, normal = nearest_distance(offset.reshape(-1, 3), self.radius_m, self.bumps)
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


BOX_FACE_M = 0.03
"""How deep a box's two faces are drawn."""
_STEPS, _HIT_M = 100, 1e-6
_STEEPEST = math.exp(-0.5)
"""Largest slope of a bump, in its height over its width."""


def march(obj: TouchObject, origin_m: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Depth (N,) of the first hits, in lengths of the rays' vectors (N, 3), world frame; inf for a miss."""
    bound = _from_box(obj) if obj.shape == "box_edge" else _from_freeform(obj)
    length = np.linalg.norm(directions, axis=1)
    enter, leave = _ball(obj, origin_m, directions / length[:, None])
    depth, found = enter.copy(), np.full(len(enter), np.inf)
    rows = np.flatnonzero(enter < leave)
    for _ in range(_STEPS):
        if rows.size == 0:
            break
        room = bound(origin_m + (depth[rows] / length[rows])[:, None] * directions[rows])
        hit = room < _HIT_M
        found[rows[hit]] = depth[rows[hit]]
        depth[rows] += room
        rows = rows[~hit & (depth[rows] < leave[rows])]
    return found / length


def surface_at(obj: TouchObject, points_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Outward normal (N, 3) and number of the face (N,) at points of the drawn surface."""
    offset = points_m - obj.center_world_m
    if obj.shape == "freeform":
        slope = implicit(offset, obj.radius_m, obj.bumps)[1]
        return slope / np.linalg.norm(slope, axis=1, keepdims=True), np.zeros(len(offset), int)
    ends = _box_ends(obj)
    room = np.column_stack([obj.signed_distance(points_m)[0], offset @ ends[0].T - ends[1]])
    face = room.argmax(axis=1)
    normals = np.where((face == 0)[:, None], obj.signed_distance(points_m)[1], ends[0][np.maximum(face - 1, 0)])
    return normals, face


def reach_m(obj: TouchObject) -> float:
    """Radius about the centre that holds what is drawn."""
    if obj.shape == "freeform":
        return obj.radius_m + sum(max(one.height_m, 0.0) for one in obj.bumps)
    return math.hypot(obj.half_length_m, math.sqrt(2.0) * max(BOX_FACE_M, obj.radius_m))


def _box_ends(obj: TouchObject) -> tuple[np.ndarray, np.ndarray]:
    """Half-spaces normal·(x − centre) ≤ offset, (4, 3) and (4,), that end the box's faces and its edge."""
    axis = np.asarray(obj.axis_world, float)
    return np.vstack([obj.into_faces, axis, -axis]), np.array([BOX_FACE_M] * 2 + [obj.half_length_m] * 2)


def _from_box(obj: TouchObject) -> Callable[[np.ndarray], np.ndarray]:
    normals, offsets = _box_ends(obj)

    def bound(points_m: np.ndarray) -> np.ndarray:
        ends = ((points_m - obj.center_world_m) @ normals.T - offsets).max(axis=1)
        return np.asarray(np.maximum(ends, obj.signed_distance(points_m)[0]))

    return bound


def _from_freeform(obj: TouchObject) -> Callable[[np.ndarray], np.ndarray]:
    steepest = 1.0 + _STEEPEST * sum(abs(one.height_m) / one.width_m for one in obj.bumps)

    def bound(points_m: np.ndarray) -> np.ndarray:
        return elevation(points_m - obj.center_world_m, obj.radius_m, obj.bumps) / steepest

    return bound


def _ball(obj: TouchObject, origin_m: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where unit rays enter and leave the ball of `reach_m`, m; (inf, −inf) for those that pass by."""
    start = origin_m - obj.center_world_m
    half = directions @ start
    root = half**2 - float(start @ start - (1.01 * reach_m(obj)) ** 2)
    spread = np.sqrt(np.maximum(root, 0.0))
    enter = np.where(root < 0, np.inf, np.maximum(-half - spread, 0.0))
    return enter, np.where(root < 0, -np.inf, -half + spread)
