"""The scale of a print from a reading on each of its rulers, and the board as printed."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

from .board import BoardSpec, BoardWithIds


@dataclass(frozen=True)
class _ScaleSettings:
    """Tolerances of the rulers' readings, beyond which a sheet was printed at another scale."""

    reading_std_mm: float = 0.25  # standard deviation of one reading with a ruler
    significant: float = 3.0  # standard deviations from which a scale differs from 1, or from the other axis
    most_aspect: float = 1e-3  # difference of the scales below which a board counts as square: 0.12 mm over 240 mm
    most_std: float = 0.01  # largest standard deviation of a usable scale
    reach_mm: float = 240.0  # a usual antenna's length, for which errors are stated
    range: tuple[float, float] = (0.8, 1.25)  # of scales that a printer can cause; others are slips
    short_mm: float = 100.0  # length of a ruler below which its scale is vague


SCALE = _ScaleSettings()


@dataclass(frozen=True)
class PrintScale:
    """Scale of a print: measured over nominal length of its rulers, in both directions.

    Attributes
    ----------
    scale, std : weighted mean of both axes; their plain mean where the axes differ.
    aspect, aspect_std : scale along x over scale along y, less 1.
    differs : whether the axes differ significantly, and enough to matter.
    words, remedy : finding and advice.
    """

    scale: float
    std: float
    aspect: float
    aspect_std: float
    words: str
    remedy: str
    differs: bool = False


def print_scale(
    ruler_x_mm: float,
    reading_x_mm: float,
    ruler_y_mm: float,
    reading_y_mm: float,
    reading_std_mm: float = SCALE.reading_std_mm,
) -> PrintScale:
    """The scale of a print. Raises ValueError for implausible readings: not positive, in another unit, or exchanged.

    Parameters
    ----------
    ruler_x_mm, ruler_y_mm : nominal lengths between the measured lines.
    reading_x_mm, reading_y_mm : lengths measured with a ruler or a caliper.
    reading_std_mm : standard deviation of a reading, both its ends together: 0.25 with a ruler, 0.05 with a caliper.
    """
    rulers, readings = (ruler_x_mm, ruler_y_mm), (reading_x_mm, reading_y_mm)
    _refuse_senseless(rulers, readings, reading_std_mm)
    x, y = (reading / ruler for reading, ruler in zip(readings, rulers, strict=True))
    std_x, std_y = (reading_std_mm / ruler for ruler in rulers)
    weight_x, weight_y = std_x**-2, std_y**-2
    aspect = x / y - 1
    aspect_std = (x / y) * math.hypot(std_x / x, std_y / y)
    axes = f"{_percent(x, std_x)} along x, {_percent(y, std_y)} along y"
    if abs(aspect) > max(SCALE.significant * aspect_std, SCALE.most_aspect):
        words = (
            f"printed at {axes}: the axes differ by {100 * abs(aspect):.2f} ± {100 * aspect_std:.2f} %, so its squares "
            f"are not square; without these readings lengths of {SCALE.reach_mm:g} mm would be off by "
            f"{SCALE.reach_mm * abs(aspect) / 2:.2g} mm"
        )
        remedy = "go on with both as measured; if the readings were rough, measure again"
        return PrintScale((x + y) / 2, math.hypot(std_x, std_y) / 2, aspect, aspect_std, words, remedy, differs=True)
    scale = (weight_x * x + weight_y * y) / (weight_x + weight_y)
    # an accepted difference of the axes stays in the squares, half of it on either side
    std = math.hypot((weight_x + weight_y) ** -0.5, min(abs(aspect), SCALE.most_aspect) / 2)
    reach = f"lengths of {SCALE.reach_mm:g} mm are known to {SCALE.reach_mm * std:.2g} mm"
    words = f"printed at {_percent(scale, std)} ({axes}): {reach}"
    if SCALE.significant * aspect_std > SCALE.most_aspect:
        words += f"; a difference of the axes below {100 * SCALE.significant * aspect_std:.1f} % would not show"
    remedy = "go on with the size as measured"
    if min(rulers) < SCALE.short_mm:
        remedy = "measure over a longer stretch of the rulers, with a caliper: it is the length that makes it sure"
    elif abs(scale - 1) > SCALE.significant * std:
        fitted = 0.9 < scale < 0.99
        remedy = f"the viewer fitted it to the page, it seems: {remedy}" if fitted else remedy
        remedy += ", or print at 100 %" if fitted else ": every length follows it"
    return PrintScale(scale, std, aspect, aspect_std, words, remedy)


