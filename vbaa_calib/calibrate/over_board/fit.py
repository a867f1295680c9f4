"""The antenna's frame in plane C from the picture of its sagging free shape: the least squares behind `over_board`.

Unknown are the direction and the place of the clamp in plane C. The board's pose, its distance, and the antenna's shape
are known with their covariances: they are solved for too, in units of their own standard deviations, so that their
uncertainty is in the result, and the picture may correct them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vbaa_calib.antenna.shape import PARAMETERS
from vbaa_calib.calibrate.antenna.bundle_adjustment import noise_scale
from vbaa_calib.calibrate.pose.board_pose import BoardPose
from vbaa_calib.core.errors import SolveError
from vbaa_calib.core.least_squares import Linearised, Rules, minimise
from vbaa_calib.geometry import Pose
from vbaa_calib.geometry.independent_axes import independent_axes
from vbaa_calib.rig.reprojection import (
    ImageCurves,
    SeenPoints,
    feet,
    image_curves,
    residuals_by_lens,
    whitened_residuals,
)

from .free_antenna import FreeAntenna, Mark

_IN_PLANE, BOARD, HEIGHT, _SHAPE = slice(0, 3), slice(3, 9), 9, slice(10, 10 + len(PARAMETERS))
"""Angle (rad) and clamp (x, y; m) in the board frame; then, whitened: board's tangent, height, antenna's parameters."""
UNKNOWNS = 10 + len(PARAMETERS)
_STEPS = np.array([1e-5, 1e-5, 1e-5, *[0.02] * (UNKNOWNS - 3)])
_RULES = Rules(iterations=40, standstill=1e-12)
_ENOUGH = 1e-6
_PASSES, _CONVERGED = 10, 1e-5
_END_MARGIN = 0.004
"""Points this part of the length off the clamp or the tip are left out: the holder's edge and the tip's round end."""
_LEAST_POINTS = 20


@dataclass(frozen=True, eq=False)
class OverFit:
    """The solved frame.

    Attributes
    ----------
    T_antenna_camera : pose of the camera.
    covariance, lens_sensitivity : as in `PoseEstimate`.
    noise_scale : scatter of the points over what their standard deviations predict.
    points : how many took part. reach_m : arc lengths of the first and the last.
    """

    T_antenna_camera: Pose
    covariance: np.ndarray
    lens_sensitivity: np.ndarray
    noise_scale: float
    points: int
    reach_m: tuple[float, float]


@dataclass(frozen=True, eq=False)
class OverProblem:
    """What was seen and what is known.

    Attributes
    ----------
    toward : +1 where the antenna frame's z points from plane C to the camera's side, −1 where away.
    """

    seen: SeenPoints
    marks: Sequence[Mark]
    board: BoardPose
    height_m: float
    height_std_m: float
    antenna: FreeAntenna
    toward: float
    noise_scale: float = 1.0

    def T_camera_antenna(self, unknowns: np.ndarray) -> Pose:
        """Pose of the antenna frame."""
        angle, x, y = unknowns[_IN_PLANE]
        cos, sin, up = np.cos(angle), np.sin(angle), self.toward
        rotation = np.array([[cos, up * sin, 0.0], [sin, -up * cos, 0.0], [0.0, 0.0, -up]])
        height = self.height_m + self.height_std_m * unknowns[HEIGHT]
        step = np.linalg.cholesky(self.board.covariance) @ unknowns[BOARD]
        return self.board.T_camera_board.retract(step) @ Pose(rotation, np.array([x, y, -height]))

    def curves(self, unknowns: np.ndarray) -> ImageCurves:
        """The antenna in the picture for each of (K, 18) unknowns."""
        parameters = self.antenna.parameters + unknowns[:, _SHAPE] @ independent_axes(self.antenna.covariance).T
        return image_curves(self.antenna.curves(parameters), [self.T_camera_antenna(row) for row in unknowns])

    def linearised(self, unknowns: np.ndarray) -> Linearised:
        """Whitened residuals (R,), Huber's of the points, then marks and priors; their Jacobian (R, 18)."""
        curves = self.curves(np.vstack([unknowns, unknowns + np.diag(_STEPS)]))
        rows = [whitened_residuals(self.seen, curves) / self.noise_scale]
        rows += [
            _mark_direction(mark, curves) @ (mark.seen.points.T - curves.nodes[:, mark.end].T) for mark in self.marks
        ]
        values = np.vstack(rows)
        jacobian = (values[:, 1:] - values[:, :1]) / _STEPS
        prior = np.eye(UNKNOWNS)[_IN_PLANE.stop :]
        certain = len(self.marks) + len(prior)
        return Linearised(
            unknowns, np.concatenate([values[:, 0], prior @ unknowns]), np.vstack([jacobian, prior]), certain
        )

    def by_lens(self, curves: ImageCurves) -> np.ndarray:
        """(R, P) change of the residuals with the lens, board and frame held where they are."""
        rows = [residuals_by_lens(self.seen, curves) / self.noise_scale]
        rows += [_mark_direction(mark, curves) @ _of_lens(mark.seen)[0] for mark in self.marks]
        points = np.vstack(rows)
        return np.vstack([points, np.zeros((UNKNOWNS - _IN_PLANE.stop, points.shape[1]))])


