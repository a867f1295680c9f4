"""`vbaa bench guided`: pictures of the board where suggested and at random, until plane C is known."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.harness import Findings, Options, new_figure, rms, save
from vbaa_calib.calibrate.guide.next_view import lens_progress
from vbaa_calib.calibrate.lens.intrinsics import LensSolution, solve_intrinsics
from vbaa_calib.core.console import progress
from vbaa_calib.core.errors import InputError
from vbaa_calib.detect.board.corners import BoardView

from .rigs import GOAL_MM, Photographer, Rig, jig_pose, rigs, true_error_mm
from .ways import PEOPLE, SUGGESTED, WAYS

COUNTS = (3, 4, 6, 8, 10, 12, 15, 18)
"""Numbers of pictures at which lenses are judged."""

ENOUGH_SUGGESTED = 8
"""Pictures taken where each has to be worked out from those before it."""

_NO_LENS_MM = 100.0


@dataclass(frozen=True)
class Row:
    """One way to choose poses on one rig, after so many pictures, over the seeds.

    Attributes
    ----------
    true_rms_mm : root mean square over seeds of the true error of points on C, the camera's pose found again in the jig
        with this lens from corners exactly seen; a seed without a lens counts as 100 mm. true_median_mm : the median.
    jig_rms_mm : the same with the board's pose found in rendered pictures of the jig; None where nothing is rendered.
    predicted_mm : root mean square over seeds of the deviation predicted. off : rms over seeds of the true error in
        predicted deviations; off_median : its median. None where no seed has a lens.
    reached : share of seeds whose predicted deviation is at most the goal.
    models : the lens models chosen and how often.
    """

    rig: str
    way: str
    pictures: int
    seeds: int
    true_rms_mm: float
    true_median_mm: float
    jig_rms_mm: float | None
    predicted_mm: float | None
    off: float | None
    off_median: float | None
    reached: float
    models: str


@dataclass(frozen=True)
class _Judged:
    """One seed after so many pictures, mm; NaN where there is no lens."""

    true: float
    jig: float
    predicted: float
    model: str


def run(draws: int, seed: int, only: str = "") -> list[Row]:
    """Every way on every rig whose name contains `only`, over the same seeds."""
    chosen = [rig for rig in rigs() if only in rig.name]
    cells = [(rig, way) for rig in chosen for way in WAYS if rig.every or way in (SUGGESTED, PEOPLE)]
    rows: list[Row] = []
    for rig, way in progress(cells, "rigs and ways", len(cells)):
        sequences = [session(rig, way, seed + number) for number in range(draws)]
        counts = sorted({count for sequence in sequences for count in sequence})
        rows += [_row(rig, way, count, [sequence.get(count, _NOTHING) for sequence in sequences]) for count in counts]
    return rows


_NOTHING = _Judged(_NO_LENS_MM, _NO_LENS_MM, np.nan, "")


def session(rig: Rig, way: str, seed: int) -> dict[int, _Judged]:
    """Pictures taken one after the other in one way; the lens judged at `COUNTS`."""
    photographer, views = Photographer(rig, seed), list[BoardView]()
    solution: LensSolution | None = None
    judged: dict[int, _Judged] = {}
    needs_lens = way not in (PEOPLE, "random, anywhere", "emptiest part")
    last = ENOUGH_SUGGESTED if needs_lens else COUNTS[-1]
    while len(views) < last:
        view = WAYS[way](photographer, views, solution)
        if view is None:
            break
        views.append(view)
        if needs_lens or len(views) in COUNTS:
            solution = _solved(views, rig)
        if len(views) in COUNTS:
            judged[len(views)] = _judge(photographer, views, solution)
    return judged


def _solved(views: list[BoardView], rig: Rig) -> LensSolution | None:
    try:
        return solve_intrinsics(views, rig.board)
    except InputError:
        return None


def _judge(photographer: Photographer, views: list[BoardView], solution: LensSolution | None) -> _Judged:
    rig = photographer.rig
    if solution is None:
        return _NOTHING
    camera = solution.camera
    found = jig_pose(photographer, camera) if rig.picture is not None else None
    jig = np.nan if found is None else true_error_mm(camera, rig, found)
    predicted = lens_progress(views, rig.board, rig.plane, solution=solution).std_m
    return _Judged(true_error_mm(camera, rig), jig, 1e3 * predicted, solution.model)


def _row(rig: Rig, way: str, pictures: int, judged: list[_Judged]) -> Row:
    true, jig, predicted = (np.array([getattr(one, name) for one in judged]) for name in ("true", "jig", "predicted"))
    known = np.isfinite(predicted)
    off = true[known] / predicted[known]
    models = Counter(one.model for one in judged if one.model)
    return Row(
        rig=rig.name,
        way=way,
        pictures=pictures,
        seeds=len(judged),
        true_rms_mm=rms(true),
        true_median_mm=float(np.median(true)),
        jig_rms_mm=rms(jig) if np.isfinite(jig).all() and rig.picture is not None else None,
        predicted_mm=rms(predicted[known]) if known.any() else None,
        off=rms(off) if known.any() else None,
        off_median=float(np.median(off)) if known.any() else None,
        reached=float(np.mean(np.where(known, predicted, np.inf) <= GOAL_MM)),
        models=", ".join(f"{model} {count}" for model, count in models.most_common()),
    )


SHARE_GOAL = 2.0 / 3.0
"""Pictures that suggested poses may need, for each that random ones need."""

_COLOURS = ("#0f766e", "#b45309", "#6d28d9", "#64748b", "#be185d")


def pictures_needed(rows: Sequence[Row], name: str) -> int | None:
    """Of one rig and way: pictures from which on the number `name`, mm, stays at or below the goal; None for never."""
    needed: int | None = None
    for row in sorted(rows, key=lambda row: -row.pictures):
        value = getattr(row, name)
        if value is None or value > GOAL_MM:
            break
        needed = row.pictures
    return needed


def as_text(rows: Sequence[Row], draws: int) -> str:
    """The table for people: after how many pictures the goal is reached, and errors on the way."""
    title = (
        f"{draws} seeds; mm on C, rms over seeds: true, and predicted; off: true error in predicted deviations, "
        f"rms and median;\nneeded: pictures from which on it stays within {GOAL_MM} mm, truly and as predicted"
    )
    head = f"{'rig':<36}{'poses':<24}{'needed':>8}{'predicted':>11}   errors: pictures true/predicted (off, median)"
    lines, previous = [title, head], ""
    for rig, way in dict.fromkeys((row.rig, row.way) for row in rows):
        own = [row for row in rows if (row.rig, row.way) == (rig, way)]
        shown, previous = (rig if rig != previous else ""), rig
        needed, foreseen = (pictures_needed(own, name) for name in ("true_rms_mm", "predicted_mm"))
        picked = [row for row in own if row.pictures in (3, 4, 6, 10, 15, 24)]
        errors = "  ".join(_errors(row) for row in picked)
        lines.append(f"{shown:<36}{way:<24}{_count(needed, own):>8}{_count(foreseen, own):>11}   {errors}")
    return "\n".join([*lines, *(_verdict(rows, rig) for rig in dict.fromkeys(row.rig for row in rows))])


def _errors(row: Row) -> str:
    predicted = "–" if row.predicted_mm is None else f"{row.predicted_mm:.3f}"
    off = "–" if row.off is None else f"{row.off:.2f}, {row.off_median:.2f}"
    return f"{row.pictures}: {row.true_rms_mm:.3f}/{predicted} ({off})"


def _count(needed: int | None, rows: Sequence[Row]) -> str:
    return f"> {max(row.pictures for row in rows)}" if needed is None else str(needed)


def _verdict(rows: Sequence[Row], rig: str) -> str:
    ours, random = ([row for row in rows if (row.rig, row.way) == (rig, way)] for way in (SUGGESTED, PEOPLE))
    if not ours or not random:
        return f"{rig:<36}not compared"
    first, second = pictures_needed(ours, "true_rms_mm"), pictures_needed(random, "true_rms_mm")
    if first is None:
        return f"{rig:<36}missed: suggested poses do not reach the goal in {max(row.pictures for row in ours)} pictures"
    most = max(row.pictures for row in random)
    share = first / (second or most)
    size = f"{'at most ' if second is None else ''}{share:.2f} of the pictures that random poses need"
    return f"{rig:<36}{'met' if share <= SHARE_GOAL else 'missed'}: {size}"


def write_figure(path: Path, rows: Sequence[Row], force: bool) -> None:
    """True (line) and predicted (dashes) error over the number of pictures, rig by rig."""
    names, ways = list(dict.fromkeys(row.rig for row in rows)), list(dict.fromkeys(row.way for row in rows))
    figure = new_figure(4.2 * len(names), 4.0)
    for panel, name in zip(figure.subplots(1, len(names), squeeze=False)[0], names, strict=True):
        panel.axhline(GOAL_MM, color="#334155", lw=0.8)
        for way, colour in zip(ways, _COLOURS, strict=False):
            own = [row for row in rows if (row.rig, row.way) == (name, way)]
            if not own:
                continue
            counts = [row.pictures for row in own]
            panel.loglog(counts, [row.true_rms_mm for row in own], "o-", color=colour, markersize=3, lw=1.4, label=way)
            panel.loglog(counts, [row.predicted_mm or float("nan") for row in own], "--", color=colour, lw=0.9)
        panel.set_ylim(0.003, 3.0)
        panel.set_xticks([3, 4, 6, 10, 15, 24], ["3", "4", "6", "10", "15", "24"])
        panel.set_title(name, fontsize=9)
        panel.set_xlabel("pictures")
        panel.grid(alpha=0.3)
        panel.legend(fontsize=7, title="true; dashed: predicted", title_fontsize=7)
    figure.axes[0].set_ylabel("error of points on plane C, mm rms")
    save(figure, path, force)


def measure(options: Options) -> Findings:
    """Every way to choose poses on every rig; a draw is one sequence of pictures."""
    rows = run(options.draws, options.seed)
    return Findings(
        as_text(rows, options.draws),
        {"guided.csv": rows},
        {"guided.png": lambda path, force: write_figure(path, rows, force)},
        {"rows": rows},
        headline(rows),
    )


def headline(rows: Sequence[Row]) -> str:
    """Pictures needed, by suggestion and by chance."""
    suggested, random = _needed(rows, SUGGESTED), _needed(rows, PEOPLE)
    return f"{GOAL_MM} mm on plane C takes {suggested} suggested pictures, {random} at random"


def _needed(rows: Sequence[Row], way: str) -> str:
    """On the rigs in turn: how many, or more than were taken."""
    counts = []
    for rig in dict.fromkeys(row.rig for row in rows):
        own = [row for row in rows if (row.rig, row.way) == (rig, way)]
        if own:
            needed = pictures_needed(own, "true_rms_mm")
            counts.append(f"> {max(row.pictures for row in own)}" if needed is None else str(needed))
    return ", ".join(counts)
