"""From frames to fits: the global minimum, the rung of the ladder, and alternative minima of each frame."""

from __future__ import annotations

from typing import Any

import numpy as np

from vbaa_calib.antenna.rungs import RUNGS
from vbaa_calib.core.threads import in_threads
from vbaa_calib.native import core

from .frames import Frames
from .linearised import rigs_of
from .numbers import FitNumbers
from .rig_arrays import UNKNOWNS


def solve(
    frames: Frames | tuple[Any, ...],
    model: str,
    warm: np.ndarray | None = None,
    pieces_m: np.ndarray | None = None,
    jobs: int = 1,
    minima_only: bool = False,
) -> FitNumbers:
    """Fit B frames independently, in `jobs` threads.

    frames : `Frames`, or the arguments of `frames_from_pixels`. warm : (B, 4) unknowns near the truth where
        finite; pieces_m : (G,) arc lengths of `motion.Beam`, if it is tested. Frames with too few
        points are not fitted.
    minima_only : for the evidence of many frames together: without the cost of valleys for the uncertainty of each, but
        with all axes of the rig's errors, also those that a single frame hardly shows.
    """
    rig_arrays, measured, count = (
        (frames.rig_arrays, frames, len(frames))
        if isinstance(frames, Frames)
        else (frames[0], frames[1:], len(frames[1]))
    )
    found = FitNumbers.empty(count)
    starts = np.empty((0, UNKNOWNS)) if warm is None else np.ascontiguousarray(warm, float)
    pieces = np.empty(0) if pieces_m is None else np.ascontiguousarray(pieces_m, float)
    rung = -1 if model == "auto" else RUNGS.index(model)
    rigs = rigs_of(rig_arrays, minima_only)

    def work(begin: int, end: int) -> None:
        core.solver.solve(rigs, measured, begin, end, rung, starts, pieces, minima_only, found.rows)

    in_threads(work, count, jobs)
    found.rows["rig_axes"] = rig_arrays.independent
    return found


def rough_fits(frames: Frames) -> tuple[np.ndarray, np.ndarray]:
    """(B, 4) unknowns of rough minima on a low rung, and the antennas' nodes there (B, M, 3), antenna frame."""
    found, points_m = np.empty((len(frames), UNKNOWNS)), np.empty((len(frames), core.solver.NODES, 3))
    core.solver.rough(frames.rig_arrays.core, frames, found, points_m)
    return found, points_m
