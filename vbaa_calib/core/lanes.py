"""Eight numbers side by side, one for each shape that is bent at a time: the processor's vectors in compiled code.

Inside a `kernel`, `load` takes a row of eight from an array, + − × ÷ and the functions below work on all eight at once,
also with plain numbers, and `store` puts a row back. LLVM does not find this by itself: it unrolls loops over eight
numbers before it looks, and arrays might overlap. In plain Python the rows are NumPy's.
"""

from __future__ import annotations

import operator
import os
from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.core.typing.templates import ConcreteTemplate, infer_global, signature
from numba.extending import lower_builtin, models, register_model
from numba.np.arrayobj import make_array

LANES = 8
"""What AVX-512 does in one go; other processors take it in two or four."""

Lanes: TypeAlias = Any
"""(LANES,) float64."""


def load(array: np.ndarray, *row: int) -> Lanes:
    """The row (LANES,) of a C-contiguous array (..., LANES)."""
    return array[row].copy()


def store(array: np.ndarray, values: Lanes, *row: int) -> None:
    """Write the row (LANES,) of a C-contiguous array (..., LANES)."""
    array[row] = values


def load_from(array: Any, *place: int) -> Lanes:
    """LANES neighbours of a C-contiguous array from a place on."""
    return array[(*place[:-1], slice(place[-1], place[-1] + LANES))].copy()


def store_to(array: Any, values: Lanes, *place: int) -> None:
    """Write LANES neighbours of a C-contiguous array from a place on."""
    array[(*place[:-1], slice(place[-1], place[-1] + LANES))] = values


def lane_of(values: Lanes, lane: int) -> float:
    """One of them."""
    return float(values[lane])


def where_positive(test: Lanes, values: Lanes, others: Lanes) -> Lanes:
    """The values where the test is above 0, the others elsewhere and where it is not a number."""
    return np.where(test > 0.0, values, others)


def spread(value: float) -> Lanes:
    """The same number in all."""
    return np.full(LANES, value)


def sqrt(values: Lanes) -> Lanes:
    """Square roots."""
    return np.sqrt(values)


def exp(values: Lanes) -> Lanes:
    """Exponentials."""
    return np.exp(values)


def sin(values: Lanes) -> Lanes:
    """Sines of any angles."""
    return np.sin(values)


def cos(values: Lanes) -> Lanes:
    """Cosines of any angles."""
    return np.cos(values)


class _Lanes(types.Type):
    def __init__(self) -> None:
        super().__init__(name="Lanes")


_LANES, _NUMBER, _INDEX = _Lanes(), types.float64, types.intp
_DOUBLE = ir.DoubleType()
_VECTOR = ir.VectorType(_DOUBLE, LANES)
_EITHER = (_LANES, _NUMBER)


@register_model(_Lanes)
class _Model(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _VECTOR)


def _vector(builder: Any, value: Any) -> Any:
    """A number as a vector of equal ones; a vector as it is."""
    if value.type == _VECTOR:
        return value
    first = builder.insert_element(ir.Constant(_VECTOR, ir.Undefined), value, _place(0))
    return builder.shuffle_vector(first, first, ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES))


def _place(lane: int) -> Any:
    return ir.Constant(ir.IntType(32), lane)


def _elementwise(instruction: str) -> Callable[..., Any]:
    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return getattr(builder, instruction)(*(_vector(builder, value) for value in args))

    return lower


def _lower_where(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    test, values, others = (_vector(builder, value) for value in args)
    return builder.select(builder.fcmp_ordered(">", test, ir.Constant(_VECTOR, [0.0] * LANES)), values, others)


def _lower_spread(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    return _vector(builder, args[0])


def _lower_lane_of(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    return builder.extract_element(*args)


def _lower_sqrt(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    kind = ir.FunctionType(_VECTOR, [_VECTOR])
    return builder.call(cgutils.get_or_insert_function(builder.module, kind, f"llvm.sqrt.v{LANES}f64"), args)


def _one_by_one(name: str) -> Callable[..., Any]:
    """A function of plain numbers, called for each: of a vector's sin/cos LLVM makes a call of the plain tan."""

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        kind = ir.FunctionType(_DOUBLE, [_DOUBLE])
        function = cgutils.get_or_insert_function(builder.module, kind, f"llvm.{name}.f64")
        result = ir.Constant(_VECTOR, ir.Undefined)
        for lane in map(_place, range(LANES)):
            value = builder.call(function, [builder.extract_element(args[0], lane)])
            result = builder.insert_element(result, value, lane)
        return result

    return lower


def _pointer(context: Any, builder: Any, kind: Any, array: Any, row: Any) -> Any:
    place = list(row) if len(row) == kind.ndim else [*row, context.get_constant(_INDEX, 0)]
    item = cgutils.get_item_pointer(context, builder, kind, make_array(kind)(context, builder, array), place)
    return builder.bitcast(item, _VECTOR.as_pointer())


def _lower_load(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    return builder.load(_pointer(context, builder, sig.args[0], args[0], args[1:]), align=8)


def _lower_store(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    builder.store(args[1], _pointer(context, builder, sig.args[0], args[0], args[2:]), align=8)
    return context.get_dummy_value()


def _compiled(function: Any, lower: Callable[..., Any], *cases: Any) -> None:
    """Tell numba what the function takes and gives, and how LLVM does it."""
    infer_global(function)(type(f"_{function.__name__}", (ConcreteTemplate,), {"cases": list(cases)}))
    for case in cases:
        lower_builtin(function, *case.args)(lower)


def _rows(indices: int, readonly: bool) -> Any:
    return types.Array(_NUMBER, 1 + indices, "C", readonly=readonly)


_PAIRS = [signature(_LANES, *pair) for pair in ((_LANES, _LANES), (_LANES, _NUMBER), (_NUMBER, _LANES))]
_compiled(operator.add, _elementwise("fadd"), *_PAIRS)
_compiled(operator.sub, _elementwise("fsub"), *_PAIRS)
_compiled(operator.mul, _elementwise("fmul"), *_PAIRS)
_compiled(operator.truediv, _elementwise("fdiv"), *_PAIRS)
_compiled(operator.neg, _elementwise("fneg"), signature(_LANES, _LANES))
_compiled(sqrt, _lower_sqrt, signature(_LANES, _LANES))
_compiled(exp, _one_by_one("exp"), signature(_LANES, _LANES))
_compiled(sin, _one_by_one("sin"), signature(_LANES, _LANES))
_compiled(cos, _one_by_one("cos"), signature(_LANES, _LANES))
_compiled(spread, _lower_spread, signature(_LANES, _NUMBER))
_compiled(lane_of, _lower_lane_of, signature(_NUMBER, _LANES, _INDEX))
_compiled(where_positive, _lower_where, *(signature(_LANES, _LANES, a, b) for a in _EITHER for b in _EITHER))
_compiled(load, _lower_load, *(signature(_LANES, _rows(n, True), *[_INDEX] * n) for n in range(4)))
_compiled(store, _lower_store, *(signature(types.none, _rows(n, False), _LANES, *[_INDEX] * n) for n in range(4)))
_compiled(load_from, _lower_load, *(signature(_LANES, _rows(n, True), *[_INDEX] * (n + 1)) for n in range(3)))
_STORED = [signature(types.none, _rows(n, False), _LANES, *[_INDEX] * (n + 1)) for n in range(3)]
_compiled(store_to, _lower_store, *_STORED)

load.stamp = (os.stat(__file__).st_mtime, os.stat(__file__).st_size)  # type: ignore[attr-defined]
"""For `core.compiled`: what uses this module is compiled anew when it changes."""
