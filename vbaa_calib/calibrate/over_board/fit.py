"""The antenna's frame in plane C from the picture of its sagging free shape: the least squares behind `over_board`.

Unknown are the direction and the place of the clamp in plane C. The board's pose, its distance, and the antenna's shape
are known with their covariances: they are solved for too, in units of their own standard deviations, so that their
uncertainty is in the result, and the picture may correct them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from targets.board import BoardWithIds
from vbaa_calib.antenna.shape import PARAMETERS, Curves, bend
from vbaa_calib.antenna.taper import UNIFORM, Taper
from vbaa_calib.calibrate.antenna.bundle_adjustment import noise_scale
from vbaa_calib.calibrate.antenna.session_rig import CLAMP_GIVE_STD_M, LOG_MASS_STD, bow_std_per_m, nominal_parameters
from vbaa_calib.calibrate.pose.board_pose import BoardPose
from vbaa_calib.calibrate.pose.fusion import PoseEstimate
from vbaa_calib.camera import Camera
from vbaa_calib.core.errors import SolveError
from vbaa_calib.core.least_squares import Linearised, Rules, minimise
from vbaa_calib.detect.over_board.line import LineEnd
from vbaa_calib.geometry import Pose
from vbaa_calib.geometry.independent_axes import independent_axes
from vbaa_calib.rig.reprojection import ImageCurves, SeenPoints, feet, image_curves, whitened_with_lens
from vbaa_calib.session import NominalAntenna

_IN_PLANE, _BOARD, _HEIGHT, _SHAPE = slice(0, 3), slice(3, 9), 9, slice(10, 10 + len(PARAMETERS))
"""Angle (rad) and clamp (x, y; m) in the board frame; then, whitened: board's tangent, height, antenna's parameters."""
_UNKNOWNS = 10 + len(PARAMETERS)
_STEPS = np.array([1e-5, 1e-5, 1e-5, *[0.02] * (_UNKNOWNS - 3)])
_RULES = Rules(iterations=40, standstill=1e-12)
_ENOUGH = 1e-4  # decrease of the cost that a next step promises: a hundredth of a deviation
_PASSES, _CONVERGED = 10, 1e-5
_END_MARGIN = 0.004  # part of the length at clamp and tip whose points are left out
_LEAST_POINTS = 20
_LENGTH_STD_M, _CLAMP_OUT_OF_PLANE_STD_RAD, _LOG_STIFFNESS_STD = 3e-4, 0.01, 0.15
"""What a nominal antenna is trusted with besides the priors of bundle adjustment: its length to a ruler's reading,
its clamp's tangent to be as parallel to the board as a gauge makes it, and its stiffness to four per cent of the
diameter."""


@dataclass(frozen=True, eq=False)
class FreeAntenna:
    """What is known of the free antenna before the picture."""

    length_m: float  # from the clamp to the tip
    length_std_m: float
    diameter_m: float  # of the wire
    # (9,) `antenna.shape.PARAMETERS` in the frame looked for; with zero clamp offsets and angles the clamp's
    parameters: np.ndarray
    covariance: np.ndarray  # (9, 9) of the parameters
    gravity_m_s2: np.ndarray  # (3,) antenna frame, at the joints' angles of the pictures
    taper: Taper = UNIFORM

    def curves(self, parameters: np.ndarray) -> Curves:
        """The free antenna with each of K parameter vectors (K, 9)."""
        count = len(parameters)
        gravity = np.repeat(self.gravity_m_s2[None], count, axis=0)
        half = np.full(count, 0.5 * self.length_m)
        none = np.zeros((count, 2))
        return bend(
            parameters, self.length_m, gravity, half, none, sweeps=4, taper=self.taper, diameter_m=self.diameter_m
        )


def nominal_free_antenna(antenna: NominalAntenna, gravity_m_s2: np.ndarray) -> FreeAntenna:
    """A straight antenna of nominal stiffness and mass, clamped in the frame that is looked for; gravity (3,) in it."""
    bow = bow_std_per_m(antenna.length_m)
    shape = [bow, bow, _LOG_STIFFNESS_STD, LOG_MASS_STD, CLAMP_GIVE_STD_M]
    std = [0.0, 0.0, _CLAMP_OUT_OF_PLANE_STD_RAD, 0.0, *shape]
    known = antenna.length_m, _LENGTH_STD_M, antenna.diameter_m, nominal_parameters(antenna), np.diag(np.square(std))
    return FreeAntenna(*known, np.asarray(gravity_m_s2, float), antenna.taper)


@dataclass(frozen=True, eq=False)
class OverSetup:
    """The antenna over the board, as described."""

    spec: BoardWithIds  # the board, flat on plane C
    camera: Camera
    antenna: FreeAntenna  # the free antenna above it
    height_m: float  # of the antenna's axis at the clamp above the print
    height_std_m: float
    clamp: LineEnd | None = None  # the clamp's visible edge, where it is known


@dataclass(frozen=True, eq=False)
class Mark:
    """A point of the antenna that is known along it."""

    end: int  # −1 the tip, 0 the clamp
    seen: SeenPoints  # the one point
    std_m: float  # how well its place along the antenna is known

    def along(self, curves: ImageCurves) -> np.ndarray:
        """(1, 2) the first curve's direction there over the mark's standard deviation along it."""
        slope = curves.slopes[0, self.end]
        unit = slope / np.linalg.norm(slope)
        variance = unit @ self.seen.covariance[0] @ unit + (self.std_m * np.linalg.norm(slope)) ** 2
        return unit[None] / np.sqrt(variance)


@dataclass(frozen=True, eq=False)
class OverProblem:
    """What was seen and what is known."""

    setup: OverSetup
    board: BoardPose
    seen: SeenPoints
    marks: Sequence[Mark]
    toward: float  # +1 where the antenna frame's z points from plane C to the camera's side, −1 where away
    noise_scale: float = 1.0  # scatter of the points over the stated one

    def T_camera_antenna(self, unknowns: np.ndarray) -> Pose:
        """Pose of the antenna frame."""
        angle, x, y = unknowns[_IN_PLANE]
        cos, sin, up = np.cos(angle), np.sin(angle), self.toward
        rotation = np.array([[cos, up * sin, 0.0], [sin, -up * cos, 0.0], [0.0, 0.0, -up]])
        height = self.setup.height_m + self.setup.height_std_m * unknowns[_HEIGHT]
        step = np.linalg.cholesky(self.board.covariance) @ unknowns[_BOARD]
        return self.board.T_camera_board.retract(step) @ Pose(rotation, np.array([x, y, -height]))

    def curves(self, unknowns: np.ndarray) -> ImageCurves:
        """The antenna in the picture for each of (K, 19) unknowns."""
        antenna = self.setup.antenna
        parameters = antenna.parameters + unknowns[:, _SHAPE] @ independent_axes(antenna.covariance).T
        return image_curves(antenna.curves(parameters), [self.T_camera_antenna(row) for row in unknowns])

    def linearised(self, unknowns: np.ndarray) -> Linearised:
        """Whitened residuals (R,), Huber's of the points, then marks and priors; their Jacobian (R, 19)."""
        curves = self.curves(np.vstack([unknowns, unknowns + np.diag(_STEPS)]))
        rows = [whitened_with_lens(self.seen, curves)[0] / self.noise_scale]
        rows += [one.along(curves) @ (one.seen.points.T - curves.nodes[:, one.end].T) for one in self.marks]
        values = np.vstack(rows)
        jacobian = (values[:, 1:] - values[:, :1]) / _STEPS
        prior = np.eye(_UNKNOWNS)[_IN_PLANE.stop :]
        residuals, certain = np.concatenate([values[:, 0], prior @ unknowns]), len(self.marks) + len(prior)
        return Linearised(unknowns, residuals, np.vstack([jacobian, prior]), certain)

    def by_lens(self, curves: ImageCurves) -> np.ndarray:
        """(R, P) change of the residuals with the lens, board and frame fixed."""
        rows = [whitened_with_lens(self.seen, curves)[1] / self.noise_scale]
        rows += [one.along(curves) @ one.seen.by_lens[0] for one in self.marks if one.seen.by_lens is not None]
        points = np.vstack(rows)
        return np.vstack([points, np.zeros((_UNKNOWNS - _IN_PLANE.stop, points.shape[1]))])


