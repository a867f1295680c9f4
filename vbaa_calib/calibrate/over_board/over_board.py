"""Plane C from the free antenna seen over a board that lies on it: the antenna's own axis and clamp make the frame.

The board gives the plane: its normal, and its distance with the height of the antenna's axis above the print. The
antenna gives the x axis, the direction of its clamped tangent in that plane, and the origin, its clamp: one known
length back from its tip, or where the clamp's edge is marked.

Unknown are the direction and the place of the clamp in plane C. The board's pose, its distance, and the antenna's shape
are known with their covariances: they are solved for too, in units of their own standard deviations, so that their
uncertainty is in the result, and the picture may correct them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from targets.board import BoardWithIds, corner_points
from vbaa_calib.antenna.shape import PARAMETERS, Curves, bend
from vbaa_calib.antenna.taper import UNIFORM, Taper
from vbaa_calib.calibrate.antenna.bundle_adjustment import noise_scale
from vbaa_calib.calibrate.antenna.session_rig import bow_std_per_m, nominal_parameters
from vbaa_calib.calibrate.antenna.settings import AntennaSettings
from vbaa_calib.calibrate.lens.board_shape import BoardShape
from vbaa_calib.calibrate.pose.board_pose import BoardPose, require_size, solve_board_pose
from vbaa_calib.calibrate.pose.fusion import PoseEstimate
from vbaa_calib.camera import Camera
from vbaa_calib.core.errors import InputError, SolveError
from vbaa_calib.core.least_squares import Linearised, Rules, minimise
from vbaa_calib.detect.board.corners import BoardView, detect_corners
from vbaa_calib.detect.board.view_quality import fixes_homography
from vbaa_calib.detect.over_board.line import BoardLine, LineEnd, PlaneAbove, find_over_board
from vbaa_calib.geometry import Pose
from vbaa_calib.geometry.covariance import independent_axes
from vbaa_calib.rig.reprojection import ImageCurves, SeenPoints, feet, image_curves, see, whitened_with_lens
from vbaa_calib.session import NominalAntenna


@dataclass(frozen=True)
class _OverBoardFitSettings:
    """Thresholds of the fit of a free antenna over a board."""

    # what a nominal antenna is trusted with besides the priors of bundle adjustment
    length_std_m: float = 3e-4  # standard deviation of its length: a ruler's reading
    out_of_plane_std_rad: float = 0.01  # of its clamp's tangent out of the board: as parallel as a gauge makes it
    log_stiffness_std: float = 0.15  # of the logarithm of EI: four per cent of the diameter
    # the fit
    enough: float = 1e-4  # predicted decrease of the cost below which the fit ends
    passes: int = 10  # most passes, each with the scatter of the points about the one before
    last_change: float = 1e-5  # relative change of that scatter at which they end
    end_margin: float = 0.004  # part of the length at clamp and tip whose points are left out
    fewest_points: int = 20  # fewest points between these
    # what is refused
    too_long: float = 1.15  # length of the line over the antenna's
    hard_shadow: float = 0.2  # part by which a band next to a dark antenna is darker
    ambiguous_side: float = 0.6  # clamp mark's distance from the nearer end over the farther: more is ambiguous
    along: float = 0.5  # cosine between the line and the antenna's expected direction, least
    moved: float = 0.6  # height of a picture's line over that of the pictures' median, least
    most_scatter: float = 5.0  # scatter of the points over their standard deviations, most
    corner_reach_px: float = 12.0  # a corner this near to the antenna was sharpened in a window that shows the antenna


_IN_PLANE = slice(0, 3)  # places of the unknowns: angle (rad) and clamp (x, y; m) in the board frame;
_BOARD = slice(3, 9)  # whitened, the board's tangent,
_UNKNOWNS = 10 + len(PARAMETERS)  # its height at 9, and the antenna's parameters from 10
_STEPS = np.array([1e-5, 1e-5, 1e-5, *[0.02] * (_UNKNOWNS - 3)])  # finite differences


@dataclass(frozen=True, eq=False)
class _FreeAntenna:
    """Prior distribution of the free antenna's shape."""

    length_m: float  # from the clamp to the tip
    length_std_m: float
    diameter_m: float  # of the wire
    # (9,) `antenna.shape.PARAMETERS` in the frame solved for; with zero clamp offsets and angles the clamp's
    parameters: np.ndarray
    covariance: np.ndarray  # (9, 9) of the parameters
    gravity_m_s2: np.ndarray  # (3,) antenna frame, at the joints' angles of the pictures
    taper: Taper = UNIFORM

    def curves(self, parameters: np.ndarray) -> Curves:
        """Shapes of the free antenna for each of K parameter vectors (K, 9)."""
        count = len(parameters)
        gravity = np.repeat(self.gravity_m_s2[None], count, axis=0)
        half = np.full(count, 0.5 * self.length_m)
        none = np.zeros((count, 2))
        return bend(
            parameters, self.length_m, gravity, half, none, sweeps=4, taper=self.taper, diameter_m=self.diameter_m
        )


