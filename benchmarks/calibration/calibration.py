"""`vbaa bench calibration`: lenses from corners, in millimetres on plane C, beside an oracle and other calibrators."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.harness import cell, new_figure, or_none, save
from vbaa_calib.core.console import progress

from .judge import error_mm
from .methods import Outcome, methods
from .rigs import Rig, draw, rigs

if TYPE_CHECKING:
    from matplotlib.axes import Axes
from benchmarks.harness import Findings, Options

from .peers import versions


@dataclass(frozen=True)
class Row:
    """One method on one rig, over the draws.

    Attributes
    ----------
    error_mm : median over draws of the rms error of points on C, whose pose is told; None where the method is absent
        or mostly failed. ratio : the same over the oracle's. rms_ratio : root mean squares over draws likewise;
        None where a draw failed.
    jig_error_mm, jig_ratio, jig_rms_ratio : the same with the pose of C solved with the method's own lens.
    seconds : median time of one solve. folds : share of draws whose lens folds inside the picture.
    good_dropped : share of the good corners that were left out; None where the method does not say.
    outliers_found : share of the outliers that were left out; None as above or where there are none.
    models : the lens models chosen and how often, where there was a choice. note : why there are no numbers.
    """

    rig: str
    method: str
    error_mm: float | None = None
    ratio: float | None = None
    rms_ratio: float | None = None
    jig_error_mm: float | None = None
    jig_ratio: float | None = None
    jig_rms_ratio: float | None = None
    seconds: float | None = None
    folds: float | None = None
    good_dropped: float | None = None
    outliers_found: float | None = None
    models: str = ""
    note: str = ""


def run(draws: int, seed: int) -> list[Row]:
    """Every method on every rig over the same draws, the oracle first."""
    rows = []
    every = methods()
    for rig in progress(rigs(), "rigs", len(rigs())):
        given = [draw(rig, seed + number) for number in range(draws)]
        oracle: np.ndarray | None = None
        for name, method in every.items():
            if isinstance(method, str):
                rows.append(Row(rig.name, name, note=method))
                continue
            outcomes = method(given)
            errors = np.array([_errors(outcome, rig) for outcome in outcomes])
            oracle = errors if oracle is None else oracle
            rows.append(_row(rig, name, outcomes, errors, oracle))
    return rows


def _errors(outcome: Outcome, rig: Rig) -> tuple[float, float]:
    """Error in mm on C with its pose told, and with its pose solved."""
    if outcome.camera is None:
        return np.inf, np.inf
    return error_mm(outcome.camera, rig.camera), error_mm(outcome.camera, rig.camera, from_jig=True)


def _row(rig: Rig, name: str, outcomes: Sequence[Outcome], errors: np.ndarray, oracle: np.ndarray) -> Row:
    """One method's row; errors (D, 2) mm of its outcomes and of the oracle's."""
    cameras = [outcome.camera for outcome in outcomes if outcome.camera is not None]
    failures = [outcome.failure for outcome in outcomes if outcome.camera is None]
    chosen = Counter(outcome.model for outcome in outcomes if outcome.model)
    middle, own_rms = np.median(errors, axis=0), np.sqrt(np.mean(errors**2, axis=0))
    reference, reference_rms = np.median(oracle, axis=0), np.sqrt(np.mean(oracle**2, axis=0))
    return Row(
        rig=rig.name,
        method=name,
        error_mm=or_none(middle[0]),
        ratio=or_none(middle[0] / reference[0]),
        rms_ratio=or_none(own_rms[0] / reference_rms[0]),
        jig_error_mm=or_none(middle[1]),
        jig_ratio=or_none(middle[1] / reference[1]),
        jig_rms_ratio=or_none(own_rms[1] / reference_rms[1]),
        seconds=_mean([outcome.seconds for outcome in outcomes if outcome.camera is not None], np.median),
        folds=_mean([camera.valid_region().image_fraction < 1.0 for camera in cameras]),
        good_dropped=_mean([outcome.good_dropped for outcome in outcomes]),
        outliers_found=_mean([outcome.outliers_found for outcome in outcomes]),
        models=", ".join(f"{model} {count}" for model, count in chosen.most_common()),
        note=f"{len(failures)} of {len(outcomes)} failed: {failures[0]}" if failures else "",
    )


def _mean(values: Sequence[float | None], middle: Callable[[list[float]], np.floating] = np.mean) -> float | None:
    given = [value for value in values if value is not None]
    return float(middle(given)) if given else None


_TITLE = (
    "mm on C: median of {draws} draws, its pose told; jig: its pose solved with the same lens; × oracle: of medians, "
    "then of root mean squares; s: median of one solve; lost: good corners left out; caught: outliers left out"
)


def as_text(rows: Sequence[Row], draws: int) -> str:
    """The table for people."""
    head = (
        f"{'rig':<34}{'method':<23}{'mm on C':>8}{'× oracle':>14}{'mm, jig':>9}{'× oracle':>14}{'s':>8}"
        f"{'folds %':>8}{'lost %':>8}{'caught %':>9}"
    )
    lines = [_TITLE.format(draws=draws), head]
    rig = ""
    for row in rows:
        shown, rig = (row.rig if row.rig != rig else ""), row.rig
        lines.append(f"{shown:<34}{row.method:<23}" + (_numbers(row) if row.seconds is not None else row.note))
    return "\n".join(lines)


def _numbers(row: Row) -> str:
    cells = (
        (row.error_mm, 8, 4, 1),
        (row.ratio, 7, 3, 1),
        (row.rms_ratio, 7, 3, 1),
        (row.jig_error_mm, 9, 4, 1),
        (row.jig_ratio, 7, 3, 1),
        (row.jig_rms_ratio, 7, 3, 1),
        (row.seconds, 8, 3, 1),
        (row.folds, 8, 0, 100),
        (row.good_dropped, 8, 2, 100),
        (row.outliers_found, 9, 1, 100),
    )
    remark = "; ".join(part for part in (row.models, row.note) if part)
    return "".join(cell(*each) for each in cells) + (f"  {remark}" if remark else "")


STYLES = {
    "oracle": ("#334155", "*"),
    "ours, auto": ("#0f766e", "s"),
    "ours, lens given": ("#14b8a6", "s"),
    "OpenCV, default": ("#b45309", "o"),
    "OpenCV, 300 iterations": ("#f59e0b", "o"),
    "mrcal": ("#6d28d9", "^"),
    "lensboy": ("#be123c", "D"),
}
"""Method → its colour and mark."""
COLUMNS = 3


def write_figure(path: Path, rows: Sequence[Row], draws: int, force: bool) -> None:
    """One panel per rig, both axes logarithmic; full marks with C's pose told, hollow ones with its pose solved."""
    from matplotlib.lines import Line2D

    names = list(dict.fromkeys(row.rig for row in rows))
    lines = len(names) // COLUMNS + 1
    figure = new_figure(11, 3.1 * lines)
    panels = figure.subplots(lines, COLUMNS, sharex=True, sharey=True, squeeze=False).ravel()
    for name, panel in zip(names, panels, strict=False):
        for row in rows:
            if row.rig == name and row.seconds is not None:
                _marks(panel, row)
        panel.set_title(name, fontsize=9)
        panel.grid(alpha=0.3)
    for index in range(len(names), len(panels)):
        panels[index].set_axis_off()
        panels[index - COLUMNS].tick_params(labelbottom=True)
    there = {row.method for row in rows if row.seconds is not None}
    handles = [
        Line2D([], [], ls="", marker=mark, color=colour, label=method)
        for method, (colour, mark) in STYLES.items()
        if method in there
    ]
    handles.append(
        Line2D([], [], ls="", marker="s", color="#334155", fillstyle="none", label="hollow: pose of C solved")
    )
    panels[-1].legend(handles=handles, loc="center", fontsize=9, title=f"median of {draws} draws")
    figure.supxlabel("time of one solve, s")
    figure.supylabel("rms error of points on plane C, mm")
    save(figure, path, force)


