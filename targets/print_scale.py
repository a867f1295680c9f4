"""The scale of a print, from one reading on each of the sheet's rulers, and the board as it was printed."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from .board import BoardSpec

READING_STD_MM = 0.25
SIGNIFICANT = 3.0
MOST_ASPECT = 1e-3
"""Difference of the scales in x and y below which a board may be called square: 0.12 mm at the end of 240 mm."""
_LEAST_PRECISION = 0.01
"""Standard deviation of a scale beyond which it is not taken."""
_REACH_MM = 240.0
"""The length for which errors are told in words: a usual antenna's."""
_RANGE = (0.8, 1.25)
_SHORT_MM = 100.0
_SLIPS = {
    0.1: "centimetres were read, it seems",
    1 / 25.4: "inches were read, it seems",
    1e-3: "metres were read, it seems",
    10.0: "a digit too many, it seems",
}


@dataclass(frozen=True)
class PrintScale:
    """How large a sheet was printed: measured length over the length that its ruler says.

    Attributes
    ----------
    scale_x, scale_y, std_x, std_y : along each axis, with standard deviations.
    scale, std : of both together, weighted by how well each is known. NaN where the axes differ.
    aspect, aspect_std : scale_x / scale_y - 1.
    differs : the axes differ by more than the readings allow, and by enough to matter: no BoardSpec describes it.
    words, remedy : what was found, and what to do.
    """

    scale_x: float
    scale_y: float
    std_x: float
    std_y: float
    scale: float
    std: float
    aspect: float
    aspect_std: float
    differs: bool
    words: str
    remedy: str


def print_scale(
    ruler_x_mm: float,
    reading_x_mm: float,
    ruler_y_mm: float,
    reading_y_mm: float,
    reading_std_mm: float = READING_STD_MM,
) -> PrintScale:
    """The scale of a print.

    Parameters
    ----------
    ruler_x_mm, ruler_y_mm : what the sheet's rulers say between the two lines that were measured.
    reading_x_mm, reading_y_mm : what a ruler or a caliper says.
    reading_std_mm : standard deviation of a reading, both its ends together: 0.25 with a ruler, 0.05 with a caliper.

    Raises
    ------
    ValueError : a reading that cannot be: not a positive number, another unit, the two exchanged.
    """
    if not 0 < reading_std_mm <= 5:
        raise ValueError(f"reading_std_mm is {reading_std_mm!r}: more than 0, at most 5 mm is needed")
    rulers, readings = (ruler_x_mm, ruler_y_mm), (reading_x_mm, reading_y_mm)
    for name, value in zip(("ruler_x_mm", "ruler_y_mm"), rulers, strict=True):
        if not (math.isfinite(value) and value > 0):
            raise ValueError(f"{name} is {value!r}: the length that the sheet's ruler says, in mm, is needed")
        least = reading_std_mm / _LEAST_PRECISION
        if value < least:
            raise ValueError(
                f"{name} is {value:g}: readings good to {reading_std_mm:g} mm tell a scale to "
                f"{100 * reading_std_mm / value:.2g} % there; measure over {least:g} mm or more"
            )
    for name, value in zip(("reading_x_mm", "reading_y_mm"), readings, strict=True):
        if not (math.isfinite(value) and value > 0):
            raise ValueError(f"{name} is {value!r}: the length that you measured, in mm, is needed")
    _refuse_exchanged(rulers, readings)
    _refuse_senseless(rulers, readings)
    x, y = (reading / ruler for reading, ruler in zip(readings, rulers, strict=True))
    std_x, std_y = (reading_std_mm / ruler for ruler in rulers)
    weight_x, weight_y = std_x**-2, std_y**-2
    aspect = x / y - 1
    aspect_std = (x / y) * math.hypot(std_x / x, std_y / y)
    differs = abs(aspect) > max(SIGNIFICANT * aspect_std, MOST_ASPECT)
    both = (weight_x * x + weight_y * y) / (weight_x + weight_y)
    # a difference of the axes that is let pass stays in the squares, half of it to either side
    unseen = min(abs(aspect), MOST_ASPECT) / 2
    scale, std = (math.nan, math.nan) if differs else (both, math.hypot((weight_x + weight_y) ** -0.5, unseen))
    words, remedy = _judged(x, std_x, y, std_y, scale, std, aspect, aspect_std, min(rulers))
    return PrintScale(x, y, std_x, std_y, scale, std, aspect, aspect_std, differs, words, remedy)


