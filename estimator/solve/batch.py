"""Dataclasses of arrays with one row a frame: picked, chosen and written row by row."""

from __future__ import annotations

from dataclasses import fields, is_dataclass, replace
from typing import Any, TypeVar

from vbaa_calib.arrays import Array, namespace

T = TypeVar("T")


def picked(values: T, which: Array) -> T:
    """The rows by index or mask, of the dataclasses inside as well; what is no array stays."""
    made = {}
    for f in fields(_data(values)):
        value = getattr(values, f.name)
        if hasattr(value, "picked"):
            made[f.name] = value.picked(which)
        elif isinstance(value, dict):
            made[f.name] = {key: entry[which] for key, entry in value.items()}
        elif is_dataclass(value):
            made[f.name] = picked(value, which)
        elif hasattr(value, "ndim"):
            made[f.name] = value[which]
    return replace(_data(values), **made)


def chosen(first_is: Array, first: T, second: T) -> T:
    """Row by row from the first where the mask says so, else from the second."""
    xp = namespace(first_is)
    made = {}
    for f in fields(_data(first)):
        a, b = getattr(first, f.name), getattr(second, f.name)
        made[f.name] = xp.where(first_is.reshape((-1,) + (1,) * (a.ndim - 1)), a, b)
    return replace(_data(first), **made)


def written(whole: T, rows: Array, part: T) -> T:
    """The whole with the rows of these indices, in rising order, replaced by a part."""
    made = {}
    for f in fields(_data(whole)):
        values, new = getattr(whole, f.name), getattr(part, f.name)
        if is_dataclass(values):
            made[f.name] = written(values, rows, new)
        elif hasattr(values, "ndim"):
            made[f.name] = new if len(rows) == len(values) else _overwritten(values, rows, new)
    return replace(_data(whole), **made)


def gathered(parts: list[T], order: Array) -> T:
    """Parts of a whole, one after the other and then in this order."""
    xp, made = namespace(order), {}
    for f in fields(_data(parts[0])):
        values = [getattr(part, f.name) for part in parts]
        if is_dataclass(values[0]):
            made[f.name] = gathered(values, order)
        elif hasattr(values[0], "ndim"):
            made[f.name] = xp.concat(values)[order]
    return replace(_data(parts[0]), **made)


def _overwritten(values: Array, rows: Array, new: Array) -> Array:
    changed = values.clone() if hasattr(values, "clone") else values.copy()
    changed[rows] = new
    return changed


def _data(values: Any) -> Any:
    return values