def nominal_free_antenna(antenna: NominalAntenna, gravity_m_s2: np.ndarray) -> _FreeAntenna:
    """Prior of a straight antenna of nominal stiffness and mass. gravity_m_s2 : (3,) in the antenna frame that is
    solved for."""
    bow = bow_std_per_m(antenna.length_m)
    std = [0.0, 0.0, _OverBoardFitSettings.out_of_plane_std_rad, 0.0, bow, bow]
    std += [_OverBoardFitSettings.log_stiffness_std, AntennaSettings.log_mass_std, AntennaSettings.clamp_give_std_m]
    return _FreeAntenna(
        length_m=antenna.length_m,
        length_std_m=_OverBoardFitSettings.length_std_m,
        diameter_m=antenna.diameter_m,
        parameters=nominal_parameters(antenna),
        covariance=np.diag(np.square(std)),
        gravity_m_s2=np.asarray(gravity_m_s2, float),
        taper=antenna.taper,
    )


@dataclass(frozen=True, eq=False)
class OverSetup:
    """Description of the antenna over the board."""

    spec: BoardWithIds  # the board, flat on plane C
    camera: Camera
    antenna: _FreeAntenna  # the free antenna above it
    height_m: float  # of the antenna's axis at the clamp above the print
    height_std_m: float
    clamp: LineEnd | None = None  # the clamp's visible edge, where it is known


_Mark = tuple[int, SeenPoints, float]
"""A point of the antenna with a known place along it: its node, −1 the tip and 0 the clamp; where it is seen; how well
its place along the antenna is known, m."""


def _along(mark: _Mark, curves: ImageCurves) -> np.ndarray:
    """(1, 2) direction of the first curve at a marked point, divided by the mark's standard deviation along it."""
    end, seen, std_m = mark
    slope = curves.slopes[0, end]
    unit = slope / np.linalg.norm(slope)
    variance = unit @ seen.covariance[0] @ unit + (std_m * np.linalg.norm(slope)) ** 2
    return np.asarray(unit[None] / np.sqrt(variance))


@dataclass(frozen=True, eq=False)
class _OverProblem:
    """Least-squares problem of the camera's pose over the board: observations and priors."""

    setup: OverSetup
    board: BoardPose
    seen: SeenPoints
    marks: Sequence[_Mark]
    toward: float  # +1 where the antenna frame's z points from plane C to the camera's side, −1 where away
    noise_scale: float = 1.0  # scatter of the points over the stated one

    def T_camera_antenna(self, unknowns: np.ndarray) -> Pose:
        """Pose of the antenna frame in the camera's, from the unknowns."""
        angle, x, y = unknowns[_IN_PLANE]
        cos, sin, up = np.cos(angle), np.sin(angle), self.toward
        rotation = np.array([[cos, up * sin, 0.0], [sin, -up * cos, 0.0], [0.0, 0.0, -up]])
        height = self.setup.height_m + self.setup.height_std_m * unknowns[9]
        step = np.linalg.cholesky(self.board.covariance) @ unknowns[_BOARD]
        return self.board.T_camera_board.retract(step) @ Pose(rotation, np.array([x, y, -height]))

    def curves(self, unknowns: np.ndarray) -> ImageCurves:
        """The projected antenna for each of (K, 19) unknowns."""
        antenna = self.setup.antenna
        parameters = antenna.parameters + unknowns[:, 10:] @ independent_axes(antenna.covariance).T
        return image_curves(antenna.curves(parameters), [self.T_camera_antenna(row) for row in unknowns])

    def linearised(self, unknowns: np.ndarray) -> Linearised:
        """Whitened residuals (R,) and their Jacobian (R, 19): points under Huber's loss, then marks and priors."""
        curves = self.curves(np.vstack([unknowns, unknowns + np.diag(_STEPS)]))
        rows = [whitened_with_lens(self.seen, curves)[0] / self.noise_scale]
        rows += [_along(one, curves) @ (one[1].points.T - curves.nodes[:, one[0]].T) for one in self.marks]
        values = np.vstack(rows)
        jacobian = (values[:, 1:] - values[:, :1]) / _STEPS
        prior = np.eye(_UNKNOWNS)[_IN_PLANE.stop :]
        residuals, certain = np.concatenate([values[:, 0], prior @ unknowns]), len(self.marks) + len(prior)
        return Linearised(unknowns, residuals, np.vstack([jacobian, prior]), certain)

    def by_lens(self, curves: ImageCurves) -> np.ndarray:
        """(R, P) derivatives of the residuals by the lens, with board and antenna frame fixed."""
        rows = [whitened_with_lens(self.seen, curves)[1] / self.noise_scale]
        rows += [_along(one, curves) @ one[1].by_lens[0] for one in self.marks if one[1].by_lens is not None]
        points = np.vstack(rows)
        return np.vstack([points, np.zeros((_UNKNOWNS - _IN_PLANE.stop, points.shape[1]))])


