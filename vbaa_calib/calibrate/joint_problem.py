"""Camera pose, antenna, moment sensor and lens against everything that was seen of the free and the loaded antenna."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from ..antenna.shape import PARAMETERS, Curves, bend
from ..camera import Camera
from ..detect.paint import Paint
from ..errors import SolveError
from ..geometry import Pose
from ..geometry.independent_axes import independent_axes
from ..reprojection import ImageCurves, SeenPoints, image_curves, see, whitened_with_lens, with_slopes_on_curve
from ..rig import RIG_PARAMETERS, RIG_STEPS
from ..session import Load, Still
from .pose_estimate import PoseEstimate

POSE, ANTENNA = slice(0, 6), slice(6, 6 + len(PARAMETERS))
GAIN, OFFSET = ANTENNA.stop, ANTENNA.stop + 1
BENT = 1 + len(PARAMETERS)
"""Curves in each still: the antenna, and one a step further along each of its parameters."""
RIG = len(RIG_PARAMETERS)
SWEEPS = 4
"""Of the antenna's model over its equilibrium, see `antenna.shape.bend`: more change nothing."""


@dataclass(frozen=True, eq=False)
class Observation:
    """One still of the antenna: what was seen, what was read, and the load on it, if any.

    Attributes
    ----------
    points_px : (N, 2) on the centreline. sigma_px : (N,) their standard deviations across it.
    gravity_m_s2 : (3,) antenna frame.
    paint : what tells the antenna from its background. height : of its line above that, grey levels.
    """

    still: Still
    points_px: np.ndarray
    sigma_px: np.ndarray
    gravity_m_s2: np.ndarray
    paint: Paint = field(default_factory=Paint)
    height: float = 0.0

    @property
    def load_N(self) -> np.ndarray:
        """(2,) force components y, z."""
        return np.array([self.still.force_y_N, self.still.force_z_N]) if isinstance(self.still, Load) else np.zeros(2)


@dataclass(frozen=True, eq=False)
class Prior:
    """What is known before the stills.

    Attributes
    ----------
    poses : the camera's pose by one or several ways.
    start : camera pose from which the solution's steps are counted.
    camera : the lens; one without a covariance counts as exact.
    mean, std : (11,) of the antenna's parameters, gain and offset.
    """

    poses: Sequence[PoseEstimate]
    start: Pose
    camera: Camera
    mean: np.ndarray
    std: np.ndarray

    @cached_property
    def lens_axes(self) -> np.ndarray:
        """(P, P): along its columns the lens varies independently, by unit deviations; (0, 0) for an exact one."""
        return np.zeros((0, 0)) if self.camera.covariance is None else independent_axes(self.camera.covariance)


class LensLost(SolveError):
    """A step of the lens within its covariance led to one that is none: its covariance is not to be trusted so far."""


