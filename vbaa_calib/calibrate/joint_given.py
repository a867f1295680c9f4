"""What goes into the joint solve: what was seen of the antenna, and what was known before."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from ..camera import Camera
from ..detect.paint import Paint
from ..geometry import Pose
from ..geometry.independent_axes import independent_axes
from ..session import Load, LoadReadings, Still
from .load_readings import EXACT, readings_altered
from .pose_estimate import PoseEstimate


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

    def with_readings_altered(self) -> tuple[Observation, Observation]:
        """With its load a step nearer to the clamp, and with a little more force; itself where it has none."""
        if not isinstance(self.still, Load):
            return self, self
        nearer, heavier = readings_altered(self.still)
        return replace(self, still=nearer), replace(self, still=heavier)


@dataclass(frozen=True, eq=False)
class Prior:
    """What is known before the stills.

    Attributes
    ----------
    poses : the camera's pose by one or several ways.
    start : camera pose from which the solution's steps are counted.
    camera : the lens; one without a covariance counts as exact.
    mean, std : (11,) of the antenna's parameters, gain and offset.
    readings : how well the loads' places and forces are known.
    """

    poses: Sequence[PoseEstimate]
    start: Pose
    camera: Camera
    mean: np.ndarray
    std: np.ndarray
    readings: LoadReadings = EXACT

    @cached_property
    def lens_axes(self) -> np.ndarray:
        """(P, P): along its columns the lens varies independently, by unit deviations; (0, 0) for an exact one."""
        return np.zeros((0, 0)) if self.camera.covariance is None else independent_axes(self.camera.covariance)
