"""What is known of the free antenna before it is seen over the board, and the points of it that are known along it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..antenna.shape import Curves, bend
from ..camera import Camera
from ..reprojection import SeenPoints, see
from ..session import NominalAntenna
from .session_rig import BOW_STD_PER_M, CLAMP_GIVE_STD_M, LOG_MASS_STD, nominal_parameters

LENGTH_STD_M = 3e-4
CLAMP_OUT_OF_PLANE_STD_RAD = 0.01
LOG_STIFFNESS_STD = 0.15
"""What a nominal antenna is trusted with besides what the joint solve trusts it with: its length to a ruler's reading,
its clamp's tangent to be as parallel to the board as a gauge makes it, and its stiffness to four per cent of the
diameter."""


@dataclass(frozen=True, eq=False)
class FreeAntenna:
    """What is known of the free antenna before the picture.

    Attributes
    ----------
    length_m, length_std_m : from the clamp to the tip.
    diameter_m : of the wire.
    parameters : (9,) `antenna.shape.PARAMETERS` in the frame that is looked for. With clamp offsets and angles of zero
        that frame is the clamp's own.
    covariance : (9, 9) of the parameters.
    gravity_m_s2 : (3,) antenna frame, at the joints' angles of the pictures.
    """

    length_m: float
    length_std_m: float
    diameter_m: float
    parameters: np.ndarray
    covariance: np.ndarray
    gravity_m_s2: np.ndarray

    def curves(self, parameters: np.ndarray) -> Curves:
        """The free antenna with each of K parameter vectors (K, 9)."""
        count = len(parameters)
        gravity = np.repeat(self.gravity_m_s2[None], count, axis=0)
        half = np.full(count, 0.5 * self.length_m)
        return bend(parameters, self.length_m, gravity, half, np.zeros((count, 2)), sweeps=4)


@dataclass(frozen=True, eq=False)
class Mark:
    """A point of the antenna that is known along it, its tip (end 1) or its clamp (end 0).

    Attributes
    ----------
    end : node of the curve, 0 or −1.
    seen : one seen point, its covariance from the pixel's standard deviation.
    std_m : how well its place along the antenna is known.
    """

    end: int
    seen: SeenPoints
    std_m: float


@dataclass(frozen=True, eq=False)
class ClampMark:
    """Where a person, or a detector, sees the clamp's edge: pixel (2,) and its standard deviation along the antenna.

    A rough mark, of many pixels, still tells which end of the antenna is the clamped one.
    """

    point_px: np.ndarray
    std_px: float


def nominal_free_antenna(
    antenna: NominalAntenna, gravity_m_s2: np.ndarray, length_std_m: float = LENGTH_STD_M
) -> FreeAntenna:
    """A straight antenna of nominal stiffness and mass, clamped in the frame that is looked for.

    gravity_m_s2 : (3,) antenna frame.
    """
    shape = [BOW_STD_PER_M, BOW_STD_PER_M, LOG_STIFFNESS_STD, LOG_MASS_STD, CLAMP_GIVE_STD_M]
    std = [0.0, 0.0, CLAMP_OUT_OF_PLANE_STD_RAD, 0.0, *shape]
    return FreeAntenna(
        antenna.length_m,
        length_std_m,
        antenna.diameter_m,
        nominal_parameters(antenna),
        np.diag(np.square(std)),
        np.asarray(gravity_m_s2, float),
    )


def see_with_lens(camera: Camera, points_px: np.ndarray, sigma_px: np.ndarray) -> SeenPoints:
    """`reprojection.see` of points (N, 2), with their dependence on the lens whether or not its covariance is known."""
    valid = camera.normalized_with_slopes(points_px)[2]
    return replace(see(camera, points_px[valid], sigma_px[valid]), by_lens=camera.lens_jacobian(points_px[valid]))