def _solve_over(problem: _OverProblem, start: np.ndarray) -> tuple[PoseEstimate, float]:
    """The unknowns solved from an initial angle and position (angle, x, y) in the board frame, and the ratio of the
    points' scatter to the stated one. Raises SolveError where that does not converge or too few points lie on the
    antenna."""
    unknowns = np.concatenate([start, np.zeros(_UNKNOWNS - 3)])
    for _ in range(_OverBoardFitSettings.passes):
        unknowns = _descended(problem, unknowns)
        # without the points beyond the clamp and the tip
        share = feet(problem.seen, problem.curves(unknowns[None])) / problem.setup.antenna.length_m
        inside = (share > _OverBoardFitSettings.end_margin) & (share < 1 - _OverBoardFitSettings.end_margin)
        if inside.sum() < _OverBoardFitSettings.fewest_points:
            raise SolveError(f"only {int(inside.sum())} points of the antenna lie between its clamp and its tip")
        problem = replace(problem, seen=problem.seen.picked(inside))
        # squares that disturb alike are few: points that scatter little by chance get no more weight
        residuals = whitened_with_lens(problem.seen, problem.curves(unknowns[None]))[0][:, 0]
        before, scale = problem.noise_scale, max(noise_scale([residuals]), 1.0)
        problem = replace(problem, noise_scale=scale)
        if abs(scale / before - 1.0) < _OverBoardFitSettings.last_change:
            break
    unknowns = _descended(problem, unknowns)
    solution, curves = problem.linearised(unknowns), problem.curves(unknowns[None])
    weight, inverse = solution.weights, solution.covariance()
    # the lens moves the board's pose, too
    by_board = np.linalg.solve(np.linalg.cholesky(problem.board.covariance), problem.board.lens_sensitivity)
    pull = (problem.by_lens(curves) + solution.jacobian[:, _BOARD] @ by_board) * weight[:, None]
    pull[-(_UNKNOWNS - 3) :] = 0.0
    by_lens = -inverse @ ((solution.jacobian * weight[:, None]).T @ pull)
    by_lens[_BOARD] += by_board
    # (6, 19) the camera pose's tangent in the antenna frame by the unknowns
    columns = []
    for step in np.diag(_STEPS):
        ahead, back = (problem.T_camera_antenna(unknowns + sign * step).inverse() for sign in (1, -1))
        columns.append(ahead.tangent_from(back) / (2 * step.sum()))
    by_unknowns = np.stack(columns, axis=1)
    covariance = by_unknowns @ inverse @ by_unknowns.T
    pose = problem.T_camera_antenna(unknowns).inverse()
    estimate = PoseEstimate("over board", pose, 0.5 * (covariance + covariance.T), by_unknowns @ by_lens)
    return estimate, problem.noise_scale


def _descended(problem: _OverProblem, unknowns: np.ndarray) -> np.ndarray:
    rules = Rules(iterations=40, standstill=1e-12)
    at, promise, exhausted = minimise(problem.linearised, problem.linearised(unknowns), rules)
    if exhausted and promise >= _OverBoardFitSettings.enough:
        raise SolveError("the antenna over the board could not be fitted to its picture")
    return at.parameters


