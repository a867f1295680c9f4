"""The headline: pictures to contacts, speed against error, between two walls.

On one side the Cramér–Rao bound of the whole chain, on the other the time to read a picture once from memory.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from itertools import groupby

import numpy as np

from benchmarks.harness import Findings, Options
from vbaa_calib.core.console import progress

from .bound import Information, as_told, contact_bound, information_of
from .figure import write_figure
from .judge import ASTRAY_BOUND, ASTRAY_STATED, Reading, StageRow, one_thread, reading, stages, typical_seconds, verdict
from .losses import LossRow, losses
from .methods import OURS, Answers, Method, ours
from .peers import others
from .scenes import RIGS, SIZES, Cell, Photograph, cell

LONG_S = 2.0
"""A recording that takes longer is timed once."""


@dataclass(frozen=True)
class ChainRow:
    """One method on the pictures of one size and rig.

    Attributes
    ----------
    told : it is told by the truth which points to take.
    ms, ms_recording : of one thread for one picture that comes alone, and for each of a recording.
    l_rms_mm, l_median_mm : error of the contact distance, of the pictures with a number; None without any.
    l_rms_error_mm : what the rms scatters by from chance, were every error as its picture's bound has it.
    of_bound, of_bound_error : rms error in the bound's standard deviations, and what it scatters by from chance.
    force_percent, direction_deg : rms error of (f_y, f_z) over its size, and of its direction.
    answered, wrong : share with a number; share of all with one that is wrong and confident.
    bound_mm : the wall: rms of the bound's standard deviations of the same pictures' distances.
    read_ms : the other: reading a picture of this size once from memory.
    """

    size: str
    rig: str
    method: str
    family: str
    told: bool
    pictures: int
    ms: float
    ms_recording: float
    l_rms_mm: float | None
    l_rms_error_mm: float | None
    l_median_mm: float | None
    of_bound: float | None
    of_bound_error: float | None
    force_percent: float | None
    direction_deg: float | None
    answered: float
    wrong: float
    bound_mm: float
    read_ms: float


@dataclass(frozen=True, eq=False)
class Measured:
    """What was measured of everything."""

    rows: list[ChainRow]
    stages: list[StageRow]
    losses: list[LossRow]


def run(pictures: int, seed: int, quick: bool = False, sizes: Sequence[tuple[int, int]] = SIZES) -> Measured:
    """So many pictures of each size and rig. `quick` : times from fewer of them."""
    timed, repeats = (1, 1) if quick else (4, 3)
    rows: list[ChainRow] = []
    spent: list[StageRow] = []
    lost: list[LossRow] = []
    with one_thread():
        for size in sizes:
            read = reading(size, repeats)
            for known in RIGS:
                pages = cell(size, known, pictures, seed)
                told = [information_of(one) for one in pages.photographs]
                bound_m = bounds(pages, told)
                methods = [*ours(pages.rig), *others(pages.rig)]
                for method in progress(methods, f"{pages.name}, {known} rig", len(methods)):
                    rows.append(_row(pages, method, bound_m, read, timed, repeats))
                of_bound = {row.method: row.of_bound for row in rows[-len(methods) :]}
                lost += losses(pages, told, bound_m, of_bound, seed)
                if RIGS[known]:
                    spent += stages(pages, read, timed, repeats)
    return Measured(rows, spent, lost)


def bounds(pages: Cell, told: Sequence[Information]) -> np.ndarray:
    """(K,) least standard deviations of the pictures' contact distances, m, with the rig as well known as it is."""
    truths = [replace(one.truth, rig=pages.rig) for one in pages.photographs]
    return contact_bound(as_told(truths, told)).std[:, 0]


def _row(pages: Cell, method: Method, bound_m: np.ndarray, read: Reading, timed: int, repeats: int) -> ChainRow:
    photographs = pages.photographs
    singles = [partial(method.solve, photographs[index : index + 1]) for index in range(min(timed, len(pages)))]
    alone = typical_seconds(singles, repeats)
    found, together = _recording(method, photographs, repeats)
    return ChainRow(
        size=pages.name,
        rig=pages.known,
        method=method.name,
        family=method.family,
        told=method.told,
        pictures=len(pages),
        ms=1e3 * alone,
        ms_recording=1e3 * together,
        **asdict(verdict(found, photographs, bound_m)),
        bound_mm=1e3 * float(np.sqrt(np.mean(bound_m**2))),
        read_ms=1e3 * read.memory_s,
    )


def _recording(method: Method, photographs: Sequence[Photograph], repeats: int) -> tuple[Answers, float]:
    """Answers to all pictures in one call, and the least time of each."""
    least = np.inf
    for _ in range(repeats):
        begun = time.process_time()
        found = method.solve(photographs)
        least = min(least, time.process_time() - begun)
        if least > LONG_S:
            break
    return found, float(least) / len(photographs)


