"""`vbaa bench calibration`: lenses from corners, in millimetres on plane C, beside an oracle and other calibrators."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.stats import chi2

from benchmarks.boards import Draw, draw, error_mm, jig_pose, offsets_on_plane_m, on_plane, seen_on_plane
from benchmarks.figures import AMBER, GREEN, INK, RED, VIOLET, label, label_x, legend, panels
from benchmarks.harness import Findings, Options, column, mean_of, of_any, or_none, rms, table
from vbaa_calib.calibrate.lens.models import pose_slopes, projected
from vbaa_calib.camera import Camera
from vbaa_calib.core.console import progress
from vbaa_calib.geometry import Pose

from .methods import AUTO, ORACLE, Outcome, methods, versions
from .scenes import cells

_REGION, _FAR = 0.95, 2.0


@dataclass(frozen=True)
class Judged:
    """One method's outcome on one draw; None where it gave no lens or does not say.

    error_mm, jig_error_mm : rms on C, with its true pose, and with the pose that this lens gives it.
    stated, jig_stated : error over the deviation stated, both rms over C. covered, jig_covered : share of the 95 %
        regions of points on C that hold the truth.
    wrong : either error is over twice its 95 % bound. folds : the lens folds inside the picture.
    """

    outcome: Outcome
    error_mm: float | None = None
    jig_error_mm: float | None = None
    stated: float | None = None
    covered: float | None = None
    jig_stated: float | None = None
    jig_covered: float | None = None
    folds: bool | None = None
    wrong: bool | None = None


def judged(outcome: Outcome, given: Draw) -> Judged:
    """Errors and stated deviations of a method's lens on one draw."""
    camera, truth = outcome.camera, given.rig.camera
    if camera is None:
        return Judged(outcome)
    errors = error_mm(camera, truth), error_mm(camera, truth, True)
    (free, held, far), (jig, jig_held, jig_far) = (_said(camera, truth, from_jig) for from_jig in (False, True))
    known = [each for each in (far, jig_far) if each is not None]
    folds = camera.valid_region().image_fraction < 1.0
    return Judged(outcome, *errors, free, held, jig, jig_held, folds, any(known) if known else None)


def _said(camera: Camera, truth: Camera, from_jig: bool) -> tuple[float | None, float | None, bool | None]:
    """Error over the deviation stated, share of regions that hold the truth, whether it is over twice its bound."""
    if camera.covariance is None:
        return None, None, None
    T_camera_plane, points, pixels = seen_on_plane(truth)
    if from_jig:
        T_camera_plane = jig_pose(camera, T_camera_plane, points, pixels)
    off = offsets_on_plane_m(camera, T_camera_plane, points, pixels)
    by_lens = plane_jacobian(camera, T_camera_plane, points, from_jig)
    each = by_lens @ camera.covariance @ np.swapaxes(by_lens, -1, -2)
    square, stated = float(np.mean(np.sum(off**2, axis=1))), float(np.mean(np.trace(each, axis1=1, axis2=2)))
    if not np.isfinite(stated) or stated <= 0.0:
        return np.inf, 0.0, True
    each = each + 1e-12 * stated * np.eye(2)
    squares = np.einsum("mi,mi->m", off, np.linalg.solve(each, off[..., None])[..., 0])
    # a sum of squares of unequal share, by the chi-squared law with its mean and variance
    spread = np.einsum("mki,mkj->ij", by_lens, by_lens) / len(points) @ camera.covariance
    freedom = stated**2 / float(np.sum(spread * spread.T))
    bound = stated * chi2.ppf(_REGION, freedom) / freedom
    inside = float(np.mean(squares <= chi2.ppf(_REGION, 2)))
    return float(np.sqrt(square / stated)), inside, bool(square > _FAR**2 * bound)


def plane_jacobian(camera: Camera, T_camera_plane: Pose, points_m: np.ndarray, from_jig: bool) -> np.ndarray:
    """(M, 2, 4 + k) by how much points (M, 2) of a plane move on it with the lens, their pixels held.

    from_jig : the pose of the plane goes along as least squares over the same points make it.
    """
    lever = on_plane(points_m) @ T_camera_plane.rotation.T
    _, by_place, by_lens = projected(camera, lever + T_camera_plane.translation_m)
    by_lens = by_lens.reshape(2 * len(points_m), -1)
    if from_jig:
        by_pose = pose_slopes(by_place, lever).reshape(-1, 6)
        by_lens = by_lens - by_pose @ np.linalg.lstsq(by_pose, by_lens, rcond=None)[0]
    by_point = by_place @ T_camera_plane.rotation[:, :2]
    return -np.linalg.solve(by_point, by_lens.reshape(len(points_m), 2, -1))


