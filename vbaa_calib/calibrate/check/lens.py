"""Do pictures of the board still fit the lens? Every picture's own pose is solved for; what is left is the lens."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from targets.board import BoardSpec, corner_points
from vbaa_calib.calibrate.lens.board_flex import Bend, bend
from vbaa_calib.calibrate.lens.models import PROJECTIONS
from vbaa_calib.calibrate.lens.outliers import DroppedView, inlier_masks, usable_views
from vbaa_calib.calibrate.lens.uncertainty import compensate, pixel_grid, projection_jacobian
from vbaa_calib.calibrate.pose.board_pose import solve_board_pose
from vbaa_calib.camera import Camera
from vbaa_calib.core.errors import InputError, SolveError
from vbaa_calib.detect.board.corners import BoardView
from vbaa_calib.geometry import Pose

from .finding import Change, Evidence, Finding, Information, estimated_change, judged, not_given, plus_minus

MIN_CORNERS = 6
FOCUS = 4
"""Parameters of a lens that a refocus or a knock changes first: fx, fy, cx, cy."""
NOTICEABLE_FOCAL, NOTICEABLE_CENTRE_PX = 0.01, 10.0
MORE_RMS_PERCENT = 50.0
"""Corners that scatter up to this much more than at calibration may have light and blur as their reason."""
LENS_FLOOR_PX = 0.1
SHARED = 4.0
"""Corners that share one error, as far as smooth changes go: rendered pictures of an unchanged lens give changes of
1.7 times the deviations that independent corners would have."""


@dataclass(frozen=True, eq=False)
class CheckedView:
    """One picture of the board under the rig's lens.

    Attributes
    ----------
    corners_px, residuals_px : (N, 2) seen, and seen less predicted at the picture's own best pose.
    good : (N,) corners that are no outliers.
    """

    name: str
    folder: str
    T_camera_board: Pose
    corners_px: np.ndarray
    residuals_px: np.ndarray
    good: np.ndarray

    @property
    def rms_px(self) -> float:
        """Over the good corners."""
        return float(np.sqrt((self.residuals_px[self.good] ** 2).sum(axis=1).mean())) if self.good.any() else np.nan

    def to_dict(self) -> dict[str, Any]:
        """For check.json, pixels to thousandths."""
        return {
            "name": self.name,
            "folder": self.folder,
            "rms_px": self.rms_px,
            "left_out": int((~self.good).sum()),
            "corners_px": np.round(self.corners_px, 2).tolist(),
            "residuals_px": np.round(self.residuals_px, 3).tolist(),
            "good": self.good.tolist(),
        }


@dataclass(frozen=True, eq=False)
class LensEvidence:
    """All pictures of the board together, under the rig's lens.

    Attributes
    ----------
    views : those that could be used. dropped : the others, each with its reason.
    rms_px : of the good corners, freed of the poses' six numbers each. expected_px : from the calibration's rms and the
        lens' own covariance; None where the calibration's is not recorded.
    change : of fx, fy, cx, cy. change_px : what the sure part of it moves in the picture, rms, a
        turn of the camera taken out.
    """

    views: tuple[CheckedView, ...]
    dropped: tuple[DroppedView, ...]
    rms_px: float
    expected_px: float | None
    freedom: int
    change: Change
    change_px: float


def _board_points(spec: BoardSpec, bent: Bend | None) -> np.ndarray:
    """(corner_count, 3) of the board, bent as the calibration found it."""
    points = corner_points(spec)
    if bent is not None:
        points[:, 2] += bend(spec) @ bent.sagittas_m
    return points


def check_lens(
    camera: Camera,
    boards: Sequence[tuple[str, BoardView]],
    spec: BoardSpec,
    bent: Bend | None,
    recorded_rms_px: float | None,
) -> LensEvidence | None:
    """The lens against pictures of the board, each given with its folder's name; None where no picture can be used.

    bent : the board's shape, as the calibration found it.
    """
    points_m = _board_points(spec, bent)
    views, dropped = _posed(camera, boards, spec, points_m, bent)
    if not views:
        return None
    blocks = [_without_pose(camera, view, points_m[ids]) for view, ids in views]
    jacobian = np.concatenate([block[0] for block in blocks])
    residuals = np.concatenate([block[1] for block in blocks])
    freedom = len(residuals) - 6 * len(views)
    count = len(camera.parameter_names)
    covariance = np.zeros((count, count)) if camera.covariance is None else camera.covariance
    sigma_px = _noise_px(jacobian, residuals, freedom)
    noise_px = np.sqrt(SHARED) * sigma_px
    data = Information.of(jacobian / noise_px, residuals / noise_px)
    change = estimated_change(data, covariance, np.arange(FOCUS), _scale(camera))
    expected = None
    if recorded_rms_px is not None:
        by_lens = 2.0 * float(np.einsum("np,pq,nq->", jacobian, covariance, jacobian)) / freedom
        expected = float(np.sqrt(recorded_rms_px**2 + by_lens))
    return LensEvidence(
        tuple(view for view, _ in views),
        tuple(dropped),
        float(np.sqrt(2.0 * (residuals @ residuals) / freedom)),
        expected,
        freedom,
        change,
        _in_picture_px(camera, change.sure),
    )


def lens_findings(found: LensEvidence | None, camera: Camera, why_not: str) -> list[Finding]:
    """Do the pictures fit, and has focal length or centre changed?"""
    fit, focus = "Do new pictures of the board fit the lens?", "Is the lens focused as it was?"
    if found is None:
        return [not_given("lens_fit", fit, why_not), not_given("lens_focus", focus, why_not)]
    pictures = f"{len(found.views)} picture{'s' if len(found.views) > 1 else ''}"
    findings = []
    if found.expected_px is None:
        words = f"rms {found.rms_px:.3f} px in {pictures}; the calibration's is not recorded in rig.json"
        findings.append(not_given("lens_fit", fit, words))
    else:
        ratio = found.rms_px / max(found.expected_px, 1e-9)
        spread = float(np.sqrt(2.0 / found.freedom))
        evidence = Evidence(
            max(ratio**2 - 1.0, 0.0) / spread, 1, 100 * max(ratio - 1.0, 0.0), MORE_RMS_PERCENT, "% more rms"
        )
        words = f"rms {found.rms_px:.3f} px in {pictures}, {found.expected_px:.3f} px expected from the calibration"
        remedy = "shoot sharper and better lit pictures of a flat board; if it stays so, calibrate the lens again"
        findings.append(judged("lens_fit", fit, words, remedy, evidence))
    if found.change.freedom == 0:
        why = f"{pictures} cannot tell: a board that fills the picture, tilted by 30 to 45 degrees, would"
        return [*findings, not_given("lens_focus", focus, why)]
    evidence = Evidence(found.change.distance_std, found.change.freedom, found.change_px, LENS_FLOOR_PX, "px")
    words = _change_in_words(found, camera)
    if found.change.freedom < FOCUS:
        words = f"{pictures} show{'s' * (len(found.views) == 1)} {found.change.freedom} of its {FOCUS} numbers: {words}"
    remedy = "lock focus, zoom and autofocus, then calibrate again: `vbaa calibrate`"
    return [*findings, judged("lens_focus", focus, words, remedy, evidence)]


def _change_in_words(found: LensEvidence, camera: Camera) -> str:
    step, std = found.change.step, found.change.std
    focal = 0.5 * (camera.matrix[0, 0] + camera.matrix[1, 1])
    mean = np.array([0.5, 0.5])
    relative = 100 * float(mean @ step[:2]) / focal
    relative_std = 100 * float(np.sqrt(mean @ found.change.covariance[:2, :2] @ mean)) / focal
    return (
        f"focal length {plus_minus(relative, relative_std)} %, centre ({plus_minus(step[2], std[2])}, "
        f"{plus_minus(step[3], std[3])}) px against the rig; beyond doubt {found.change_px:.2f} px in the picture"
    )


def _posed(
    camera: Camera, boards: Sequence[tuple[str, BoardView]], spec: BoardSpec, points: np.ndarray, bent: Bend | None
) -> tuple[list[tuple[CheckedView, np.ndarray]], list[DroppedView]]:
    """Views with their poses and corner ids, and those that have none."""
    usable, dropped = usable_views([view for _, view in boards], spec, MIN_CORNERS)
    found = []
    for folder, view in ((folder, view) for folder, view in boards if any(view is one for one in usable)):
        try:
            pose = solve_board_pose([view], spec, camera, bent).T_camera_board
        except (InputError, SolveError) as error:
            if view.image_size != tuple(camera.image_size):
                raise
            dropped.append(DroppedView(view.name, error.what if isinstance(error, InputError) else str(error)))
            continue
        predicted, seen = camera.project(pose @ points[view.ids])
        ids, pixels = view.ids[seen], view.corners_px[seen]
        found.append((folder, view.name, pose, ids, pixels, pixels - predicted[seen]))
    masks = inlier_masks([entry[5] for entry in found]) if found else []
    kept = []
    for (folder, name, pose, ids, pixels, residuals), good in zip(found, masks, strict=True):
        if good.sum() >= MIN_CORNERS:
            kept.append((CheckedView(name, folder, pose, pixels, residuals, good), ids[good]))
        else:
            dropped.append(DroppedView(name, "most of its corners lie far off any pose of the board"))
    return kept, dropped


def _without_pose(camera: Camera, view: CheckedView, board: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives by the lens (2N, P) and residuals (2N,), px, what the view's own pose explains taken out of both."""
    intrinsics = camera.parameters
    points = view.T_camera_board @ board
    _, by_lens, by_pose = PROJECTIONS[camera.model](points, np.zeros(6), intrinsics)
    axes, _ = np.linalg.qr(by_pose / np.linalg.norm(by_pose, axis=0))
    residuals = view.residuals_px[view.good].ravel()
    return by_lens - axes @ (axes.T @ by_lens), residuals - axes @ (axes.T @ residuals)


