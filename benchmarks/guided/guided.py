"""`vbaa bench guided`: pictures of the board where suggested and at random, until plane C is known."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.figures import COLOURS, INK, label, panels
from benchmarks.harness import Draws, Findings, Options, aligned, cell, column, of_any, or_none, rms, rms_known, row_of
from vbaa_calib.calibrate.guide.next_view import lens_progress
from vbaa_calib.calibrate.lens.intrinsics import LensSolution, solve_intrinsics
from vbaa_calib.core.console import progress
from vbaa_calib.core.errors import InputError
from vbaa_calib.detect.board.corners import BoardView

from .rigs import GOAL_MM, PEOPLE, STRATEGIES, SUGGESTED, Photographer, Rig, rigs, true_error_mm

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_COUNTS = (3, 4, 6, 8, 10, 12, 15, 18)
"""Numbers of pictures at which lenses are judged."""
ENOUGH_SUGGESTED = 8
"""Pictures taken where each has to be worked out from those before it."""
_NO_LENS_MM = 100.0


def _off(judged: Draws) -> np.ndarray:
    """True errors in predicted deviations, of the seeds with a lens."""
    return (judged.true / judged.predicted)[np.isfinite(judged.predicted)]


@dataclass(frozen=True)
class Row:
    """One strategy on one rig, after so many pictures, over the seeds.

    true_rms_mm : root mean square over seeds of the true error of points on C, the camera's pose found again in the jig
        with this lens from exact corners; a seed without a lens counts as 100 mm. true_median_mm : the median.
    jig_rms_mm : the same with the board's pose found in rendered pictures of the jig; None where nothing is rendered.
    predicted_mm : root mean square over seeds of the deviation predicted. off : rms over seeds of the true error in
        predicted deviations; off_median : its median. None where no seed has a lens.
    reached : share of seeds whose predicted deviation is at most the goal.
    models : the lens models chosen and how often.
    """

    rig: str
    way: str
    pictures: int
    seeds: int = column(of=len)
    true_rms_mm: float = column(of=lambda judged: rms(judged.true))
    true_median_mm: float = column(of=lambda judged: float(np.median(judged.true)))
    jig_rms_mm: float | None = column(of=lambda judged: or_none(rms(judged.jig)))
    predicted_mm: float | None = column(of=lambda judged: or_none(rms_known(judged.predicted)))
    off: float | None = column(of=lambda judged: or_none(rms(_off(judged))))
    off_median: float | None = column(of=lambda judged: of_any(np.median, _off(judged)))
    reached: float = column(of=lambda judged: float((judged.predicted <= GOAL_MM).mean()))
    models: str = column(default="")


@dataclass(frozen=True)
class _Judged:
    """One seed after so many pictures, mm; NaN where there is no lens."""

    true: float
    jig: float
    predicted: float
    model: str


def run(draws: int, seed: int) -> list[Row]:
    """Every strategy on every rig, over the same seeds."""
    cells = [(rig, way) for rig in rigs() for way in STRATEGIES]
    rows: list[Row] = []
    for rig, way in progress(cells, "rigs and strategies", len(cells)):
        sequences = [sequence(rig, way, seed + number) for number in range(draws)]
        counts = sorted({count for judged in sequences for count in judged})
        for count in counts:
            judged = [each.get(count, _nothing(rig)) for each in sequences]
            models = Counter(one.model for one in judged if one.model).most_common()
            words = ", ".join(f"{model} {number}" for model, number in models)
            rows.append(row_of(Row, Draws(judged), rig.name, way, count, models=words))
    return rows


def _nothing(rig: Rig) -> _Judged:
    """Of a seed without a lens."""
    return _Judged(_NO_LENS_MM, np.nan if rig.picture is None else _NO_LENS_MM, np.nan, "")


def sequence(rig: Rig, way: str, seed: int) -> dict[int, _Judged]:
    """Pictures taken one after the other by one strategy; the lens judged at `_COUNTS`."""
    photographer, views = Photographer(rig, seed), list[BoardView]()
    solution: LensSolution | None = None
    judged: dict[int, _Judged] = {}
    while len(views) < (ENOUGH_SUGGESTED if way == SUGGESTED else _COUNTS[-1]):
        view = STRATEGIES[way](photographer, views, solution)
        if view is None:
            break
        views.append(view)
        if way == SUGGESTED or len(views) in _COUNTS:
            try:
                solution = solve_intrinsics(views, rig.board)
            except InputError:
                solution = None
        if len(views) in _COUNTS:
            judged[len(views)] = _judge(photographer, views, solution)
    return judged


def _judge(photographer: Photographer, views: list[BoardView], solution: LensSolution | None) -> _Judged:
    rig = photographer.rig
    if solution is None:
        return _nothing(rig)
    camera = solution.camera
    found = photographer.in_the_jig(camera) if rig.picture is not None else None
    jig = np.nan if found is None else true_error_mm(camera, rig, found)
    predicted = lens_progress(views, rig.board, rig.plane, solution=solution).std_m
    return _Judged(true_error_mm(camera, rig), jig, 1e3 * predicted, solution.model)


_SHARE_GOAL = 2.0 / 3.0
"""Pictures that suggested poses may need, for each that random ones need."""


def pictures_needed(rows: Sequence[Row], name: str) -> int | None:
    """Of one rig and strategy: pictures from which on the number `name`, mm, stays within the goal; None for never."""
    needed: int | None = None
    for row in sorted(rows, key=lambda row: -row.pictures):
        value = getattr(row, name)
        if value is None or value > GOAL_MM:
            break
        needed = row.pictures
    return needed


def _needed(rows: Sequence[Row], name: str = "true_rms_mm") -> str:
    return str(pictures_needed(rows, name) or f"> {max(row.pictures for row in rows)}")


def _of(rows: Sequence[Row], rig: str, way: str) -> list[Row]:
    return [row for row in rows if (row.rig, row.way) == (rig, way)]


def as_text(rows: Sequence[Row], draws: int) -> str:
    """After how many pictures the goal is reached, errors on the way, and a verdict on each rig."""
    title = (
        f"{draws} seeds; mm on C, rms over seeds: true, and predicted; off: true error in predicted deviations, "
        f"rms and median;\nneeded: pictures from which on it stays within {GOAL_MM} mm, truly and as predicted"
    )
    lines = [["rig", "poses", "needed", "predicted", "errors: pictures true/predicted (off, median)"]]
    for rig, way in dict.fromkeys((row.rig, row.way) for row in rows):
        own, errors = _of(rows, rig, way), []
        for row in (row for row in own if row.pictures in (3, 4, 6, 10, 15)):
            predicted, off, median = cell(row.predicted_mm, ".3f"), cell(row.off, ".2f"), cell(row.off_median, ".2f")
            errors.append(f"{row.pictures}: {row.true_rms_mm:.3f}/{predicted} ({off}, {median})")
        lines.append([rig, way, _needed(own), _needed(own, "predicted_mm"), "  ".join(errors)])
    verdicts = [f"{rig}: {_verdict(rows, rig)}" for rig in dict.fromkeys(row.rig for row in rows)]
    return "\n".join([aligned(lines, (True, True, False, False, True), title), *verdicts])


def _verdict(rows: Sequence[Row], rig: str) -> str:
    ours, random = _of(rows, rig, SUGGESTED), _of(rows, rig, PEOPLE)
    if not ours or not random:
        return "not compared"
    first, second = pictures_needed(ours, "true_rms_mm"), pictures_needed(random, "true_rms_mm")
    if first is None:
        return f"missed: suggested poses do not reach the goal in {max(row.pictures for row in ours)} pictures"
    share = first / (second or max(row.pictures for row in random))
    size = f"{'at most ' if second is None else ''}{share:.2f} of the pictures that random poses need"
    return f"{'met' if share <= _SHARE_GOAL else 'missed'}: {size}"


def _figure(rows: Sequence[Row]) -> Figure:
    """True (line) and predicted (dashes) error over the number of pictures, rig by rig."""
    names, ways = (list(dict.fromkeys(getattr(row, name) for row in rows)) for name in ("rig", "way"))
    drawn, every = panels(len(names), len(names), (4.2, 4.0))
    for panel, name in zip(every, names, strict=True):
        panel.axhline(GOAL_MM, color=INK, lw=0.8)
        for way, colour in zip(ways, COLOURS, strict=False):
            own = _of(rows, name, way)
            if own:
                counts, true = [row.pictures for row in own], [row.true_rms_mm for row in own]
                panel.loglog(counts, true, "o-", color=colour, markersize=3, lw=1.4, label=way)
                panel.loglog(counts, [row.predicted_mm or np.nan for row in own], "--", color=colour, lw=0.9)
        panel.set_ylim(0.003, 3.0)
        panel.set_xticks([3, 4, 6, 10, 15], ["3", "4", "6", "10", "15"])
        label(panel, name, "pictures")
        panel.legend(fontsize=7, title="true; dashed: predicted", title_fontsize=7)
    every[0].set_ylabel("error of points on plane C, mm rms")
    return drawn


def measure(options: Options) -> Findings:
    """Every strategy on every rig; a draw is one sequence of pictures."""
    rows = run(options.draws, options.seed)
    # on the rigs in turn, by suggestion and by chance
    suggested, random = (
        ", ".join(_needed(own) for rig in dict.fromkeys(row.rig for row in rows) if (own := _of(rows, rig, way)))
        for way in (SUGGESTED, PEOPLE)
    )
    return Findings(
        as_text(rows, options.draws),
        {"guided.csv": rows},
        {"guided.png": lambda: _figure(rows)},
        {"rows": rows},
        f"{GOAL_MM} mm on plane C takes {suggested} suggested pictures, {random} at random",
    )
