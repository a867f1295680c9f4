"""What a value in a file must be: the annotation of a field, and the words for what is out of its bounds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints


class Within:
    """Annotation of a field of a file: what its value must be, and its description for the JSON Schema.

    Numbers are finite, and no number is a boolean or a text; an array is a list of them.

    check : makes the value out of what was read. Raises ValueError(clause[, remedy[, key inside the value]]).
    says : ge, gt, le, lt, of a number or of each number of an array; min_length, max_length; pattern, of a text;
        description; alias, the key in the file; default, where the file need not have the key; written, the type in
        the file, where the field has another; before, as `check` for what the file has; also, JSON Schema of what
        `before` accepts besides; json_schema_extra, further keys of the JSON Schema, or a function that changes it.
    """

    def __init__(self, check: Callable[[Any], Any] | None = None, **says: Any) -> None:
        self.check, self.says = check, says

    def holds(self, value: Any) -> bool:
        """Whether a number, or the length of anything else, is within the bounds."""
        says, number = self.says, isinstance(value, float | int)
        low, high = (says.get("ge"), says.get("le")) if number else (says.get("min_length"), says.get("max_length"))
        above, below = says.get("gt"), says.get("lt")
        size = value if number else len(value)
        return (
            (low is None or size >= low)
            and (high is None or size <= high)
            and not (number and ((above is not None and not size > above) or (below is not None and not size < below)))
        )

    def words_for(self, value: Any) -> str:
        """What is needed in place of a value out of the bounds."""
        says = self.says
        if not isinstance(value, float | int):
            least, most = says.get("min_length"), says.get("max_length")
            return f"{least} values" if least == most else f"{least or 0} {f'to {most}' if most else 'or more'} values"
        least = says["gt"] if says.get("ge") is None and "gt" in says else says.get("ge")
        most = says["lt"] if says.get("le") is None and "lt" in says else says.get("le")
        if least is None:
            return f"{most:g} or less"
        if most is None:
            return f"above {least:g}" if says.get("ge") is None else f"{least:g} or more"
        return f"between {least:g} and {most:g}"

    @staticmethod
    def require(record: Any) -> None:
        """Raises ValueError for the first field of a dataclass, of numbers, booleans and texts, that is not what its
        annotation says."""
        kinds = get_type_hints(type(record), include_extras=True)
        for field in fields(record):
            value = getattr(record, field.name)
            if wanted := _wanted(kinds[field.name], value):
                raise ValueError(f"{field.name}: {value!r:.60} is not {wanted}")


def _wanted(kind: Any, value: Any) -> str:
    """What a kind of value has in place of this one; "" where it is one."""
    parts = get_args(kind)
    if get_origin(kind) is Annotated:
        others = (one.words_for(value) for one in parts[1:] if not one.holds(value))
        return _wanted(parts[0], value) or next(others, "")
    if get_origin(kind) is Literal:
        return "" if value in parts else " or ".join(map(repr, parts))
    if get_origin(kind) is tuple:
        if not isinstance(value, tuple | list):
            return "a list"
        return next((wanted for each in value if (wanted := _wanted(parts[0], each))), "")
    if parts:  # one of several kinds
        several = [_wanted(part, value) for part in parts if part is not type(None)]
        return "" if value is None or "" in several else several[0]
    known = {float: (float | int, "a number"), int: (int, "a whole number"), str: (str, "a text")}
    fitting, words = known.get(kind, (bool, "true or false"))
    return "" if isinstance(value, fitting) and (kind is bool or not isinstance(value, bool)) else words