@dataclass(frozen=True, eq=False)
class Problem:
    """The residuals of everything, for parameters (17 + P,): `RIG_PARAMETERS`, then steps along `lens_axes`.

    Attributes
    ----------
    seen_at_lens : every observation's points, through the lens that is `lens_at` (P,) steps away.
    noise_scale : factor on the deviations that the points claim.
    kept : (F,) which observations take part.
    """

    observations: Sequence[Observation]
    prior: Prior
    seen_at_lens: Sequence[SeenPoints]
    lens_at: np.ndarray
    length_m: float
    moment_std_Nm: float
    noise_scale: float
    kept: np.ndarray

    @staticmethod
    def of(observations: Sequence[Observation], prior: Prior, length_m: float, moment_std_Nm: float) -> Problem:
        """With all observations in, their points' deviations as claimed, and the lens as it is."""
        count = len(observations)
        blank = Problem(observations, prior, (), np.zeros(0), length_m, moment_std_Nm, 1.0, np.ones(count, bool))
        return blank.relinearised(blank.begin)

    @property
    def begin(self) -> np.ndarray:
        """(17 + P,) parameters before anything was seen."""
        return np.concatenate([np.zeros(6), self.prior.mean, np.zeros(len(self.prior.lens_axes))])

    def relinearised(self, parameters: np.ndarray) -> Problem:
        """The same with all points seen through the lens that the parameters ask for.

        Raises LensLost where that lens folds before points that the prior's lens sees.
        """
        camera = self.camera(parameters)
        curves, view = self.curves(parameters[None, ANTENNA]), self.pose(parameters).inverse()
        seen = [
            with_slopes_on_curve(
                see(camera, one.points_px, one.sigma_px), camera, image_curves(curves.picked(np.array([index])), view)
            )
            for index, one in enumerate(self.observations)
        ]
        if self.seen_at_lens and sum(map(len, seen)) < sum(map(len, self.seen_at_lens)):
            raise LensLost("the lens that the stills ask for folds inside the picture")
        return replace(self, seen_at_lens=seen, lens_at=parameters[RIG:])

    def camera(self, parameters: np.ndarray) -> Camera:
        """The lens that the parameters ask for; its covariance is still the prior's."""
        camera, step = self.prior.camera, self.prior.lens_axes @ parameters[RIG:]
        if not len(step):
            return camera
        matrix = camera.matrix.copy()
        matrix[[0, 1, 0, 1], [0, 1, 2, 2]] += step[:4]
        return replace(camera, matrix=matrix, distortion=camera.distortion + step[4:])

    @property
    def certain(self) -> int:
        """How many residuals, the last ones, are the priors': they are what they say, and are never weighed down."""
        return 6 * len(self.prior.poses) + len(self.prior.mean) + len(self.prior.lens_axes)

    def pose(self, parameters: np.ndarray) -> Pose:
        """Camera pose in the antenna frame."""
        return self.prior.start.retract(parameters[POSE])

    def seen(self, parameters: np.ndarray) -> list[SeenPoints]:
        """The points of every observation through the lens that the parameters ask for, to first order."""
        step = self.prior.lens_axes @ (parameters[RIG:] - self.lens_at)
        return [points.with_lens_moved(step) for points in self.seen_at_lens]

    def curves(self, antennas: np.ndarray, compliance: np.ndarray | None = None) -> Curves:
        """Shapes of A antennas (A, 9) in each of F stills, still by still.

        compliance : (A, 2) factors on what bends each antenna to y and to z; 1 where not given.
        """
        count, each = len(self.observations), len(antennas)
        factor = np.tile(np.ones((each, 2)) if compliance is None else compliance, (count, 1))
        gravity = np.repeat([obs.gravity_m_s2 for obs in self.observations], each, axis=0)
        load = np.repeat([obs.load_N for obs in self.observations], each, axis=0)
        contact = [
            obs.still.distance_m if isinstance(obs.still, Load) else 0.5 * self.length_m for obs in self.observations
        ]
        return bend(
            np.tile(antennas, (count, 1)),
            self.length_m,
            gravity * np.hstack([np.ones((len(factor), 1)), factor]),
            np.repeat(contact, each),
            load * factor,
            dead=True,
            sweeps=SWEEPS,
        )

    def evaluate(self, parameters: np.ndarray) -> tuple[list[np.ndarray], np.ndarray]:
        """Per observation (N, 16 + P): whitened distances, their slopes by pose, antenna and lens; (F, 10) moments.

        The moments are those of the antenna and of one a step further along each of its parameters.
        """
        antennas = np.repeat(parameters[None, ANTENNA], BENT, axis=0)
        antennas[1:] += np.diag(RIG_STEPS[6:])
        pose = self.pose(parameters)
        views = [each.inverse() for each in [pose, *map(pose.retract, np.diag(RIG_STEPS[:6]))]]
        curves = self.curves(antennas)
        order = np.array([0] * 7 + list(range(1, BENT)))
        blocks = []
        for index, points in enumerate(self.seen(parameters)):
            images = image_curves(curves.picked(BENT * index + order), [*views, *[views[0]] * (BENT - 1)])
            blocks.append(self._with_slopes(points, images))
        return blocks, curves.moment_Nm.reshape(len(self.observations), BENT)

    def _with_slopes(self, points: SeenPoints, images: ImageCurves) -> np.ndarray:
        distances, by_lens = whitened_with_lens(points, images)
        slopes = (distances[:, 1:] - distances[:, :1]) / RIG_STEPS
        return np.hstack([distances[:, :1], slopes, by_lens @ self.prior.lens_axes])

    def residuals(self, parameters: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """All residuals (R,) and their Jacobian (R, 17 + P): points, moments, camera poses, then antenna to lens."""
        distances, moments = self.evaluate(parameters)
        parts = [self._points(distances), self._moments(parameters, moments)]
        parts += [self._pose_prior(estimate, parameters) for estimate in self.prior.poses]
        size = len(parameters)
        std = np.concatenate([self.prior.std, np.ones(size - RIG)])
        away = parameters[6:] - np.concatenate([self.prior.mean, np.zeros(size - RIG)])
        parts.append((away / std, np.hstack([np.zeros((size - 6, 6)), np.diag(1 / std)])))
        return np.concatenate([part for part, _ in parts]), np.vstack([rows for _, rows in parts])

    def _points(self, distances: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        whole = np.vstack([block for block, kept in zip(distances, self.kept, strict=True) if kept]) / self.noise_scale
        return whole[:, 0], np.hstack([whole[:, 1 : 1 + GAIN], np.zeros((len(whole), 2)), whole[:, 1 + GAIN :]])

    def _moments(self, parameters: np.ndarray, moments: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        rows = np.zeros((len(moments), len(parameters)))
        rows[:, ANTENNA] = parameters[GAIN] * (moments[:, 1:] - moments[:, :1]) / RIG_STEPS[6:]
        rows[:, GAIN], rows[:, OFFSET] = moments[:, 0], 1.0
        misfit = -self.moment_residuals_Nm(parameters, moments)
        return misfit[self.kept] / self.moment_std_Nm, rows[self.kept] / self.moment_std_Nm

    def moment_residuals_Nm(self, parameters: np.ndarray, moments: np.ndarray) -> np.ndarray:
        """(F,) the sensor's readings less what the parameters predict."""
        readings = np.array([obs.still.moment_Nm for obs in self.observations])
        return readings - parameters[GAIN] * moments[:, 0] - parameters[OFFSET]

    def _pose_prior(self, estimate: PoseEstimate, parameters: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        whiten = np.linalg.inv(np.linalg.cholesky(estimate.covariance))
        away = self.pose(parameters).tangent_from(estimate.T_antenna_camera)
        rows = np.zeros((6, len(parameters)))
        rows[:, POSE] = whiten
        if len(parameters) > RIG:
            by_lens = estimate.lens_sensitivity @ self.prior.lens_axes
            rows[:, RIG:] = -whiten @ by_lens
            away = away - by_lens @ parameters[RIG:]
        return whiten @ away, rows


assert RIG == OFFSET + 1
