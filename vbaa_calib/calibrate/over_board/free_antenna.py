"""The free antenna over a board: what is known of it, whether what is seen can be it, and which end is clamped."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np

from targets.board import BoardSpec
from vbaa_calib.antenna.shape import Curves, bend
from vbaa_calib.calibrate.antenna.session_rig import BOW_STD_PER_M, CLAMP_GIVE_STD_M, LOG_MASS_STD, nominal_parameters
from vbaa_calib.camera import Camera
from vbaa_calib.core.errors import InputError
from vbaa_calib.detect.over_board.measure import BoardLine, LineEnd
from vbaa_calib.detect.over_board.search import PlaneAbove
from vbaa_calib.geometry import Pose
from vbaa_calib.session import NominalAntenna

_LENGTH_STD_M, _CLAMP_OUT_OF_PLANE_STD_RAD, _LOG_STIFFNESS_STD = 3e-4, 0.01, 0.15
"""What a nominal antenna is trusted with besides the priors of bundle adjustment: its length to a ruler's reading,
its clamp's tangent to be as parallel to the board as a gauge makes it, and its stiffness to four per cent of the
diameter."""
_TOO_LONG = 1.15
_AMBIGUOUS_SIDE = 0.6
_ALONG = 0.5
_MOVED = 0.6
_HARD_SHADOW = 0.2


@dataclass(frozen=True, eq=False)
class FreeAntenna:
    """What is known of the free antenna before the picture.

    length_m, length_std_m : from the clamp to the tip. diameter_m : of the wire.
    parameters : (9,) `antenna.shape.PARAMETERS` in the frame that is looked for, with their covariance (9, 9). With
        clamp offsets and angles of zero that frame is the clamp's own.
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


def nominal_free_antenna(antenna: NominalAntenna, gravity_m_s2: np.ndarray) -> FreeAntenna:
    """A straight antenna of nominal stiffness and mass, clamped in the frame that is looked for; gravity (3,) in it."""
    shape = [BOW_STD_PER_M, BOW_STD_PER_M, _LOG_STIFFNESS_STD, LOG_MASS_STD, CLAMP_GIVE_STD_M]
    std = [0.0, 0.0, _CLAMP_OUT_OF_PLANE_STD_RAD, 0.0, *shape]
    known = antenna.length_m, _LENGTH_STD_M, antenna.diameter_m, nominal_parameters(antenna), np.diag(np.square(std))
    return FreeAntenna(*known, np.asarray(gravity_m_s2, float))


@dataclass(frozen=True, eq=False)
class OverSetup:
    """The antenna over the board, as described.

    spec : the board, flat on plane C. antenna : the free antenna above it.
    height_m, height_std_m : of the antenna's axis at the clamp above the print.
    clamp : the clamp's visible edge, where it is known.
    """

    spec: BoardSpec
    camera: Camera
    antenna: FreeAntenna
    height_m: float
    height_std_m: float
    clamp: LineEnd | None = None


def refuse_touching(setup: OverSetup, toward: float) -> None:
    """Raises InputError when the free antenna would rest on the board; `toward` as in `OverProblem`."""
    antenna, free_m = setup.antenna, setup.height_m - 0.5 * setup.antenna.diameter_m
    rise = toward * antenna.curves(antenna.parameters[None]).points_m[0, :, 2]
    lowest = max(-float(rise.min()), 0.0)
    if not free_m > 0.0 or lowest > free_m:
        raise InputError(
            f"the antenna's axis is {1e3 * setup.height_m:.1f} mm above the board, and sags by {1e3 * lowest:.1f} mm",
            remedy="hold it higher: an antenna that rests on the board is not free",
        )


def refuse_other_lines(line: BoardLine, plane: PlaneAbove, antenna: FreeAntenna, where: str) -> None:
    """Raises InputError for a line longer than the antenna, or a dark one beside its own hard shadow."""
    if not line.bright and line.shadow > _HARD_SHADOW:
        raise InputError(
            f"a band {100 * line.shadow:.0f} % darker runs beside the dark antenna: its shadow",
            where=where,
            remedy="light it from several sides or through a sheet of paper, or paint the antenna white",
        )
    seen = float(np.linalg.norm(np.diff(plane.to_plane(line.points_px[[0, -1]])[0], axis=0)))
    if seen > _TOO_LONG * antenna.length_m:
        raise InputError(
            f"the line found is {1e3 * seen:.0f} mm long, the antenna {1e3 * antenna.length_m:.0f} mm",
            where=where,
            remedy="is it the antenna? check its length and the board's square size",
        )


def refuse_moved(images: Mapping[str, np.ndarray], picture: np.ndarray, line: BoardLine) -> None:
    """Raises InputError for a picture (H, W) that does not show the line where the typical one does."""
    along = np.gradient(line.points_px, axis=0)
    normal = np.stack([-along[:, 1], along[:, 0]], axis=1)
    normal *= (line.width_px + 3.0) / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-9)
    at = (line.points_px + np.array([-1, 0, 1])[:, None, None] * normal).astype(np.float32)

    def height(image: np.ndarray) -> float:
        grey = image.astype(np.float32)
        left, middle, right = cv2.remap(grey, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
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
    pairs = zip(line.ends, line.points_px[[0, -1]], strict=True)
    return np.stack([point if end is None else end.point_px for end, point in pairs])


def from_clamp(line: BoardLine, plane: PlaneAbove, guess: Pose | None, clamp: LineEnd | None, where: str) -> BoardLine:
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