def solve_over_board(
    images: Mapping[str, np.ndarray], setup: OverSetup, guess: Pose | None = None
) -> tuple[PoseEstimate, BoardPose]:
    """Camera poses relative to the antenna and to the board, from pictures of the free antenna over a board on plane
    C.

    The frame is the antenna's own: a jig that holds the same frame differs by the clamp's scatter.

    images : name → (H, W) uint8; camera, antenna and board at rest in all of them.
    guess : a rough T_antenna_camera: only decides which end is clamped, and to which side z points. Without it z points
        to the camera's side, and the clamped end is the one at the mark, or else the one that leaves the picture.

    Raises InputError for no board, no antenna, one that touches the board or hides in its own shadow, one with ends
    that leave open which is clamped or where it is, or pictures that do not agree; SolveError where it cannot be
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
    where = ", ".join(list(images)[:3]) + (" …" if len(images) > 3 else "")
    board = _board(views, setup)
    line = _line(picture, board, setup, where)
    # once more without the corners that the antenna runs past
    reach_px = _OverBoardFitSettings.corner_reach_px + 0.5 * line.width_px
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
    estimate, scatter = _solve_over(_OverProblem(setup, board, seen, marks, toward), start)
    if scatter > _OverBoardFitSettings.most_scatter:
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
    """Raises InputError for a picture in which the line is not where the median picture (H, W) has it."""
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
        if height(image) / usual < _OverBoardFitSettings.moved:
            remedy = "let it come to rest and keep it still, or remove that picture"
            raise InputError("the antenna is not where the other pictures show it", where=name, remedy=remedy)


def _refuse_other_lines(line: BoardLine, plane: PlaneAbove, setup: OverSetup, where: str) -> None:
    """Raises InputError for a line longer than the antenna, or a dark line next to its own hard shadow."""
    if not line.bright and line.shadow > _OverBoardFitSettings.hard_shadow:
        raise InputError(
            f"a band {100 * line.shadow:.0f} % darker runs beside the dark antenna: its shadow",
            where=where,
            remedy="light it from several sides or through a sheet of paper, or paint the antenna white",
        )
    seen = float(np.linalg.norm(np.diff(plane.to_plane(line.points_px[[0, -1]])[0], axis=0)))
    if seen > _OverBoardFitSettings.too_long * setup.antenna.length_m:
        raise InputError(
            f"the line found is {1e3 * seen:.0f} mm long, the antenna {1e3 * setup.antenna.length_m:.0f} mm",
            where=where,
            remedy="is it the antenna? check its length and the board's square size",
        )


def _outermost(line: BoardLine) -> np.ndarray:
    """(2, 2) the two ends of the visible part of the line, px."""
    pairs = zip(line.ends, line.points_px[[0, -1]], strict=True)
    return np.stack([point if end is None else end.point_px for end, point in pairs])


def _from_clamp(line: BoardLine, plane: PlaneAbove, guess: Pose | None, setup: OverSetup, where: str) -> BoardLine:
    """The line ordered from its clamped end. Raises InputError where the picture does not show which end that is."""
    ends = _outermost(line)
    if setup.clamp is not None:
        near = np.linalg.norm(ends - setup.clamp.point_px, axis=1)
        if near.min() > _OverBoardFitSettings.ambiguous_side * near.max():
            what = "the clamp's mark is as near to one end of the antenna as to the other"
            raise InputError(what, where=where, remedy="set over.clamp_px in session.yaml to the clamp's edge")
        return line if near[0] < near[1] else line.reversed()
    if guess is not None:
        along = plane.T_camera_board.rotation @ np.append(np.diff(plane.to_plane(ends)[0], axis=0)[0], 0.0)
        cosine = float(along @ guess.rotation.T[:, 0] / np.linalg.norm(along))
        if abs(cosine) < _OverBoardFitSettings.along:
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


def _marks(line: BoardLine, setup: OverSetup, where: str) -> list[_Mark]:
    known = (-1, line.ends[1], setup.antenna.length_std_m), (0, setup.clamp, 0.0)
    marks = [
        (end, see(setup.camera, at.point_px[None], np.array([at.std_px]), with_lens=True), std_m)
        for end, at, std_m in known
        if at is not None
    ]
    if not marks:
        remedy = "bring the tip into the picture, or mark the clamp's edge"
        raise InputError(
            "the antenna's tip is not in the picture, and its clamp is not marked", where=where, remedy=remedy
        )
    return marks
