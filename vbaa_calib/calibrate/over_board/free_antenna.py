"""Whether what is seen over the board can be the antenna, and which of its ends is the clamped one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np

from vbaa_calib.antenna.shape import Curves, bend
from vbaa_calib.calibrate.antenna.session_rig import BOW_STD_PER_M, CLAMP_GIVE_STD_M, LOG_MASS_STD, nominal_parameters
from vbaa_calib.core.errors import InputError
from vbaa_calib.detect.over_board.measure import BoardLine
from vbaa_calib.detect.over_board.search import PlaneAbove
from vbaa_calib.geometry import Pose
from vbaa_calib.rig.reprojection import SeenPoints
from vbaa_calib.session import NominalAntenna

LENGTH_STD_M = 3e-4
_CLAMP_OUT_OF_PLANE_STD_RAD = 0.01
LOG_STIFFNESS_STD = 0.15
"""What a nominal antenna is trusted with besides the priors of bundle adjustment: its length to a ruler's reading,
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

    A rough mark, of many pixels, still shows which end of the antenna is the clamped one.
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
    std = [0.0, 0.0, _CLAMP_OUT_OF_PLANE_STD_RAD, 0.0, *shape]
    return FreeAntenna(
        antenna.length_m,
        length_std_m,
        antenna.diameter_m,
        nominal_parameters(antenna),
        np.diag(np.square(std)),
        np.asarray(gravity_m_s2, float),
    )


_TOO_LONG = 1.15
_AMBIGUOUS_SIDE = 0.6
_ALONG = 0.5
_MOVED = 0.6
_HARD_SHADOW = 0.2
_MOST_SCATTER = 5.0


def refuse_touching(antenna: FreeAntenna, height_m: float, toward: float) -> None:
    """Raises InputError when the free antenna would rest on the board; `toward` as in `OverProblem`."""
    rise = toward * antenna.curves(antenna.parameters[None]).points_m[0, :, 2]
    lowest = max(-float(rise.min()), 0.0)
    if not height_m > 0.5 * antenna.diameter_m or lowest > height_m - 0.5 * antenna.diameter_m:
        raise InputError(
            f"the antenna's axis is {1e3 * height_m:.1f} mm above the board, and sags by {1e3 * lowest:.1f} mm",
            remedy="hold it higher: an antenna that rests on the board is not free",
        )


def refuse_shadowed(line: BoardLine, where: str) -> None:
    """Raises InputError for a dark antenna beside its own hard shadow: the two cannot be distinguished."""
    if not line.bright and line.shadow > _HARD_SHADOW:
        raise InputError(
            f"a band {100 * line.shadow:.0f} % darker runs beside the dark antenna: its shadow",
            where=where,
            remedy="light it from several sides or through a sheet of paper, or paint the antenna white",
        )


def refuse_scattered(noise_scale: float, where: str) -> None:
    """Raises InputError when the points of the line are not those of one antenna."""
    if noise_scale > _MOST_SCATTER:
        raise InputError(
            f"the antenna's points scatter {noise_scale:.1f} times as far as the picture's noise explains",
            where=where,
            remedy="clear the board of other things, light it softly, and check the board's description",
        )


def refuse_moved(images: Mapping[str, np.ndarray], picture: np.ndarray, line: BoardLine) -> None:
    """Raises InputError for a picture (H, W) that does not show the line where the typical one does."""
    along = np.gradient(line.points_px, axis=0)
    normal = np.stack([-along[:, 1], along[:, 0]], axis=1)
    normal *= (line.width_px + 3.0) / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-9)

    def height(image: np.ndarray) -> float:
        grey = image.astype(np.float32)
        levels = []
        for side in (-1, 0, 1):
            at = (line.points_px + side * normal).astype(np.float32)
            levels.append(cv2.remap(grey, at[:, 0], at[:, 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)[:, 0])
        left, middle, right = levels
        return float(np.median(middle - 0.5 * (left + right)))

    usual = height(picture)
    for name, image in images.items():
        if height(image) / usual < _MOVED:
            raise InputError(
                "the antenna is not where the other pictures show it",
                where=name,
                remedy="let it come to rest and keep it still, or remove that picture",
            )


def outermost(line: BoardLine) -> np.ndarray:
    """(2, 2) the two ends of what is seen of the line, px."""
    first, last = line.ends
    return np.stack(
        [line.points_px[0] if first is None else first.point_px, line.points_px[-1] if last is None else last.point_px]
    )


def from_clamp(
    line: BoardLine, plane: PlaneAbove, guess: Pose | None, clamp: ClampMark | None, where: str
) -> BoardLine:
    """The line with its clamped end first. Raises InputError where nothing shows which end that is."""
    ends = outermost(line)
    if clamp is not None:
        near = np.linalg.norm(ends - clamp.point_px, axis=1)
        if near.min() > _AMBIGUOUS_SIDE * near.max():
            raise InputError("the clamp's mark is as near to one end of the antenna as to the other", where=where)
        return line if near[0] < near[1] else line.reversed()
    if guess is not None:
        along = plane.T_camera_board.rotation @ np.append(np.diff(plane.to_plane(ends)[0], axis=0)[0], 0.0)
        cosine = float(along @ guess.rotation.T[:, 0] / np.linalg.norm(along))
        if abs(cosine) < _ALONG:
            raise InputError(
                f"the line found lies {np.degrees(np.arccos(abs(cosine))):.0f}° off the antenna's expected direction",
                where=where,
                remedy="is it the antenna? remove other thin things from the board",
            )
        return line if cosine > 0 else line.reversed()
    if (line.ends[0] is None) == (line.ends[1] is None):
        both = "leaves the picture at both ends" if line.ends[0] is None else "ends in the picture on both sides"
        raise InputError(
            f"the antenna {both}, which of them is the clamp does not show",
            where=where,
            remedy="give over.clamp_px in session.yaml: where the clamp's edge shows",
        )
    return line if line.ends[0] is None else line.reversed()


def refuse_too_long(line: BoardLine, plane: PlaneAbove, antenna: FreeAntenna, where: str) -> None:
    """Raises InputError when the line is longer than the antenna."""
    seen = float(np.linalg.norm(np.diff(plane.to_plane(line.points_px[[0, -1]])[0], axis=0)))
    if seen > _TOO_LONG * antenna.length_m:
        raise InputError(
            f"the line found is {1e3 * seen:.0f} mm long, the antenna {1e3 * antenna.length_m:.0f} mm",
            where=where,
            remedy="is it the antenna? check its length and the board's square size",
        )
