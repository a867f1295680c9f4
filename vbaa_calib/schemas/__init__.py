"""The JSON Schemas of our files: what is published is what is checked."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from functools import cache
from importlib import resources
from typing import Any

from ..errors import InputError

NAMES = ("session", "rig")


@cache
def schema(name: str) -> Mapping[str, Any]:
    """The published schema of `session.yaml` ("session") or `rig.json` ("rig")."""
    return json.loads(resources.files(__package__).joinpath(f"{name}.json").read_text(encoding="utf-8"))


def check(data: Mapping[str, Any], name: str, where: object) -> None:
    """Raises InputError naming the first key of `data` that the schema refuses, or that is not a finite number."""
    import jsonschema

    errors = jsonschema.Draft202012Validator(schema(name)).iter_errors(data)
    first = min(errors, key=lambda error: (len(error.path), str(error.path)), default=None)
    if first is not None:
        key = ".".join(map(str, first.absolute_path)) or "the file"
        raise InputError(
            f"{key}: {_in_words(first)}", where=where, remedy=f"`vbaa schema {name}` prints what is expected"
        )
    bad = _not_finite(data)
    if bad:
        raise InputError(f"{bad} is not a finite number", where=where, remedy="give a number in SI units")


def _in_words(error: Any) -> str:
    value = repr(error.instance)
    shown = value if len(value) <= 60 else value[:57] + "..."
    match error.validator:
        case "required":
            return error.message.replace("is a required property", "is missing")
        case "additionalProperties":
            return error.message.replace("Additional properties are not allowed", "unknown keys")
        case "type":
            return f"{shown} is not a {error.validator_value}"
        case _:
            return error.message if len(error.message) < 160 else f"{shown} does not fit"


def _not_finite(data: Any, path: str = "") -> str | None:
    if isinstance(data, float) and not math.isfinite(data):
        return path.lstrip(".")
    items = data.items() if isinstance(data, Mapping) else enumerate(data) if isinstance(data, list) else ()
    return next(filter(None, (_not_finite(value, f"{path}.{key}") for key, value in items)), None)
