"""Pictures of the board for the lens: how many it takes until plane C is known, where suggested and at random."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np

from ..calibrate.intrinsics import LensSolution, solve_intrinsics
from ..calibrate.next_view import lens_progress
from ..console import progress
from ..detect.corners import BoardView
from ..errors import InputError
from .averages import rms
from .guided_judge import true_error_mm
from .guided_rigs import GOAL_MM, Rig, rigs
from .guided_shots import Photographer, jig_pose
from .guided_ways import PEOPLE, SUGGESTED, WAYS

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
