"""Plane C from a board in a jig with a known pose on the antenna's base."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from vbaa_calib.calibrate.lens.board_shape import SHAPE, BoardShape, deformations
from vbaa_calib.calibrate.lens.models import pose_slopes, projected
from vbaa_calib.camera import Camera
from vbaa_calib.core.errors import InputError, SolveError
from vbaa_calib.core.least_squares import SOFT_L1, SQUARES, Linearised, Loss, Rules, levenberg_marquardt
from vbaa_calib.core.robust import radial_std, soft_l1_losses
from vbaa_calib.detect.board.corners import BoardView
from vbaa_calib.detect.board.view_quality import fixes_homography
from vbaa_calib.geometry import Pose

from .fusion import PoseEstimate
from .settings import PoseSettings


def require_size(image_size: tuple[int, int], camera: Camera, where: object) -> None:
    """Raises InputError for a picture (width, height) of another size than the lens was calibrated for."""
    if tuple(image_size) != tuple(camera.image_size):
        is_, was = (f"{width}x{height} px" for width, height in (image_size, camera.image_size))
        remedy = "take all pictures at one resolution; of a known lens --binning and --roi tell the difference"
        raise InputError(f"is {is_}, the lens was calibrated at {was}", where=where, remedy=remedy)


def start_poses(points: np.ndarray, normalized: np.ndarray) -> list[Pose]:
    """Initial board poses by every closed-form solution of OpenCV (IPPE alone can be far off or NaN without an
    error), from points (N, 3) m, z = 0, and their normalised image coordinates (N, 2). Raises SolveError without one.
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
                if all(turn_between(start, other) > PoseSettings.same_start_rad for other in starts):
                    starts.append(start)
    if not starts:
        raise SolveError("no pose of the board explains its corners: is the lens that of this camera?")
    return starts


def turn_between(one: Pose, other: Pose) -> float:
    """Angle between two orientations, rad."""
    return float(np.linalg.norm(one.tangent_from(other)[:3]))


def mirrored(T_camera_board: Pose, points: np.ndarray) -> Pose:
    """The board's pose with its normal reflected about the line of sight through the board's centre: the second pose
    of a planar target."""
    centre_board = points.mean(axis=0)
    centre = T_camera_board @ centre_board
    sight, normal = centre / np.linalg.norm(centre), T_camera_board.rotation[:, 2]
    axis = np.cross(normal, sight)
    angle = 2.0 * np.arctan2(np.linalg.norm(axis), normal @ sight)
    turn = Pose.from_rotvec(angle * axis / max(float(np.linalg.norm(axis)), 1e-12), np.zeros(3))
    rotation = turn.rotation @ T_camera_board.rotation
    return Pose(rotation, centre - rotation @ centre_board)


@dataclass(frozen=True, eq=False)
class BoardPose:
    """Pose of the board in the camera frame, with its uncertainty. The board frame lies on the printed face; its
    thickness is the jig's.

    With the lens' covariance C and sensitivity S the whole covariance is `covariance + S C Sᵀ`, and `S C` its
    covariance with the lens.
    """

    T_camera_board: Pose
    covariance: np.ndarray  # (6, 6) of `Pose.retract`'s tangent, camera frame, the lens fixed; with the board's shape
    lens_sensitivity: np.ndarray  # (6, 4 + k) derivative of that tangent by fx, fy, cx, cy, distortion
    rms_px: float  # over the corners used
    corners: int  # how many were used
    left_out: int  # how many were grossly wrong
    second_ratio: float | None  # error of a plane's second pose over the first's; None without one

    @property
    def is_ambiguous(self) -> bool:
        """Whether the planar target's second pose fits nearly as well as the first."""
        return self.second_ratio is not None and self.second_ratio < PoseSettings.ambiguous


