"""`vbaa bench chain`: pictures to contacts, speed against error, every method on the same pictures.

One limit is the Cramér–Rao bound of the whole chain, the other the time to read a picture once from memory.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import groupby
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.figures import AMBER, BLUE, GREEN, GREY, INK, SHADE, VIOLET, label, label_x, legend, name_points, panels
from benchmarks.harness import Findings, Options, column, one_thread, processor_seconds, table
from vbaa_calib.core.console import progress

from .judge import ASTRAY_BOUND, ASTRAY_STATED, reading_seconds, verdict
from .methods import CLASSIC, LINE, LOOP, ONE_LOOK, OURS, PAPER, Answers, Method, others, ours
from .scenes import RIGS, SIZES, Cell, cell, contact_bound, frames_at_information, information_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_LONG_S = 2.0
"""A recording that takes longer is timed once."""


@dataclass(frozen=True)
class ChainRow:
    """One method on the pictures of one size and rig.

    told : the truth decides which points it takes.
    ms, ms_recording : of one thread for one picture that comes alone, and for each of a recording.
    l_rms_mm, l_median_mm : error of the contact distance, of the pictures with a number; None without any.
    l_rms_error_mm : what the rms scatters by from chance, were every error as its picture's bound has it.
    of_bound, of_bound_error : rms error in the bound's standard deviations, and what it scatters by from chance.
    force_percent, direction_deg : rms error of (f_y, f_z) over its size, and of its direction.
    answered, wrong : share with a number; share of all with one that is wrong and confident.
    bound_mm : rms of the bound's standard deviations of the same pictures' distances.
    read_ms : reading a picture of this size once from memory.
    """

    size: str
    rig: str
    method: str = column("method")
    family: str = column("family")
    told: bool = column()
    pictures: int = column()
    ms: float = column("ms", ".1f")
    ms_recording: float = column("recording", ".1f")
    l_rms_mm: float | None = column("l rms mm", ".2f")
    l_rms_error_mm: float | None = column()
    l_median_mm: float | None = column("median", ".2f")
    of_bound: float | None = column("× bound", ".2f")
    of_bound_error: float | None = column("±", ".2f")
    force_percent: float | None = column("force %", ".2f")
    direction_deg: float | None = column("°", ".2f")
    answered: float = column("answered %", ".0f", 100)
    wrong: float = column("wrong %", ".0f", 100)
    bound_mm: float = column()
    read_ms: float = column()


def run(pictures: int, seed: int, quick: bool = False, sizes: Sequence[tuple[int, int]] = SIZES) -> list[ChainRow]:
    """So many pictures of each size and rig. `quick` : times from fewer of them."""
    timed, repeats = (1, 1) if quick else (4, 3)
    rows: list[ChainRow] = []
    with one_thread():
        for size in sizes:
            read_s = reading_seconds(size, repeats)
            for known in RIGS:
                pages = cell(size, known, pictures, seed)
                bound_m, methods = bounds(pages), [*ours(pages.rig), *others(pages.rig)]
                for method in progress(methods, f"{pages.name}, {known} rig", len(methods)):
                    rows.append(_row(pages, method, bound_m, read_s, timed, repeats))
    return rows


def bounds(pages: Cell) -> np.ndarray:
    """(K,) least standard deviations of the pictures' contact distances, m, with the rig as well known as it is."""
    truths = [replace(one.truth, rig=pages.rig) for one in pages.photographs]
    return contact_bound(frames_at_information(truths, [information_of(one) for one in pages.photographs])).std[:, 0]


def _row(pages: Cell, method: Method, bound_m: np.ndarray, read_s: float, timed: int, repeats: int) -> ChainRow:
    photographs = pages.photographs
    singles = [partial(method.solve, photographs[index : index + 1]) for index in range(min(timed, len(pages)))]
    alone = float(np.median([processor_seconds(work, repeats) for work in singles]))
    found: list[Answers] = []
    together = processor_seconds(lambda: found.append(method.solve(photographs)), repeats - 1, _LONG_S) / len(pages)
    return ChainRow(
        size=pages.name,
        rig=pages.known,
        method=method.name,
        family=method.family,
        told=method.told,
        pictures=len(pages),
        ms=1e3 * alone,
        ms_recording=1e3 * together,
        **verdict(found[-1], photographs, bound_m),
        bound_mm=1e3 * float(np.sqrt(np.mean(bound_m**2))),
        read_ms=1e3 * read_s,
    )


_NOTES = f"""\
limit of error: the Cramér–Rao bound from the picture's own pixels and the moment's noise, friction and rig free within
  what is known of them; held as known: cross-section, blur and noise of the picture; free in every column: the line's
  height, level and slope of the background
limit of time: every byte of a picture read once from memory
wrong: off by more than {ASTRAY_BOUND:.0f} of the bound's deviations, and by more than {ASTRAY_STATED:.0f} of its
  own where a method states them; two points on the straight part: the truth tells where it is straight
ms: one thread's processor time from the decoded picture to distance and force; what needs no picture is
  prepared before"""


