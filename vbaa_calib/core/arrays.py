"""Checks of numbers from outside; and arrays of NumPy or torch: one set of formulas serves both, and the kind, dtype
and device of the input are those of the output.

torch takes a second to load. Nothing here loads it: where there is a tensor, it is loaded already.
"""

from __future__ import annotations

import math
import os
import re
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import wraps
from types import ModuleType
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self, TypeAlias, TypeVar, cast

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from .errors import InputError, quoted

if TYPE_CHECKING:
    import torch
    from typing_extensions import TypeIs

Array: TypeAlias = Any
"""np.ndarray or torch.Tensor, inside formulas that use only what the two spell alike."""

ArrayT = TypeVar("ArrayT", np.ndarray, "torch.Tensor")


@dataclass(frozen=True, eq=False)
class Rows:
    """A record of arrays with the same first axis, which gives its length; fields of other kinds belong to all rows."""

    def __len__(self) -> int:
        return len(next(each for each in vars(self).values() if isinstance(each, np.ndarray)))

    def picked(self, which: slice | np.ndarray) -> Self:
        """The rows of a slice, a mask or indices, which may repeat."""
        return self._with({name: each[which] for name, each in self._arrays().items()})

    @classmethod
    def joined(cls, parts: Sequence[Self]) -> Self:
        """The rows of several records, at least one, concatenated."""
        each = [part._arrays() for part in parts]
        return parts[0]._with({name: np.concatenate([one[name] for one in each]) for name in each[0]})

    def _with(self, changed: Mapping[str, Any]) -> Self:
        """The record with changed fields, all at once: to set each takes longer than the arrays of a few rows."""
        found, own = object.__new__(type(self)), vars(self)
        vars(found).update({field.name: own[field.name] for field in fields(cast(Any, self))}, **changed)
        return found

    def _arrays(self) -> dict[str, Any]:
        return {name: each for name, each in vars(self).items() if isinstance(each, np.ndarray)}


def is_tensor(values: Any) -> TypeIs[torch.Tensor]:
    """Whether values are a torch tensor."""
    kind = getattr(sys.modules.get("torch"), "Tensor", None)
    return kind is not None and isinstance(values, kind)


def _is_masked(values: Any) -> bool:
    """Whether values are a masked array of NumPy; `numpy.ma` loads with the first one."""
    kind = getattr(sys.modules.get("numpy.ma"), "MaskedArray", None)
    return kind is not None and isinstance(values, kind)


def namespace(values: Array) -> ModuleType:
    """The array library of these values: numpy or torch."""
    return sys.modules["torch"] if is_tensor(values) else np


def working(values: Array, last: int, name: str) -> tuple[Array, Callable[[Array], Array]]:
    """An input in float64 (float32 on a device that has no other), and the function that converts a result to the
    input's dtype.

    Raises InputError, which names it, unless it is float32 or float64 of shape (..., last).
    """
    xp = namespace(values)
    if xp is np:
        try:
            missing = _is_masked(values) and values.dtype.kind == "f"
            values = values.filled(np.nan) if missing else np.asarray(values)
        except ValueError:
            raise InputError(f"{name} are lists of different lengths", remedy=f"give them as (..., {last})") from None
    kind = str(values.dtype).removeprefix("torch.")
    if kind not in ("float32", "float64"):
        raise InputError(f"{name} are {kind}", remedy="convert them to float32 or float64")
    if values.ndim == 0 or values.shape[-1] != last:
        raise InputError(f"{name} have the shape {tuple(values.shape)}", remedy=f"give them as (..., {last})")
    if kind == "float64":
        return values, lambda result: result
    if xp is np:
        return values.astype(np.float64), lambda result: result.astype(np.float32)
    return values.to(widest_float(values.device)), lambda result: result.float()


def widest_float(device: torch.device) -> torch.dtype:
    """float64, except on Apple's GPUs, which have none."""
    torch = sys.modules["torch"]
    return torch.float32 if device.type == "mps" else torch.float64


def like(reference: Array, values: Array) -> Array:
    """Values converted to the kind, dtype and device of the reference."""
    if is_tensor(reference):
        return namespace(reference).as_tensor(values, dtype=reference.dtype, device=reference.device)
    return np.asarray(values, dtype=reference.dtype)


def masked(values: Array, valid: Array) -> Array:
    """Values with NaN where not valid; `valid` has the leading dimensions of the values.

    The values under the mask must be finite: then no NaN reaches a gradient.
    """
    mask = valid.reshape(tuple(valid.shape) + (1,) * (values.ndim - valid.ndim))
    return namespace(values).where(mask, values, np.nan)


@dataclass(frozen=True)
class _PlausibleSettings:
    """Largest plausible sizes: what is larger must be in another unit."""

    pixel_px: float = 1e7  # beyond, coordinates are of another kind
    angle_rad: float = 2.0 * math.pi  # of a joint: beyond a turn they are degrees, or counts of an encoder
    moment_Nm: float = 100.0  # beyond, they are mN·m or µN·m: an antenna's are some mN·m
    place_m: float = 1e6  # beyond, positions are in millimetres at least


