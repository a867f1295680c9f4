"""Files as dataclasses, and one clear line for what they may not contain.

A field's annotation says what its value in a file must be (`Within`). Values are checked when a file is read; building
a dataclass in code does not check them.
"""

from __future__ import annotations

import difflib
import json
import re
import sys
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import MISSING, Field, asdict, fields, is_dataclass
from functools import cache
from inspect import cleandoc
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, ClassVar, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np
from yaml import YAMLError

from targets.within import Within

from .errors import InputError, about, quoted
from .files import read_text, with_lines

T = TypeVar("T")
_Reader = Callable[[Any], Any]
"""Makes a value of what a file has in its place, or raises _Refused."""


def read_as(written: Any, made: _Reader) -> Within:
    """Annotation of a value that a function makes from a value of the type `written` in the file."""
    return Within(made, written=written)


def array_of(*shape: int, ge: float | None = None, le: float | None = None) -> Within:
    """Annotation of an array that a file has as nested lists of finite numbers."""
    nested: Any = Annotated[float, Within(ge=ge, le=le)]
    for length in reversed(shape):
        nested = Annotated[list[nested], Within(min_length=length, max_length=length)]
    return read_as(nested, lambda values: np.array(values, float))


class FileModel:
    """The top level of a file, as a dataclass. Unknown keys are ignored, unless they can only be a misspelt one of
    ours."""

    VERSION: ClassVar[str]
    """What the key `schema` must say."""
    FURTHER_KEYS: ClassVar[bool] = True
    """Whether the top level may have keys of others."""
    FURTHER_INSIDE: ClassVar[bool] = False
    """Whether the mappings in it may."""


class _Refused(Exception):
    """What is wrong in a file's data: a clause with {} for the key, which is the one at `place`.

    rank : of the mistakes that are as near to the top the one of the lowest explains the others.
    beyond : whether a number is out of all bounds, and so mostly one in another unit.
    """

    def __init__(self, what: str, remedy: str | None = None, rank: int = 2, beyond: bool = False) -> None:
        self.what, self.remedy, self.rank, self.beyond = what, remedy, rank, beyond
        self.place: tuple[str | int, ...] = ()

    def below(self, key: str | int) -> _Refused:
        """The same, seen from the mapping or list in which its value has this key."""
        self.place = (key, *self.place)
        return self

    def clause(self, name: str) -> str:
        """The clause for a value of this name, which the top level of a file has not."""
        return self.what.replace("{}", name, 1) if name else self.what.removeprefix("{}").lstrip(": ")

    @staticmethod
    def explaining(mistakes: Iterable[_Refused]) -> _Refused:
        """The mistake that explains the others best."""
        return min(mistakes, key=lambda one: (len(one.place), one.rank))


def _wrong(value: Any, wanted: str, rank: int = 2, beyond: bool = False) -> _Refused:
    return _Refused(f"{{}}: {quoted(value)} is not {wanted}", None, rank, beyond)


def checked(model: type[T], data: Any, where: object, remedy: str, key: str = "") -> T:
    """`data` as a model, a dataclass or an annotated type. Raises InputError naming the first key that is wrong.

    where : the file. key : the dotted name of `data` in it. remedy : where no better one is known.
    """
    bad = _not_finite(data)
    if bad is not None:
        place = _with_line(where, data, bad)
        raise InputError(f"{_dotted(key, bad)} is not a finite number", where=place, remedy="give a number in SI units")
    kind: Any = model
    try:
        with about(where):  # what a value is made into may refuse it, too
            found: T = _reader(kind, not getattr(model, "FURTHER_INSIDE", False))(data)
        return found
    except _Refused as refused:
        name, place = _dotted(key, refused.place), _with_line(where, data, refused.place)
        better = refused.remedy or (_unit_of(name) if refused.beyond else None)
        raise InputError(refused.clause(name), where=place, remedy=better or remedy) from None


def refusal(error: ValueError, where: object) -> InputError:
    """The one-line error for a ValueError(clause), or ValueError(predicate, remedy[, key])."""
    refused = _by(error)
    return InputError(refused.clause(_dotted("", refused.place)), where=where, remedy=refused.remedy)


def _by(error: ValueError) -> _Refused:
    """The mistake that a ValueError(clause), or ValueError(predicate, remedy[, key inside the value]), names."""
    what, better, inner = (*error.args, None, None)[:3]
    refused = _Refused(f"{{}}{':' if better is None else ''} {what}", better)
    return refused.below(inner) if inner else refused


