"""The JSON Schemas of our files: what is published is what is checked."""

from __future__ import annotations

import difflib
import json
import sys
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from importlib import resources
from typing import Any

from vbaa_calib.core.errors import InputError

NAMES = ("session", "rig")


@cache
def schema(name: str) -> Mapping[str, Any]:
    """The published schema of `session.yaml` ("session") or `rig.json` ("rig")."""
    return json.loads(resources.files(__package__).joinpath(f"{name}.json").read_text(encoding="utf-8"))


def check(data: Mapping[str, Any], name: str, where: object) -> None:
    """Raises InputError naming the first key of `data` that the schema refuses, or that is not a finite number.

    Further keys at the top are let through, unless they can only be a misspelt one of ours.
    """
    import jsonschema

    published = schema(name)
    remedy = f"`vbaa schema {name}` prints what is expected"
    expected = published["properties"]["schema"]["const"]
    if data.get("schema") != expected:
        raise InputError(f"schema is {data.get('schema')!r}", where=where, remedy=f"{expected} is needed here")
    for key, meant in _misspelt(data, published["properties"]):
        raise InputError(f"unknown key {key}", where=where, remedy=f"is {meant} meant?")
    bad = _not_finite(data)
    if bad:
        raise InputError(f"{bad} is not a finite number", where=where, remedy="give a number in SI units")
    first = min(jsonschema.Draft202012Validator(published).iter_errors(data), key=_importance, default=None)
    if first is not None:
        key = ".".join(map(str, first.absolute_path))
        raise InputError(f"{key}: {_in_words(first)}" if key else _in_words(first), where=where, remedy=remedy)


def _misspelt(data: Mapping[str, Any], known: Iterable[str]) -> Iterator[tuple[str, str]]:
    """Keys that nobody knows, each with the one known key that looks like it and is not there."""
    missing = [name for name in known if name not in data]
    for key in data:
        if key not in known:
            for meant in difflib.get_close_matches(str(key).lower(), missing, n=1, cutoff=0.7):
                yield str(key), meant


def _importance(error: Any) -> tuple[int, bool, str]:
    # a key that nobody knows explains the one that is missing
    return len(error.path), error.validator != "additionalProperties", str(error.path)


_WORDS = {
    "object": "a mapping",
    "array": "a list",
    "string": "a text",
    "number": "a number",
    "integer": "a whole number",
    "boolean": "true or false",
    "null": "null",
}


def _in_words(error: Any) -> str:
    value = repr(error.instance)
    shown = value if len(value) <= 60 else value[:57] + "..."
    match error.validator:
        case "required":
            missing = [name for name in error.validator_value if name not in error.instance]
            return f"{missing[0]} is missing"
        case "additionalProperties":
            known = error.schema["properties"]
            unknown = [str(name) for name in error.instance if name not in known]
            return f"unknown key {', '.join(unknown)}, the keys are {', '.join(known)}"
        case "type":
            types = error.validator_value
            wanted = [types] if isinstance(types, str) else types
            return f"{shown} is not {' or '.join(_WORDS[name] for name in wanted)}"
        case "minimum" | "maximum" | "exclusiveMinimum" | "exclusiveMaximum" | "not":
            return f"{shown} is not {_allowed(error.schema)}"
        case _:
            return error.message if len(error.message) < 160 else f"{shown} does not fit"


def _allowed(bounds: Mapping[str, Any]) -> str:
    """The numbers that a schema lets through, in words."""
    low = max((bounds[key] for key in ("minimum", "exclusiveMinimum") if key in bounds), default=None)
    high = min((bounds[key] for key in ("maximum", "exclusiveMaximum") if key in bounds), default=None)
    gap = bounds.get("not", {}).get("exclusiveMaximum")
    away = "" if gap is None else f" and at least {gap:g} from 0"
    if low is None:
        return f"{high:g} or less{away}"
    if high is None:
        return (f"{low:g} or more" if "minimum" in bounds else f"above {low:g}") + away
    return f"between {low:g} and {high:g}{away}"


def _not_finite(data: Any, path: str = "") -> str | None:
    if isinstance(data, float | int):
        # a whole number may be too large for a float
        return None if abs(data) <= sys.float_info.max else path.lstrip(".")
    items = data.items() if isinstance(data, Mapping) else enumerate(data) if isinstance(data, list) else ()
    return next(filter(None, (_not_finite(value, f"{path}.{key}") for key, value in items)), None)
