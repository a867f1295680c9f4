"""Every method on the same pictures, timed and judged, and the two walls: the bound and the reading of a picture."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial

import numpy as np

from ..console import progress
from .chain_bound import Information, as_told, contact_bound, information_of
from .chain_clock import Reading, one_thread, reading, typical_seconds
from .chain_judge import verdict
from .chain_losses import LossRow, losses
from .chain_methods import Answers, Method, ours
from .chain_peers import others
from .chain_scenes import RIGS, SIZES, Cell, Photograph, cell
from .chain_stages import StageRow, stages

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
