"""Plane C by a board in a jig: its place on the antenna's base is known, so its pose in the camera is the camera's."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.linalg import solve_triangular
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from targets.board import BoardSpec, corner_points
from vbaa_calib.calibrate.lens.board_flex import Bend, bend
from vbaa_calib.calibrate.lens.models import PROJECTIONS
from vbaa_calib.camera import Camera
from vbaa_calib.core.errors import InputError, SolveError
from vbaa_calib.core.robust import radial_std
from vbaa_calib.detect.board.corners import BoardView
from vbaa_calib.detect.board.view_quality import fixes_homography
from vbaa_calib.geometry import Pose

from .fusion import PoseEstimate

_SAME_START_RAD = 0.02


def start_poses(points: np.ndarray, normalized: np.ndarray) -> list[Pose]:
    """Poses by every closed form at hand: IPPE alone can be far off or NaN, and says nothing of it.

    points : (N, 3) m, all with z = 0. normalized : (N, 2) their rays' x/z and y/z. Raises SolveError without one.
    """
    starts: list[Pose] = []
    for method in (cv2.SOLVEPNP_ITERATIVE, cv2.SOLVEPNP_SQPNP, cv2.SOLVEPNP_IPPE):
        try:
            _, rotvecs, translations, _ = cv2.solvePnPGeneric(points, normalized, np.eye(3), None, flags=method)
        except cv2.error:
            continue
        for rotvec, translation in zip(rotvecs, translations, strict=True):
            if np.all(np.isfinite(rotvec)) and np.all(np.isfinite(translation)) and translation[2] > 0.0:
                start = Pose.from_rotvec(rotvec.ravel(), translation)
                if all(_turn_between(start, other) > _SAME_START_RAD for other in starts):
                    starts.append(start)
    if not starts:
        raise SolveError("no pose of the board explains its corners: is the lens that of this camera?")
    return starts


def _turn_between(one: Pose, other: Pose) -> float:
    """Angle between two orientations, rad."""
    return float(Rotation.from_matrix(one.rotation @ other.rotation.T).magnitude())


def mirrored(T_camera_board: Pose, points: np.ndarray) -> Pose:
    """Pose of the board, points (N, 3) m, turned about its centre its normal to the other side of the line of sight."""
    centre_board = points.mean(axis=0)
    centre = T_camera_board @ centre_board
    sight, normal = centre / np.linalg.norm(centre), T_camera_board.rotation[:, 2]
    axis = np.cross(normal, sight)
    angle = 2.0 * np.arctan2(np.linalg.norm(axis), normal @ sight)
    turn = Rotation.from_rotvec(angle * axis / max(float(np.linalg.norm(axis)), 1e-12)).as_matrix()
    rotation = turn @ T_camera_board.rotation
    return Pose(rotation, centre - rotation @ centre_board)


_MOVED_PX = 2.0
_GROSS_CORNER = 20.0
_GROSS_LEAST_PX = 0.5
_SAME_RAD = 1e-3
_POLISHING, _ROUNDING = 2, 1e-9
AMBIGUOUS = 1.2
"""A plane's second pose fits nearly as well where its error is less than this many times the first one's."""
_OUT_OF_SIGHT_PX = 1e3


@dataclass(frozen=True, eq=False)
class PoseCandidate:
    """A pose that explains the corners, and how well."""

    T_camera_board: Pose
    rms_px: float


@dataclass(frozen=True, eq=False)
class BoardPose:
    """Where the board is, seen from the camera. The board frame lies on the printed face; its thickness is the jig's.

    Attributes
    ----------
    T_camera_board : pose of the board.
    covariance : (6, 6) of `Pose.retract`'s tangent (rotation vector rad, translation m) in the camera frame, the lens
        held fixed, scaled by the residual variance; the uncertainty of the board's bend is in it where one was given.
    lens_sensitivity : (6, 4 + k) derivative of that tangent by the camera's (fx, fy, cx, cy, distortion). With the
        lens' covariance C the whole covariance is `covariance + S C Sᵀ`, and `S C` its covariance with the lens.
    rms_px : reprojection error over the corners used.
    corners : how many were used, averaged over the pictures. left_out : how many were grossly wrong.
    second : the other solution that a plane allows, where there is one.
    """

    T_camera_board: Pose
    covariance: np.ndarray
    lens_sensitivity: np.ndarray
    rms_px: float
    corners: int
    left_out: int
    second: PoseCandidate | None

    @property
    def second_ratio(self) -> float | None:
        """Reprojection error of the second solution over that of the first."""
        return None if self.second is None else self.second.rms_px / max(self.rms_px, 1e-12)

    @property
    def is_ambiguous(self) -> bool:
        """Whether the second solution fits nearly as well, so that the first cannot be trusted."""
        return self.second_ratio is not None and self.second_ratio < AMBIGUOUS


def solve_board_pose(
    views: Sequence[BoardView], spec: BoardSpec, camera: Camera, bent: Bend | None = None
) -> BoardPose:
    """Pose of the board from one or many pictures in which it stands still relative to the camera.

    Each corner is averaged over the pictures first: what they share (print, lens, detector bias) does not average out,
    and only so does the residual variance tell of it.

    bent : the board's shape, where the lens solve found it bent (`BoardFlex.bend`). The pose is that of its mean plane.
        How its uncertainty goes with the lens' is left out.

    Raises
    ------
    InputError : no usable board in the pictures, a picture size that is not the camera's, or a board that moved.
    SolveError : no start led to a pose.
    """
    _refuse_other_sizes(views, camera)
    ids, pixels = _mean_corners(views)
    flat, rise = corner_points(spec)[ids], bend(spec)[ids]
    points = flat if bent is None else flat + np.outer(rise @ bent.sagittas_m, [0.0, 0.0, 1.0])
    normalized, seen = _ideal_points(camera, pixels)
    if not fixes_homography(points[seen, :2]):
        raise InputError(
            f"{int(seen.sum())} corners of the board are seen in the pictures of the jig, which do not fix its pose",
            remedy="take the picture again with the board sharp, lit and wholly in view",
        )
    starts = start_poses(flat[seen], normalized[seen])
    found = [_refined(pose, camera, points, pixels, "soft_l1") for pose in starts]
    found += [_refined(mirrored(pose, points), camera, points, pixels, "soft_l1") for pose in found[:1]]
    first, *others = sorted(found, key=lambda pose: _robust_cost(pose, camera, points, pixels))
    inliers = _inliers(first, camera, points, pixels)
    points, pixels = points[inliers], pixels[inliers]
    if not fixes_homography(points[:, :2]):
        raise SolveError("no pose of the board explains its corners: is the lens that of this camera?")
    first = _polished(_refined(first, camera, points, pixels, "linear"), camera, points, pixels)
    by_pose, by_lens = _derivatives(first, camera, points)
    basis, factor = np.linalg.qr(by_pose)
    inverse = solve_triangular(factor, np.eye(6))
    residual = _residual(first, camera, points, pixels)
    covariance = inverse @ inverse.T * float(residual @ residual) / max(residual.size - 6, 1)
    if bent is not None:
        # a sagitta moves each corner along the board's normal
        by_point = by_pose[:, 3:].reshape(-1, 2, 3) @ first.rotation[:, 2]
        by_sagitta = inverse @ basis.T @ (by_point[..., None] * rise[inliers][:, None]).reshape(-1, 2)
        covariance = covariance + by_sagitta @ bent.covariance_m2 @ by_sagitta.T
    return BoardPose(
        first,
        covariance,
        -inverse @ (basis.T @ by_lens),
        _rms(residual),
        len(points),
        int((~inliers).sum()),
        _second(first, others, camera, points, pixels),
    )


def _refuse_other_sizes(views: Sequence[BoardView], camera: Camera) -> None:
    for view in views:
        if view.image_size != tuple(camera.image_size):
            raise InputError(
                f"is {view.image_size[0]}x{view.image_size[1]} px, the lens was calibrated at "
                f"{camera.image_size[0]}x{camera.image_size[1]} px",
                where=view.name,
                remedy="take all pictures at one resolution",
            )


def _mean_corners(views: Sequence[BoardView]) -> tuple[np.ndarray, np.ndarray]:
    """Ids (N,) and pixels (N, 2) averaged over the views. Raises InputError when the board moved between them."""
    ids = np.unique(np.concatenate([np.zeros(0, int), *(view.ids for view in views)]))
    stack = np.full((len(views), len(ids), 2), np.nan)
    for row, view in zip(stack, views, strict=True):
        row[np.searchsorted(ids, view.ids)] = view.corners_px
    if not len(ids):
        raise InputError(
            "the board is not found in the pictures of the jig",
            remedy="take them again with the board sharp, lit and wholly in view",
        )
    middle = np.nanmedian(stack, axis=0)
    for row, view in zip(stack, views, strict=True):
        shift = np.linalg.norm(row - middle, axis=-1)
        if np.isfinite(shift).any() and np.nanmedian(shift) > _MOVED_PX:
            raise InputError(
                f"the board stands {np.nanmedian(shift):.1f} px from where the other pictures of the jig show it",
                where=view.name,
                remedy="keep the board fixed to the antenna's base, or remove that picture",
            )
    # one wrong corner must not spoil the mean
    near = np.linalg.norm(stack - middle, axis=-1) <= _MOVED_PX
    total = np.where(near[..., None], stack, 0.0).sum(axis=0)
    count = near.sum(axis=0)
    return ids[count > 0], total[count > 0] / count[count > 0, None]


def _ideal_points(camera: Camera, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    rays, valid = camera.unproject(pixels)
    seen = valid & (rays[:, 2] > 0.05)
    return np.where(seen[:, None], rays[:, :2] / np.where(seen, rays[:, 2], 1.0)[:, None], 0.0), seen


def _residual(T_camera_board: Pose, camera: Camera, points: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    projected, valid = camera.project(T_camera_board @ points)
    return np.where(valid[:, None], projected - pixels, _OUT_OF_SIGHT_PX).ravel()


def _rms(residual: np.ndarray) -> float:
    return float(np.sqrt(2.0 * np.mean(residual**2)))


def _robust_cost(T_camera_board: Pose, camera: Camera, points: np.ndarray, pixels: np.ndarray) -> float:
    return float(np.sum(np.sqrt(1.0 + _residual(T_camera_board, camera, points, pixels) ** 2) - 1.0))


def _refined(T_camera_board: Pose, camera: Camera, points: np.ndarray, pixels: np.ndarray, loss: str) -> Pose:
    # in units of the board's distance, so that the six steps weigh alike
    reach = float(np.linalg.norm(T_camera_board.translation_m))
    scale = np.array([1.0, 1.0, 1.0, reach, reach, reach])
    for _ in range(2):
        start = T_camera_board
        result = least_squares(
            lambda step, start=start: _residual(start.retract(step * scale), camera, points, pixels),
            np.zeros(6),
            # exact at the start of each round and within a turn of a few degrees good enough to descend
            jac=lambda step, start=start: _derivatives(start.retract(step * scale), camera, points)[0] * scale,
            loss=loss,
            xtol=1e-12,
            ftol=1e-12,
            gtol=1e-12,
            max_nfev=60,
        )
        T_camera_board = start.retract(result.x * scale)
    return T_camera_board


def _polished(T_camera_board: Pose, camera: Camera, points: np.ndarray, pixels: np.ndarray) -> Pose:
    """SciPy ends where the cost stands still, a few parts in 10⁵ of a deviation short of where the slope is zero."""
    for _ in range(_POLISHING):
        by_pose, _ = _derivatives(T_camera_board, camera, points)
        residual = _residual(T_camera_board, camera, points, pixels)
        moved = T_camera_board.retract(np.linalg.lstsq(by_pose, -residual, rcond=None)[0])
        if not np.sum(_residual(moved, camera, points, pixels) ** 2) <= (1.0 + _ROUNDING) * np.sum(residual**2):
            break
        T_camera_board = moved
    return T_camera_board


def _inliers(T_camera_board: Pose, camera: Camera, points: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    distance = np.linalg.norm(_residual(T_camera_board, camera, points, pixels).reshape(-1, 2), axis=1)
    sigma = radial_std(distance)
    return distance <= max(_GROSS_CORNER * sigma, _GROSS_LEAST_PX)


def _second(
    first: Pose, others: Sequence[Pose], camera: Camera, points: np.ndarray, pixels: np.ndarray
) -> PoseCandidate | None:
    for start in others:
        T_camera_board = _refined(start, camera, points, pixels, "linear")
        if _turn_between(T_camera_board, first) > _SAME_RAD and bool(camera.project(T_camera_board @ points)[1].all()):
            return PoseCandidate(T_camera_board, _rms(_residual(T_camera_board, camera, points, pixels)))
    return None


def _derivatives(T_camera_board: Pose, camera: Camera, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives of the interleaved pixels by the pose's tangent (2N, 6) and by the lens' parameters (2N, 4 + k)."""
    intrinsics = camera.parameters
    vector = T_camera_board.vector
    _, by_lens, by_vector = PROJECTIONS[camera.model](points, vector, intrinsics)
    by_position = by_vector[:, 3:].reshape(-1, 2, 3)
    # turning by w about the board's origin moves a point by w × lever
    by_turn = np.cross((points @ T_camera_board.rotation.T)[:, None], by_position)
    by_pose = np.concatenate([by_turn, by_position], axis=-1)
    seen = camera.project(T_camera_board @ points)[1]
    return np.where(seen[:, None, None], by_pose, 0.0).reshape(-1, 6), by_lens


