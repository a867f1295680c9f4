"""The objects that the antenna touches, as a core grown by a radius: a line for the cylinder and the knife, a point
for the sphere."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from ..errors import InputError

SHAPES = ("cylinder", "sphere", "knife_edge")


@dataclass(frozen=True, eq=False)
class TouchObject:
    """An object that stands still in the world.

    Attributes
    ----------
    shape : "cylinder", "sphere" or "knife_edge".
    center_world_m : (3,) a point on the axis, the sphere's centre, a point on the edge.
    axis_world : (3,) unit vector along the cylinder or the edge; unused for the sphere.
    radius_m : of the cylinder, the sphere or the rounding of the edge.
    half_length_m : of the cylinder or the edge, to both sides of the centre; unused for the sphere.
    stiffness_N_m : normal force per penetration; `math.inf` is rigid.
    friction : Coulomb's μ.
    wedge_world : (3,) unit vector across the axis, from the edge into the blade's body; unused but for the knife edge.
    """

    shape: str
    center_world_m: np.ndarray
    axis_world: np.ndarray
    radius_m: float
    half_length_m: float
    stiffness_N_m: float = math.inf
    friction: float = 0.0
    wedge_world: np.ndarray = field(default_factory=lambda: np.zeros(3))

    def __post_init__(self) -> None:
        if self.shape not in SHAPES:
            raise InputError(f"shape {self.shape!r} is unknown", where="object", remedy=f"give one of {SHAPES}")
        for name in ("radius_m", "half_length_m", "stiffness_N_m"):
            if not getattr(self, name) > 0.0:
                raise InputError(f"{name} is {getattr(self, name)}", where="object", remedy="give a positive number")
        if not 0.0 <= self.friction < math.inf:
            raise InputError(f"friction is {self.friction}", where="object", remedy="give 0 or more")
        units = {"sphere": (), "cylinder": ("axis_world",), "knife_edge": ("axis_world", "wedge_world")}[self.shape]
        for name in units:
            if not math.isclose(float(np.linalg.norm(getattr(self, name))), 1.0, abs_tol=1e-6):
                raise InputError(f"{name} has not length 1", where="object", remedy="give a unit vector")
        if self.shape == "knife_edge" and abs(float(np.dot(self.axis_world, self.wedge_world))) > 1e-6:
            raise InputError("wedge_world is not across axis_world", where="object", remedy="give orthogonal vectors")

    @property
    def across(self) -> np.ndarray:
        """(3, 3) world: projects on the directions across the core, the identity for the sphere."""
        along = np.zeros(3) if self.shape == "sphere" else np.asarray(self.axis_world, float)
        return np.eye(3) - np.outer(along, along)

    def signed_distance(self, points_world: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Distance from the undeformed surface, negative inside, and its outward normal.

        The cylinder and the edge count as endless here; the blade is a plate as thick as the edge's rounding. On the
        core, or on the blade's middle plane, where no direction is nearest, the normal is NaN.

        Parameters
        ----------
        points_world : (..., 3) m.

        Returns
        -------
        distance (...,) m and normal (..., 3).
        """
        offset = (np.asarray(points_world, float) - self.center_world_m) @ self.across
        if self.shape == "knife_edge":
            wedge = np.asarray(self.wedge_world, float)
            offset = offset - np.maximum(offset @ wedge, 0.0)[..., None] * wedge
        away = np.linalg.norm(offset, axis=-1)
        normal = np.divide(offset, away[..., None], out=np.full_like(offset, np.nan), where=(away > 1e-15)[..., None])
        return away - self.radius_m, normal