if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Row:
    """One method in one cell, over the draws; None where the method is absent or does not say.

    error_mm, worst_mm : median and largest over draws of the rms error of points on C, whose true pose is given.
    ratio, worst_ratio : the same over the oracle's.
    jig_... : likewise with the pose of C solved with the method's own lens.
    stated, jig_stated : error over the deviation stated, both rms over C, rms over draws. covered, jig_covered : share
        of the 95 % regions of points on C that hold the truth.
    seconds : median processor time of one solve. folds : share of draws whose lens folds inside the picture.
    good_dropped, outliers_found, views_dropped : shares withheld of good corners, outliers and whole views.
    trusted : share of draws whose verdict is trust; wrong : of those trusted whose error is over twice its 95 % bound,
        of all draws. models : the lens models chosen and how often, where there was a choice.
    failed : share of draws without a lens; they count as infinitely wrong. note : why.
    """

    cell: str = column("cell")
    method: str = column("method")
    error_mm: float | None = column("mm", ".3f", default=None)
    worst_mm: float | None = column("worst", ".2f", default=None)
    ratio: float | None = column("× oracle", ".2f", default=None)
    worst_ratio: float | None = column("worst", ".2f", default=None)
    jig_error_mm: float | None = column("jig mm", ".4f", default=None)
    jig_worst_mm: float | None = column("worst", ".3f", default=None)
    jig_ratio: float | None = column("× oracle", ".2f", default=None)
    jig_worst_ratio: float | None = column("worst", ".2f", default=None)
    stated: float | None = column("stated", ".2f", default=None)
    covered: float | None = column("in %", ".0f", 100, default=None)
    jig_stated: float | None = column("stated, jig", ".2f", default=None)
    jig_covered: float | None = column("in %", ".0f", 100, default=None)
    folds: float | None = column("folds %", ".0f", 100, default=None)
    good_dropped: float | None = column("lost %", ".2f", 100, default=None)
    outliers_found: float | None = column("caught %", ".1f", 100, default=None)
    views_dropped: float | None = column("views %", ".1f", 100, default=None)
    trusted: float | None = column("trust %", ".0f", 100, default=None)
    wrong: float | None = column("wrong %", ".0f", 100, default=None)
    seconds: float | None = column("s", ".2f", default=None)
    failed: float | None = column("failed %", ".0f", 100, default=None)
    models: str = column("models", default="")
    note: str = column("note", default="")


def run(draws: int, seed: int, chosen: Sequence[str] | None = None) -> list[Row]:
    """Every method, the oracle first, in every cell (or those chosen) over the same draws."""
    rows, names = list[Row](), list(cells()) if chosen is None else chosen
    for name in progress(names, "cells", len(names)):
        given = [draw(cells()[name](each), each) for each in range(seed, seed + draws)]
        oracle: list[Judged] = []
        for one, method in methods().items():
            if isinstance(method, str):
                rows.append(Row(name, one, note=method))
                continue
            own = [judged(outcome, one_set) for one_set, outcome in zip(given, method(given), strict=True)]
            oracle = oracle or own
            rows.append(_row(name, one, own, oracle))
    return rows


