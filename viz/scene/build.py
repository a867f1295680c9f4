"""From a table of contacts, and what else is known, to a scene."""

from __future__ import annotations

from typing import TYPE_CHECKING

from estimator.table.contacts import ContactTable
from vbaa_calib.rig import Rig
from vbaa_calib.simulate.scene.objects import TouchObject

from .facts import drawn_estimate
from .instants import instants_of
from .rig_items import rig_items
from .scene import Contacts, ObjectMesh, Scene

if TYPE_CHECKING:
    from estimator.object.estimate import ObjectEstimate


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
    return Scene(
        Contacts.of(table),
        instants,
        rig=None if rig is None else rig_items(rig, table, instants),
        object=mesh if estimate is None else ObjectMesh.of(estimate.surface),
        truth=truth,
        estimate=None if estimate is None else drawn_estimate(estimate),
    )