def solve_board_pose(views: Sequence[BoardView], board: BoardShape, camera: Camera) -> BoardPose:
    """Pose of the board's mean plane from pictures in which it is at rest relative to the camera.

    Each corner is averaged over the pictures first: errors that they share (print, lens, detector bias) do not average
    out, and so they count fully in the residual variance.

    Raises InputError for no usable board in the pictures, a picture size that is not the camera's, or a board that
    moved; SolveError when no start led to a pose.
    """
    for view in views:
        require_size(view.image_size, camera, view.name)
    ids, pixels = _mean_corners(views)
    flat, points = board.nominal_m[ids], board.points_m[ids]
    rays, valid = camera.unproject(pixels)
    seen = valid & (rays[:, 2] > 0.05)
    if not fixes_homography(points[seen, :2]):
        raise InputError(
            f"{int(seen.sum())} corners of the board are seen in the pictures of the jig, which do not fix its pose",
            remedy="take the picture again with the board sharp, lit and wholly in view",
        )
    starts = start_poses(flat[seen], rays[seen, :2] / rays[seen, 2:])
    whole = SeenBoard(camera, points, pixels, np.ones(len(points)))
    found = [whole.refined(pose, SOFT_L1) for pose in starts]
    found.append(whole.refined(mirrored(found[0], points), SOFT_L1))
    first, *others = sorted(found, key=lambda pose: float(soft_l1_losses(whole.residual(pose)).sum()))
    distance = np.linalg.norm(whole.residual(first).reshape(-1, 2), axis=1)
    inliers = distance <= max(PoseSettings.gross_corner * radial_std(distance), PoseSettings.gross_corner_px)
    if not fixes_homography(points[inliers, :2]):
        raise SolveError("no pose of the board explains its corners: is the lens that of this camera?")
    good = whole.picked(inliers)
    first = good.refined(first, SQUARES)
    by_pose, by_lens = good.derivatives(first)
    inverse, residual = np.linalg.pinv(by_pose), good.residual(first)
    covariance = inverse @ inverse.T * float(residual @ residual) / max(residual.size - 6, 1)
    by_point = by_pose[:, 3:].reshape(-1, 2, 3) @ first.rotation
    by_shape = -inverse @ (by_point @ deformations(board.nominal_m)[ids[inliers]]).reshape(-1, SHAPE)
    # the shape's covariance with the lens is counted with the lens
    shared = np.zeros((SHAPE, by_lens.shape[1])) if board.by_lens is None else board.by_lens
    own = board.covariance
    if board.by_lens is not None and camera.covariance is not None:
        own = own - shared @ camera.covariance @ shared.T
    covariance = covariance + by_shape @ own @ by_shape.T
    rms_px, left_out = _rms(residual), int((~inliers).sum())
    second_px = good.second_rms_px(first, others)
    ratio = None if second_px is None else second_px / max(rms_px, 1e-12)
    by_lens = by_shape @ shared - inverse @ by_lens
    return BoardPose(first, covariance, by_lens, rms_px, len(good.points), left_out, ratio)


def _mean_corners(views: Sequence[BoardView]) -> tuple[np.ndarray, np.ndarray]:
    """Ids (N,) and pixels (N, 2) averaged over the views. Raises InputError when the board moved between them."""
    ids = np.unique(np.concatenate([np.zeros(0, int), *(view.ids for view in views)]))
    stack = np.full((len(views), len(ids), 2), np.nan)
    for row, view in zip(stack, views, strict=True):
        row[np.searchsorted(ids, view.ids)] = view.corners_px
    if not len(ids):
        remedy = "take them again with the board sharp, lit and wholly in view"
        raise InputError("the board is not found in the pictures of the jig", remedy=remedy)
    middle = np.nanmedian(stack, axis=0)
    for row, view in zip(stack, views, strict=True):
        shift_px = np.linalg.norm(row - middle, axis=-1)
        if np.isfinite(shift_px).any() and np.nanmedian(shift_px) > PoseSettings.moved_px:
            raise InputError(
                f"the board is {np.nanmedian(shift_px):.1f} px away from where the other pictures of the jig show it",
                where=view.name,
                remedy="keep the board fixed to the antenna's base, or remove that picture",
            )
    # one wrong corner must not spoil the mean
    near = np.linalg.norm(stack - middle, axis=-1) <= PoseSettings.moved_px
    total, count = np.where(near[..., None], stack, 0.0).sum(axis=0), near.sum(axis=0)
    return ids[count > 0], total[count > 0] / count[count > 0, None]


def _rms(residual: np.ndarray) -> float:
    return float(np.sqrt(2.0 * np.mean(residual**2)))


