"""The object that was really there, as truth.json of a simulated session tells it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

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
class TruthObject:
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


def truth_object(truth: Mapping[str, Any], where: object = "truth.json") -> TruthObject:
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
    return TruthObject(
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
