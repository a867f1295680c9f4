"""`vbaa bench calibration`: lenses from corners, in millimetres on plane C, beside an oracle and other calibrators."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.figures import AMBER, GREEN, INK, RED, VIOLET, label, label_x, legend, panels
from benchmarks.harness import Findings, Options, column, mean_of, or_none, table
from vbaa_calib.core.console import progress

from .judge import error_mm
from .methods import Outcome, methods
from .peers import versions
from .rigs import Rig, draw, rigs

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Row:
    """One method on one rig, over the draws; None where the method is absent, mostly failed or does not say.

    Attributes
    ----------
    error_mm : median over draws of the rms error of points on C, whose true pose is given. ratio : the same over the
        oracle's. rms_ratio : root mean squares over draws likewise; None where a draw failed.
    jig_error_mm, jig_ratio, jig_rms_ratio : the same with the pose of C solved with the method's own lens.
    seconds : median time of one solve. folds : share of draws whose lens folds inside the picture.
    good_dropped, outliers_found : shares of the good corners and of the outliers that were withheld.
    models : the lens models chosen and how often, where there was a choice. note : why there are no numbers.
    """

    rig: str = column("rig")
    method: str = column("method")
    error_mm: float | None = column("mm on C", ".4f", default=None)
    ratio: float | None = column("× oracle", ".3f", default=None)
    rms_ratio: float | None = column("rms", ".3f", default=None)
    jig_error_mm: float | None = column("mm, jig", ".4f", default=None)
    jig_ratio: float | None = column("× oracle", ".3f", default=None)
    jig_rms_ratio: float | None = column("rms", ".3f", default=None)
    seconds: float | None = column("s", ".3f", default=None)
    folds: float | None = column("folds %", ".0f", 100, default=None)
    good_dropped: float | None = column("lost %", ".2f", 100, default=None)
    outliers_found: float | None = column("caught %", ".1f", 100, default=None)
    models: str = column("models", default="")
    note: str = column("note", default="")


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
    """Error in mm on C with its true pose, and with its pose solved."""
    if outcome.camera is None:
        return np.inf, np.inf
    return error_mm(outcome.camera, rig.camera), error_mm(outcome.camera, rig.camera, from_jig=True)


def _row(rig: Rig, name: str, outcomes: Sequence[Outcome], errors: np.ndarray, oracle: np.ndarray) -> Row:
    """One method's row; errors (D, 2) mm of its outcomes and of the oracle's."""
    solved = [outcome for outcome in outcomes if outcome.camera is not None]
    failures = [outcome.failure for outcome in outcomes if outcome.camera is None]
    chosen = Counter(outcome.model for outcome in outcomes if outcome.model)
    middle, own_rms = np.median(errors, axis=0), np.sqrt(np.mean(errors**2, axis=0))
    ratio, rms_ratio = middle / np.median(oracle, axis=0), own_rms / np.sqrt(np.mean(oracle**2, axis=0))
    folds = [one.camera.valid_region().image_fraction < 1.0 for one in solved if one.camera is not None]
    return Row(
        rig=rig.name,
        method=name,
        error_mm=or_none(middle[0]),
        ratio=or_none(ratio[0]),
        rms_ratio=or_none(rms_ratio[0]),
        jig_error_mm=or_none(middle[1]),
        jig_ratio=or_none(ratio[1]),
        jig_rms_ratio=or_none(rms_ratio[1]),
        seconds=float(np.median([one.seconds for one in solved])) if solved else None,
        folds=float(np.mean(folds)) if folds else None,
        good_dropped=or_none(mean_of(outcomes, "good_dropped")),
        outliers_found=or_none(mean_of(outcomes, "outliers_found")),
        models=", ".join(f"{model} {count}" for model, count in chosen.most_common()),
        note=f"{len(failures)} of {len(outcomes)} failed: {failures[0]}" if failures else "",
    )


_TITLE = (
    "mm on C: median of {} draws, with its true pose; jig: its pose solved with the same lens; × oracle: of medians, "
    "then of root mean squares;\ns: median of one solve; lost: good corners withheld; caught: outliers withheld"
)
STYLES = {
    "oracle": (INK, "*"),
    "ours, auto": (GREEN, "s"),
    "ours, lens given": ("#14b8a6", "s"),
    "OpenCV, default": (AMBER, "o"),
    "OpenCV, 300 iterations": ("#f59e0b", "o"),
    "mrcal": (VIOLET, "^"),
    "lensboy": (RED, "D"),
}
"""Method → its colour and mark."""


def figure(rows: Sequence[Row], draws: int) -> Figure:
    """One panel per rig, both axes logarithmic; full marks with C's true pose, hollow ones with its pose solved."""
    names = list(dict.fromkeys(row.rig for row in rows))
    drawn, every = panels(len(names), 3, (3.7, 3.1), sharex=True, sharey=True)
    solved = [row for row in rows if row.seconds is not None]
    for name, panel in zip(names, every, strict=True):
        for row in (row for row in solved if row.rig == name):
            colour, mark = STYLES[row.method]
            for error, fill in ((row.error_mm, "full"), (row.jig_error_mm, "none")):
                if error is not None:
                    panel.loglog(row.seconds, error, mark, color=colour, fillstyle=fill, markersize=7)
        label(panel, name)
    there = {row.method for row in solved}
    shown = {method: style for method, style in STYLES.items() if method in there}
    legend(drawn, shown, "hollow: pose of C solved", title=f"median of {draws} draws")
    label_x(every, 3, "time of one solve, s")
    drawn.supylabel("rms error of points on plane C, mm")
    return drawn


def measure(options: Options) -> Findings:
    """Every method on every rig; a draw is one set of views."""
    rows = run(options.draws, options.seed)
    return Findings(
        table(rows, _TITLE.format(options.draws), once=1),
        {"calibration.csv": rows},
        {"calibration.png": lambda: figure(rows, options.draws)},
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
