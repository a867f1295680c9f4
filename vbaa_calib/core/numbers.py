"""Numbers from outside, by file or call: which kinds are taken, and which sizes are possible in their unit."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from .errors import InputError

FARTHEST_PX = 1e7
"""Pixels beyond this belong to no camera: coordinates of another kind."""
LARGEST_RAD = 2.0 * math.pi
"""Joint angles beyond a turn are degrees, or counts of an encoder."""
LARGEST_NM = 100.0
"""Moments beyond this are in mN·m or µN·m: a whisker's are some mN·m."""
FARTHEST_M = 1e6
"""Positions beyond this are in millimetres at least."""

ANGLE_REMEDY = "give radians, up to a turn (degrees where the call or the table says so)"
MOMENT_REMEDY = "give N·m"


def as_floats(values: Any, name: str, remedy: str) -> np.ndarray:
    """`values` as float64, of any shape: numbers, lists and arrays of them; None and what an array masks become NaN.

    Raises
    ------
    InputError : text, booleans, complex numbers, other objects, or lists of different lengths.
    """
    if isinstance(values, np.ndarray) and values.dtype == np.float64 and type(values) is np.ndarray:
        return values
    masked = isinstance(values, np.ma.MaskedArray)
    try:
        if masked and values.dtype.kind in "iuf":
            values = values.astype(float).filled(np.nan)
        # NumPy takes a list of numbers and booleans for numbers
        array = np.array(values, object) if isinstance(values, list | tuple) else np.asarray(values)
        if array.dtype.kind == "O":
            array = np.array([np.nan if one is None else _number(one) for one in array.ravel()]).reshape(array.shape)
        if array.dtype.kind not in "iuf":
            raise TypeError
        return array.astype(float)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{name} is {values!r:.60}, not a number", remedy=remedy) from None


def _number(one: Any) -> float:
    if isinstance(one, bool | np.bool_ | str | bytes | complex):
        raise TypeError
    return float(one)


def check_angle(value: float, name: str, refuse: Callable[[str, str], InputError] | None = None) -> float:
    """A joint angle, rad. Raises InputError, or what `refuse(what, remedy)` returns, for one beyond a turn."""
    if abs(value) <= LARGEST_RAD:
        return value
    what = f"{name} is {value:g}, more than a turn" if math.isfinite(value) else f"{name} is {value:g}"
    raise refuse(what, ANGLE_REMEDY) if refuse else InputError(what, remedy=ANGLE_REMEDY)


def check_each(values: np.ndarray, most: float, name: str, remedy: str, *, required: bool = False) -> np.ndarray:
    """Values of any shape within ±most, or NaN where they are not `required`. Raises InputError for the first other."""
    bad = ~(np.abs(values) <= most) if required else np.abs(values) > most
    if bad.any():
        place = np.unravel_index(int(np.flatnonzero(bad)[0]), bad.shape)
        at = f"{name}[{', '.join(map(str, place))}]" if values.ndim else name
        raise InputError(f"{at} is {values[place]:g}", remedy=remedy)
    return values
