"""Predicted against sampled scatter: many errors, each with its predicted covariance, to a few honest numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import chi2

from vbaa_calib.calibrate.antenna.bundle_adjustment import adjust_bundle
from vbaa_calib.calibrate.antenna.inputs import Observation, Prior
from vbaa_calib.calibrate.antenna.session_rig import prior
from vbaa_calib.calibrate.lens.intrinsics import solve_intrinsics
from vbaa_calib.calibrate.pose.board_pose import jig_estimate, solve_board_pose
from vbaa_calib.camera import Camera
from vbaa_calib.geometry import Pose
from vbaa_calib.rig import RIG_PARAMETERS

from .rigs import BOARD, CENTRELINE_PX, MOMENT_NM, NOMINAL, T_ANTENNA_JIG, TIP_PX, Draw


@dataclass(frozen=True, eq=False)
class Solved:
    """What a calibration says, in the form that the benchmark judges.

    Attributes
    ----------
    camera, T_antenna_camera : solved lens and pose.
    parameters : (11,) antenna, gain and offset: `RIG_PARAMETERS` after the pose.
    covariance : (17, 17) of `RIG_PARAMETERS`, the pose's six about the solved pose.
    plane_covariance : (P + 6, P + 6) of the lens, then of the pose: `CameraOnPlane.parameter_names`.
    """

    camera: Camera
    T_antenna_camera: Pose
    parameters: np.ndarray
    covariance: np.ndarray
    plane_covariance: np.ndarray


def prior_of(given: Draw) -> Prior:
    """Lens from the views, then pose of C from the jig."""
    lens = solve_intrinsics(given.views, BOARD, model=given.rig.lens_model)
    board_pose = solve_board_pose(given.jig_views, lens.board_shape, lens.camera)
    return prior(NOMINAL, lens.camera, [jig_estimate(board_pose, T_ANTENNA_JIG)])


def solve(given: Draw) -> Solved:
    """Lens from the views, pose of C from the jig, then everything together from the stills.

    Raises VbaaError as these do.
    """
    joint = adjust_bundle(observations(given), prior_of(given), NOMINAL.length_m, MOMENT_NM)
    first = len(RIG_PARAMETERS)
    order = np.r_[first : len(joint.covariance), :6]
    return Solved(
        joint.camera,
        joint.T_antenna_camera,
        parameters=joint.parameters[6:],
        covariance=joint.covariance[:first, :first],
        plane_covariance=joint.covariance[np.ix_(order, order)],
    )


def observations(given: Draw) -> list[Observation]:
    """The stills as the joint solve takes them, with the deviations that are true."""
    sigma = (np.full(len(seen.points_px), CENTRELINE_PX) for seen in given.stills)
    return [
        Observation(seen.still, seen.points_px, own, seen.gravity_m_s2, tip_px=seen.tip_px, tip_std_px=TIP_PX)
        for seen, own in zip(given.stills, sigma, strict=True)
    ]


_REGION = 0.95


@dataclass(frozen=True, eq=False)
class Errors:
    """K things of d numbers each in one draw: errors (K, d), solved less true, and predicted covariances (K, d, d)."""

    errors: np.ndarray
    covariances: np.ndarray

    @property
    def whitened(self) -> np.ndarray:
        """(K, d) errors over their predicted standard deviations, number by number."""
        return self.errors / np.sqrt(np.diagonal(self.covariances, axis1=-2, axis2=-1))

    @property
    def squares(self) -> np.ndarray:
        """(K,) eᵀ Σ⁻¹ e: χ² with d degrees of freedom if the covariances are right."""
        std = np.sqrt(np.diagonal(self.covariances, axis1=-2, axis2=-1))
        correlation = self.covariances / (std[..., :, None] * std[..., None, :])
        solved = np.linalg.solve(correlation, self.whitened[..., None])[..., 0]
        return (self.whitened * solved).sum(axis=-1)


def statistics(draws: Sequence[Errors]) -> dict[str, Any]:
    """Of one quantity over at least two draws, the columns of `coverage.Row` from `ratio` on."""
    whitened = np.array([draw.whitened for draw in draws])
    scatter = whitened - whitened.mean(axis=0)
    squares = (scatter**2).mean(axis=(1, 2))
    root = np.sqrt(len(draws))
    ratio = float(np.sqrt(squares.sum() / (len(draws) - 1)))
    each, mean = whitened.std(axis=0, ddof=1), whitened.mean(axis=0)
    things, numbers = whitened.shape[1:]
    inside = np.array([draw.squares for draw in draws]) <= chi2.ppf(_REGION, numbers)
    # things that share a draw share its errors: what scatters is the draw's share
    spread = np.sqrt(_REGION * (1 - _REGION)) if things == 1 else float(inside.mean(axis=1).std(ddof=1))
    variances = np.array([np.diagonal(draw.covariances, axis1=-2, axis2=-1) for draw in draws])
    return {
        "ratio": ratio,
        # of a mean of squares, and the root halves it
        "ratio_error": float(squares.std(ddof=1) / root / (2.0 * ratio)),
        "worst_ratio": float(each.ravel()[np.abs(np.log(each)).argmax()]),
        "covered": float(inside.mean()),
        "covered_error": spread / float(root),
        "bias": float(mean.ravel()[np.abs(mean).argmax()]),
        "predicted_std": float(np.sqrt(variances.mean())),
    }
