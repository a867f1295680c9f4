"""One method on one draw: its error on plane C, beside the deviation that it states."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from benchmarks.boards import Draw, error_mm, jig_pose, offsets_on_plane_m, on_plane, seen_on_plane
from vbaa_calib.calibrate.lens.models import pose_slopes, projected
from vbaa_calib.camera import Camera
from vbaa_calib.geometry import Pose

from .methods import Outcome

_REGION, _FAR = 0.95, 2.0


@dataclass(frozen=True)
class Judged:
    """One method's outcome on one draw; None where it gave no lens or does not say.

    error_mm, jig_error_mm : rms on C, with its true pose, and with the pose that this lens gives it.
    stated, jig_stated : error over the deviation stated, both rms over C. covered, jig_covered : share of the 95 %
        regions of points on C that hold the truth.
    wrong : either error is over twice its 95 % bound. folds : the lens folds inside the picture.
    """

    outcome: Outcome
    error_mm: float | None = None
    jig_error_mm: float | None = None
    stated: float | None = None
    covered: float | None = None
    jig_stated: float | None = None
    jig_covered: float | None = None
    folds: bool | None = None
    wrong: bool | None = None


def judged(outcome: Outcome, given: Draw) -> Judged:
    """Errors and stated deviations of a method's lens on one draw."""
    camera, truth = outcome.camera, given.rig.camera
    if camera is None:
        return Judged(outcome)
    errors = error_mm(camera, truth), error_mm(camera, truth, True)
    (free, held, far), (jig, jig_held, jig_far) = (_said(camera, truth, from_jig) for from_jig in (False, True))
    known = [each for each in (far, jig_far) if each is not None]
    folds = camera.valid_region().image_fraction < 1.0
    return Judged(outcome, *errors, free, held, jig, jig_held, folds, any(known) if known else None)


def _said(camera: Camera, truth: Camera, from_jig: bool) -> tuple[float | None, float | None, bool | None]:
    """Error over the deviation stated, share of regions that hold the truth, whether it is over twice its bound."""
    if camera.covariance is None:
        return None, None, None
    T_camera_plane, points, pixels = seen_on_plane(truth)
    if from_jig:
        T_camera_plane = jig_pose(camera, T_camera_plane, points, pixels)
    off = offsets_on_plane_m(camera, T_camera_plane, points, pixels)
    by_lens = plane_jacobian(camera, T_camera_plane, points, from_jig)
    each = by_lens @ camera.covariance @ np.swapaxes(by_lens, -1, -2)
    square, stated = float(np.mean(np.sum(off**2, axis=1))), float(np.mean(np.trace(each, axis1=1, axis2=2)))
    if not np.isfinite(stated) or stated <= 0.0:
        return np.inf, 0.0, True
    each = each + 1e-12 * stated * np.eye(2)
    squares = np.einsum("mi,mi->m", off, np.linalg.solve(each, off[..., None])[..., 0])
    # a sum of squares of unequal share, by the chi-squared law with its mean and variance
    spread = np.einsum("mki,mkj->ij", by_lens, by_lens) / len(points) @ camera.covariance
    freedom = stated**2 / float(np.sum(spread * spread.T))
    bound = stated * chi2.ppf(_REGION, freedom) / freedom
    inside = float(np.mean(squares <= chi2.ppf(_REGION, 2)))
    return float(np.sqrt(square / stated)), inside, bool(square > _FAR**2 * bound)


def plane_jacobian(camera: Camera, T_camera_plane: Pose, points_m: np.ndarray, from_jig: bool) -> np.ndarray:
    """(M, 2, 4 + k) by how much points (M, 2) of a plane move on it with the lens, their pixels held.

    from_jig : the pose of the plane goes along as least squares over the same points make it.
    """
    lever = on_plane(points_m) @ T_camera_plane.rotation.T
    _, by_place, by_lens = projected(camera, lever + T_camera_plane.translation_m)
    by_lens = by_lens.reshape(2 * len(points_m), -1)
    if from_jig:
        by_pose = pose_slopes(by_place, lever).reshape(-1, 6)
        by_lens = by_lens - by_pose @ np.linalg.lstsq(by_pose, by_lens, rcond=None)[0]
    by_point = by_place @ T_camera_plane.rotation[:, :2]
    return -np.linalg.solve(by_point, by_lens.reshape(len(points_m), 2, -1))