def solve_over(problem: OverProblem, start: np.ndarray) -> tuple[PoseEstimate, float]:
    """The camera's pose from a start (angle, x, y) in the board frame, and the scatter of the points over the stated
    one. Raises SolveError where that does not converge, or too few points lie on the antenna."""
    unknowns = np.concatenate([start, np.zeros(_UNKNOWNS - 3)])
    for _ in range(_PASSES):
        unknowns = _descended(problem, unknowns)
        # without the points beyond the clamp and the tip
        share = feet(problem.seen, problem.curves(unknowns[None])) / problem.setup.antenna.length_m
        inside = (share > _END_MARGIN) & (share < 1 - _END_MARGIN)
        if inside.sum() < _LEAST_POINTS:
            raise SolveError(f"only {int(inside.sum())} points of the antenna lie between its clamp and its tip")
        problem = replace(problem, seen=problem.seen.picked(inside))
        # squares that disturb alike are few: points that scatter little by chance get no more weight
        residuals = whitened_with_lens(problem.seen, problem.curves(unknowns[None]))[0][:, 0]
        before, scale = problem.noise_scale, max(noise_scale([residuals]), 1.0)
        problem = replace(problem, noise_scale=scale)
        if abs(scale / before - 1.0) < _CONVERGED:
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


def _descended(problem: OverProblem, unknowns: np.ndarray) -> np.ndarray:
    descent = minimise(problem.linearised, problem.linearised(unknowns), _RULES)
    if descent.exhausted and descent.promise >= _ENOUGH:
        raise SolveError("the antenna over the board could not be fitted to its picture")
    return descent.at.parameters