PLAUSIBLE = _PlausibleSettings()
ANGLE_REMEDY = "give radians, up to a turn (degrees where the call or the table says so)"
MOMENT_REMEDY = "give N·m"


def as_floats(values: Any, name: str, remedy: str) -> np.ndarray:
    """`values` as float64 of any shape: numbers, lists and arrays of them; None and masked values become NaN.

    Raises
    ------
    InputError : text, booleans, complex numbers, other objects, or lists of different lengths.
    """
    if isinstance(values, np.ndarray) and values.dtype == np.float64 and type(values) is np.ndarray:
        return values
    if isinstance(values, list) and all(one is None or type(one) is float for one in values):
        return np.array(values, float)
    masked = _is_masked(values)
    try:
        if is_tensor(values):
            values = values.detach().cpu().numpy()
        if masked and values.dtype.kind in "iuf":
            values = values.astype(float).filled(np.nan)
        if isinstance(values, list | tuple):
            # NumPy takes a list of numbers and booleans for numbers, and no tensor with gradients
            values = np.array([one.tolist() if is_tensor(one) else one for one in values], object)
        array = np.asarray(values)
        if array.dtype.kind == "O":
            array = np.array([_number(one) for one in array.ravel()]).reshape(array.shape)
        if array.dtype.kind not in "iuf":
            raise TypeError
        return array.astype(float)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{name} is {quoted(values)}, not a number", remedy=remedy) from None


def as_float(value: Any, name: str, remedy: str) -> float:
    """One number as float64. Raises InputError as `as_floats`, and for several numbers."""
    if type(value) is float:
        return value
    number = as_floats(value, name, remedy)
    if number.ndim:
        raise InputError(f"{name} has shape {number.shape}", remedy=f"give one number: {remedy}")
    return float(number)


def _number(one: Any) -> float:
    if one is None or _is_masked(one):
        return np.nan
    one = one.item() if is_tensor(one) else one
    if isinstance(one, bool | np.bool_ | str | bytes | complex):
        raise TypeError
    return float(one)


def of_shape(values: Any, shape: tuple[int, ...], name: str, finite: bool = True) -> np.ndarray:
    """`values` as float64 of this shape. Raises InputError, also for NaN and infinity if `finite`."""
    if not (type(values) is np.ndarray and values.dtype == np.float64):
        values = as_floats(values, name, f"give finite numbers, {shape}")
    if values.shape != shape:
        raise InputError(f"{name} has shape {values.shape}", remedy=f"give {shape}")
    if finite and not np.isfinite(values).all():
        raise InputError(f"{name} is {quoted(values.tolist())}", remedy=f"give finite numbers, {shape}")
    return np.asarray(values)


def fixed(values: Any, shape: tuple[int, ...], name: str, finite: bool = True) -> np.ndarray:
    """A read-only float64 copy, for immutable records. Raises InputError as `of_shape`."""
    array = of_shape(values, shape, name, finite)
    if array.flags.writeable or array.base is not None:
        array = array.copy()
        array.flags.writeable = False
    return array


def real_gravity(gravity: np.ndarray) -> np.ndarray:
    """(3,) m/s², zero for weightless. Raises ValueError, with a remedy, for a magnitude in other units."""
    size = math.hypot(*gravity)
    if size and not 1.5 <= size <= 30.0:  # the Moon's, and more than Jupiter's
        raise ValueError(f"has the size {size:.3g}", "give m/s²: on Earth the three numbers have the size 9.8, not 1")
    return gravity


class Within:
    """Annotation of a field of a file: its bounds and description, as pydantic's `Field` takes them, and what else its
    numbers must be. Numbers are finite, and no number is a boolean or a text; an array is a list of them, each within
    the bounds. pydantic loads with the first file."""

    def __init__(self, check: Callable[[Any], Any] | None = None, **bounds: Any) -> None:
        self._check, self._bounds = check, bounds

    def __get_pydantic_core_schema__(self, kind: Any, handler: Any) -> Any:
        from pydantic import AfterValidator, AllowInfNan, Field, Strict

        plain = ([Strict()] if kind in (float, int, bool) else []) + ([AllowInfNan(False)] if kind is float else [])
        last = [] if self._check is None else [AfterValidator(self._check)]
        if kind is np.ndarray:
            number = Annotated[float, Strict(), AllowInfNan(False), Field(**self._bounds)]
            return handler.generate_schema(Annotated[list[number], AfterValidator(np.array), *last])
        return handler.generate_schema(Annotated[(kind, *plain, Field(**self._bounds), *last)])


def neighbours(values: np.ndarray, count: int, ends: Literal["edge", "symmetric"]) -> np.ndarray:
    """(N, ..., count) each of the values (N, ...) with those around it, itself in the middle. ends : how the values
    continue beyond their ends, as `np.pad` has it."""
    before = count // 2
    padded = np.pad(values, [(before, count - 1 - before), *[(0, 0)] * (values.ndim - 1)], ends)
    return sliding_window_view(padded, count, axis=0)


