"""Checks of lens and camera pose by new pictures of the board, with each picture's board pose solved for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from vbaa_calib.calibrate.antenna.problem import POSE
from vbaa_calib.calibrate.lens.board_shape import BoardShape
from vbaa_calib.calibrate.lens.models import pose_slopes, projected
from vbaa_calib.calibrate.lens.outliers import DroppedView, inlier_masks, usable_views
from vbaa_calib.calibrate.lens.settings import LensSettings
from vbaa_calib.calibrate.lens.uncertainty import compensate, pixel_grid, projection_jacobian
from vbaa_calib.calibrate.pose.board_pose import jig_estimate, solve_board_pose
from vbaa_calib.calibrate.pose.fusion import PoseEstimate
from vbaa_calib.camera import Camera
from vbaa_calib.core.errors import InputError, SolveError
from vbaa_calib.core.least_squares import ScoreTest, change_test, products
from vbaa_calib.core.robust import chi_square
from vbaa_calib.detect.board.corners import BoardView
from vbaa_calib.diagnose.boards import lens_reading_diagnoses
from vbaa_calib.geometry import Pose
from vbaa_calib.rig import POSE_PARAMETERS, RIG_PARAMETERS, Rig
from vbaa_calib.session import Session

from .finding import HOLDS, LOOK, Discrepancy, Finding, judged, plus_minus, unanswered
from .settings import CheckSettings

FOCUS = 4  # parameters that a refocus or a knock changes first: fx, fy, cx, cy


class _CheckedView(NamedTuple):
    """One picture of the board, fitted with the rig's lens."""

    name: str
    folder: str
    T_camera_board: Pose
    ids: np.ndarray  # (N,)
    corners_px: np.ndarray  # (N, 2)
    residuals_px: np.ndarray  # (N, 2) observed less predicted at the picture's own best pose
    good: np.ndarray  # (N,) corners that are no outliers

    def to_dict(self) -> dict[str, Any]:
        """The entry of check.json, with pixels rounded to thousandths."""
        return {
            "name": self.name,
            "folder": self.folder,
            "rms_px": float(np.sqrt((self.residuals_px[self.good] ** 2).sum(axis=1).mean())),
            "left_out": int((~self.good).sum()),
            "corners_px": np.round(self.corners_px, 2).tolist(),
            "residuals_px": np.round(self.residuals_px, 3).tolist(),
            "good": self.good.tolist(),
        }


