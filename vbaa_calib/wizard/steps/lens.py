"""The lens: the board by hand, in many poses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from vbaa_calib.calibrate.faults.views import same_pose, view_set_diagnoses
from vbaa_calib.calibrate.guide.next_view import LensProgress, lens_progress
from vbaa_calib.calibrate.guide.suggestion import pose_match
from vbaa_calib.core.errors import VbaaError
from vbaa_calib.wizard.sources.picture import Picture
from vbaa_calib.wizard.state.session_state import SessionState

from .step import ENOUGH, Number, PictureCheck, Progress, Readings, Step, Target, check_board, counted

_GOAL_M = 1e-4
_LEAST = 3
"""Pictures below which no lens is solved for."""


def _check(state: SessionState, picture: Picture, readings: Readings | None) -> PictureCheck:
    view, check = check_board(state, picture, readings is None)
    if check.refusal:
        return check
    again = same_pose(view, state.views("lens"), state.board)
    if again is not None:
        check = replace(check, refusal=str(again), hints=(*check.hints, again))
    suggestion = None if readings is not None else guidance(state).suggestion
    if suggestion is None:
        return check
    solution = guidance(state).solution
    camera = None if solution is None else solution.camera
    close, closer = pose_match(suggestion, view, state.board, camera, view.image_size)
    return replace(check, closeness=close, closer=closer)


def guidance(state: SessionState) -> LensProgress:
    """How well the pictures determine points on plane C, and which pose improves that most."""
    size = state.live_size or (1280, 720)

    def made() -> LensProgress:
        try:
            solution = state.lens()
        except VbaaError:
            solution = None
        return lens_progress(state.views("lens"), state.board, state.work_plane(), _GOAL_M, size, solution)

    return state.cached("guidance", (state.inputs("lens", "plane"), size), made)


def _progress(state: SessionState) -> Progress:
    views = state.views("lens")
    seen = [f"{counted(len(views), 'picture')}, {sum(len(view.ids) for view in views)} corners"]
    try:
        now = guidance(state)
    except VbaaError as error:
        return Progress(tuple(seen), (str(error),), "show the board in another pose")
    target, diagnoses, missing = None, [], now.words
    if now.suggestion is not None and not now.enough:
        target = Target(now.suggestion.outline_px, now.suggestion.words)
    if now.solution is not None:
        diagnoses = view_set_diagnoses(views, now.solution, state.board)
        seen.append(f"lens {now.solution.model}, rms {now.solution.rms_px:.2f} px")
    if len(views) < _LEAST:
        missing = f"{counted(_LEAST - len(views), 'more picture')}, then there is a first lens"
    known = np.isfinite(now.std_m)
    std = Number(
        "plane C, one standard deviation",
        f"{1e3 * now.std_m:.3f} mm" if known else "not known yet",
        f"{1e3 * _GOAL_M:.2f} mm",
        bool(now.std_m <= _GOAL_M) if known else None,
    )
    return Progress(
        seen=tuple(seen),
        missing=() if now.enough else (missing,),
        next=ENOUGH if now.enough else (target.words if target else ""),
        enough=now.enough,
        usable=now.solution is not None,
        numbers=(std,),
        target=target,
        diagnoses=tuple(diagnoses),
    )


STEP = Step(
    "lens",
    "Lens",
    "Hold the board before the camera in different places, distances and tilts, still each time.",
    "A lens bends straight lines. What it does to the place where the antenna moves has to be known.",
    _progress,
    _check,
)