def _refuse_senseless(rulers: tuple[float, float], readings: tuple[float, float], std_mm: float) -> None:
    if not all(type(each) is not bool and isinstance(each, int | float) for each in (*rulers, *readings, std_mm)):
        raise ValueError(f"rulers and readings are {(*rulers, *readings, std_mm)!r:.200}: lengths in mm are needed")
    if not 0 < std_mm <= 5:
        raise ValueError(f"reading_std_mm is {std_mm!r}: more than 0, at most 5 mm is needed")
    least = std_mm / SCALE.most_std
    for kind, lengths, wanted in (("ruler", rulers, "the sheet's ruler says"), ("reading", readings, "you measured")):
        for axis, length in zip("xy", lengths, strict=True):
            if not 0 < length < math.inf:
                raise ValueError(f"{kind}_{axis}_mm is {length!r}: the length that {wanted}, in mm, is needed")
            if kind == "ruler" and length < least:
                raise ValueError(
                    f"ruler_{axis}_mm is {length:g}: readings good to {std_mm:g} mm tell a scale to "
                    f"{100 * std_mm / length:.2g} % there; measure over {least:g} mm or more"
                )
    straight, exchanged = (
        max(abs(reading / ruler - 1) for reading, ruler in zip(order, rulers, strict=True))
        for order in (readings, readings[::-1])
    )
    if straight > 0.1 and exchanged < 0.05:
        raise ValueError(
            f"reading_x_mm is {readings[0]:g} and reading_y_mm {readings[1]:g}, for rulers of {rulers[0]:g} and "
            f"{rulers[1]:g} mm: they are exchanged, it seems; x is the ruler along the sheet's lower edge"
        )
    for axis, ruler, reading in zip("xy", rulers, readings, strict=True):
        ratio, hint = reading / ruler, "read it again, in mm, or print the sheet at 100 %"
        for factor, slip in {
            0.1: "centimetres were read",
            1 / 25.4: "inches were read",
            1e-3: "metres were read",
            10.0: "a digit too many",
        }.items():
            if abs(ratio / factor - 1) < 0.1:
                hint = f"{slip}, it seems, {reading / factor:.5g} mm would do"
        if readings[0] == readings[1] and not 0.9 < rulers[0] / rulers[1] < 1.1:
            hint = "one square was measured, it seems; measure from end to end"
        if not SCALE.range[0] <= ratio <= SCALE.range[1]:
            raise ValueError(f"reading_{axis}_mm is {reading:g} where about {ruler:g} is expected: {hint}")


def _percent(scale: float, std: float) -> str:
    return f"{100 * scale:.2f} ± {100 * std:.2f} %"


def rescaled(spec: BoardWithIds, scale: PrintScale) -> BoardWithIds:
    """The board as printed: squares, markers and tags at the measured scale, the thickness unchanged."""
    if not (isinstance(spec, BoardWithIds) and isinstance(scale, PrintScale)):
        raise ValueError(f"{spec!r:.60} and {scale!r:.60}: a board with ids and what print_scale returns are needed")
    lengths = ("square_m", "marker_m") if isinstance(spec, BoardSpec) else ("tag_m",)
    fields: dict[str, Any] = {name: round(getattr(spec, name) * scale.scale, 9) for name in lengths}
    printed: BoardWithIds = replace(spec, **fields)
    if not scale.differs:
        return printed
    # of the mean, not of y
    stretch, std = (value / (1.0 + 0.5 * scale.aspect) for value in (scale.aspect, scale.aspect_std))
    return replace(printed, stretch=round(stretch, 9), stretch_std=round(std, 9))
