"""The truth.json of a simulated session: its contacts, row by row of a table, and its object."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from estimator.table.contacts import ContactTable
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.models import checked
from vbaa_calib.simulate.scene.objects import LINES, WEDGES, TouchObject
from vbaa_calib.simulate.scene.scene_file import FileObject

_REMEDY = "give the truth.json that vbaa simulate wrote"


@dataclass(frozen=True, eq=False)
class TrueContacts:
    """The true contacts in the order of a table of B frames; NaN where there is no contact, or it is not known.

    Attributes
    ----------
    distance_m, force_y_N, force_z_N : (B,). point_world_m : (B, 3) on the antenna's centreline.
    friction : the object's μ. stiffness_N_m : the object's, inf for a rigid one; NaN where not known.
    """

    distance_m: np.ndarray
    force_y_N: np.ndarray
    force_z_N: np.ndarray
    point_world_m: np.ndarray
    friction: float = np.nan
    stiffness_N_m: float = np.nan


def true_contacts(table: ContactTable, contents: Mapping[str, Any], where: object = "truth.json") -> TrueContacts:
    """The true values of a table's frames. Raises InputError when the content is not truth.json's."""
    distance, force, point = (np.full((len(table), *shape), np.nan) for shape in ((), (3,), (3,)))
    try:
        frames = {int(frame["frame"]): frame for frame in contents["frames"]}
        for row, name in enumerate(table.frame):
            frame = frames.get(int(name))
            if frame is not None and frame["in_contact"]:
                distance[row], force[row] = frame["distance_m"], frame["force_N"]
                point[row] = frame.get("contact_world_m", np.nan)
        touched = contents.get("object", {})
        friction, stiffness = float(touched.get("friction", np.nan)), touched.get("stiffness_N_m", np.nan)
        stiffness = np.inf if stiffness is None else float(stiffness)
    except (ArithmeticError, AttributeError, KeyError, TypeError, ValueError) as error:
        raise InputError(f"frames are not as expected ({error!r})", where=where, remedy=_REMEDY) from None
    return TrueContacts(distance, force[:, 1], force[:, 2], point, friction, stiffness)


def true_object(truth: Mapping[str, Any], where: object = "truth.json") -> TouchObject:
    """The touched object in truth.json's content. Raises InputError when it is missing or wrong."""
    data = truth.get("object")
    if not isinstance(data, Mapping):
        raise InputError("has no object", where=where, remedy=_REMEDY)
    shape = data.get("shape")
    needed = {"axis_world": shape in LINES, "wedge_world": shape in WEDGES, "bumps": shape == "freeform"}
    found = {key: value for key, value in data.items() if needed.get(key, True) and value is not None}
    return checked(FileObject, found, where, _REMEDY, "object")