@cache
def _reader(kind: Any, forbid: bool) -> _Reader:
    """Reads what a file has as a value of a kind. forbid : refuses unknown keys in mappings."""
    origin, parts = get_origin(kind), get_args(kind)
    if origin is Annotated:
        read = _reader(parts[0], forbid) if parts[0] is not np.ndarray else _anything
        for within in parts[1:]:
            read = _within(read, within, forbid, parts[0])
        return read
    if origin in (Union, UnionType):
        return _one_of(parts, forbid)
    if origin is Literal:
        return _among(parts)
    if origin in (list, tuple):
        return _several(parts, origin, forbid)
    if origin is dict:
        return _mapping(_reader(parts[0], forbid), _reader(parts[1], forbid))
    if kind in _PLAIN:
        return _plain(kind)
    return _record(kind, forbid) if is_dataclass(kind) else _anything


def _anything(value: Any) -> Any:
    return value


_PLAIN: dict[Any, tuple[Any, str, str]] = {
    float: (float | int, "a number", "number"),
    int: (int, "a whole number", "integer"),
    str: (str, "a text", "string"),
    bool: (bool, "true or false", "boolean"),
}
"""Kind → the types of its values, and its names in words and in JSON Schema."""


def _plain(kind: Any) -> _Reader:
    types, words, _ = _PLAIN[kind]

    def read(value: Any) -> Any:
        if not isinstance(value, types) or (isinstance(value, bool) and kind is not bool):
            raise _wrong(value, words)
        return float(value) if kind is float else value

    return read


def _among(values: Sequence[Any]) -> _Reader:
    *first, last = map(repr, values)

    def read(value: Any) -> Any:
        if not any(value == one and type(value) is type(one) for one in values):
            raise _wrong(value, f"{', '.join(first)} or {last}" if first else last, rank=1)
        return value

    return read


def _within(read: _Reader, within: Within, forbid: bool, kind: Any) -> _Reader:
    """A reader that minds an annotation, too."""
    says, check = within.says, within.check
    before = says.get("before", _anything)
    written: Any = says.get("written")
    if written is None and kind is np.ndarray and read is _anything:
        written, made_by = list[Annotated[float, Within(**says)]], check or _anything
        return _within(read, read_as(written, lambda values: made_by(np.array(values, float))), forbid, kind)
    if written is not None:
        read = _reader(written, forbid)
    fullmatch = re.compile(says["pattern"]).fullmatch if "pattern" in says else None
    bounded = written is None and not says.keys().isdisjoint(("ge", "gt", "le", "lt", "min_length", "max_length"))

    def made(data: Any) -> Any:
        try:
            value = read(before(data))
            if fullmatch is not None and not fullmatch(value):
                raise _wrong(data, f"a text that fits {says['pattern']}")
            if bounded and value is not None and not within.holds(value):
                raise _wrong(data, within.words_for(value), beyond=isinstance(value, float | int))
            return value if check is None else check(value)
        except ValueError as error:
            raise _by(error) from None

    return made


def _all(parts: Iterable[tuple[str | int, _Reader, Any]]) -> list[Any]:
    """The values of (key, reader, what the file has). Raises the mistake that explains the others."""
    found, mistakes = [], []
    for key, read, value in parts:
        try:
            found.append(read(value))
        except _Refused as refused:
            mistakes.append(refused.below(key))
    if mistakes:
        raise _Refused.explaining(mistakes)
    return found


def _several(parts: Sequence[Any], origin: type, forbid: bool) -> _Reader:
    """Reads a list, or a tuple of one kind, or of as many values as it has kinds."""
    alike = origin is list or parts[-1] is Ellipsis
    readers = [_reader(part, forbid) for part in (parts[:1] if alike else parts)]

    def read(value: Any) -> Any:
        if not isinstance(value, list | tuple):
            raise _wrong(value, "a list")
        if not alike and len(value) != len(readers):
            raise _wrong(value, f"{len(readers)} values")
        each = readers * len(value) if alike else readers
        return origin(_all(zip(range(len(value)), each, value, strict=True)))

    return read


def _mapping(key: _Reader, of_key: _Reader) -> _Reader:
    def read(value: Any) -> Any:
        if not isinstance(value, Mapping):
            raise _wrong(value, "a mapping")
        names = _all((name, key, name) for name in value)
        return dict(zip(names, _all((name, of_key, one) for name, one in value.items()), strict=True))

    return read


