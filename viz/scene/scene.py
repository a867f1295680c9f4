"""What there is to see, as plain arrays in the world frame. `viz.parts` draws it; pyvista stays there."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from estimator.table.contacts import ContactTable
from vbaa_calib.simulate.scene.objects import TouchObject

from .instants import Instants

if TYPE_CHECKING:
    from estimator.object.surface import Surface


@dataclass(frozen=True, eq=False)
class RigItems:
    """The rig at each of M instants; NaN where its joints are not known.

    Attributes
    ----------
    poses : (M, 4, 4) T_world_antenna.
    bent_m : (M, N, 3) the antenna; free_m (M, N, 3): where it would be without the object.
    ghosts : (G,) the instants whose antennas are drawn faintly.
    antenna_radius_m : of the wire.
    plane_m : (4, 3) antenna frame: corners of the drawn patch of plane C.
    camera_m : (3,) antenna frame: the camera's centre.
    picture_m : (H, W, 3) antenna frame: where the picture is drawn, as the lens sees it; rows down, columns right.
    """

    poses: np.ndarray
    bent_m: np.ndarray
    free_m: np.ndarray
    ghosts: np.ndarray
    antenna_radius_m: float
    plane_m: np.ndarray
    camera_m: np.ndarray
    picture_m: np.ndarray


@dataclass(frozen=True, eq=False)
class Contacts:
    """P located contacts in the order of time. NaN where the table gives nothing.

    Attributes
    ----------
    points_m : (P, 3) on the antenna's centreline.
    force_N : (P, 3) the object's force on the antenna.
    covariance_m2 : (P, 3, 3) of the points.
    time_s : (P,) since the recording's first frame.
    row : (P,) index into the contact table.
    """

    points_m: np.ndarray
    force_N: np.ndarray
    covariance_m2: np.ndarray
    time_s: np.ndarray
    row: np.ndarray

    @staticmethod
    def of(table: ContactTable) -> Contacts:
        """The located contacts of a table."""
        row = np.flatnonzero(table.located)
        return Contacts(
            table.point_world_m[row],
            table.force_world_N[row],
            table.covariance_world_m2[row],
            table.time_s[row] - table.time_s[0],
            row,
        )

    @property
    def size_mN(self) -> np.ndarray:
        """(P,) force magnitudes."""
        return 1e3 * np.linalg.norm(self.force_N, axis=1)

    @property
    def principal(self) -> tuple[np.ndarray, np.ndarray]:
        """(P, 3, 3) unit principal axes of the covariances in columns, and (P, 3) m standard deviations, rising."""
        known = np.isfinite(self.covariance_m2).all(axis=(1, 2))
        variance, axes = np.linalg.eigh(np.where(known[:, None, None], self.covariance_m2, 0.0))
        return axes, np.where(known[:, None], np.sqrt(np.maximum(variance, 0.0)), np.nan)

    @property
    def std_mm(self) -> np.ndarray:
        """(P,) standard deviation along the most uncertain direction."""
        return 1e3 * self.principal[1][:, -1]


@dataclass(frozen=True, eq=False)
class ObjectMesh:
    """The reconstructed object: points (V, 3), normals (V, 3), triangles (T, 3), lines (E, 2).

    `std_m` (V,) is each point's standard deviation along its normal, NaN where it is not known; None for none.
    """

    points_m: np.ndarray
    normals: np.ndarray
    triangles: np.ndarray
    lines: np.ndarray
    std_m: np.ndarray | None = None

    @staticmethod
    def of(surface: Surface) -> ObjectMesh:
        """What is drawn of a reconstructed surface."""
        return ObjectMesh(surface.points_m, surface.normals, surface.triangles, surface.lines, surface.std_m)


@dataclass(frozen=True, eq=False)
class DrawnEstimate:
    """What the contacts say together of the object, beside its shape.

    Attributes
    ----------
    row : (K,) index into the contact table of each contact; normals (K, 3): the object's, NaN where undetermined.
    cone_rad : half angle of the friction cone; None where friction is undetermined.
    facts : sentences on friction, stiffness and shape, or on why they are undetermined.
    """

    row: np.ndarray
    normals: np.ndarray
    cone_rad: float | None = None
    facts: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Scene:
    """Everything that is drawn; what is None or empty is left out.

    `pictures` holds what the camera saw at each instant, (H, W, 3) uint8 RGB all of one size, None where there is none.
    """

    contacts: Contacts
    instants: Instants
    rig: RigItems | None = None
    object: ObjectMesh | None = None
    truth: TouchObject | None = None
    estimate: DrawnEstimate | None = None
    pictures: tuple[np.ndarray | None, ...] = field(default=())

    @property
    def bounding_ball_m(self) -> tuple[np.ndarray, float]:
        """Centre (3,) and radius of a ball around what was touched."""
        points = [self.contacts.points_m]
        if self.object is not None:
            points.append(self.object.points_m)
        stacked = np.concatenate(points)
        centre = (stacked.min(axis=0) + stacked.max(axis=0)) / 2
        return centre, max(float(np.linalg.norm(stacked - centre, axis=1).max()), 5e-3)

    @property
    def normals(self) -> np.ndarray:
        """(P, 3) the object's outward normal at each contact; NaN where it is not known."""
        normals = np.full_like(self.contacts.points_m, np.nan)
        if self.estimate is not None:
            _, here, there = np.intersect1d(self.contacts.row, self.estimate.row, return_indices=True)
            normals[here] = self.estimate.normals[there]
        return normals
