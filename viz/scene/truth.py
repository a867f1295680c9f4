"""truth.json of a simulated session: its contacts, row by row of a table, and its object."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from estimator.table.contacts import ContactTable
from vbaa_calib.core.errors import InputError
from vbaa_calib.simulate.scene.bumps import Bump

REMEDY = "give the truth.json that vbaa simulate wrote"
NEEDED = {
    "cylinder": ("axis_world", "half_length_m"),
    "sphere": (),
    "knife_edge": ("axis_world", "wedge_world", "half_length_m"),
    "box_edge": ("axis_world", "wedge_world", "half_length_m"),
    "freeform": (),
}
"""Shape → what it needs beside its centre and radius."""
SPARE: dict[str, Any] = {"axis_world": (0.0, 0.0, 1.0), "wedge_world": (0.0, 0.0, 0.0), "half_length_m": 1.0}


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

    @property
    def compliance_m_N(self) -> float:
        """Of the object; NaN where not known."""
        return 1.0 / self.stiffness_N_m


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
        raise InputError(f"frames are not as expected ({error!r})", where=where, remedy=REMEDY) from None
    return TrueContacts(**values, point_world_m=points, friction=friction, stiffness_N_m=stiffness)


@dataclass(frozen=True, eq=False)
class TrueObject:
    """One of the shapes of `NEEDED`. What a shape does not need has some value.

    Attributes
    ----------
    center_m, axis, wedge : (3,) world; `axis` of unit length.
    radius_m, half_length_m, bumps : as in `vbaa_calib.simulate.scene.objects.TouchObject`.
    """

    shape: str
    center_m: np.ndarray
    axis: np.ndarray
    wedge: np.ndarray
    radius_m: float
    half_length_m: float
    bumps: tuple[Bump, ...] = ()


def true_object(truth: Mapping[str, Any], where: object = "truth.json") -> TrueObject:
    """The touched object out of truth.json's contents. Raises InputError when it is not there or wrong."""
    data = truth.get("object")
    if not isinstance(data, Mapping):
        raise InputError("has no object", where=where, remedy=REMEDY)
    shape = data.get("shape")
    if not isinstance(shape, str) or shape not in NEEDED:
        raise InputError(f"object.shape is {shape!r}", where=where, remedy=REMEDY)

    def numbers(name: str, size: int) -> np.ndarray:
        value = data.get(name, SPARE[name]) if name in SPARE and name not in NEEDED[shape] else data.get(name)
        return _numbers(value, size, f"object.{name}", where)

    def positive(name: str) -> float:
        number = float(numbers(name, 1)[0])
        if number <= 0:
            raise InputError(f"object.{name} is {number:g}", where=where, remedy=REMEDY)
        return number

    axis = numbers("axis_world", 3)
    length = np.linalg.norm(axis)
    if length == 0:
        raise InputError("object.axis_world has no direction", where=where, remedy=REMEDY)
    return TrueObject(
        shape,
        numbers("center_world_m", 3),
        axis / length,
        numbers("wedge_world", 3),
        positive("radius_m"),
        positive("half_length_m"),
        _bumps(data.get("bumps", []), where) if shape == "freeform" else (),
    )


def _bumps(value: Any, where: object) -> tuple[Bump, ...]:
    if not isinstance(value, list) or not all(isinstance(bump, Mapping) for bump in value):
        raise InputError(f"object.bumps is {value!r}", where=where, remedy=REMEDY)
    made = []
    for index, bump in enumerate(value):
        name = f"object.bumps[{index}]"
        height, width = (
            float(_numbers(bump.get(key), 1, f"{name}.{key}", where)[0]) for key in ("height_m", "width_m")
        )
        direction = _numbers(bump.get("direction_world"), 3, f"{name}.direction_world", where)
        try:
            made.append(Bump(direction, height, width))
        except InputError as error:
            raise InputError(f"{name}: {error.what}", where=where, remedy=REMEDY) from None
    return tuple(made)


def _numbers(value: Any, size: int, name: str, where: object) -> np.ndarray:
    try:
        array = np.atleast_1d(np.array(value, float))
    except (TypeError, ValueError, OverflowError):
        array = np.array(math.nan)
    if array.shape != (size,) or not np.isfinite(array).all():
        raise InputError(f"{name} is {value!r}", where=where, remedy=REMEDY)
    return array
