"""The page on repeated calibrations of one rig."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vbaa_calib.rig.over_time import FEWEST_FOR_TREND, OverTime
from viz.figures.drawing import Plot, limits
from viz.figures.settings import STYLE
from viz.pages.page import Table, labelled, number, render


def words(found: OverTime) -> list[str]:
    """Sentences on the parameters that are constant, scatter and drift."""
    lines = []
    for index, name in enumerate(found.names):
        label, unit, scale = labelled(name)
        columns = found.slope_per_day, found.slope_std_per_day, found.between_std, found.supposed_std
        slope, std, between, supposed = (number(scale * float(each[index]), 2) for each in columns)
        unit = f" {unit}" if unit else ""
        if found.drifts[index]:
            lines.append(f"{label} drifts by {slope} ± {std}{unit} a day")
        elif found.scatters[index]:
            lines.append(
                f"{label} varies by {between}{unit} from one calibration to the next beyond what they state; the drift "
                f"in rig.json supposes {supposed}{unit}"
            )
    if len(found.days) < FEWEST_FOR_TREND:
        lines.append(f"fewer than {FEWEST_FOR_TREND} calibrations show no trend")
    return lines or [f"all {len(found.names)} parameters stay within their deviations"]


def page(title: str, found: OverTime, dates: Sequence[str], lines: Sequence[str]) -> str:
    """The page: a row and a plot for each parameter over dates."""
    moves = found.scatters | found.drifts
    head = ("parameter", "unit", "last minus first", "±", "between calibrations", "a day", "± a day", "")
    rows = []
    for index, name in enumerate(found.names):
        verdict = "drifts" if found.drifts[index] else "scatters" if found.scatters[index] else ""
        values = (found.values[-1], found.std[-1], found.between_std, found.slope_per_day, found.slope_std_per_day)
        label, unit, scale = labelled(name)
        rows.append([label, unit, *(number(scale * float(each[index]), 3) for each in values), verdict])
    order = np.argsort(~moves, kind="stable")
    return render(
        "over_time.html.j2",
        title=title,
        colour=STYLE.red if found.drifts.any() else STYLE.amber if moves.any() else STYLE.teal,
        headline=f"{len(dates)} calibrations, {' to '.join(dates[end].removesuffix(' 00:00') for end in (0, -1))}",
        words=lines,
        numbers=Table(head, rows, ("parameter", "unit", "")),
        figures=[_figure(found, int(index)).svg() for index in order],
    )


def _figure(found: OverTime, index: int) -> Plot:
    """One parameter against days, with two standard deviations, its mean, and its trend where there is one."""
    label, unit, scale = labelled(found.names[index])
    at, value, std = found.days, scale * found.values[:, index], scale * found.std[:, index]
    low, high = value - 2.0 * std, value + 2.0 * std
    title = f"{label}, {unit}" if unit else label
    axes = Plot(title, x=limits(at), y=limits(low, high), labels=("days", "change since the first"))
    ends, mean, between = np.array(axes.x), scale * found.mean[index], scale * found.between_std[index]
    axes.band(ends, np.full(2, mean - between), np.full(2, mean + between), STYLE.slate)
    if found.drifts[index]:
        axes.line(ends, value.mean() + scale * found.slope_per_day[index] * (ends - at.mean()), STYLE.red, 1.5)
    colour = STYLE.red if found.drifts[index] else STYLE.amber if found.scatters[index] else STYLE.teal
    axes.bars(at, low, high, colour)
    axes.dots(at, value, colour)
    return axes
