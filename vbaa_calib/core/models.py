"""Files as pydantic models and dataclasses, and one clear line for what they may not contain.

Dataclasses have the bounds of their fields as annotations. A model of ours checks these when it reads a file; building
a dataclass in code does not.
"""

from __future__ import annotations

import difflib
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Annotated, Any, ClassVar, TypeVar

import numpy as np
from pydantic import (
    AllowInfNan,
    BaseModel,
    ConfigDict,
    Field,
    GetPydanticSchema,
    Strict,
    TypeAdapter,
    ValidationError,
    model_validator,
)
from pydantic.json_schema import GenerateJsonSchema
from pydantic_core import ErrorDetails, core_schema
from yaml import YAMLError

from .errors import InputError, about, quoted
from .files import read_text, with_lines

T = TypeVar("T")
Number = Annotated[float, Strict(), AllowInfNan(False)]
"""Finite, and not a boolean or a text."""
WholeNumber = Annotated[int, Strict()]


def read_as(written: Any, made: Callable[[Any], Any]) -> GetPydanticSchema:
    """Annotation of a value that a function makes from a value of the type `written` in the file."""
    return GetPydanticSchema(
        lambda _, handler: core_schema.no_info_after_validator_function(made, handler.generate_schema(written))
    )


def array_of(*shape: int, ge: float | None = None, le: float | None = None) -> GetPydanticSchema:
    """Annotation of an array that a file has as nested lists of finite numbers."""
    nested: Any = Annotated[Number, Field(ge=ge, le=le)]
    for length in reversed(shape):
        nested = Annotated[list[nested], Strict(), Field(min_length=length, max_length=length)]
    return read_as(nested, lambda values: np.array(values, float))


class FileModel(BaseModel):
    """The top level of a file. Unknown keys are ignored, unless they can only be a misspelt one of ours.

    The configuration of a subclass decides about unknown keys in nested mappings.
    """

    model_config = ConfigDict(
        frozen=True, extra="forbid", json_schema_extra={"additionalProperties": True}, defer_build=True
    )
    VERSION: ClassVar[str]
    """What the key `schema` must say."""
    FURTHER_KEYS: ClassVar[bool] = True

    @model_validator(mode="before")
    @classmethod
    def _known_keys(cls, data: Mapping[str, Any]) -> dict[str, Any]:
        if data.get("schema") != cls.VERSION:
            raise ValueError(f"schema is {data.get('schema')!r}", f"{cls.VERSION} is needed here")
        known = {field.alias or name for name, field in cls.model_fields.items()}
        for key in data:
            if cls.FURTHER_KEYS and key not in known and (meant := _meant(key, known - set(data))):
                raise ValueError(f"unknown key {key}", f"is {meant} meant?")
        return {key: value for key, value in data.items() if key in known or not cls.FURTHER_KEYS}


class _Schema(GenerateJsonSchema):
    def field_title_should_be_set(self, schema: Any) -> bool:
        return False


def json_schema(model: type[BaseModel], title: str) -> dict[str, Any]:
    """The published JSON Schema of a model."""
    published = model.model_json_schema(schema_generator=_Schema)
    return {"$schema": "https://json-schema.org/draft/2020-12/schema"} | published | {"title": title}


def checked(model: type[T], data: Any, where: object, remedy: str, key: str = "") -> T:
    """`data` as a model, a dataclass or an annotated type. Raises InputError naming the first key that is wrong.

    where : the file. key : the dotted name of `data` in it. remedy : where no better one is known.
    """
    bad = _not_finite(data)
    if bad is not None:
        name = _dotted(key, bad)
        place = _with_line(where, data, bad)
        raise InputError(f"{name} is not a finite number", where=place, remedy="give a number in SI units")
    kind: Any = model
    try:
        with about(where):  # what a value is made into may refuse it, too
            found: T = _adapter(kind).validate_python(data)
        return found
    except ValidationError as error:
        place = _with_line(where, data, _first(error)["loc"])
        raise refusal(error, place, remedy, key, lambda: _bounds(kind)) from None


@cache
def _adapter(model: Any) -> TypeAdapter[Any]:
    return TypeAdapter(model)


@cache
def _bounds(model: Any) -> Mapping[str, Any]:
    """JSON Schema of a model, cached, because it takes longer than to check a file."""
    return _adapter(model).json_schema()


def refusal(
    error: ValueError,
    where: object,
    remedy: str | None = None,
    key: str = "",
    schema: Callable[[], Mapping[str, Any]] = dict,
) -> InputError:
    """The one-line error for the first mistake that a ValueError, pydantic's or another, names. schema : gives the
    bounds."""
    if not isinstance(error, ValidationError):
        return _from_value_error(error, where, remedy, key)
    first = _first(error)
    whole = schema()
    part, above = _at(whole, whole, first["loc"]), _at(whole, whole, first["loc"][:-1])
    name = _dotted(key, first["loc"])
    if first["type"] == "value_error":
        return _from_value_error(first["ctx"]["error"], where, remedy, name)
    if first["type"] == "missing":
        return InputError(f"{name} is missing", where=where, remedy=remedy)
    if first["type"] in _UNKNOWN:
        keys = above.get("properties", {})
        meant = _meant(first["loc"][-1], keys)
        other = f"is {meant} meant?" if meant else f"the keys here are {', '.join(keys)}" if keys else remedy
        return InputError(f"unknown key {name}", where=where, remedy=other)
    what = f"{quoted(first['input'])} is not {_wanted(first, part)}"
    if "than" in first["type"] and (unit := _unit_of(name)):
        remedy = f"give {unit}"  # a number out of all bounds is mostly one in another unit
    return InputError(f"{name}: {what}" if name else what, where=where, remedy=remedy)


