"""`vbaa bench chain`: pictures to contacts, speed against error, every method on the same pictures.

One limit is the Cramér–Rao bound of the whole chain, the other the time to read a picture once from memory.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import groupby
from typing import Any

import numpy as np

from benchmarks.harness import Findings, Options, column, one_thread, table
from vbaa_calib.core.console import progress

from .bound import Information, contact_bound, frames_at_information, information_of
from .figure import figure
from .judge import ASTRAY_BOUND, ASTRAY_STATED, Reading, StageRow, reading, stages, typical_seconds, verdict
from .losses import LossRow, losses
from .methods import OURS, Answers, Method, ours
from .peers import others
from .scenes import RIGS, SIZES, Cell, Photograph, cell

_LONG_S = 2.0
"""A recording that takes longer is timed once."""


@dataclass(frozen=True)
class ChainRow:
    """One method on the pictures of one size and rig.

    Attributes
    ----------
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


@dataclass(frozen=True, eq=False)
class Measured:
    """What was measured of everything."""

    rows: list[ChainRow]
    stages: list[StageRow]
    losses: list[LossRow]


def run(pictures: int, seed: int, quick: bool = False, sizes: Sequence[tuple[int, int]] = SIZES) -> Measured:
    """So many pictures of each size and rig. `quick` : times from fewer of them."""
    timed, repeats = (1, 1) if quick else (4, 3)
    found = Measured([], [], [])
    with one_thread():
        for size in sizes:
            read = reading(size, repeats)
            for known in RIGS:
                pages = cell(size, known, pictures, seed)
                informations = [information_of(one) for one in pages.photographs]
                bound_m = bounds(pages, informations)
                methods = [*ours(pages.rig), *others(pages.rig)]
                rows = [
                    _row(pages, method, bound_m, read, timed, repeats)
                    for method in progress(methods, f"{pages.name}, {known} rig", len(methods))
                ]
                found.rows.extend(rows)
                of_bound = {row.method: row.of_bound for row in rows}
                found.losses.extend(losses(pages, informations, bound_m, of_bound, seed))
                if RIGS[known]:
                    found.stages.extend(stages(pages, read, timed, repeats))
    return found


def bounds(pages: Cell, told: Sequence[Information]) -> np.ndarray:
    """(K,) least standard deviations of the pictures' contact distances, m, with the rig as well known as it is."""
    truths = [replace(one.truth, rig=pages.rig) for one in pages.photographs]
    return contact_bound(frames_at_information(truths, told)).std[:, 0]


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
        **verdict(found, photographs, bound_m),
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
        if least > _LONG_S:
            break
    return found, float(least) / len(photographs)


_NOTES = f"""\
limit of error: the Cramér–Rao bound from the picture's own pixels and the moment's noise, friction and rig free within
  what is known of them; held as known: cross-section, blur and noise of the picture; free in every column: the line's
  height, level and slope of the background
limit of time: every byte of a picture read once from memory
wrong: off by more than {ASTRAY_BOUND:.0f} of the bound's deviations, and by more than {ASTRAY_STATED:.0f} of its
  own where a method states them; two points on the straight part: the truth tells where it is straight
ms: one thread's processor time from the decoded picture to distance and force; what needs no picture is
  prepared before"""
_LOSSES = """\
where accuracy goes: rms error of the distance in the bound's deviations, from points without noise, from points as
good as the picture allows, and from the picture; noise of the found points over the least; share of the columns with
a point; the points' stated deviations over their noise"""
_STAGES = "where the time goes, auto, two looks; ms of a picture that comes alone and of each in a recording"


def as_text(found: Measured) -> str:
    """The tables for people, below the result in one sentence."""
    row = _chosen(found.rows)
    lines = [
        f"auto, {row.size}, a calibrated rig: {row.ms:.1f} ms a picture, {row.ms_recording:.1f} ms in a recording; "
        f"{row.l_rms_mm:.2f} mm rms, {row.of_bound:.2f} ± {row.of_bound_error:.2f} times the bound; reading the "
        f"picture once takes {row.read_ms:.3f} ms",
        _NOTES,
    ]
    for (size, rig), group in groupby(found.rows, key=lambda row: (row.size, row.rig)):
        own = list(group)
        limits = f"{own[0].bound_mm:.3f} mm rms, {own[0].read_ms:.4f} ms"
        lines += ["", table(own, f"{size}, rig {rig}, {own[0].pictures} pictures; the limits: {limits}")]
    return "\n".join([*lines, "", table(found.losses, _LOSSES), "", table(found.stages, _STAGES)])


def headline(rows: Sequence[ChainRow]) -> str:
    """Time and error of `auto` on the largest pictures."""
    row = _chosen(rows)
    return (
        f"picture to contact, auto, {row.size}: {row.ms:.0f} ms, {row.of_bound:.2f} × the bound; "
        f"reading it {row.read_ms:.3f} ms"
    )


def _chosen(rows: Sequence[ChainRow]) -> Any:
    """`auto` on the largest pictures of a rig as calibrations leave it."""
    return [row for row in rows if (row.family, row.method, row.rig) == (OURS, "auto", "calibrated")][-1]


def measure(options: Options) -> Findings:
    """The subject `chain` of `vbaa bench`; a draw is a picture, of each size and rig."""
    found = run(options.draws, options.seed, options.quick)
    return Findings(
        text=as_text(found),
        tables={"chain.csv": found.rows, "chain_stages.csv": found.stages, "chain_losses.csv": found.losses},
        figures={"chain.png": lambda: figure(found.rows)},
        numbers=vars(found),
        headline=headline(found.rows),
    )