def _one_of(kinds: Sequence[Any], forbid: bool) -> _Reader:
    """Reads a value of one of several kinds: of records the one that has its `type`, or the first."""
    readers = {kind: _reader(kind, forbid) for kind in kinds if kind is not NoneType}

    def read(value: Any) -> Any:
        if value is None and NoneType in kinds:
            return None
        stated = value.get("type") if isinstance(value, Mapping) else None
        fitting = [kind for kind in readers if is_dataclass(kind) and stated in _types_of(kind)]
        mistakes = []
        for kind in fitting or readers:
            try:
                return readers[kind](value)
            except _Refused as refused:
                mistakes.append(refused)
        raise mistakes[0]

    return read


def _types_of(kind: Any) -> tuple[Any, ...]:
    """The values that a record's field `type` may have."""
    return get_args(_kinds(kind).get("type"))


@cache
def _kinds(record: Any) -> dict[str, Any]:
    """Field → annotation."""
    return get_type_hints(record, include_extras=True)


def _key(name: str, kind: Any) -> tuple[str, dict[str, Any]]:
    """The key of a field in the file, and all that its annotation says."""
    says: dict[str, Any] = {}
    for within in get_args(kind)[1:] if get_origin(kind) is Annotated else ():
        says |= within.says
    return says.get("alias", name), says


def _is_needed(field: Field[Any], says: Mapping[str, Any]) -> bool:
    return field.default is MISSING and field.default_factory is MISSING and "default" not in says


def _record(record: Any, forbid: bool) -> _Reader:
    """Reads a mapping as a dataclass."""
    kinds, readers = _kinds(record), {}
    defaults, needed = {}, []
    for field in fields(record):
        key, says = _key(field.name, kinds[field.name])
        readers[key] = field.name, _reader(kinds[field.name], forbid)
        if _is_needed(field, says):
            needed.append(key)
        elif "default" in says:
            defaults[field.name] = says["default"]
    top = issubclass(record, FileModel)

    def read(value: Any) -> Any:
        if isinstance(value, record):
            return value
        if not isinstance(value, Mapping):
            raise _wrong(value, "a mapping")
        if top:
            value = _top_level(record, value, readers.keys())
        mistakes = []
        for key in value if forbid else ():
            if key in readers:
                continue
            meant = _meant(key, readers)
            other = f"is {meant} meant?" if meant else f"the keys here are {', '.join(readers)}"
            mistakes.append(_Refused("unknown key {}", other, rank=0).below(key))
        mistakes += [_Refused("{} is missing").below(key) for key in needed if key not in value]
        found = dict(defaults)
        for key, (name, of_key) in readers.items():
            if key in value:
                try:
                    found[name] = of_key(value[key])
                except _Refused as refused:
                    mistakes.append(refused.below(key))
        if mistakes:
            raise _Refused.explaining(mistakes)
        try:
            return record(**found)
        except ValueError as error:
            raise _by(error) from None

    return read


def _top_level(model: Any, data: Mapping[str, Any], known: Collection[str]) -> dict[str, Any]:
    """The keys of a file that its model knows."""
    if data.get("schema") != model.VERSION:
        raise _Refused(f"schema is {data.get('schema')!r}", f"{model.VERSION} is needed here")
    for key in data:
        if model.FURTHER_KEYS and key not in known and (meant := _meant(key, known - data.keys())):
            raise _Refused(f"unknown key {key}", f"is {meant} meant?")
    return {key: value for key, value in data.items() if key in known or not model.FURTHER_KEYS}


def _unit_of(name: str) -> str | None:
    """What to give for a dotted name's number, such as metres for `jig.translation_m.1`."""
    units = {"m": "metres", "rad": "radians", "N": "newtons", "Nm": "newton metres", "s": "seconds", "Pa": "pascals"}
    stem, _, suffix = next((part for part in reversed(name.split(".")) if not part.isdigit()), "").rpartition("_")
    return f"give {units[suffix]}" if stem and suffix in units else None


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


def _meant(key: object, known: Iterable[str]) -> str | None:
    return next(iter(difflib.get_close_matches(str(key).lower(), known, n=1, cutoff=0.7)), None)


def _not_finite(data: Any, loc: tuple[int | str, ...] = ()) -> tuple[int | str, ...] | None:
    """Place of the first number that is not finite; a whole number may be too large for a float."""
    if isinstance(data, float | int):
        return None if abs(data) <= sys.float_info.max else loc
    items = data.items() if isinstance(data, Mapping) else enumerate(data) if isinstance(data, list) else ()
    return next((bad for name, value in items if (bad := _not_finite(value, (*loc, name))) is not None), None)


def json_schema(model: type[FileModel], title: str) -> dict[str, Any]:
    """The published JSON Schema of a model."""
    parts: dict[str, Any] = {}
    whole = _described(model, not model.FURTHER_INSIDE, parts) | {"additionalProperties": True, "title": title}
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", "$defs": parts, **whole}