def check_lens(
    camera: Camera,
    boards: Sequence[tuple[str, BoardView]],
    board: BoardShape,
    recorded_rms_px: float | None,
    in_jig_px: float | None = None,
) -> tuple[tuple[Finding, ...], dict[str, Any]]:
    """Checks whether pictures of the board, by their folders' names, fit the lens, and whether its focus has changed;
    returns the findings, and entries of check.json's `session`.
    board : its solved shape. recorded_rms_px : the calibration's rms. in_jig_px : the rms of the board in its jig,
    where the corners scatter more if it is small in the picture."""
    points_m = board.points_m
    views, dropped = _posed(camera, boards, board) if boards else ([], [])
    if not views:
        why = "no usable picture of the board" if boards else "no picture of the board (intrinsics/, plane/)"
        nothing: dict[str, Any] = {
            "boards": [],
            "boards_dropped": [],
            "boards_rms_px": None,
            "boards_expected_rms_px": None,
        }
        return (unanswered("lens_fit", why), unanswered("lens_focus", why)), nothing
    # without what the views' own poses explain
    blocks = []
    for view in views:
        points = view.T_camera_board @ points_m[view.ids[view.good]]
        _, by_point, by_lens = projected(camera, points)
        by_pose, by_lens = pose_slopes(by_point, points).reshape(-1, 6), by_lens.reshape(2 * len(points), -1)
        axes, _ = np.linalg.qr(by_pose / np.linalg.norm(by_pose, axis=0))
        both = np.column_stack([by_lens, view.residuals_px[view.good].ravel()])
        blocks.append(both - axes @ (axes.T @ both))
    jacobian, residuals = np.vstack(blocks)[:, :-1], np.vstack(blocks)[:, -1]
    freedom = len(residuals) - 6 * len(views)
    count = len(camera.parameter_names)
    covariance = np.zeros((count, count)) if camera.covariance is None else camera.covariance
    rms_px = float(np.sqrt(2.0 * (residuals @ residuals) / freedom))
    expected_px = None
    if recorded_rms_px is not None:
        from_lens = 2.0 * float(np.einsum("np,pq,nq->", jacobian, covariance, jacobian)) / freedom
        corners = np.array([int(view.good.sum()) for view in views])
        alike_px = [in_jig_px or recorded_rms_px if view.folder == "plane" else recorded_rms_px for view in views]
        before_px = np.maximum(alike_px, recorded_rms_px)
        expected_px = float(np.sqrt(corners @ before_px**2 / corners.sum() + from_lens))
    # the noise of a coordinate that no change of the lens explains; of few corners one explains nearly all
    axes, values, _ = np.linalg.svd(jacobian / np.maximum(np.linalg.norm(jacobian, axis=0), 1e-12), full_matrices=False)
    axes = axes[:, values > 1e-6 * values.max()]
    remainder = residuals - axes @ (axes.T @ residuals)
    spare = freedom - axes.shape[1]
    remainder, spare = (remainder, spare) if spare >= FOCUS else (residuals, max(freedom, 1))
    variance_px2 = max(float(remainder @ remainder / spare), 1e-12)
    noise_px = np.sqrt(CheckSettings.shared_corners * variance_px2)
    data = products(jacobian / noise_px, residuals / noise_px)
    focal = CheckSettings.noticeable_focal * camera.matrix[[0, 1], [0, 1]]
    scale = np.concatenate([focal, [CheckSettings.noticeable_centre_px] * 2, np.full(len(camera.distortion), 0.01)])
    change = change_test(data, covariance, np.arange(FOCUS), scale)
    fit = _fit_finding(rms_px, expected_px, freedom, len(views))
    if fit.is_bad and (misread := lens_reading_diagnoses((camera, None, [view for _, view in boards], points_m))):
        remedy = "take the pictures raw, as those of the calibration are"
        fit = replace(fit, words=f"{fit.words}; {misread[0].words}", remedy=remedy)
    document = {
        "boards": [view.to_dict() for view in views],
        "boards_dropped": [vars(one) for one in dropped],
        "boards_rms_px": rms_px,
        "boards_expected_rms_px": expected_px,
    }
    return (fit, _focus_finding(camera, change, len(views))), document


def _fit_finding(rms_px: float, expected_px: float | None, freedom: int, views: int) -> Finding:
    """The finding on the fit of the lens. rms_px : of the good corners, per degree of freedom. expected_px : from the
    calibration's rms and the lens's covariance."""
    words = f"rms {rms_px:.3f} px in {_pictures(views)}"
    if expected_px is None:
        return unanswered("lens_fit", f"{words}; the calibration's is not recorded in rig.json")
    ratio = rms_px / max(expected_px, 1e-9)
    distance_std = max(ratio**2 - 1.0, 0.0) / float(np.sqrt(2.0 / freedom))
    evidence = Discrepancy(distance_std, 1, 100 * max(ratio - 1.0, 0.0), CheckSettings.more_rms_percent, "% more rms")
    words += f", {expected_px:.3f} px expected from the calibration"
    remedy = "shoot sharper and better lit pictures of a flat board; if it stays so, calibrate the lens again"
    return judged("lens_fit", words, remedy, evidence)


