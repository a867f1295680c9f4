"""truth.json of a simulated session: its contacts, row by row of a table, and its object."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from estimator.table.contacts import ContactTable
from vbaa_calib.core.errors import InputError
from vbaa_calib.simulate.scene.bumps import Bump
from vbaa_calib.simulate.scene.objects import LINES, SHAPES, WEDGES, TouchObject

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
    return TrueContacts(**values, point_world_m=points, friction=friction, stiffness_N_m=stiffness)


def true_object(truth: Mapping[str, Any], where: object = "truth.json") -> TouchObject:
    """The touched object out of truth.json's contents. Raises InputError when it is not there or wrong."""
    data = truth.get("object")
    if not isinstance(data, Mapping):
        raise InputError("has no object", where=where, remedy=_REMEDY)
    shape = data.get("shape")
    if shape not in SHAPES:
        raise InputError(f"object.shape is {shape!r}", where=where, remedy=_REMEDY)
    sizes = {"center_world_m": 3, "radius_m": 1}
    sizes |= {"axis_world": 3, "half_length_m": 1} if shape in LINES else {}
    sizes |= {"wedge_world": 3} if shape in WEDGES else {}
    found: dict[str, Any] = {"axis_world": np.zeros(3), "half_length_m": 1.0}
    found |= {name: _numbers(data.get(name), size, f"object.{name}", where) for name, size in sizes.items()}
    found["axis_world"] = found["axis_world"] / (np.linalg.norm(found["axis_world"]) or 1.0)
    bumps = _bumps(data.get("bumps", []), where) if shape == "freeform" else ()
    try:
        return TouchObject(shape=shape, bumps=bumps, **found)
    except InputError as error:
        raise InputError(f"object.{error.what}", where=where, remedy=_REMEDY) from None


def _bumps(value: Any, where: object) -> tuple[Bump, ...]:
    if not isinstance(value, list) or not all(isinstance(bump, Mapping) for bump in value):
        raise InputError(f"object.bumps is {value!r}", where=where, remedy=_REMEDY)
    made = []
    for index, bump in enumerate(value):
        name = f"object.bumps[{index}]"
        sizes = (("direction_world", 3), ("height_m", 1), ("width_m", 1))
        numbers = [_numbers(bump.get(key), size, f"{name}.{key}", where) for key, size in sizes]
        try:
            made.append(Bump(*numbers))
        except InputError as error:
            raise InputError(f"{name}: {error.what}", where=where, remedy=_REMEDY) from None
    return tuple(made)


def _numbers(value: Any, size: int, name: str, where: object) -> Any:
    """A finite number, or (size,) of them."""
    try:
        array = np.atleast_1d(np.array(value, float))
    except (TypeError, ValueError, OverflowError):
        array = np.full(1, np.nan)
    if array.shape != (size,) or not np.isfinite(array).all():
        raise InputError(f"{name} is {value!r}", where=where, remedy=_REMEDY)
    return float(array[0]) if size == 1 else array
