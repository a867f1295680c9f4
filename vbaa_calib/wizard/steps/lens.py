"""The lens: the board by hand, in many poses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from vbaa_calib.calibrate.faults.variety import same_pose
from vbaa_calib.calibrate.faults.views import view_set_diagnoses
from vbaa_calib.calibrate.guide.next_view import LensProgress, lens_progress
from vbaa_calib.calibrate.guide.suggestion import closeness
from vbaa_calib.core.errors import VbaaError
from vbaa_calib.detect.board.corners import BoardView
from vbaa_calib.wizard.sources.offered import Offered
from vbaa_calib.wizard.state.progress import Judged, Number, Progress, Target
from vbaa_calib.wizard.state.session_state import Known

from .pictures import judged
from .step import Step

GOAL_M = 1e-4
LEAST = 3
"""Pictures below which no lens is solved for."""


def judge(known: Known, offered: Offered, readings: Mapping[str, float] | None) -> Judged:
    """A picture of the board for the lens."""
    view, found = judged(known, offered, readings is None)
    if found.refusal:
        return found
    again = same_pose(view, known.views("lens"), known.board)
    if again is not None:
        found = replace(found, refusal=str(again), hints=(*found.hints, again))
    return _compared(known, view, found) if readings is None else found


def _compared(known: Known, view: BoardView, found: Judged) -> Judged:
    """With how close a live picture is to the pose that is wanted."""
    now = worth(known)
    if now.suggestion is None:
        return found
    camera = None if now.solution is None else now.solution.camera
    close, closer = closeness(now.suggestion, view, known.board, camera, view.image_size)
    return replace(found, closeness=close, closer=closer)


def worth(known: Known) -> LensProgress:
    """What the pictures are worth on plane C, and which pose lowers it most."""
    size = known.live_size or (1280, 720)

    def make() -> LensProgress:
        try:
            solution = known.lens()
        except VbaaError:
            solution = None
        return lens_progress(known.views("lens"), known.board, known.work_plane(), GOAL_M, "auto", size, solution)

    return known.once("worth", (known.cause("lens", "plane"), size), make)


def look(known: Known) -> Progress:
    """How far the lens is."""
    views = known.views("lens")
    seen = [f"{len(views)} picture{'' if len(views) == 1 else 's'}, {sum(len(view.ids) for view in views)} corners"]
    try:
        now = worth(known)
    except VbaaError as error:
        return Progress(tuple(seen), (str(error),), "show the board in another pose")
    target = None
    if now.suggestion is not None and not now.enough:
        target = Target(now.suggestion.outline_px, now.suggestion.words)
    diagnoses = []
    if now.solution is not None:
        diagnoses = view_set_diagnoses(views, now.solution, known.board)
        seen.append(f"lens {now.solution.model}, rms {now.solution.rms_px:.2f} px")
    known_std = np.isfinite(now.std_m)
    return Progress(
        seen=tuple(seen),
        missing=() if now.enough else (now.words if len(views) >= LEAST else _before_a_lens(LEAST - len(views)),),
        next="enough, more will not help" if now.enough else (target.words if target else ""),
        enough=now.enough,
        usable=now.solution is not None,
        numbers=(
            Number(
                "plane C, one standard deviation",
                f"{1e3 * now.std_m:.3f} mm" if known_std else "not known yet",
                f"{1e3 * GOAL_M:.2f} mm",
                bool(now.std_m <= GOAL_M) if known_std else None,
            ),
        ),
        target=target,
        diagnoses=tuple(diagnoses),
    )


def _before_a_lens(more: int) -> str:
    return f"{more} more picture{'' if more == 1 else 's'}, then there is a first lens"


STEP = Step(
    "lens",
    "Lens",
    "Hold the board before the camera in different places, distances and tilts, still each time.",
    "A lens bends straight lines. What it does to the place where the antenna moves has to be known.",
    look,
    judge,
)
