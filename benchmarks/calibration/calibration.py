"""`vbaa bench calibration`: lenses from corners, in millimetres on plane C, beside an oracle and other calibrators."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.boards import Rig, draw, error_mm, rigs
from benchmarks.figures import AMBER, GREEN, INK, RED, VIOLET, label, label_x, legend, panels
from benchmarks.harness import Findings, Options, column, mean_of, of_any, or_none, table
from vbaa_calib.core.console import progress

from .methods import Outcome, methods, versions

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Row:
    """One method on one rig, over the draws; None where the method is absent, mostly failed or does not say.

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
            errors = np.array([[_error(outcome, rig, from_jig) for from_jig in (False, True)] for outcome in outcomes])
            oracle = errors if oracle is None else oracle
            rows.append(_row(rig, name, outcomes, errors, oracle))
    return rows


def _error(outcome: Outcome, rig: Rig, from_jig: bool) -> float:
    return np.inf if outcome.camera is None else error_mm(outcome.camera, rig.camera, from_jig)


def _row(rig: Rig, name: str, outcomes: Sequence[Outcome], errors: np.ndarray, oracle: np.ndarray) -> Row:
    """One method's row; errors (D, 2) mm of its outcomes and of the oracle's."""
    cameras = [one.camera for one in outcomes if one.camera is not None]
    failures = [one.failure for one in outcomes if one.camera is None]
    chosen = Counter(one.model for one in outcomes if one.model)
    middle = np.median(errors, axis=0)
    own_rms, least_rms = (np.sqrt(np.mean(each**2, axis=0)) for each in (errors, oracle))
    ratios = middle / np.median(oracle, axis=0), own_rms / least_rms
    numbers: list[Any] = [or_none(each[at]) for at in (0, 1) for each in (middle, *ratios)]
    seconds = np.array([one.seconds for one in outcomes if one.camera is not None])
    folds = np.array([camera.valid_region().image_fraction < 1.0 for camera in cameras])
    numbers += [of_any(np.median, seconds), of_any(np.mean, folds)]
    numbers += [or_none(mean_of(outcomes, told)) for told in ("good_dropped", "outliers_found")]
    numbers.append(", ".join(f"{model} {count}" for model, count in chosen.most_common()))
    numbers.append(f"{len(failures)} of {len(outcomes)} failed: {failures[0]}" if failures else "")
    return Row(rig.name, name, *numbers)


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


def _figure(rows: Sequence[Row], draws: int) -> Figure:
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
    rows, draws = run(options.draws, options.seed), options.draws
    spans = f"ours {_span(rows, 'ours, auto')}, OpenCV {_span(rows, 'OpenCV, default')}"
    return Findings(
        table(rows, _TITLE.format(draws), once=1),
        {"calibration.csv": rows},
        {"calibration.png": lambda: _figure(rows, draws)},
        {"rows": rows},
        f"rms error over the oracle's: {spans}",
        versions(),
    )


def _span(rows: Sequence[Row], method: str) -> str:
    own = [row for row in rows if row.method == method]
    ratios = [row.rms_ratio for row in own if row.rms_ratio is not None]
    failed = f", no lens on {len(own) - len(ratios)} of {len(own)} rigs" if len(ratios) < len(own) else ""
    return f"{min(ratios):.2f} to {max(ratios):.2f}{failed}" if ratios else "without a lens"