def _refuse_exchanged(rulers: tuple[float, float], readings: tuple[float, float]) -> None:
    def off(first: float, second: float) -> float:
        return max(abs(first / rulers[0] - 1), abs(second / rulers[1] - 1))

    if off(*readings) > 0.1 and off(*reversed(readings)) < 0.05:
        raise ValueError(
            f"reading_x_mm is {readings[0]:g} and reading_y_mm {readings[1]:g}, for rulers of {rulers[0]:g} and "
            f"{rulers[1]:g} mm: they are exchanged, it seems; x is the ruler along the sheet's lower edge"
        )


def _refuse_senseless(rulers: tuple[float, float], readings: tuple[float, float]) -> None:
    for axis, ruler, reading in zip("xy", rulers, readings, strict=True):
        ratio = reading / ruler
        if _RANGE[0] <= ratio <= _RANGE[1]:
            continue
        slip = next((words for factor, words in _SLIPS.items() if abs(ratio / factor - 1) < 0.1), None)
        meant = next((factor for factor in _SLIPS if abs(ratio / factor - 1) < 0.1), None)
        hint = (
            f": {slip}, {reading / meant:.5g} mm would do"
            if slip and meant
            else ": read it again, in mm, or print the sheet at 100 %"
        )
        raise ValueError(f"reading_{axis}_mm is {reading:g} where about {ruler:g} is expected{hint}")


def _judged(
    x: float,
    std_x: float,
    y: float,
    std_y: float,
    scale: float,
    std: float,
    aspect: float,
    aspect_std: float,
    shorter_mm: float,
) -> tuple[str, str]:
    axes = f"{_percent(x, std_x)} along x, {_percent(y, std_y)} along y"
    if math.isnan(scale):
        return (
            f"printed at {axes}: the axes differ by {100 * abs(aspect):.2f} ± {100 * aspect_std:.2f} %, so its squares "
            f"are not square, and lengths of {_REACH_MM:g} mm would be off by {_REACH_MM * abs(aspect) / 2:.2g} mm",
            "print it again, at 100 % and with nothing fitted to the page, on another printer if it comes out the "
            "same; if the readings were rough, measure again",
        )
    words = (
        f"printed at {_percent(scale, std)} ({axes}): lengths of {_REACH_MM:g} mm are known to {_REACH_MM * std:.2g} mm"
    )
    if SIGNIFICANT * aspect_std > MOST_ASPECT:
        words += f"; a difference of the axes below {100 * SIGNIFICANT * aspect_std:.1f} % would not show"
    if shorter_mm < _SHORT_MM:
        return words, "measure over a longer stretch of the rulers, with a caliper: it is the length that makes it sure"
    if abs(scale - 1) <= SIGNIFICANT * std:
        return words, "go on with the size as measured"
    if 0.9 < scale < 0.99:
        return words, "the viewer fitted it to the page, it seems: go on with the size as measured, or print at 100 %"
    return words, "go on with the size as measured: every length follows it"


def _percent(scale: float, std: float) -> str:
    return f"{100 * scale:.2f} ± {100 * std:.2f} %"


def rescaled(spec: BoardSpec, scale: PrintScale) -> BoardSpec:
    """The board as it was printed: squares and markers at the measured scale; the mount's thickness stays.

    Raises ValueError where the axes differ: a BoardSpec has square squares.
    """
    if scale.differs:
        raise ValueError(f"{scale.words}; {scale.remedy}")
    return replace(spec, square_m=round(spec.square_m * scale.scale, 9), marker_m=round(spec.marker_m * scale.scale, 9))
