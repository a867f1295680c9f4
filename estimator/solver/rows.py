"""Operations on the rows of dataclasses of arrays, and of those inside them; what is no array stays."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import fields, is_dataclass, replace
from typing import Any, TypeVar

from vbaa_calib.core.arrays import Array, namespace

_T = TypeVar("_T")


def select(values: _T, which: Array) -> _T:
    """Rows by index or mask."""
    return _changed(lambda value: value[which], [values])


def where(mask: Array, first: _T, second: _T) -> _T:
    """Row by row from the first where the mask is true, else from the second."""

    def chosen(one: Array, other: Array) -> Array:
        return namespace(mask).where(mask.reshape((-1,) + (1,) * (one.ndim - 1)), one, other)

    return _changed(chosen, [first, second])


def with_rows(whole: _T, rows: Array, part: _T) -> _T:
    """The whole with the rows of these indices, in rising order, replaced by a part."""

    def replaced(values: Array, new: Array) -> Array:
        if len(rows) == len(values):
            return new
        made = values.clone() if hasattr(values, "clone") else values.copy()
        made[rows] = new
        return made

    return _changed(replaced, [whole, part])


def concatenate(parts: Sequence[_T], order: Array) -> _T:
    """Parts one after the other, then reordered."""
    return _changed(lambda *values: namespace(order).concat(values)[order], parts)


def _changed(change: Callable[..., Array], several: Sequence[Any]) -> Any:
    """The first with `change` of the arrays of all. A class that says `same_for_all_rows` is left as it is."""
    made: dict[str, Any] = {}
    for name in (f.name for f in fields(several[0])):
        values = [getattr(each, name) for each in several]
        if is_dataclass(values[0]):
            made[name] = values[0] if hasattr(values[0], "same_for_all_rows") else _changed(change, values)
        elif isinstance(values[0], dict):
            made[name] = {key: change(*(value[key] for value in values)) for key in values[0]}
        elif isinstance(values[0], tuple):
            made[name] = tuple(change(*entries) for entries in zip(*values, strict=True))
        elif hasattr(values[0], "ndim"):
            made[name] = change(*values)
    return replace(several[0], **made)
