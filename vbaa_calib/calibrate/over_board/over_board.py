"""Plane C from the free antenna seen over a board that lies on it: the antenna's own axis and clamp make the frame.

The board gives the plane: its normal, and its distance with the height of the antenna's axis above the print. The
antenna gives the x axis, the direction of its clamped tangent in that plane, and the origin, its clamp: one known
length back from its tip, or where the clamp's edge is marked.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import cv2
import numpy as np

from targets.board import corner_points
from vbaa_calib.calibrate.lens.board_shape import BoardShape
from vbaa_calib.calibrate.pose.board_pose import BoardPose, require_size, solve_board_pose
from vbaa_calib.calibrate.pose.fusion import PoseEstimate
from vbaa_calib.core.errors import InputError
from vbaa_calib.detect.board.corners import BoardView, detect_corners
from vbaa_calib.detect.board.view_quality import fixes_homography
from vbaa_calib.detect.over_board.line import BoardLine, PlaneAbove, find_over_board
from vbaa_calib.geometry import Pose
from vbaa_calib.rig.reprojection import see

from .fit import Mark, OverProblem, OverSetup, solve_over

_TOO_LONG, _HARD_SHADOW = 1.15, 0.2
_AMBIGUOUS_SIDE, _ALONG = 0.6, 0.5
_MOVED = 0.6
_CORNER_REACH_PX = 12.0  # a corner this near to the antenna was sharpened in a window that shows the antenna
_MOST_SCATTER = 5.0
_NAMED = 3


def solve_over_board(
    images: Mapping[str, np.ndarray], setup: OverSetup, guess: Pose | None = None
) -> tuple[PoseEstimate, BoardPose]:
    """Pose of the camera from pictures of the free antenna over a board on plane C, and the board's.

    The frame is the antenna's own: a jig that holds the same frame differs by the clamp's scatter.

    images : name → (H, W) uint8; camera, antenna and board stand still in all of them.
    guess : a rough T_antenna_camera: only decides which end is clamped, and to which side z points. Without it z points
        to the camera's side, and the clamped end is the one at the mark, or else the one that leaves the picture.

    Raises InputError for no board, no antenna, one that touches the board or hides in its own shadow, one whose ends do
    not show which is clamped or do not fix its place, or pictures that do not agree; SolveError where it cannot be
    fitted.
    """
    if not images:
        raise InputError("there are no pictures of the antenna over the board", remedy="take one, or remove over/")
    toward = 1.0 if guess is None else float(np.sign(guess.translation_m[2]) or 1.0)
    _refuse_touching(setup, toward)
    for name, image in images.items():
        require_size(image.shape[1::-1], setup.camera, name)
    views = [detect_corners(image, setup.spec, name) for name, image in images.items()]
    # the pictures' median: less noise, and one disturbed picture does not change it
    picture = np.median(np.stack(list(images.values())), axis=0).astype(np.float32)
    where = ", ".join(list(images)[:_NAMED]) + (" …" if len(images) > _NAMED else "")
    board = _board(views, setup)
    line = _line(picture, board, setup, where)
    # once more without the corners that the antenna runs past
    reach_px = _CORNER_REACH_PX + 0.5 * line.width_px
    clear = [view.picked(line.distance_px(view.corners_px) >= reach_px) for view in views]
    ids = np.unique(np.concatenate([view.ids for view in clear]))
    if len(clear[0].ids) < len(views[0].ids) and fixes_homography(corner_points(setup.spec)[ids, :2]):
        board = _board(clear, setup)
        line = _line(picture, board, setup, where, line.bright)
    _refuse_moved(images, picture, line)
    plane = PlaneAbove(setup.camera, board.T_camera_board, setup.height_m)
    _refuse_other_lines(line, plane, setup, where)
    line = _from_clamp(line, plane, guess, setup, where)
    marks = _marks(line, setup, where)
    seen = see(setup.camera, line.points_px, line.sigma_px, with_lens=True)
    # from where the clamp would be if the antenna were straight
    ends = plane.to_plane(_outermost(line))[0]
    along = np.diff(ends, axis=0)[0]
    unit = along / np.linalg.norm(along)
    origin = ends[1] - setup.antenna.length_m * unit
    if line.ends[1] is None and setup.clamp is not None:
        origin = plane.to_plane(setup.clamp.point_px[None])[0][0]
    start = np.array([np.arctan2(unit[1], unit[0]), *origin])
    estimate, scatter = solve_over(OverProblem(setup, board, seen, marks, toward), start)
    if scatter > _MOST_SCATTER:
        raise InputError(
            f"the antenna's points scatter {scatter:.1f} times as far as the picture's noise explains",
            where=where,
            remedy="clear the board of other things, light it softly, and check the board's description",
        )
    return estimate, board


def _refuse_touching(setup: OverSetup, toward: float) -> None:
    antenna, free_m = setup.antenna, setup.height_m - 0.5 * setup.antenna.diameter_m
    rise = toward * antenna.curves(antenna.parameters[None]).points_m[0, :, 2]
    lowest = max(-float(rise.min()), 0.0)
    if not free_m > 0.0 or lowest > free_m:
        raise InputError(
            f"the antenna's axis is {1e3 * setup.height_m:.1f} mm above the board, and sags by {1e3 * lowest:.1f} mm",
            remedy="hold it higher: an antenna that rests on the board is not free",
        )


def _board(views: Sequence[BoardView], setup: OverSetup) -> BoardPose:
    try:
        return solve_board_pose(views, BoardShape.flat(corner_points(setup.spec)), setup.camera)
    except InputError as error:
        what = error.what.replace("pictures of the jig", "pictures of the antenna over the board")
        raise InputError(what, where=error.where, remedy=error.remedy) from None


def _line(picture: np.ndarray, board: BoardPose, setup: OverSetup, where: str, bright: bool | None = None) -> BoardLine:
    plane = PlaneAbove(setup.camera, board.T_camera_board, setup.height_m)
    line = find_over_board(picture, plane, setup.spec, setup.antenna.diameter_m, bright)
    if line is None:
        remedy = "let it run across several squares; a white antenna shows over black, a dark one over white"
        raise InputError("no antenna is found over the board", where=where, remedy=remedy)
    return line


def _refuse_moved(images: Mapping[str, np.ndarray], picture: np.ndarray, line: BoardLine) -> None:
    """A picture that does not show the line where the typical one (H, W) does."""
    along = np.gradient(line.points_px, axis=0)
    normal = np.stack([-along[:, 1], along[:, 0]], axis=1)
    normal *= (line.width_px + 3.0) / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-9)
    at = (line.points_px + np.array([-1, 0, 1])[:, None, None] * normal).astype(np.float32)

    def height(image: np.ndarray) -> float:
        grey = image.astype(np.float32)
        left, middle, right = cv2.remap(grey, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return float(np.median(middle - 0.5 * (left + right)))

    usual = height(picture)
    for name, image in images.items():
        if height(image) / usual < _MOVED:
            remedy = "let it come to rest and keep it still, or remove that picture"
            raise InputError("the antenna is not where the other pictures show it", where=name, remedy=remedy)


def _refuse_other_lines(line: BoardLine, plane: PlaneAbove, setup: OverSetup, where: str) -> None:
    """A line longer than the antenna, or a dark one beside its own hard shadow."""
    if not line.bright and line.shadow > _HARD_SHADOW:
        raise InputError(
            f"a band {100 * line.shadow:.0f} % darker runs beside the dark antenna: its shadow",
            where=where,
            remedy="light it from several sides or through a sheet of paper, or paint the antenna white",
        )
    seen = float(np.linalg.norm(np.diff(plane.to_plane(line.points_px[[0, -1]])[0], axis=0)))
    if seen > _TOO_LONG * setup.antenna.length_m:
        raise InputError(
            f"the line found is {1e3 * seen:.0f} mm long, the antenna {1e3 * setup.antenna.length_m:.0f} mm",
            where=where,
            remedy="is it the antenna? check its length and the board's square size",
        )


def _outermost(line: BoardLine) -> np.ndarray:
    """(2, 2) the two ends of what is seen of the line, px."""
    pairs = zip(line.ends, line.points_px[[0, -1]], strict=True)
    return np.stack([point if end is None else end.point_px for end, point in pairs])


def _from_clamp(line: BoardLine, plane: PlaneAbove, guess: Pose | None, setup: OverSetup, where: str) -> BoardLine:
    """The line with its clamped end first. Raises InputError where nothing shows which end that is."""
    ends = _outermost(line)
    if setup.clamp is not None:
        near = np.linalg.norm(ends - setup.clamp.point_px, axis=1)
        if near.min() > _AMBIGUOUS_SIDE * near.max():
            raise InputError("the clamp's mark is as near to one end of the antenna as to the other", where=where)
        return line if near[0] < near[1] else line.reversed()
    if guess is not None:
        along = plane.T_camera_board.rotation @ np.append(np.diff(plane.to_plane(ends)[0], axis=0)[0], 0.0)
        cosine = float(along @ guess.rotation.T[:, 0] / np.linalg.norm(along))
        if abs(cosine) < _ALONG:
            raise InputError(
                f"the line found lies {np.degrees(np.arccos(abs(cosine))):.0f}° off the antenna's expected direction",
                where=where,
                remedy="is it the antenna? remove other thin things from the board",
            )
        return line if cosine > 0 else line.reversed()
    if (line.ends[0] is None) == (line.ends[1] is None):
        both = "leaves the picture at both ends" if line.ends[0] is None else "ends in the picture on both sides"
        raise InputError(
            f"the antenna {both}, which of them is the clamp does not show",
            where=where,
            remedy="give over.clamp_px in session.yaml: where the clamp's edge shows",
        )
    return line if line.ends[0] is None else line.reversed()


def _marks(line: BoardLine, setup: OverSetup, where: str) -> list[Mark]:
    known = (-1, line.ends[1], setup.antenna.length_std_m), (0, setup.clamp, 0.0)
    marks = [
        Mark(end, see(setup.camera, at.point_px[None], np.array([at.std_px]), with_lens=True), std_m)
        for end, at, std_m in known
        if at is not None
    ]
    if not marks:
        remedy = "bring the tip into the picture, or mark the clamp's edge"
        raise InputError(
            "the antenna's tip is not in the picture, and its clamp is not marked", where=where, remedy=remedy
        )
    return marks
