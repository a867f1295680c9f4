"""The scale of the board's print, by what was measured on it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from targets.scale import READING_STD_MM, PrintScale, print_scale

from ..errors import InputError

MEASURED = ("measure_x_mm", "board_along_x_mm", "measure_y_mm", "board_along_y_mm")
"""Answers that a scale needs: what the rulers say, and what was read on them."""
_WHERE = "board_along_x_mm, board_along_y_mm"


def scale_of(answers: Mapping[str, Any]) -> PrintScale | None:
    """The print's scale; None before both readings were given. Raises InputError for readings that cannot be."""
    if any(name not in answers for name in MEASURED):
        return None
    x, along_x, y, along_y = (float(answers[name]) for name in MEASURED)
    try:
        return print_scale(x, along_x, y, along_y, float(answers.get("board_reading_std_mm", READING_STD_MM)))
    except ValueError as error:
        # targets.scale knows its own parameters, not what they are called here
        what = str(error).replace("reading_std", "board_reading_std")
        what = what.replace("reading_x", "board_along_x").replace("reading_y", "board_along_y")
        raise InputError(what, where=_WHERE, remedy="measure it again") from None


def square_scale_of(answers: Mapping[str, Any]) -> PrintScale | None:
    """The same. Raises InputError for a print whose squares are not square, too: no board describes it."""
    scale = scale_of(answers)
    if scale is not None and scale.differs:
        raise InputError(scale.words, where=_WHERE, remedy=scale.remedy)
    return scale