def _marks(panel: Axes, row: Row) -> None:
    colour, mark = STYLES[row.method]
    for error, fill in ((row.error_mm, "full"), (row.jig_error_mm, "none")):
        if error is not None:
            panel.loglog(row.seconds, error, mark, color=colour, fillstyle=fill, markersize=7)


def measure(options: Options) -> Findings:
    """Every method on every rig; a draw is one set of views."""
    rows = run(options.draws, options.seed)
    return Findings(
        as_text(rows, options.draws),
        {"calibration.csv": rows},
        {"calibration.png": lambda path, force: write_figure(path, rows, options.draws, force)},
        {"rows": rows},
        headline(rows),
        versions(),
    )


def headline(rows: Sequence[Row]) -> str:
    """Rms errors over the oracle's, ours and OpenCV's."""
    return f"rms error over the oracle's: ours {_span(rows, 'ours, auto')}, OpenCV {_span(rows, 'OpenCV, default')}"


def _span(rows: Sequence[Row], method: str) -> str:
    own = [row for row in rows if row.method == method]
    ratios = [row.rms_ratio for row in own if row.rms_ratio is not None]
    failed = f", no lens on {len(own) - len(ratios)} of {len(own)} rigs" if len(ratios) < len(own) else ""
    return f"{min(ratios):.2f} to {max(ratios):.2f}{failed}" if ratios else "without a lens"