def _described(record: Any, forbid: bool, parts: dict[str, Any]) -> dict[str, Any]:
    """JSON Schema of a dataclass. parts : those of the dataclasses in it, by name."""
    properties, needed = {}, []
    for field in fields(record):
        kind = _kinds(record)[field.name]
        key, says = _key(field.name, kind)
        properties[key] = _schema(kind, forbid, parts)
        default = says.get("default", field.default)
        if _is_needed(field, says):
            needed.append(key)
        elif default is not MISSING:
            properties[key] = {"default": _plain_data(default), **properties[key]}
    words = cleandoc(record.__doc__ or "")
    return {
        **({} if words.startswith(f"{record.__name__}(") else {"description": words}),  # that is its signature
        "properties": properties,
        **({"required": needed} if needed else {}),
        **({"additionalProperties": False} if forbid else {}),
        "title": record.__name__,
        "type": "object",
    }


def _plain_data(value: Any) -> Any:
    """A default as JSON has it."""
    if is_dataclass(value) and not isinstance(value, type):
        value = asdict(value)
    return json.loads(json.dumps(value))


def _schema(kind: Any, forbid: bool, parts: dict[str, Any]) -> dict[str, Any]:
    """JSON Schema of a kind of value. parts : of the dataclasses that it contains, by name, to which it adds."""
    origin, inner = get_origin(kind), get_args(kind)
    if origin is Annotated:
        return _with_bounds(inner[0], inner[1:], forbid, parts)
    if origin in (Union, UnionType):
        each = [_schema(one, forbid, parts) for one in inner if one is not NoneType]
        each = each[0]["anyOf"] if each[0].keys() == {"anyOf"} else each
        null = [{"type": "null"}] if NoneType in inner else []
        return {"anyOf" if null or len(each) < 2 or "$ref" not in each[0] else "oneOf": each + null}
    if origin is Literal:
        return ({"const": inner[0]} if len(inner) == 1 else {"enum": list(inner)}) | {"type": "string"}
    if origin is list or (origin is tuple and inner[-1] is Ellipsis):
        return {"items": _schema(inner[0], forbid, parts), "type": "array"}
    if origin is tuple:
        each = [_schema(one, forbid, parts) for one in inner]
        return {"prefixItems": each, "minItems": len(each), "maxItems": len(each), "type": "array"}
    if origin is dict:
        of_values, of_keys = _schema(inner[1], forbid, parts), _schema(inner[0], forbid, parts)
        if "pattern" in of_keys:
            return {"patternProperties": {of_keys["pattern"]: of_values}, "type": "object"}
        return {"additionalProperties": of_values or True, "type": "object"}
    if kind in _PLAIN:
        return {"type": _PLAIN[kind][2]}
    if not is_dataclass(kind):
        return {}
    record: Any = kind
    if record.__name__ not in parts:
        parts[record.__name__] = {}
        parts[record.__name__] |= _described(record, forbid, parts)
    return {"$ref": f"#/$defs/{record.__name__}"}


def _with_bounds(kind: Any, several: Sequence[Within], forbid: bool, parts: dict[str, Any]) -> dict[str, Any]:
    """JSON Schema of a kind of value with what its annotations say."""
    keywords = {"ge": "minimum", "gt": "exclusiveMinimum", "le": "maximum", "lt": "exclusiveMaximum"}
    keywords |= {name: name for name in ("pattern", "description")}
    found: dict[str, Any] = {}
    for within in several:
        says = within.says
        written: Any = says.get("written", list[float] if kind is np.ndarray and not found else kind)
        if not found or "written" in says:
            found = _schema(written, forbid, parts)
        bounds = {word: says[name] for name, word in keywords.items() if says.get(name) is not None}
        sizes = {"string": "Length", "object": "Properties"}.get(found.get("type", ""), "Items")
        bounds |= {
            f"{end}{sizes}": says[f"{end}_length"] for end in ("min", "max") if says.get(f"{end}_length") is not None
        }
        description = {"description": bounds.pop("description")} if "description" in bounds else {}
        inside = found["items"] if "items" in found and "minimum" in bounds else found
        inside = inside["anyOf"][0] if "anyOf" in inside and bounds else inside
        inside |= bounds
        found |= description
        extra = says.get("json_schema_extra", {})
        if callable(extra):
            extra(parts[found["$ref"].rpartition("/")[2]])
        else:
            found |= extra
        if "also" in says:
            found = {"anyOf": [found, says["also"]]}
    return found