@dataclass(frozen=True, eq=False)
class SeenBoard:
    """Points (N, 3) m of the board, what a camera sees of them, pixels (N, 2), and factors (N,) on their residuals.

    Without a camera `pixels` are measured points (N, 3) m of its frame.
    """

    camera: Camera | None
    points: np.ndarray
    pixels: np.ndarray
    weights: np.ndarray

    def picked(self, which: np.ndarray) -> SeenBoard:
        """The points of a mask (N,)."""
        return replace(self, points=self.points[which], pixels=self.pixels[which], weights=self.weights[which])

    def residual(self, T_camera_board: Pose) -> np.ndarray:
        """Weighted residuals (2N,) px, projected less observed; 1,000 px where the lens does not see the point.
        Without a camera (3N,) m."""
        predicted, seen = T_camera_board @ self.points, np.ones(len(self.points), bool)
        if self.camera is not None:
            predicted, seen = self.camera.project(predicted)
        return (np.where(seen[:, None], predicted - self.pixels, 1e3) * self.weights[:, None]).ravel()

    def derivatives(self, T_camera_board: Pose) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives of the residuals by the pose's tangent (2N, 6) and by the lens' parameters (2N, 4 + k); without
        a camera (3N, 6) and (3N, 0)."""
        lever = self.points @ T_camera_board.rotation.T
        by_point, by_lens = np.broadcast_to(np.eye(3), (len(lever), 3, 3)), np.zeros((len(lever), 3, 0))
        if self.camera is not None:
            _, by_point, by_lens = projected(self.camera, lever + T_camera_board.translation_m)
        rows = by_point.shape[0] * by_point.shape[1]
        by_pose, by_lens = (part * self.weights[:, None, None] for part in (pose_slopes(by_point, lever), by_lens))
        return by_pose.reshape(rows, 6), by_lens.reshape(rows, -1)

    def refined(self, T_camera_board: Pose, loss: Loss) -> Pose:
        """The local minimum of the robust cost, from an initial pose."""

        def pose_of(at: Linearised) -> Pose:
            return Pose(at.parameters[:, :3], at.parameters[:, 3])

        def linearised(pose: Pose) -> Linearised:
            here = np.column_stack([pose.rotation, pose.translation_m])
            return Linearised(here, self.residual(pose), self.derivatives(pose)[0], 0, loss=loss)

        def step(at: Linearised, damping: float) -> tuple[np.ndarray, float]:
            return at.step(damping)

        def moved(at: Linearised, move: np.ndarray) -> Linearised:
            return linearised(pose_of(at).retract(move))

        rules = Rules(iterations=60, tolerance=1e-12, takes_last=True, may_rise_share=1e-13)
        return pose_of(levenberg_marquardt(linearised(T_camera_board), step, moved, rules)[0])

    def second_rms_px(self, first: Pose, others: Sequence[Pose]) -> float | None:
        """Rms residual, px, of the best distinct other pose; None without one."""
        for start in others:
            pose = self.refined(start, SQUARES)
            residual = self.residual(pose)
            if turn_between(pose, first) > PoseSettings.same_pose_rad and (residual != 1e3).all():
                return _rms(residual)
        return None


def jig_estimate(
    board_pose: BoardPose, T_antenna_board: Pose, translation_std_m: float = 0.0, rotation_std_rad: float = 0.0
) -> PoseEstimate:
    """The camera's pose in the antenna frame; the standard deviations are those of `T_antenna_board`, per axis."""
    T_camera_board = board_pose.T_camera_board
    T_antenna_camera = T_antenna_board @ T_camera_board.inverse()
    rotation = T_antenna_camera.rotation
    # Turning the board by w turns the camera by −R·w about the board, which also moves it.
    lever = np.cross(rotation @ T_camera_board.translation_m, np.eye(3)).T
    by_board = np.block([[-rotation, np.zeros((3, 3))], [-lever @ rotation, -rotation]])
    by_jig = np.block([[np.eye(3), np.zeros((3, 3))], [lever, np.eye(3)]])
    jig = np.repeat([rotation_std_rad, translation_std_m], 3)
    return PoseEstimate(
        "jig",
        T_antenna_camera,
        by_board @ board_pose.covariance @ by_board.T + by_jig * jig**2 @ by_jig.T,
        by_board @ board_pose.lens_sensitivity,
        by_jig * jig,
    )
