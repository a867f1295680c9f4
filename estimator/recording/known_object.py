"""An object whose place is known: contacts on it tell where the antenna was touched, and so the rig's errors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from vbaa_calib.antenna.nodes import CONTACT

if TYPE_CHECKING:
    from estimator.solver.linearised import Linearised
    from vbaa_calib.session import KnownObject

_ROUND_M = 1e-5
"""How far a touched place may be from where pin and antenna would meet: neither is quite round or straight."""


@dataclass(frozen=True, eq=False)
class KnownLine:
    """A straight pin or edge in the world: where the antenna touches it, the antenna's axis passes at a known distance.

    With a the line's direction, t the antenna's tangent and n ∝ ± a × t, the contact point X lies at (r + r_antenna)·n
    from the line, whichever way it slid along it: two equations across a, of which the one along t tells the distance.

    Attributes
    ----------
    position_m : (3,) a point on its axis. direction : (3,) unit. radius_m : 0 for a sharp edge.
    std_m : how well its place is known along each axis, the same error in all frames.
    """

    position_m: np.ndarray
    direction: np.ndarray
    radius_m: float
    std_m: float

    @staticmethod
    def of(known: KnownObject) -> KnownLine:
        """As session.yaml gives it."""
        return KnownLine(known.position_m, known.direction, known.radius_m, known.std_m)

    def residuals(
        self, point_m: np.ndarray, tangent: np.ndarray, force: np.ndarray, antenna_radius_m: float, shift: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Of contact points, tangents and forces (B, 3), world frame: (B, 2) m, and the (2, 3) axes they are along.

        shift : (3,) of the object's place in its deviations.
        """
        across = np.linalg.svd(self.direction[None])[2][1:]
        normal = np.cross(self.direction, tangent)
        size = np.linalg.norm(normal, axis=1, keepdims=True)
        normal = normal / np.where(size > 1e-6, size, np.nan)
        normal *= np.where(np.sum(normal * force, axis=1, keepdims=True) < 0.0, -1.0, 1.0)
        reach = (self.radius_m + antenna_radius_m) * normal
        off = point_m - self.position_m - self.std_m * shift - np.nan_to_num(reach)
        return off @ across.T, across

    def equations(
        self,
        found: Linearised,
        columns: np.ndarray,
        rotation: np.ndarray,
        translation: np.ndarray,
        radius_m: float,
        shift: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Information (B, K, K) and side (B, K) that contacts with derivatives `columns` (B, 6, K) of point and force
        give; the last three columns are the object's own place."""
        point, force = found.point_force[:, :3], found.point_force[:, 3:]
        world = np.einsum("bij,bj->bi", rotation, point) + translation
        tangent, force = (np.einsum("bij,bj->bi", rotation, each) for each in (found.tangents[:, :, CONTACT], force))
        residual, across = self.residuals(world, tangent, force, radius_m, shift)
        rows = across @ rotation @ columns[:, :3]
        rows[:, :, -3:] -= self.std_m * across
        rows /= _ROUND_M
        return np.swapaxes(rows, 1, 2) @ rows, -np.einsum("bqk,bq->bk", rows, residual / _ROUND_M)