def spread_evenly(count: int, most: int) -> np.ndarray:
    """Evenly spaced indices, at most `most` of `count`, with the first and the last."""
    places = np.linspace(0, max(count - 1, 0), min(count, most)).astype(int)
    return np.array(list(dict.fromkeys(places.tolist())), int)


_Call = TypeVar("_Call", bound=Callable[..., Any])
_ARRAYS = {"np.ndarray", "ArrayT", "ArrayLike", "Array"}
_PLAIN: dict[str, Any] = {"float": float, "int": (int, np.integer), "str": str, "bool": bool, "Mapping": Mapping}
_AT_ONCE = {float: "float", int: "int", str: "str", bool: "bool"}
"""What most calls are given, and the annotation that it fits."""


def validate_arguments(call: _Call) -> _Call:
    """Decorator: a public function or record that validates its arguments by its annotations.

    Numbers must be numbers, arrays consist of numbers (masked values are missing), lists must not be text, records must
    be of their class; an argument annotated `Any` is not validated. Raises InputError for anything else.
    """
    function: Any = vars(call)["__init__"] if isinstance(call, type) else call
    names = function.__code__.co_varnames[: function.__code__.co_argcount]
    # " | " between alternatives, not within their brackets; resolved by name, so that nothing need be loaded for it
    wanted = {name: re.split(r" \| (?![^\[]*\])", str(kinds)) for name, kinds in function.__annotations__.items()}

    @wraps(function)
    def validated(*args: Any, **named: Any) -> Any:
        pairs = zip(names, args, strict=False)
        known = [_taken(value, name, wanted[name]) if name in wanted else value for name, value in pairs]
        for name in named:
            if name in wanted:
                named[name] = _taken(named[name], name, wanted[name])
        return function(*known, *args[len(known) :], **named)

    if isinstance(call, type):
        call.__init__ = validated  # type: ignore[misc]
        return call
    return validated  # type: ignore[return-value]


def _taken(value: Any, name: str, kinds: list[str]) -> Any:
    """A value of one of these types, arrays converted to ours. Raises InputError for another."""
    own = type(value)
    if own in _AT_ONCE and _AT_ONCE[own] in kinds:
        return value
    if own is np.ndarray and value.dtype.kind == "f" and not _ARRAYS.isdisjoint(kinds):
        return value
    if (value is None and "None" in kinds) or "Any" in kinds or any(_is(value, kind) for kind in kinds):
        return value
    if value is not None and not _ARRAYS.isdisjoint(kinds):
        real = is_tensor(value) and value.is_floating_point()
        return value if real else as_floats(value, name, "give an array of numbers")
    if value is not None and "float" in kinds:
        return as_float(value, name, "give a number")
    raise InputError(f"{name} is {quoted(value)}", remedy=f"give {' or '.join(kinds)}")


def _is(value: Any, kind: str) -> bool:
    kind = kind.partition("[")[0]
    if kind in ("Iterable", "Sequence", "list", "tuple"):
        several = isinstance(value, Iterable) and not isinstance(value, str | bytes | Mapping)
        return several and getattr(value, "ndim", 1) != 0
    if kind in _PLAIN:
        return isinstance(value, _PLAIN[kind]) and (kind == "bool" or not isinstance(value, bool))
    if kind == "Path":
        return isinstance(value, str | os.PathLike)
    return any(each.__name__ == kind for each in type(value).__mro__) and kind not in _ARRAYS


def check_angle(value: float, name: str, refuse: Callable[[str, str], InputError] | None = None) -> float:
    """A joint angle, rad. Raises InputError, or the result of `refuse(what, remedy)`, for more than a turn."""
    if abs(value) <= PLAUSIBLE.angle_rad:
        return value
    what = f"{name} is {value:g}, more than a turn" if math.isfinite(value) else f"{name} is {value:g}"
    raise refuse(what, ANGLE_REMEDY) if refuse else InputError(what, remedy=ANGLE_REMEDY)


def check_each(values: np.ndarray, most: float, name: str, remedy: str, missing: str = "nan") -> np.ndarray:
    """Values of any shape within ±most. Raises InputError for the first beyond.

    missing : what may stand for a missing value: "nan" for NaN, "infinite" for NaN and infinity, "" for nothing.
    """
    if values.size and values.min() >= -most and values.max() <= most:
        return values
    size = np.abs(values)
    bad = ~(size <= most) if not missing else size > most
    if missing == "infinite":
        bad &= np.isfinite(size)
    if bad.any():
        place = np.unravel_index(int(np.flatnonzero(bad)[0]), bad.shape)
        at = f"{name}[{', '.join(map(str, place))}]" if values.ndim else name
        raise InputError(f"{at} is {values[place]:g}", remedy=remedy)
    return values