_NOTES = f"""\
wall of error: the Cramér–Rao bound from the picture's own pixels and the moment's noise, friction and rig free within
  what is known of them; held as known: cross-section, blur and noise of the picture; free in every column: the line's
  height, level and slope of the background
wall of time: every byte of a picture read once from memory
wrong: off by more than {ASTRAY_BOUND:.0f} of the bound's deviations, and by more than {ASTRAY_STATED:.0f} of its
  own where a method states them; * told by the truth where it is straight
ms: one thread's processor time from the decoded picture to distance and force; what needs no picture is
  prepared before"""


def as_text(rows: Sequence[ChainRow], spent: Sequence[StageRow], lost: Sequence[LossRow]) -> str:
    """The tables for people."""
    lines = [_headline_sentence(rows), _NOTES]
    for (size, rig), own in groupby(rows, key=lambda row: (row.size, row.rig)):
        lines += ["", *_methods(size, rig, list(own))]
    lines += ["", *_losses(lost), "", *_stages(spent)]
    return "\n".join(lines)


def headline(rows: Sequence[ChainRow]) -> str:
    """At most 100 characters for a summary."""
    row = _chosen(rows)
    return (
        f"picture to contact, auto, {row.size}: {row.ms:.0f} ms, {_number(row.of_bound)} × the bound; "
        f"reading it {row.read_ms:.3f} ms"
    )


def _headline_sentence(rows: Sequence[ChainRow]) -> str:
    """What it comes down to."""
    row = _chosen(rows)
    return (
        f"auto, {row.size}, a calibrated rig: {row.ms:.1f} ms a picture, {row.ms_recording:.1f} ms in a recording; "
        f"{_number(row.l_rms_mm)} mm rms, {_number(row.of_bound)} ± {_number(row.of_bound_error)} times the bound; "
        f"reading the picture once takes {row.read_ms:.3f} ms"
    )


def _chosen(rows: Sequence[ChainRow]) -> ChainRow:
    """`auto` on the largest pictures of a rig as calibrations leave it."""
    return [row for row in rows if (row.family, row.method, row.rig) == (OURS, "auto", "calibrated")][-1]


def _methods(size: str, rig: str, rows: Sequence[ChainRow]) -> list[str]:
    first = rows[0]
    title = (
        f"{size}, rig {rig}, {first.pictures} pictures; the walls: {first.bound_mm:.3f} mm rms, {first.read_ms:.4f} ms"
    )
    head = (
        f"{'method':<35}{'ms':>8}{'recording':>11}{'l rms mm':>10}{'median':>8}{'× bound':>9}{'±':>6}{'force %':>9}"
        f"{'°':>7}{'answered %':>12}{'wrong %':>9}"
    )
    lines = [title, head]
    family = ""
    for row in rows:
        if row.family != family:
            family = row.family
            lines.append(family)
        values = (row.l_rms_mm, row.l_median_mm, row.of_bound, row.of_bound_error, row.force_percent, row.direction_deg)
        shown = "".join(f"{_number(value):>{width}}" for value, width in zip(values, (10, 8, 9, 6, 9, 7), strict=True))
        lines.append(
            f"  {row.method + (' *' if row.told else ''):<33}{row.ms:>8.1f}{row.ms_recording:>11.1f}{shown}"
            f"{100 * row.answered:>12.0f}{100 * row.wrong:>9.0f}"
        )
    return lines


def _losses(rows: Sequence[LossRow]) -> list[str]:
    lines = [
        "where accuracy goes: rms error of the distance in the bound's deviations, from points without noise, from "
        "points as good as the picture allows,\nand from the picture; noise of the found points over the least; share "
        "of the columns with a point; the points' stated deviations over their noise",
        f"{'picture':<12}{'rig':<12}{'rung':<10}{'no noise':>10}{'best points':>13}{'picture':>9}{'points':>9}"
        f"{'kept %':>8}{'stated':>8}",
    ]
    lines += [
        f"{row.size:<12}{row.rig:<12}{row.model:<10}{_number(row.noiseless):>10}{_number(row.ideal):>13}"
        f"{_number(row.picture):>9}{_number(row.points):>9}{100 * row.kept:>8.1f}{_number(row.stated):>8}"
        for row in rows
    ]
    return lines


def _stages(rows: Sequence[StageRow]) -> list[str]:
    lines = [
        "where the time goes, auto, two looks; ms of a picture that comes alone and of each in a recording",
        f"{'picture':<12}{'stage':<28}{'ms':>8}{'recording':>11}{'share %':>9}",
    ]
    lines += [
        f"{row.size:<12}{row.stage:<28}{row.ms:>8.3f}{row.ms_recording:>11.3f}{100 * row.share:>9.1f}" for row in rows
    ]
    return lines


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.2f}" if abs(value) < 100 else f"{value:.0f}"


def measure(options: Options) -> Findings:
    """The subject `chain` of `vbaa bench`; a draw is a picture, of each size and rig."""
    found = run(options.draws, options.seed, options.quick)
    return Findings(
        text=as_text(found.rows, found.stages, found.losses),
        tables={"chain.csv": found.rows, "chain_stages.csv": found.stages, "chain_losses.csv": found.losses},
        figures={"chain.png": lambda path, force: write_figure(path, found.rows, force)},
        numbers={name: [asdict(row) for row in getattr(found, name)] for name in ("rows", "stages", "losses")},
        headline=headline(found.rows),
    )