def _row(cell: str, method: str, own: Sequence[Judged], oracle: Sequence[Judged]) -> Row:
    """One method in one cell."""
    numbers: dict[str, float | None] = {}
    for prefix in ("", "jig_"):
        errors, least = (_errors(one, f"{prefix}error_mm") for one in (own, oracle))
        for name, statistic in (("", np.median), ("worst_", np.max)):
            found = statistic(errors)
            numbers[f"{prefix}{name or 'error_'}mm"] = or_none(found)
            numbers[f"{prefix}{name}ratio"] = or_none(found / statistic(least))
    lenses = [one for one in own if one.error_mm is not None]
    outcomes = [one.outcome for one in lenses]
    for name in ("stated", "jig_stated"):
        said = [value for one in lenses if (value := getattr(one, name)) is not None]
        numbers[name] = or_none(rms(np.array(said)))
    numbers |= {name: or_none(mean_of(lenses, name)) for name in ("covered", "jig_covered", "folds")}
    of_outcome = ("good_dropped", "outliers_found", "views_dropped", "trusted")
    numbers |= {name: or_none(mean_of(outcomes, name)) for name in of_outcome}
    if numbers["trusted"] is not None:
        numbers["wrong"] = float(np.mean([bool(one.outcome.trusted and one.wrong) for one in lenses]))
    failures = [one.outcome.failure for one in own if one.error_mm is None]
    chosen = Counter(one.model for one in outcomes if one.model)
    return Row(
        cell,
        method,
        **numbers,
        seconds=of_any(np.median, np.array([one.seconds for one in outcomes])),
        failed=len(failures) / len(own),
        models=", ".join(f"{model} {count}" for model, count in chosen.most_common()),
        note=failures[0] if failures else "",
    )


def _errors(own: Sequence[Judged], name: str) -> np.ndarray:
    return np.array([np.inf if (value := getattr(one, name)) is None else value for one in own])


_TITLE = (
    "mm: rms error on C with its true pose, median of {} draws, then the worst; × oracle: of medians, then of worst;\n"
    "jig: C's pose solved with the same lens; stated: error over the deviation stated, in: 95 % regions that hold the\n"
    "truth; lost: good corners withheld; caught: outliers withheld; views: withheld; trust: verdicts; wrong: of all\n"
    "draws, trusted and over twice the 95 % bound; s: of one processor"
)
STYLES = {
    ORACLE: (INK, "*"),
    AUTO: (GREEN, "s"),
    "ours, lens given": ("#14b8a6", "s"),
    "OpenCV": (AMBER, "o"),
    "mrcal": (VIOLET, "^"),
    "lensboy": (RED, "D"),
}
"""Method → its colour and mark."""
_WORST_MM = 100.0


def _figure(rows: Sequence[Row], draws: int) -> Figure:
    """A line for each cell, errors over the oracle's to the right: a mark at the median, a thin line to the worst."""
    names = list(dict.fromkeys(row.cell for row in rows))
    drawn, every = panels(2, 2, (6.0, 0.24 * len(names) + 1.2), sharey=True)
    for panel, prefix, words in zip(every, ("", "jig_"), ("true pose of C", "pose of C solved"), strict=True):
        for row in (row for row in rows if row.method in STYLES and row.method != ORACLE):
            colour, mark = STYLES[row.method]
            place = -names.index(row.cell) - 0.13 * (list(STYLES).index(row.method) - 3)
            middle, worst = getattr(row, f"{prefix}ratio"), getattr(row, f"{prefix}worst_ratio")
            if middle is not None:
                panel.plot([middle, _WORST_MM if worst is None else worst], [place, place], "-", color=colour, lw=0.8)
                panel.plot(middle, place, mark, color=colour, markersize=4)
        panel.set_xscale("log")
        panel.axvline(1.0, color=INK, lw=0.6)
        panel.set_yticks(range(0, -len(names), -1), names)
        label(panel, words)
    there = {row.method for row in rows if row.seconds is not None} - {ORACLE}
    shown = {method: style for method, style in STYLES.items() if method in there}
    legend(drawn, shown, title=f"median of {draws} draws, a line to the worst")
    label_x(every, 2, "error on plane C over the oracle's")
    return drawn


def measure(options: Options) -> Findings:
    """Every method in every cell; a draw is one set of views. Quick: the published rigs and those drawn."""
    names = [name for place, name in enumerate(cells()) if not options.quick or place < 5 or name.startswith("drawn")]
    rows = run(options.draws, options.seed, names)
    return Findings(
        table(rows, _TITLE.format(options.draws), once=1),
        {"calibration.csv": rows},
        {"calibration.png": lambda: _figure(rows, options.draws)},
        {"rows": rows},
        f"error over the oracle's: ours {_span(rows, AUTO)}, OpenCV {_span(rows, 'OpenCV')}",
        versions(),
    )


def _span(rows: Sequence[Row], method: str) -> str:
    """Median over cells, and the largest."""
    ratios = [np.inf if row.ratio is None else row.ratio for row in rows if row.method == method]
    return f"{np.median(ratios):.2f}, at most {max(ratios):.2f}"
