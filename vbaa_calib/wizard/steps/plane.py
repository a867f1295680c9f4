"""Plane C: where the camera stands on the antenna's base."""

from __future__ import annotations

import numpy as np

from vbaa_calib.calibrate.guide.next_view import plane_progress
from vbaa_calib.calibrate.plane_c import PlaneC
from vbaa_calib.core.errors import VbaaError
from vbaa_calib.wizard.sources.picture import Picture
from vbaa_calib.wizard.state.session_state import SessionState

from .step import ENOUGH, Number, PictureCheck, Progress, Readings, Step, check_board, counted

_LEAST = {"plane": 1, "sweep": 5, "over": 1}
_ENOUGH = {"sweep": 10, "over": 3}
_SHOOT = {
    "plane": "the board in the jig, the jig fixed to the antenna's base",
    "sweep": "the board fixed in the world; turn pan and tilt to another place, let them rest, read them",
    "over": "the board flat under the free antenna, at rest",
}


def _check(state: SessionState, picture: Picture, readings: Readings | None) -> PictureCheck:
    return check_board(state, picture, readings is None)[1]


def _progress(state: SessionState) -> Progress:
    way, count = state.store.folder("plane"), len(state.taken("plane"))
    seen = (counted(count, "picture"),)
    if count < _LEAST[way]:
        return Progress(seen, (f"{_LEAST[way] - count} more at least",), _SHOOT[way])
    try:
        plane = state.plane()
    except VbaaError as error:
        return Progress(seen, (str(error),), _SHOOT[way])
    x, y, z = 1e3 * plane.estimates[0].T_antenna_camera.translation_m
    numbers = _numbers(state, plane)
    if way == "plane":
        lens, views = state.lens(), state.views("plane")
        now = plane_progress(views, state.board, lens.camera, lens.board_flex.bend, state.work_plane())
        enough, missing = now.enough, now.words
        if now.std_m >= 0:
            numbers = (Number("plane C by lens and jig's pictures", f"± {1e3 * now.std_m:.3f} mm"), *numbers)
    else:
        enough = count >= _ENOUGH[way]
        missing = f"{_ENOUGH[way] - count} more would average out noise and show a board that moves"
    return Progress(
        seen=(*seen, f"camera at ({x:.1f}, {y:.1f}, {z:.1f}) mm in the antenna frame"),
        missing=() if enough else (missing,),
        next=ENOUGH if enough else _SHOOT[way],
        enough=enough,
        usable=True,
        numbers=numbers,
    )


def _numbers(state: SessionState, plane: PlaneC) -> tuple[Number, ...]:
    """How well the camera's pose on the base is known, the jig's own deviation included."""
    estimate, lens = plane.estimates[0], state.lens().camera.covariance
    covariance = estimate.covariance
    if lens is not None:
        covariance = covariance + estimate.lens_sensitivity @ lens @ estimate.lens_sensitivity.T
    std = np.sqrt(np.diag(covariance))
    return (
        Number("camera's position, with the jig's own uncertainty", f"± {1e3 * std[3:].max():.2f} mm"),
        Number("camera's angles, the same", f"± {1e3 * std[:3].max():.2f} mrad"),
    )


STEP = Step(
    "plane",
    "Plane C",
    "Show the camera where the antenna's base is: the board in its jig, a sweep of the joints, or the board under it.",
    "The antenna bends in this plane. Pixels become millimetres of the antenna only when it is known.",
    _progress,
    _check,
)
