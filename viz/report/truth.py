"""What is true of a simulated recording, row by row of its contacts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from estimator.table.contacts import ContactTable
from vbaa_calib.core.errors import InputError

_REMEDY = "give the truth.json that vbaa simulate wrote"


@dataclass(frozen=True, eq=False)
class Truth:
    """truth.json in the order of a table of B contacts; NaN where there is no contact, or it was not told.

    Attributes
    ----------
    distance_m, force_y_N, force_z_N : (B,). point_world_m : (B, 3) on the antenna's centreline.
    friction : the object's μ. stiffness_N_m : the object's, inf for a rigid one; NaN where not told.
    """

    distance_m: np.ndarray
    force_y_N: np.ndarray
    force_z_N: np.ndarray
    point_world_m: np.ndarray
    friction: float = np.nan
    stiffness_N_m: float = np.nan

    @property
    def compliance_m_N(self) -> float:
        """Of the object; NaN where not told."""
        return 1.0 / self.stiffness_N_m


def truth_of(table: ContactTable, contents: Mapping[str, Any], where: object = "truth.json") -> Truth:
    """The truth of a table's frames. Raises InputError when the contents are not truth.json's."""
    number = len(table)
    values = {name: np.full(number, np.nan) for name in ("distance_m", "force_y_N", "force_z_N")}
    points = np.full((number, 3), np.nan)
    try:
        frames = {int(frame["frame"]): frame for frame in contents["frames"]}
        for row, name in enumerate(table.frame):
            frame = frames.get(int(name))
            if frame is None or not frame["in_contact"]:
                continue
            values["distance_m"][row] = frame["distance_m"]
            _, values["force_y_N"][row], values["force_z_N"][row] = frame["force_N"]
            points[row] = frame.get("contact_world_m", (np.nan, np.nan, np.nan))
        touched = contents.get("object", {})
        friction = float(touched.get("friction", np.nan))
        stiffness = touched.get("stiffness_N_m", np.nan)
        stiffness = np.inf if stiffness is None else float(stiffness)
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise InputError(f"frames are not as expected ({error!r})", where=where, remedy=_REMEDY) from None
    return Truth(**values, point_world_m=points, friction=friction, stiffness_N_m=stiffness)
