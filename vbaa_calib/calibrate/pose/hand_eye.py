"""Hand-eye calibration: where the camera sits on a robot's arm, or stands in its base, from poses and board views.

X is the camera in what carries it (the tool, or the base), Z the board in the other: X·T_camera_board = K·Z, K the
robot's pose of the one in the other. Robots miss their readings by more than corners are off, so the variances of the
robot's turns and shifts are part of the model (`hand_eye_fit`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.special import chdtri, fdtri

from vbaa_calib.camera import Camera
from vbaa_calib.core.arrays import gate
from vbaa_calib.core.errors import InputError, SolveError
from vbaa_calib.core.robust import radial_std
from vbaa_calib.detect.board.corners import BoardView, require_corners
from vbaa_calib.detect.board.view_quality import fixes_homography
from vbaa_calib.geometry import Pose
from vbaa_calib.geometry.independent_axes import largest_std

from .board_pose import mirrored, require_size, start_poses, turn_between
from .hand_eye_fit import HandEyeProblem, HandEyeSolution, Misfits, Start, ViewCorners, consensus, other_orders
from .settings import HandEyeSettings


@dataclass(frozen=True, eq=False)
class _SeenView:
    """A view's good corners, the one or two poses of the board that they allow, the squares (px²) that the better one
    leaves, how many corners were left out; or the reason why it is not used.
    """

    name: str
    reason: str = ""
    corners: ViewCorners | None = None
    poses: tuple[Pose, ...] = ()
    square: float = 0.0
    left_out: int = 0


def _seen_view(view: BoardView, points: np.ndarray, camera: Camera) -> _SeenView:
    """Good corners and possible board poses of one view. Raises InputError for another picture size, or corners that
    are none of the board's."""
    require_size(view.image_size, camera, view.name)
    ids, pixels = np.asarray(view.ids), np.asarray(view.corners_px, float)
    require_corners(ids, pixels, len(points), view.name)
    if len(ids) < HandEyeSettings.fewest_corners:
        return _SeenView(view.name, f"{len(ids)} corners, at least {HandEyeSettings.fewest_corners} are needed")
    rays, valid = camera.unproject(pixels)
    seen = valid & (rays[:, 2] > 0.05)
    flat = np.where([True, True, False], points[ids], 0.0)
    if seen.sum() < HandEyeSettings.fewest_corners or not fixes_homography(flat[seen, :2]):
        return _SeenView(view.name, "its corners lie (nearly) on a line, or the lens does not see them")
    try:
        starts = start_poses(flat[seen], rays[seen, :2] / rays[seen, 2:])
    except SolveError as error:
        return _SeenView(view.name, str(error))
    every = ViewCorners(points[ids[seen]], pixels[seen], _weights(view, seen))
    if len(starts) == 1:
        starts.append(mirrored(starts[0], every.points_m))
    found = [every.posed(camera, start) for start in starts]
    pose, distances = min(found, key=lambda one: float(np.minimum(one[1], 10.0 * np.median(one[1])).sum()))
    inlying = distances <= max(HandEyeSettings.outlier * radial_std(distances), HandEyeSettings.outlier_px)
    if inlying.sum() < HandEyeSettings.fewest_corners or not fixes_homography(every.points_m[inlying, :2]):
        return _SeenView(view.name, "no pose of the board explains its corners")
    corners = ViewCorners(every.points_m[inlying], every.pixels[inlying], every.weights[inlying])
    best, distances = corners.posed(camera, pose)
    poses, square = [best], float((distances**2).sum())
    other, _ = max(found, key=lambda one: turn_between(one[0], best))
    second, off = corners.posed(camera, other)
    ahead = second.translation_m[2] > 0.0 and turn_between(second, best) > HandEyeSettings.same_pose_rad
    if ahead and float((off**2).sum()) < HandEyeSettings.second_pose**2 * square:
        poses.append(second)
    return _SeenView(view.name, "", corners, tuple(poses), square, len(ids) - int(inlying.sum()))