def _focus_finding(camera: Camera, change: ScoreTest, views: int) -> Finding:
    """The finding on the focus. change : of fx, fy, cx, cy."""
    if change.freedom == 0:
        why = f"{_pictures(views)} cannot decide: a board that fills the picture, tilted by 30 to 45 degrees, would"
        return unanswered("lens_focus", why)
    # the motion over the picture by what is significant, a turn of the camera compensated
    pixels = pixel_grid(camera.image_size)
    by_focus = projection_jacobian(camera, pixels)[..., :FOCUS] @ change.clear(CheckSettings.significant)
    moved = compensate(camera, pixels, by_focus[..., None])[..., 0]
    change_px = float(np.sqrt(np.nanmean((moved**2).sum(axis=-1))))
    focal, mean = 0.5 * (camera.matrix[0, 0] + camera.matrix[1, 1]), np.array([0.5, 0.5])
    relative = 100 * float(mean @ change.values[:2]) / focal
    relative_std = 100 * float(np.sqrt(mean @ change.covariance[:2, :2] @ mean)) / focal
    centre = ", ".join(map(plus_minus, change.values[2:].tolist(), change.std[2:].tolist()))
    words = (
        f"focal length {plus_minus(relative, relative_std)} %, centre ({centre}) px against the rig; beyond its "
        f"uncertainty this moves points by {change_px:.2f} px"
    )
    if change.freedom < FOCUS:
        words = f"{_pictures(views)} determine{'s' * (views == 1)} {change.freedom} of these {FOCUS} numbers: {words}"
    remedy = "lock focus, zoom and autofocus, then calibrate again: `vbaa calibrate`"
    return judged(
        "lens_focus",
        words,
        remedy,
        Discrepancy(change.distance_std, change.freedom, change_px, CheckSettings.lens_floor_px, "px"),
    )


def _pictures(count: int) -> str:
    return f"{count} picture{'s' * (count > 1)}"


def _posed(
    camera: Camera, boards: Sequence[tuple[str, BoardView]], board: BoardShape
) -> tuple[list[_CheckedView], list[DroppedView]]:
    usable, dropped = usable_views([view for _, view in boards], board.nominal_m, LensSettings.min_corners)
    points = board.points_m
    found: list[_CheckedView] = []
    for folder, view in ((folder, view) for folder, view in boards if any(view is one for one in usable)):
        try:
            pose = solve_board_pose([view], board, camera).T_camera_board
        except (InputError, SolveError) as error:
            if view.image_size != tuple(camera.image_size):
                raise
            dropped.append(DroppedView(view.name, error.what if isinstance(error, InputError) else str(error)))
            continue
        predicted, seen = camera.project(pose @ points[view.ids])
        ids, corners_px = view.ids[seen], view.corners_px[seen]
        found.append(_CheckedView(view.name, folder, pose, ids, corners_px, corners_px - predicted[seen], seen))
    masks = inlier_masks([np.linalg.norm(view.residuals_px, axis=1) for view in found]) if found else []
    found = [view._replace(good=good) for view, good in zip(found, masks, strict=True)]
    contradicting = [view.name for view in found if view.good.sum() < LensSettings.min_corners]
    dropped += [DroppedView(name, "most of its corners lie far off any pose of the board") for name in contradicting]
    return [view for view in found if view.good.sum() >= LensSettings.min_corners], dropped


_LENS = slice(len(RIG_PARAMETERS), None)  # places of the lens after `RIG_PARAMETERS`