def _unit_of(name: str) -> str | None:
    """The unit of a dotted name's number in words, such as metres of `jig.translation_m.1`."""
    units = {"m": "metres", "rad": "radians", "N": "newtons", "Nm": "newton metres", "s": "seconds", "Pa": "pascals"}
    stem, _, suffix = next((part for part in reversed(name.split(".")) if not part.isdigit()), "").rpartition("_")
    return units.get(suffix) if stem else None


_UNKNOWN = ("extra_forbidden", "unexpected_keyword_argument")


def _first(error: ValidationError) -> ErrorDetails:
    """The error that explains the others best."""

    def importance(one: ErrorDetails) -> tuple[int, bool, bool]:
        # a key that nobody knows explains the one that is missing, and so does another type of thing; else as declared
        return len(one["loc"]), one["type"] not in _UNKNOWN, one["type"] != "literal_error"

    return min(error.errors(include_url=False), key=importance)


def _dotted(key: str, loc: Sequence[int | str]) -> str:
    return ".".join(map(str, [*([key] if key else ()), *_keys_of(loc)]))


def _keys_of(loc: Sequence[int | str]) -> list[int | str]:
    """The keys of a place in a file, without the tags, such as <AprilGrid>, of the alternative types that were
    tried."""
    return [part for part in loc if not str(part).startswith("<")]


def _with_line(where: object, data: Any, loc: Sequence[int | str]) -> object:
    """The file's name with the line of a value, where the data are what a YAML file contains, whole or under
    `board`."""
    if not isinstance(where, Path) or where.suffix not in (".yaml", ".yml"):
        return where
    try:
        content, line_of = with_lines(read_text(where))
    except (InputError, YAMLError, ValueError, RecursionError):
        return where
    above = (
        () if content == data else ("board",) if isinstance(content, dict) and content.get("board") == data else None
    )
    line = None if above is None else line_of([*above, *_keys_of(loc)])
    return where if line is None else f"{where} line {line}"


def _from_value_error(error: ValueError, where: object, remedy: str | None, name: str) -> InputError:
    """The error for a validator's ValueError(clause), or ValueError(predicate, remedy[, key inside what it checks])."""
    what, better, inner = (*error.args, None, None)[:3]
    name = ".".join(filter(None, (name, inner)))
    between = "" if not name else ": " if better is None else " "
    return InputError(f"{name}{between}{what}", where=where, remedy=better or remedy)


def _meant(key: object, known: Iterable[str]) -> str | None:
    return next(iter(difflib.get_close_matches(str(key).lower(), known, n=1, cutoff=0.7)), None)


def _at(whole: Mapping[str, Any], part: Mapping[str, Any], loc: tuple[int | str, ...]) -> Mapping[str, Any]:
    """The part of a JSON Schema for the value at a place of the data; empty where there is none."""
    if "$ref" in part:
        return _at(whole, whole["$defs"][part["$ref"].rpartition("/")[2]], loc)
    if "anyOf" in part and "properties" not in part:  # of ours always something or null
        return _at(whole, part["anyOf"][0], loc)
    if "oneOf" in part and loc:
        kind = str(loc[0]).strip("<>")
        return next((_at(whole, one, loc[1:]) for one in part["oneOf"] if one["$ref"].endswith(f"/{kind}")), {})
    if not loc:
        return part
    if isinstance(loc[0], str):
        inner = part.get("properties", {}).get(loc[0], {})
    else:
        each = part.get("prefixItems", ())
        inner = each[loc[0]] if loc[0] < len(each) else part.get("items", {})
    return _at(whole, inner, loc[1:])


def _wanted(error: ErrorDetails, part: Mapping[str, Any]) -> str:
    """What the model wants in place of the wrong value, in words."""
    kind, context = error["type"], error.get("ctx", {})
    if kind.startswith(("greater_than", "less_than")):
        keys = {"minimum": "ge", "exclusiveMinimum": "gt", "maximum": "le", "exclusiveMaximum": "lt"}
        bounds = part or {key: context.get(name) for key, name in keys.items()}
        low, above, high, below = (bounds.get(key) for key in keys)
        least, most = above if low is None else low, below if high is None else high
        if least is None:
            return f"{most:g} or less"
        if most is None:
            return f"above {least:g}" if low is None else f"{least:g} or more"
        return f"between {least:g} and {most:g}"
    if kind in ("too_short", "too_long"):
        return f"{part.get('minItems', '')} or more values" if "maxItems" not in part else f"{part['maxItems']} values"
    if kind == "literal_error":
        return str(context["expected"])
    types = {
        "object": "a mapping",
        "array": "a list",
        "string": "a text",
        "number": "a number",
        "integer": "a whole number",
        "boolean": "true or false",
    }
    return types.get(part.get("type", ""), error["msg"][0].lower() + error["msg"][1:])


def _not_finite(data: Any, loc: tuple[int | str, ...] = ()) -> tuple[int | str, ...] | None:
    """Place of the first number that is not finite; a whole number may be too large for a float."""
    if isinstance(data, float | int):
        return None if abs(data) <= sys.float_info.max else loc
    items = data.items() if isinstance(data, Mapping) else enumerate(data) if isinstance(data, list) else ()
    return next((bad for name, value in items if (bad := _not_finite(value, (*loc, name))) is not None), None)