def _weights(view: BoardView, seen: np.ndarray) -> np.ndarray:
    """Weights (N,) of the corners' residuals: less for corners that are less certain than the median one."""
    if view.covariance_px2 is None:
        return np.ones(int(seen.sum()))
    variance = np.trace(view.covariance_px2[seen], axis1=1, axis2=2)
    middle = max(float(np.median(variance)), 1e-12)
    # besides the picture's noise all corners have errors of print, blur and lens
    return np.sqrt(2.0 * middle / (variance + middle))


_TURN_MORE = "add views with the hand turned by 20° and more about a second axis, at right angles to the first"


@dataclass(frozen=True, eq=False)
class HandEyeView:
    """A view and its disagreement with the robot.

    distance_m, turn_rad : disagreement of the board's centre and turn, by its corners alone, with the robot's pose; NaN
    where not used. reason : why the view counts as an outlier or was not used; empty for a good one.
    """

    name: str
    corners: int
    left_out: int
    distance_m: float
    turn_rad: float
    reason: str = ""


@dataclass(frozen=True, eq=False)
class HandEye:
    """Result of a hand-eye calibration.

    Attributes
    ----------
    mount : "hand": the arm carries the camera; "fixed": it carries the board, and the camera stands next to it.
    camera_pose : T_tool_camera, or T_base_camera where the camera is fixed. board_pose : T_base_board, or T_tool_board.
    covariance : (12, 12) of their tangents (`Pose.retract`), camera first; with the lens' covariance and the
        uncertainty of the robot's variance, so that χ² regions of 95 % hold 95 % also with few views.
    robot_std : (2,) standard deviation per axis of the tool's turns, rad, and shifts, m, against the robot's readings.
    robot_log_std : (2,) of their logarithms.
    rms : (2,) disagreement of the good views, turns rad and the board's centre m.
    parts : "corners", "lens", "robot" → (2,) predicted contribution of each to it, rms; the last one with poses alone.
    board_scale : by what part the board is larger than stated where the robot's lengths are right, and its standard
        deviation.
    noise_px : of a corner's coordinate: as the corners of a view scatter, or more where the boards' poses do; None
        where the input was the board's poses: their errors count as the robot's.
    """

    mount: str
    camera_pose: Pose
    board_pose: Pose
    covariance: np.ndarray
    robot_std: np.ndarray
    robot_log_std: np.ndarray
    rms: np.ndarray
    parts: Mapping[str, np.ndarray]
    board_scale: tuple[float, float]
    noise_px: float | None
    views: tuple[HandEyeView, ...]

    @property
    def outliers(self) -> tuple[str, ...]:
        """Names of the views that the others contradict or that could not be used."""
        return tuple(view.name for view in self.views if view.reason)

    @property
    def robot_share(self) -> np.ndarray:
        """(2,) share of the robot in the predicted variance of the disagreement: turns, distances."""
        return self.parts["robot"] ** 2 / np.sum([part**2 for part in self.parts.values()], axis=0)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings, in words: few views, a board of another size, many contradicting views."""
        used = len(self.views) - len(self.outliers)
        larger, by = self.board_scale
        contradicted = sum(bool(view.reason) and view.distance_m == view.distance_m for view in self.views)
        rules = (
            (
                used < HandEyeSettings.few_to_judge,
                f"{used} views hardly show which of them are wrong: ten to twenty are good",
            ),
            (
                abs(larger) > HandEyeSettings.scale_significant * by,
                f"measured by the robot the board is {100 * larger:.2f} ± {100 * by:.2f} % larger than "
                "described, and the camera's distance is off by as much: measure the print",
            ),
            (
                contradicted > HandEyeSettings.many * (used + contradicted),
                f"{contradicted} views contradict the others: look at them",
            ),
        )
        return tuple(words for holds, words in rules if holds)

    def antenna_on_arm(self, T_antenna_camera: Pose, covariance: np.ndarray) -> tuple[Pose, np.ndarray]:
        """T_tool_antenna, a session's `T_actuator_antenna` on this arm, and its covariance (6, 6).

        T_antenna_camera : of the rig, with its covariance (6, 6); its errors count as independent of these.
        Raises InputError where the camera is not on the arm.
        """
        if self.mount != "hand":
            raise InputError("the camera is not on the arm", remedy="camera and antenna ride together: take mount hand")
        found = self.camera_pose @ T_antenna_camera.inverse()
        R, t = found.rotation, T_antenna_camera.translation_m
        by_camera, by_rig = np.eye(6), -np.kron(np.eye(2), R)
        by_camera[3:, :3] = np.cross(R @ t, np.eye(3)).T
        by_rig[3:, :3] = -R @ np.cross(t, np.eye(3)).T
        spread = by_camera @ self.covariance[:6, :6] @ by_camera.T + by_rig @ covariance @ by_rig.T
        return found, spread

    def to_dict(self) -> dict[str, Any]:
        """The document handeye.json."""
        carrier, other = ("tool", "base") if self.mount == "hand" else ("base", "tool")
        std = np.sqrt(np.diag(self.covariance))
        poses = {f"T_{carrier}_camera": (self.camera_pose, std[:6]), f"T_{other}_board": (self.board_pose, std[6:])}
        return {
            "schema": "vbaa.handeye/1",
            "mount": self.mount,
            **{
                name: pose.to_dict() | {"translation_std_m": own[3:].tolist(), "rotation_std_rad": own[:3].tolist()}
                for name, (pose, own) in poses.items()
            },
            "covariance": self.covariance.tolist(),
            "robot": _two("std", self.robot_std)
            | {
                "translation_relative_std": float(self.robot_log_std[1]),
                "rotation_relative_std": float(self.robot_log_std[0]),
                "translation_share": float(self.robot_share[1]),
                "rotation_share": float(self.robot_share[0]),
            },
            "disagreement": _two("rms", self.rms) | {f"from_{name}": _two("rms", p) for name, p in self.parts.items()},
            "board_scale": {"larger_by": self.board_scale[0], "std": self.board_scale[1]},
            "noise_px": self.noise_px,
            "warnings": list(self.warnings),
            "views": [
                {name: None if value != value else value for name, value in asdict(view).items()} for view in self.views
            ],
        }


def _two(what: str, turn_and_shift: np.ndarray) -> dict[str, Any]:
    turn, shift = turn_and_shift.tolist()
    return {f"translation_{what}_m": shift, f"rotation_{what}_rad": turn}


@gate
def solve_hand_eye(
    views: Sequence[BoardView | tuple[str, Pose]],
    robot_poses: Sequence[Pose],
    board_points: np.ndarray | None = None,
    camera: Camera | None = None,
    mount: str = "hand",
    readings: Mapping[str, Sequence[Pose]] | None = None,
) -> HandEye:
    """Solve for the camera's pose on the arm, or next to it, and the board's.

    views : the board in each picture; grossly wrong corners are left out. Or name and pose T_camera_board of each, by
    whatever means they were measured (A·X = X·B, A·X = Z·B): then neither points nor camera are needed.
    robot_poses : T_base_tool of each, in the same order.
    board_points : (K, 3) m, by corner id, as the lens solve has found them.
    mount : "hand" or "fixed", as in `HandEye`.
    readings : other ways to read the poses, by the mistake that they stand for ("are in degrees"), to name a mistake.

    Raises InputError for views and poses that are not of equal number, fewer than three views that can be used, an arm
    that turned about one axis only or not at all, poses that fit far better read in another way, or do not fit.
    """
    if mount not in ("hand", "fixed"):
        raise InputError(f"the mount is {mount!r}", remedy="take one of hand, fixed")
    if len(views) != len(robot_poses):
        raise InputError(
            f"there are {len(views)} views and {len(robot_poses)} robot poses", remedy="give one pose for each view"
        )
    measured = [view for view in views if isinstance(view, tuple)]
    if measured:
        camera = None
        points, seen = _seen_poses(measured, len(views))
    else:
        points, seen = _seen_corners([view for view in views if not isinstance(view, tuple)], board_points, camera)
    used = np.array([index for index, one in enumerate(seen) if not one.reason], int)
    if len(used) < HandEyeSettings.fewest_views:
        reasons = sorted({one.reason for one in seen if one.reason})
        raise InputError(
            f"{len(used)} of {len(views)} views can be used, at least {HandEyeSettings.fewest_views} are needed"
            + (f" ({'; '.join(reasons[:3])})" if reasons else ""),
            remedy="add views with the hand turned about two axes; ten to twenty are good",
        )
    good = [seen[i] for i in used]
    rows = [_checked_pose(pose, f"robot pose {index}") for index, pose in enumerate(robot_poses)]
    poses = [rows[i] for i in used]
    _refuse_one_axis(poses)  # and again without outliers
    start = _start(rows, used, good, points, mount == "hand", (readings or {}, camera is None))
    corners = tuple(one.corners for one in good if one.corners is not None)
    freedom = sum(one.pixels.size - 6 for one in corners)
    noise_px = float(np.sqrt(sum(one.square for one in good) / freedom))
    problem = HandEyeProblem(corners, tuple(poses), camera, max(noise_px, HandEyeSettings.rounding_px), mount == "hand")
    chosen = [one.poses[min(k, len(one.poses) - 1)] for one, k in zip(good, start.chosen.tolist(), strict=True)]
    solved, kept, off = _consistent(problem, start, chosen, points.mean(axis=0))
    in_it = [pose for pose, good_one in zip(poses, kept, strict=True) if good_one]
    _refuse_loose(solved, in_it, float(np.median([_distance_m(pose, camera is None) for pose in chosen])))
    return _result(solved, kept, off, problem, seen)


def _distance_m(pose: Pose, measured: bool) -> float:
    """Distance of the board from the camera: along its axis, or of a measured pose the whole distance."""
    return float(np.linalg.norm(pose.translation_m) if measured else pose.translation_m[2])


def _seen_corners(
    views: Sequence[BoardView], board_points: np.ndarray | None, camera: Camera | None
) -> tuple[np.ndarray, list[_SeenView]]:
    if board_points is None or camera is None:
        raise InputError("corners need the board's points and a camera", remedy="give both, or poses T_camera_board")
    points = _checked_points(board_points)
    return points, [_seen_view(view, points, camera) for view in views]


def _seen_poses(views: Sequence[tuple[str, Pose]], count: int) -> tuple[np.ndarray, list[_SeenView]]:
    """Points of a board about the origin, as large as a tenth of its distance, and the views of it."""
    if len(views) < count:
        raise InputError("views are partly poses and partly corners", remedy="give one kind")
    poses = [(name, _checked_pose(pose, f"view {name}")) for name, pose in views]
    size_m = max(
        HandEyeSettings.point_share * float(np.median([_distance_m(pose, True) for _, pose in poses])),
        HandEyeSettings.least_size_m,
    )
    points = size_m * np.vstack([np.eye(3), -np.eye(3)])
    ones = np.ones(len(points))
    return points, [_SeenView(name, "", ViewCorners(points, pose @ points, ones), (pose,)) for name, pose in poses]


def _checked_points(board_points: np.ndarray) -> np.ndarray:
    points = np.asarray(board_points, float)
    if (
        points.ndim != 2
        or points.shape[1] != 3
        or len(points) < HandEyeSettings.fewest_corners
        or not np.isfinite(points).all()
    ):
        raise InputError(
            f"the board's points have the shape {points.shape}, or are not finite",
            remedy="give them as (K, 3) metres, by corner id",
        )
    return points


def _checked_pose(pose: Pose, name: str) -> Pose:
    rotation, place = np.asarray(pose.rotation, float), np.asarray(pose.translation_m, float)
    fits = rotation.shape == (3, 3) and place.shape == (3,) and np.isfinite(rotation).all() and np.isfinite(place).all()
    if not fits or np.abs(rotation @ rotation.T - np.eye(3)).max() > 1e-3 or np.linalg.det(rotation) < 0.0:
        raise InputError(f"{name} is none", remedy="give a rotation matrix, and metres")
    return Pose(Rotation.from_matrix(rotation).as_matrix(), place)


def _turns(poses: Sequence[Pose]) -> tuple[np.ndarray, np.ndarray]:
    """(3,) rms turns of the tool about their principal axes, rad, largest first, and the axes (3, 3) in the tool."""
    turns = Rotation.from_matrix(np.array([pose.rotation for pose in poses]))
    middle = turns[int(np.argmin([(turns * one.inv()).magnitude().sum() for one in turns]))]
    vectors = (middle.inv() * turns).as_rotvec()
    _, values, axes = np.linalg.svd(np.vstack([vectors, np.zeros((3, 3))]), full_matrices=False)
    return values / np.sqrt(len(vectors)), axes


def _refuse_one_axis(poses: Sequence[Pose]) -> None:
    (most, second, _), axes = _turns(poses)
    if most < HandEyeSettings.least_turn_rad:
        raise InputError(
            f"the hand only shifted, turning by {np.degrees(most):.2g}° rms, which leaves the camera's place open",
            remedy=_TURN_MORE.replace("a second axis, at right angles to the first", "two axes"),
        )
    if second < HandEyeSettings.least_turn_rad:
        axis = ", ".join(f"{part:+.2f}" for part in axes[0])
        raise InputError(
            f"all turns of the hand are about one axis, ({axis}) in the tool's frame: the camera's place along it "
            "stays open",
            remedy=_TURN_MORE,
        )


def _start(
    rows: list[Pose],
    used: np.ndarray,
    seen: Sequence[_SeenView],
    points: np.ndarray,
    in_hand: bool,
    how: tuple[Mapping[str, Sequence[Pose]], bool],
) -> Start:
    """A start from all rows of poses, of which `used` (V,) are the views'. Raises InputError where they fit far better
    in another reading, or in none.

    how : other readings of the rows, and whether the board's poses were measured.
    """
    readings, measured = how
    detected = [one.poses for one in seen]

    def known(tools: Sequence[Pose]) -> list[Pose]:
        return [pose.inverse() for pose in tools] if in_hand else list(tools)

    best = consensus(known([rows[i] for i in used]), detected, points)
    reach = float(np.median([_distance_m(one.poses[0], measured) for one in seen]))
    if best.spread_m <= HandEyeSettings.well_explained * reach:
        return best
    # X and Z exchanged, these are the same
    inverted = ", or the views' are of the camera in the board" if measured else ""
    tables = {
        f"are inverted, or the mount is the other{inverted}": [pose.inverse() for pose in rows],
        "are in millimetres": [Pose(pose.rotation, 1e-3 * pose.translation_m) for pose in rows],
        "are in kilometres": [Pose(pose.rotation, 1e3 * pose.translation_m) for pose in rows],
        **readings,
    }
    others = {
        words: [(table[i], own) for i, own in zip(used, detected, strict=True)] for words, table in tables.items()
    }
    for words, order in other_orders(known(rows), [one[0] for one in detected], used).items():
        pairs = [(rows[i], own) for i, own in zip(order, detected, strict=True) if i >= 0]
        if not np.array_equal(order, used) and len(pairs) > HandEyeSettings.fewest_views:
            others[words] = pairs
    spreads = {
        words: consensus(
            known([tool for tool, _ in pairs]), [own for _, own in pairs], points, HandEyeSettings.few_subsets
        ).spread_m
        for words, pairs in others.items()
    }
    # another order may be the same as a shift, but for the views at the ends
    words = next(one for one, spread in spreads.items() if spread <= 2.0 * min(spreads.values()))
    better = HandEyeSettings.better_of_few if len(used) < HandEyeSettings.few else HandEyeSettings.far_better
    if better * spreads[words] < best.spread_m and spreads[words] <= HandEyeSettings.explained * reach:
        raise InputError(
            f"the robot's poses fit to {1e3 * best.spread_m:.3g} mm as they stand, and to "
            f"{1e3 * spreads[words]:.2g} mm if they {words}",
            remedy="give poses of the tool in the base, in metres, one for each view in its order, and the right mount",
        )
    if best.spread_m > HandEyeSettings.explained * reach:
        raise InputError(
            f"the robot's poses do not explain the views: the better part of them misses the board by "
            f"{1e3 * best.spread_m:.0f} mm",
            remedy="is each the pose at its picture, of the tool in the base, and what the tool carries fixed to it?",
        )
    return best


def _consistent(
    problem: HandEyeProblem, start: Start, seen: Sequence[Pose], centre_m: np.ndarray
) -> tuple[HandEyeSolution, np.ndarray, Misfits]:
    """Solves over the views that agree: the solution, the mask (V,) of these views, and the misfit of every view."""
    kept, X, Z = start.good, start.X, start.Z
    std = np.array([max(start.spread_m, 1e-6), max(start.spread_m, 1e-6), 1.0])
    for _ in range(HandEyeSettings.outlier_rounds):
        part = problem.picked(kept)
        _refuse_one_axis(part.readings)
        solved = part.solved(part.start(X, Z), std)
        (X, Z, *_), std = solved.state, solved.std
        off = problem.misfits(solved, seen, kept, centre_m)
        # outliers still in it make the robot look worse than it is; among few views that cannot be seen
        scale = float(np.median(off.squares) / chdtri(6, 0.5))
        scale = max(scale, 1.0) if len(seen) < HandEyeSettings.few_to_judge else scale
        before, kept = kept, off.squares <= scale * 6.0 * fdtri(6, solved.freedom, 1.0 - HandEyeSettings.outlier_chance)
        if np.array_equal(kept, before) or kept.sum() < max(HandEyeSettings.fewest_views, 0.5 * len(kept)):
            break
    return solved, before, off


def _refuse_loose(found: HandEyeSolution, tools: Sequence[Pose], reach_m: float) -> None:
    of_camera = found.covariance[:6, :6]
    turn, place = (float(largest_std(part)) for part in (of_camera[:3, :3], of_camera[3:, 3:]))
    if turn > HandEyeSettings.loose_rad or place > HandEyeSettings.loose_share * reach_m:
        second = np.degrees(_turns(tools)[0][1])
        raise InputError(
            f"the views leave the camera's pose open to {turn:.2g} rad and {1e3 * place:.2g} mm; the hand turned by "
            f"{second:.2g}° rms about the second axis",
            remedy=_TURN_MORE
            if second < HandEyeSettings.turned_well_deg
            else "add views, the board large in them and the robot at rest",
        )


def _result(
    solved: HandEyeSolution, kept: np.ndarray, off: Misfits, problem: HandEyeProblem, seen: Sequence[_SeenView]
) -> HandEye:
    views, index = [], 0
    for one in seen:
        if one.corners is None:
            views.append(HandEyeView(one.name, 0, 0, np.nan, np.nan, one.reason))
            continue
        reason = "" if kept[index] else "its robot pose contradicts the others"
        count = 0 if problem.camera is None else len(one.corners.pixels)
        distance, turn = float(off.distance_m[index]), float(off.turn_rad[index])
        views.append(HandEyeView(one.name, count, one.left_out, distance, turn, reason))
        index += 1
    return HandEye(
        mount="hand" if problem.in_hand else "fixed",
        camera_pose=solved.state[0],
        board_pose=solved.state[1],
        covariance=solved.covariance,
        robot_std=solved.std[:2],
        robot_log_std=solved.log_std[:2],
        rms=np.sqrt([np.mean(off.turn_rad[kept] ** 2), np.mean(off.distance_m[kept] ** 2)]),
        parts={
            name: np.sqrt(part[kept].mean(axis=0))
            for name, part in off.parts.items()
            if problem.camera is not None or name == "robot"
        },
        board_scale=problem.picked(kept).board_scale(solved),
        noise_px=None if problem.camera is None else problem.noise_px * solved.std[2],
        views=tuple(views),
    )