def check_pose(
    rig: Rig, views: Sequence[BoardView], session: Session, no_jig: str, shape: BoardShape, lens_holds: bool
) -> tuple[tuple[Finding, ...], dict[str, Any], Rig]:
    """Checks whether the camera has moved, by the board in the jig; returns the findings, entries of check.json's
    `session`, and the rig with the camera's present pose. no_jig : the reason why the jig's pose is unknown, if it is.

    Raises InputError for pictures of another size or without a usable board, SolveError where no pose explains it.
    """
    T_antenna_board = session.T_antenna_board
    if not views or T_antenna_board is None:
        why = no_jig if views else "no picture of the board in the jig (plane/)"
        return (unanswered("camera_pose", why),), {"camera_pose": None}, rig
    board = solve_board_pose(views, shape, rig.camera)
    jig = jig_estimate(board, T_antenna_board)
    joint, by_lens = rig.joint_covariance, jig.lens_sensitivity
    shared = by_lens @ joint[_LENS, POSE]
    covariance = jig.covariance + by_lens @ joint[_LENS, _LENS] @ by_lens.T
    covariance = covariance + joint[POSE, POSE] - shared - shared.T
    step, std = jig.T_antenna_camera.tangent_from(rig.T_antenna_camera), np.sqrt(np.diag(covariance))
    on_plane_mm = 1e3 * _on_plane_m(rig, jig.T_antenna_camera)
    words = (
        f"the board in the jig puts the camera {1e3 * np.linalg.norm(step[3:]):.2f} mm "
        f"(± {1e3 * np.linalg.norm(std[3:]):.2f}) and {1e3 * np.linalg.norm(step[:3]):.2f} mrad "
        f"(± {1e3 * np.linalg.norm(std[:3]):.2f}) from the rig's pose; {on_plane_mm:.2f} mm on plane C"
    )
    remedy = "tighten the camera's mount, check that the board sits in its jig, then calibrate again: `vbaa calibrate`"
    sight = jig.T_antenna_camera.rotation @ (board.T_camera_board @ shape.points_m.mean(axis=0))
    lengths = float(np.linalg.norm(step[3:]) * np.linalg.norm(sight))
    if abs(float(step[3:] @ sight)) > CheckSettings.along_sight * max(lengths, 1e-15):
        remedy = "it moved along its line of sight, which a refocus looks like, too: check the focus, then " + remedy
    if not lens_holds:
        remedy = "mend the lens first: the rest may come from it. Then " + remedy
    distance_std = float(np.sqrt(chi_square(step, covariance)))
    evidence = Discrepancy(distance_std, len(POSE_PARAMETERS), on_plane_mm, CheckSettings.jig_floor_mm, "mm on plane C")
    finding = judged("camera_pose", words, remedy, evidence)
    if finding.level == HOLDS and board.is_ambiguous:
        why = "the board in the jig has a second pose that fits nearly as well: take it from a steeper angle"
        finding = replace(finding, level=LOOK, remedy=why)
    document = {
        "turn_mrad": (1e3 * step[:3]).tolist(),
        "turn_std_mrad": (1e3 * std[:3]).tolist(),
        "shift_mm": (1e3 * step[3:]).tolist(),
        "shift_std_mm": (1e3 * std[3:]).tolist(),
        "on_plane_mm": on_plane_mm,
        "rms_px": board.rms_px,
        "second_ratio": board.second_ratio,
        "T_antenna_camera": jig.T_antenna_camera.to_dict(),
    }
    return (finding,), {"camera_pose": document}, _with_jig_pose(rig, jig) if finding.is_bad else rig


def _with_jig_pose(rig: Rig, jig: PoseEstimate) -> Rig:
    """The rig with the jig's pose, which shares the lens's errors, and through them what the antenna shares with it."""
    whole, lens = rig.covariance_with_tip.copy(), slice(len(RIG_PARAMETERS), len(rig.covariance))
    by_lens = jig.lens_sensitivity[:, : lens.stop - lens.start]  # none where the lens counts as exact
    shared = by_lens @ whole[lens]
    whole[POSE], whole[:, POSE] = shared, shared.T
    whole[POSE, POSE] = jig.covariance + shared[:, lens] @ by_lens.T
    return replace(rig, T_antenna_camera=jig.T_antenna_camera).with_covariance(whole)


def _on_plane_m(rig: Rig, T_antenna_camera: Pose) -> float:
    """Largest error on plane C of the antenna's axis when it is seen from the pose `T_antenna_camera` but evaluated
    with the rig's."""
    axis = rig.antenna.length_m * np.linspace(0.0, 1.0, 9)[:, None] * np.array([1.0, 0.0, 0.0])
    pixels, seen = rig.camera.project(T_antenna_camera.inverse() @ axis)
    points, crossed = rig.on_plane_C(pixels)
    off = np.linalg.norm(points - axis[:, :2], axis=1)[seen & crossed]
    # an axis that the moved camera does not see at all has moved by more than its length
    return float(off.max()) if len(off) else rig.antenna.length_m
