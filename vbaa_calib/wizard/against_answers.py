"""Pictures checked against the answers: the jig's place, the board's thickness, the camera's distance."""

from __future__ import annotations

import numpy as np

from vbaa_calib.calibrate.pose.board_pose import BoardPose, solve_board_pose
from vbaa_calib.calibrate.pose.fusion import fused
from vbaa_calib.camera import Camera
from vbaa_calib.core.errors import Diagnosis, InputError, VbaaError
from vbaa_calib.detect.board.corners import BoardView, detect_corners
from vbaa_calib.detect.quality.screen import LEAST_CORNERS
from vbaa_calib.geometry import Pose
from vbaa_calib.session import Still

from .session_state import SessionState

_MOVED_PX = 2.0
_TIMES_LENS_RMS, _LEAST_RMS_PX = 4.0, 1.0
_LEAST_IN_VIEW, _POINTS = 0.25, 41
_DISTANCE_RATIO = 1.3
_THICKNESSES_MM = (0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 12.0)
"""Of boards that are tried when the antenna is not where the answers put it."""
_JIG_REMEDY = "correct jig_translation_mm, jig_board_x, jig_board_y or board_thickness_mm: type `key = value`"


def jig_moved(state: SessionState, corners_px: np.ndarray, ids: np.ndarray) -> str:
    """How far corners (N, 2) px with ids (N,) are from the jig's first picture: "by 59 px"; "" if they stand still."""
    taken = state.views("plane")
    if not taken:
        return ""
    _, here, there = np.intersect1d(ids, taken[0].ids, return_indices=True)
    off_px = np.linalg.norm(corners_px[here] - taken[0].corners_px[there], axis=-1)
    if len(off_px) and np.median(off_px) <= _MOVED_PX:
        return ""
    return f"by {np.median(off_px):.0f} px" if len(off_px) else "wholly"


def board_in_the_way(state: SessionState, image: np.ndarray) -> str:
    """Why a picture (H, W) uint8 is not of the antenna: the jig's board is in it; or ""."""
    if state.store.folder("plane") != "plane" or len(detect_corners(image, state.board, "").ids) < LEAST_CORNERS:
        return ""
    return "the board is still in the picture; take it and its jig away"


def jig_refusal(state: SessionState, view: BoardView, fast: bool) -> str:
    """Why a picture cannot be of the board in its jig, or "". fast : without solving for the board's pose."""
    if how := jig_moved(state, view.corners_px, view.ids):
        first = state.views("plane")[0].name
        moved = f"the board has moved {how} since {first}, and the jig stands still"
        return f"{moved}: is it of the jig? If {first} is not, type redo"
    if fast:
        return ""
    lens = state.lens()
    try:
        board = solve_board_pose([view], lens.board_shape, lens.camera)
    except VbaaError as error:
        return f"the lens does not explain this picture of the board: {error}"
    if board.rms_px > max(_TIMES_LENS_RMS * lens.rms_px, _LEAST_RMS_PX):
        return (
            f"its corners are {board.rms_px:.2f} px off this lens (its own pictures {lens.rms_px:.2f} px): "
            "has focus, zoom or the board changed?"
        )
    return _antenna_out_of_view(state, board, lens.camera)


def _antenna_out_of_view(state: SessionState, board: BoardPose, camera: Camera) -> str:
    session = state.session
    assert session.T_antenna_board is not None
    T_camera_antenna = board.T_camera_board @ session.T_antenna_board.inverse()
    along = np.linspace(0.0, session.antenna.length_m, _POINTS)
    pixels, valid = camera.project(T_camera_antenna @ np.pad(along[:, None], ((0, 0), (0, 2))))
    share = float(np.mean(valid & camera.in_picture(pixels)))
    if share >= _LEAST_IN_VIEW:
        return ""
    return f"by what was typed about the jig {100 * share:.0f} % of the antenna would be in the picture; {_JIG_REMEDY}"


def camera_distance(state: SessionState, T_antenna_camera: Pose) -> tuple[str, list[Diagnosis]]:
    """The camera's distance from the antenna's middle beside what was typed, and a doubt if they differ by much."""
    typed_mm = state.store.journal.answers.get("camera_distance_mm")
    middle = np.array([0.5 * state.session.antenna.length_m, 0.0, 0.0])
    seen_mm = 1e3 * float(np.linalg.norm(T_antenna_camera.translation_m - middle))
    words = f"the camera is {seen_mm:.0f} mm from the antenna's middle"
    if typed_mm is None:
        return words, []
    words += f", {typed_mm:g} mm was typed"
    if 1 / _DISTANCE_RATIO < seen_mm / typed_mm < _DISTANCE_RATIO:
        return words, []
    remedy = f"check jig, square size and antenna_length_mm; or type `camera_distance_mm = {seen_mm:.0f}` if that is so"
    return words, [Diagnosis("camera_distance", words, remedy)]


def thickness_that_shows_it(state: SessionState, still: Still, step: str, image: np.ndarray) -> str:
    """The board's thickness with which the antenna is found where it was not, in words; empty without one.

    A tenth of what was typed is named if it is one of them; else the range, since the antenna's width in the picture
    does not tell one from the next.
    """
    session, typed_mm = state.session, float(state.store.journal.answers.get("board_thickness_mm") or 0.0)
    if session.T_antenna_board is None:
        return ""
    normal = session.T_antenna_board.rotation[:, 2]
    pose = fused(state.plane().estimates)

    def found(other_mm: float) -> bool:
        moved = Pose(pose.rotation, pose.translation_m + 1e-3 * (typed_mm - other_mm) * normal)
        try:
            state.observe(still, step, image, moved)
        except InputError:
            return False
        return True

    if typed_mm and found(typed_mm / 10):
        thick, value = f"{typed_mm / 10:g} mm", f"{typed_mm / 10:g}"
    elif seen := [other for other in _THICKNESSES_MM if found(other)]:
        thick, value = f"{min(seen):g} to {max(seen):g} mm", "…"
    else:
        return ""
    return (
        f"the antenna is found where a board {thick} thick puts it, {typed_mm:g} mm was typed: measure it, "
        f"and type `board_thickness_mm = {value}`"
    )