def _noise_px(jacobian: np.ndarray, residuals: np.ndarray, freedom: int) -> float:
    """Standard deviation of a coordinate that no change of the lens explains."""
    scaled = jacobian / np.maximum(np.linalg.norm(jacobian, axis=0), 1e-12)
    axes, values, _ = np.linalg.svd(scaled, full_matrices=False)
    axes = axes[:, values > 1e-6 * values.max()]
    left = residuals - axes @ (axes.T @ residuals)
    return max(float(np.sqrt(left @ left / max(freedom - axes.shape[1], 1))), 1e-6)


def _scale(camera: Camera) -> np.ndarray:
    """(P,) a change of each parameter that is worth knowing of."""
    focal = NOTICEABLE_FOCAL * camera.matrix[[0, 1], [0, 1]]
    return np.concatenate([focal, [NOTICEABLE_CENTRE_PX] * 2, np.full(len(camera.distortion), 0.01)])


def _in_picture_px(camera: Camera, step: np.ndarray) -> float:
    """Root mean square over the picture of what a change of fx, fy, cx, cy moves there, a turn taken out."""
    pixels = pixel_grid(camera.image_size)
    moved = compensate(camera, pixels, (projection_jacobian(camera, pixels)[..., :FOCUS] @ step)[..., None])
    return float(np.sqrt(np.nanmean((moved[..., 0] ** 2).sum(axis=-1))))
