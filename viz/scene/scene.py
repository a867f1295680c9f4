"""What there is to see, as plain arrays in the world frame. `viz.parts` draws it; pyvista stays there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from estimator.table.contacts import ContactTable
from vbaa_calib.rig import Rig
from vbaa_calib.simulate.scene.objects import TouchObject

from .facts import object_facts, sentence
from .instants import Instants, instants_of
from .rig_items import RigItems, rig_items

if TYPE_CHECKING:
    from estimator.object.estimate import ObjectEstimate
    from estimator.object.surface import Surface

_VAGUE_RAD = np.radians(20)
"""A normal less well known than this is not drawn: it would show the force's direction, not the object's."""


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
class Scene:
    """Everything that is drawn; what is None or empty is left out.

    Attributes
    ----------
    normals : (P, 3) the object's outward normal at each contact, NaN where it is undetermined; None for none.
    cone_rad : half angle of the friction cone; None where friction is undetermined.
    facts : sentences on friction, stiffness and shape, or on why they are undetermined.
    pictures : what the camera saw at each instant, (H, W, 3) uint8 RGB all of one size, None where there is none.
    """

    contacts: Contacts
    instants: Instants
    rig: RigItems | None = None
    object: ObjectMesh | None = None
    truth: TouchObject | None = None
    normals: np.ndarray | None = None
    cone_rad: float | None = None
    facts: tuple[str, ...] = ()
    pictures: tuple[np.ndarray | None, ...] = ()

    @property
    def bounding_ball_m(self) -> tuple[np.ndarray, float]:
        """Centre (3,) and radius of a ball around what was touched."""
        points = self.contacts.points_m
        if self.object is not None:
            points = np.concatenate([points, self.object.points_m])
        centre = (points.min(axis=0) + points.max(axis=0)) / 2
        return centre, max(float(np.linalg.norm(points - centre, axis=1).max()), 5e-3)


def build_scene(
    table: ContactTable,
    rig: Rig | None = None,
    estimate: ObjectEstimate | None = None,
    truth: TouchObject | None = None,
    mesh: ObjectMesh | None = None,
) -> Scene:
    """The scene without the camera's pictures; the object is that of the estimate, or else `mesh`.

    Raises InputError when nothing is located, or the contacts are not of this rig.
    """
    instants = instants_of(table, None if estimate is None else estimate.track.phase)
    items = None if rig is None else rig_items(rig, table, instants)
    contacts = Contacts.of(table)
    if estimate is None:
        return Scene(contacts, instants, items, mesh, truth)
    friction, known = estimate.friction, estimate.normals.std_rad < _VAGUE_RAD
    normals = np.full((len(table), 3), np.nan)
    normals[friction.row[known]] = estimate.normals.normal[known]
    said = [f"{fact.label}: {fact.words}" for fact in object_facts(estimate)]
    return Scene(
        contacts,
        instants,
        items,
        ObjectMesh.of(estimate.surface),
        truth,
        normals=normals[contacts.row],
        cone_rad=float(friction.cone_half_angle_rad) if friction.determined else None,
        facts=(*said, *map(sentence, estimate.surface.notes)),
    )
