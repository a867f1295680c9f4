"""The figure of `vbaa budget`: contributions to each standard deviation, and the distance's standard deviation along
the antenna."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from estimator.budget.budget import CAUSES, OWN, Budget, per_result
from estimator.budget.report import RESULT_NAMES, TABLES, unit_of
from viz.pages.page import number, render

from .drawing import Plot, key_rows
from .settings import STYLE

Looks = tuple[str, str]
"""Name and colour of a cause."""


def budget_figure(budget: Budget) -> str:
    """An SVG file: shares of each result's variance, those of the calibration's part, and the standard deviation of
    l along l."""
    look: dict[str, Looks] = {cause: (one.name, one.colour) for cause, one in CAUSES.items()}
    of_rig = {look[cause]: rows for cause, rows in budget.variances.items() if cause not in OWN}
    grouped = {look[cause]: rows for cause, rows in budget.variances.items() if cause in OWN}
    if of_rig:
        grouped["calibration", "#334155"] = np.sum(list(of_rig.values()), axis=0)
    whole, common = ({name: getattr(budget.results[name], of) for name in TABLES} for of in ("std", "common_std"))
    panels = [_bars("What makes up each standard deviation", whole, grouped)]
    if of_rig:
        panels.append(_bars("The calibration's part of it", common, of_rig))
    drawn = [*_shares(grouped), *_shares(of_rig)]
    key = [(colour, name, "block") for name, colour in dict.fromkeys(drawn)]
    if len(np.unique(budget.touches.distance_m)) > 1:
        kept = {one: rows for one, rows in grouped.items() if one != look["force_prior"]}
        panels.append(_along(budget, kept))
        key.append((STYLE.ink, "all", "line"))
    (wide, tall), width = panels[0].size, panels[0].size[0] * len(panels)
    rows = key_rows(key, width - 48)
    sheet = Plot("", (width, tall + 24 * len(rows) + 12), (0, 0, 0, 0), x_ticks=((), ()), y_ticks=((), ()), grid="")
    sheet.under.append(f"<style>{render('style.css')}</style>")
    sheet.under.append('<rect width="100%" height="100%" style="fill:var(--sheet)"/>')
    for place, panel in enumerate(panels):
        sheet.over.append(panel.svg(attributes=f'x="{place * wide:g}" width="{wide:g}" height="{tall:g}"'))
    for row, entries in enumerate(rows):
        sheet.over.append(f'<text class="legend" x="24" y="{tall + 18 + 24 * row:g}">{entries}</text>')
    size = f'width="{width:g}" height="{sheet.size[1]:g}" font-family="system-ui, Segoe UI, Roboto, sans-serif"'
    return sheet.svg("error budget", f'xmlns="http://www.w3.org/2000/svg" {size}') + "\n"


def _plot(title: str, **axes: Any) -> Plot:
    return Plot(title, (440.0, 380.0), (70.0, 16.0, 74.0, 50.0), **axes)


def _shares(variances: Mapping[Looks, np.ndarray]) -> dict[Looks, np.ndarray]:
    """The share, percent, of each visible cause in each result's variance."""
    means = {one: np.array([per_result(rows)[name].mean() for name in TABLES]) for one, rows in variances.items()}
    total: np.ndarray = np.sum(list(means.values()), axis=0)
    shares = {one: 100.0 * mean / np.where(total > 0.0, total, 1.0) for one, mean in means.items()}
    # percent of the variance: smaller causes are not drawn
    return {one: share for one, share in shares.items() if share.max() >= 0.1}


def _bars(title: str, std: Mapping[str, float], variances: Mapping[Looks, np.ndarray]) -> Plot:
    """Stacked bars of the shares of each result's variance, with the standard deviations `std` above them."""
    axes = _plot(
        title,
        x=(-0.5, len(TABLES) - 0.5),
        y=(0.0, 100.0),
        labels=("", "share of the variance, %"),
        x_ticks=(range(len(TABLES)), [RESULT_NAMES[name] for name in TABLES]),
        grid="y",
    )
    below = np.zeros(len(TABLES))
    for (words, colour), share in _shares(variances).items():
        for place, part in enumerate(share):
            left, right = place - 0.31, place + 0.31
            low, high = below[place], below[place] + part
            corners = np.array([[[left, low], [right, low], [right, high], [left, high]]])
            axes.paths(corners, "share", fill=colour, tip=f"{words}: {number(part, 2)} %")
        below = below + share
    for place, name in enumerate(TABLES):
        axes.write((place, 100.0), f"± {number(1e3 * std[name], 2)} {unit_of(name)}", "middle", "strong", (0, -9))
    return axes


def _along(budget: Budget, variances: Mapping[Looks, np.ndarray]) -> Plot:
    """Standard deviation of l against the distance, rms over directions and loads."""
    distances, which = np.unique(budget.touches.distance_m, return_inverse=True)
    every = {**variances, ("all", STYLE.ink): np.sum(list(budget.variances.values()), axis=0)}
    logs = {
        one: np.log10(1e3 * np.sqrt(np.bincount(which, per_result(rows)["distance_m"]) / np.bincount(which)) + 1e-9)
        for one, rows in every.items()
    }
    top = max(float(values.max()) for values in logs.values())
    low = max(min(float(values.min()) for values in logs.values()), top - 3.0)
    steps = [digit * 10.0**power for power in range(-9, 6) for digit in (1, 2, 5)]
    steps = [step for step in steps if low - 0.2 <= np.log10(step) <= top + 0.2]
    axes = _plot(
        "Along the antenna",
        x=(0.0, 1.04e3 * float(distances[-1])),
        y=(low - 0.1, top + 0.1),
        labels=("contact's distance l, mm", "standard deviation of l, mm"),
        y_ticks=([float(np.log10(step)) for step in steps], [f"{step:g}" for step in steps]),
    )
    for (name, colour), values in logs.items():
        axes.line(1e3 * distances, values, colour, 2.4 if name == "all" else 1.4, name)
        axes.dots(1e3 * distances, values, colour, 6.0 if name == "all" else 4.5)
    return axes