def solve_over(problem: OverProblem, start: np.ndarray) -> OverFit:
    """Solve from a start (angle, x, y) in the board frame.

    Raises SolveError when the solver does not converge, or too few points lie on the antenna between clamp and tip.
    """
    unknowns = np.concatenate([start, np.zeros(UNKNOWNS - 3)])
    for _ in range(_PASSES):
        unknowns = _descended(problem, unknowns)
        problem = _trimmed(problem, unknowns)
        points, curves = len(problem.seen), problem.curves(unknowns[None])
        # squares that disturb alike are few: points that scatter little by chance get no more weight
        scale = max(noise_scale([whitened_residuals(problem.seen, curves)[:, 0]]), 1.0)
        converged = abs(scale / problem.noise_scale - 1.0) < _CONVERGED
        problem = replace(problem, noise_scale=scale)
        if converged:
            break
    unknowns = _descended(problem, unknowns)
    solution, curves = problem.linearised(unknowns), problem.curves(unknowns[None])
    weight, inverse = solution.weights, solution.covariance()
    pose = problem.T_camera_antenna(unknowns).inverse()
    by_unknowns = _tangents(problem, unknowns)
    # the lens moves the board's pose, too
    by_board = np.linalg.solve(np.linalg.cholesky(problem.board.covariance), problem.board.lens_sensitivity)
    pull = (problem.by_lens(curves) + solution.jacobian[:, BOARD] @ by_board) * weight[:, None]
    pull[-(UNKNOWNS - 3) :] = 0.0
    by_lens = -inverse @ ((solution.jacobian * weight[:, None]).T @ pull)
    by_lens[BOARD] += by_board
    foot = feet(problem.seen, curves)
    covariance = by_unknowns @ inverse @ by_unknowns.T
    return OverFit(
        pose,
        0.5 * (covariance + covariance.T),
        by_unknowns @ by_lens,
        problem.noise_scale,
        points,
        (float(foot.min()), float(foot.max())),
    )


def _mark_direction(mark: Mark, curves: ImageCurves) -> np.ndarray:
    """(1, 2) the first curve's direction at the mark over the mark's standard deviation along it."""
    slope = curves.slopes[0, mark.end]
    unit = slope / np.linalg.norm(slope)
    variance = unit @ mark.seen.covariance[0] @ unit + (mark.std_m * np.linalg.norm(slope)) ** 2
    return unit[None] / np.sqrt(variance)


def _of_lens(seen: SeenPoints) -> np.ndarray:
    return np.zeros((len(seen), 2, 0)) if seen.by_lens is None else seen.by_lens


def _descended(problem: OverProblem, unknowns: np.ndarray) -> np.ndarray:
    descent = minimise(problem.linearised, problem.linearised(unknowns), _RULES)
    if descent.exhausted and descent.promise >= _ENOUGH:
        raise SolveError("the antenna over the board could not be fitted to its picture")
    return descent.at.parameters


def _trimmed(problem: OverProblem, unknowns: np.ndarray) -> OverProblem:
    """Without the points beyond the clamp and the tip."""
    foot = feet(problem.seen, problem.curves(unknowns[None]))
    length = problem.antenna.length_m
    inside = (foot > _END_MARGIN * length) & (foot < (1 - _END_MARGIN) * length)
    if inside.sum() < _LEAST_POINTS:
        raise SolveError(f"only {int(inside.sum())} points of the antenna lie between its clamp and its tip")
    return replace(problem, seen=problem.seen.picked(inside))


def _tangents(problem: OverProblem, unknowns: np.ndarray) -> np.ndarray:
    """(6, 18) derivative of the camera pose's tangent in the antenna frame by the unknowns."""
    columns = []
    for step in np.diag(_STEPS):
        ahead, back = (problem.T_camera_antenna(unknowns + sign * step).inverse() for sign in (1, -1))
        turn = Pose(ahead.rotation @ back.rotation.T, np.zeros(3)).rotvec_rad
        columns.append(np.concatenate([turn, ahead.translation_m - back.translation_m]) / (2 * step.sum()))
    return np.stack(columns, axis=1)