def _as_text(rows: Sequence[ChainRow], row: Any) -> str:
    """The tables for people, below the result in one sentence."""
    lines = [
        f"auto, {row.size}, a calibrated rig: {row.ms:.1f} ms a picture, {row.ms_recording:.1f} ms in a recording; "
        f"{row.l_rms_mm:.2f} mm rms, {row.of_bound:.2f} ± {row.of_bound_error:.2f} times the bound; reading the "
        f"picture once takes {row.read_ms:.3f} ms",
        _NOTES,
    ]
    for (size, rig), group in groupby(rows, key=lambda row: (row.size, row.rig)):
        own = list(group)
        limits = f"{own[0].bound_mm:.3f} mm rms, {own[0].read_ms:.4f} ms"
        lines += ["", table(own, f"{size}, rig {rig}, {own[0].pictures} pictures; the limits: {limits}")]
    return "\n".join(lines)


def _chosen(rows: Sequence[ChainRow]) -> Any:
    """`auto` on the largest pictures of a rig as calibrations leave it."""
    return [row for row in rows if (row.family, row.method, row.rig) == (OURS, "auto", "calibrated")][-1]


_STYLES = {
    OURS: (GREEN, "s"),
    ONE_LOOK: (GREEN, "P"),
    LOOP: (GREY, "D"),
    PAPER: (AMBER, "o"),
    LINE: (VIOLET, "^"),
    CLASSIC: (BLUE, "v"),
}
"""Of each family of methods: its colour and mark."""


def _figure(rows: Sequence[ChainRow]) -> Figure:
    """One panel for each picture size and rig; full marks a picture that comes alone, hollow ones in a recording."""
    shown = [row for row in rows if row.l_rms_mm is not None]
    cells = list(dict.fromkeys((row.size, row.rig) for row in rows))
    drawn, every = panels(len(cells), 2, (6, 4.9), sharex=True, sharey=True)
    for which, panel in zip(cells, every, strict=True):
        own = [row for row in rows if (row.size, row.rig) == which]
        _limits(panel, own[0])
        _marks(panel, [row for row in own if row.l_rms_mm is not None])
        label(panel, f"{which[0]}, rig {'exactly known' if which[1] == 'exact' else 'as calibrated'}")
    least = min([row.bound_mm for row in rows] + [row.l_rms_mm or 1.0 for row in shown])
    every[0].set_xlim(0.35 * least, 8.0 * max([row.l_rms_mm or 0.0 for row in shown], default=1.0))
    every[0].set_ylim(0.35 * min(row.read_ms for row in rows), 8.0 * max([row.ms for row in shown], default=1.0))
    legend(drawn, _STYLES, "hollow: in a recording; bars: one standard error of the rms", columns=4)
    label_x(every, 2, "rms error of the contact distance, mm")
    drawn.supylabel("processor time per picture, ms")
    return drawn


def _limits(panel: Axes, row: ChainRow) -> None:
    """Left of the bound and below the reading of the picture nothing can be."""
    panel.axvspan(1e-9, row.bound_mm, color=SHADE, lw=0)
    panel.axhspan(1e-9, row.read_ms, color=SHADE, lw=0)
    panel.axvline(row.bound_mm, color=INK, lw=1.2)
    panel.axhline(row.read_ms, color=INK, lw=1.2)
    across, along = panel.get_xaxis_transform(), panel.get_yaxis_transform()
    bound = f"Cramér–Rao bound, {row.bound_mm:.2f} mm "
    panel.text(row.bound_mm, 0.4, bound, rotation=90, ha="right", va="center", transform=across, fontsize=8, color=INK)
    read = f"the picture read once from memory, {row.read_ms:.3f} ms"
    panel.text(0.98, 0.8 * row.read_ms, read, ha="right", va="top", transform=along, fontsize=8, color=INK)


def _marks(panel: Axes, rows: Sequence[ChainRow]) -> None:
    for row in rows:
        colour, mark = _STYLES[row.family]
        error = row.l_rms_mm or 0.0
        scatter = row.l_rms_error_mm or 0.0
        panel.loglog([error, error], [row.ms, row.ms_recording], color=colour, lw=0.7)
        panel.loglog([error - scatter, error + scatter], [row.ms, row.ms], color=colour, lw=1.0, alpha=0.5)
        panel.loglog(error, row.ms_recording, mark, color=colour, markerfacecolor="white", markersize=6)
        panel.loglog(error, row.ms, mark, color=colour, markersize=6)
    alike: dict[object, list[ChainRow]] = {}
    for row in rows:  # rungs whose errors are much the same share a label
        about = round(8 * np.log10(row.l_rms_mm or 1.0)) if row.family == OURS else row.method
        alike.setdefault(about, []).append(row)
    names = [", ".join(row.method for row in group) for group in alike.values()]
    at = [(max(row.l_rms_mm or 0.0 for row in g), g[0].ms, _STYLES[g[0].family][0]) for g in alike.values()]
    name_points(panel, [(name, *place) for name, place in zip(names, at, strict=True)], gap=1.35)


def measure(options: Options) -> Findings:
    """The subject `chain` of `vbaa bench`; a draw is a picture, of each size and rig."""
    rows = run(options.draws, options.seed, options.quick)
    row = _chosen(rows)
    return Findings(
        _as_text(rows, row),
        {"chain.csv": rows},
        {"chain.png": lambda: _figure(rows)},
        {"rows": rows},
        f"picture to contact, auto, {row.size}: {row.ms:.0f} ms, {row.of_bound:.2f} × the bound; reading it "
        f"{row.read_ms:.3f} ms",
    )