def jig_estimate(
    board_pose: BoardPose, T_antenna_board: Pose, translation_std_m: float = 0.0, rotation_std_rad: float = 0.0
) -> PoseEstimate:
    """The camera's pose in the antenna frame.

    The deviations are what the jig itself is worth: how far the board's origin, and its turn about each axis, may be
    off from `T_antenna_board`.
    """
    T_camera_board = board_pose.T_camera_board
    T_antenna_camera = T_antenna_board @ T_camera_board.inverse()
    rotation = T_antenna_camera.rotation
    # Turning the board by w turns the camera by −R·w about the board, which also moves it.
    lever = _cross_matrix(rotation @ T_camera_board.translation_m)
    by_board = np.block([[-rotation, np.zeros((3, 3))], [-lever @ rotation, -rotation]])
    by_jig = np.block([[np.eye(3), np.zeros((3, 3))], [lever, np.eye(3)]])
    jig = np.repeat([rotation_std_rad, translation_std_m], 3) ** 2
    return PoseEstimate(
        "jig",
        T_antenna_camera,
        by_board @ board_pose.covariance @ by_board.T + by_jig * jig @ by_jig.T,
        by_board @ board_pose.lens_sensitivity,
    )


def _cross_matrix(vector: np.ndarray) -> np.ndarray:
    """(3, 3) with `cross_matrix(a) @ b == np.cross(a, b)`."""
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
