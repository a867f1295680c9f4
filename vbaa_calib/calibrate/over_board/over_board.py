"""Plane C from the free antenna seen over a board that lies on it: the antenna's own axis and clamp make the frame.

The board gives the plane: its normal, and its distance with the height of the antenna's axis above the print. The
antenna gives the x axis, the direction of its clamped tangent in that plane, and the origin, its clamp: one known
length back from its tip, or where the clamp's edge is marked.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from targets.board import corner_points
from vbaa_calib.calibrate.pose.board_pose import BoardPose, require_size, solve_board_pose
from vbaa_calib.calibrate.pose.fusion import PoseEstimate
from vbaa_calib.core.errors import InputError
from vbaa_calib.detect.board.corners import BoardView, detect_corners
from vbaa_calib.detect.board.view_quality import fixes_homography
from vbaa_calib.detect.over_board.measure import BoardLine, find_over_board
from vbaa_calib.detect.over_board.search import PlaneAbove
from vbaa_calib.geometry import Pose
from vbaa_calib.rig.reprojection import see

from .fit import Mark, OverProblem, solve_over
from .free_antenna import OverSetup, from_clamp, outermost, refuse_moved, refuse_other_lines, refuse_touching

_CORNER_REACH_PX = 12.0
"""A corner this near to the antenna was sharpened in a window that shows the antenna."""
_MOST_SCATTER = 5.0
_NAMED = 3


@dataclass(frozen=True, eq=False)
class OverBoardSolution:
    """The camera's pose by the antenna over the board.

    estimate : the pose with its covariance. The frame is the antenna's own; a jig that holds the same frame only as
        well as the clamp repeats differs by the clamp's scatter.
    board : the board's pose, with the second solution that a plane allows. line : the antenna, from clamp to tip.
    reach_m : arc lengths of the first and the last point that took part.
    """

    estimate: PoseEstimate
    board: BoardPose
    line: BoardLine
    reach_m: tuple[float, float]


def solve_over_board(
    images: Mapping[str, np.ndarray], setup: OverSetup, guess: Pose | None = None, bright: bool | None = None
) -> OverBoardSolution:
    """Pose of the camera from pictures of the free antenna over a board that lies on plane C.

    Parameters
    ----------
    images : name → (H, W) uint8; camera, antenna and board stand still in all of them.
    guess : a rough T_antenna_camera: only decides which end is clamped, and to which side z points. Without it z points
        to the camera's side, and the clamped end is the one at the mark, or else the one that leaves the picture.
    bright : whether the antenna is brighter than black print; None: as the pictures show.

    Raises
    ------
    InputError : no board, no antenna, one that touches the board or hides in its own shadow, one whose ends do not
        show which is clamped or do not fix its place, or pictures that do not agree.
    SolveError : the antenna could not be fitted.
    """
    if not images:
        raise InputError("there are no pictures of the antenna over the board", remedy="take one, or remove over/")
    toward = 1.0 if guess is None else float(np.sign(guess.translation_m[2]) or 1.0)
    refuse_touching(setup, toward)
    for name, image in images.items():
        require_size(image.shape[1::-1], setup.camera, name)
    views = [detect_corners(image, setup.spec, name) for name, image in images.items()]
    # the pictures' median: less noise, and one disturbed picture does not change it
    picture = np.median(np.stack(list(images.values())), axis=0).astype(np.float32)
    board, line = _board_and_line(picture, views, setup, bright)
    refuse_moved(images, picture, line)
    where = ", ".join(list(images)[:_NAMED]) + (" …" if len(images) > _NAMED else "")
    plane = PlaneAbove(setup.camera, board.T_camera_board, setup.height_m)
    refuse_other_lines(line, plane, setup.antenna, where)
    line = from_clamp(line, plane, guess, setup.clamp, where)
    marks = _marks(line, setup, where)
    seen = see(setup.camera, line.points_px, line.sigma_px, with_lens=True)
    problem = OverProblem(setup, board, seen, marks, toward)
    estimate, scatter, reach_m = solve_over(problem, _start(line, plane, setup))
    if scatter > _MOST_SCATTER:
        raise InputError(
            f"the antenna's points scatter {scatter:.1f} times as far as the picture's noise explains",
            where=where,
            remedy="clear the board of other things, light it softly, and check the board's description",
        )
    return OverBoardSolution(estimate, board, line, reach_m)


def _board_and_line(
    picture: np.ndarray, views: Sequence[BoardView], setup: OverSetup, bright: bool | None
) -> tuple[BoardPose, BoardLine]:
    """Board and antenna, the board once more without the corners that the antenna runs past."""
    board = _board(views, setup)
    line = _line(picture, board, views, setup, bright)
    reach = _CORNER_REACH_PX + 0.5 * line.width_px
    clear = [_without(view, line.distance_px(view.corners_px) < reach) for view in views]
    ids = np.unique(np.concatenate([view.ids for view in clear]))
    if len(clear[0].ids) == len(views[0].ids) or not fixes_homography(corner_points(setup.spec)[ids, :2]):
        return board, line
    board = _board(clear, setup)
    return board, _line(picture, board, views, setup, line.bright)


def _without(view: BoardView, covered: np.ndarray) -> BoardView:
    kept = None if view.covariance_px2 is None else view.covariance_px2[~covered]
    return replace(view, ids=view.ids[~covered], corners_px=view.corners_px[~covered], covariance_px2=kept)


def _board(views: Sequence[BoardView], setup: OverSetup) -> BoardPose:
    try:
        return solve_board_pose(views, setup.spec, setup.camera)
    except InputError as error:
        what = error.what.replace("pictures of the jig", "pictures of the antenna over the board")
        raise InputError(what, where=error.where, remedy=error.remedy) from None


def _line(
    picture: np.ndarray, board: BoardPose, views: Sequence[BoardView], setup: OverSetup, bright: bool | None
) -> BoardLine:
    plane = PlaneAbove(setup.camera, board.T_camera_board, setup.height_m)
    line = find_over_board(picture, plane, setup.spec, setup.antenna.diameter_m, bright)
    if line is None:
        raise InputError(
            "no antenna is found over the board",
            where=", ".join(view.name for view in views[:_NAMED]),
            remedy="let it run across several squares; a white antenna shows over black, a dark one over white",
        )
    return line


def _marks(line: BoardLine, setup: OverSetup, where: str) -> list[Mark]:
    known = (-1, line.ends[1], setup.antenna.length_std_m), (0, setup.clamp, 0.0)
    marks = [
        Mark(end, see(setup.camera, at.point_px[None], np.array([at.std_px]), with_lens=True), std_m)
        for end, at, std_m in known
        if at is not None
    ]
    if not marks:
        raise InputError(
            "the antenna's tip is not in the picture, and its clamp is not marked",
            where=where,
            remedy="bring the tip into the picture, or mark the clamp's edge",
        )
    return marks


def _start(line: BoardLine, plane: PlaneAbove, setup: OverSetup) -> np.ndarray:
    """(3,) angle and clamp as if the antenna were straight."""
    ends = plane.to_plane(outermost(line))[0]
    along = np.diff(ends, axis=0)[0]
    unit = along / np.linalg.norm(along)
    origin = ends[1] - setup.antenna.length_m * unit
    if line.ends[1] is None and setup.clamp is not None:
        origin = plane.to_plane(setup.clamp.point_px[None])[0][0]
    return np.array([np.arctan2(unit[1], unit[0]), *origin])
