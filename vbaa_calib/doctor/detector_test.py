"""How well the installed OpenCV, and our detector, find a board's corners in pictures with known corners."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from targets.board import BoardSpec, corner_points, opencv_board
from vbaa_calib.core.console import progress
from vbaa_calib.detect.board.corners import BoardView, detect_corners
from vbaa_calib.geometry import Pose
from vbaa_calib.simulate.render.board import Sheet, board_patch, print_sheet
from vbaa_calib.simulate.render.picture import Studio, digitise, expose
from vbaa_calib.simulate.scene.lens import Lens, project, ray_map
from vbaa_calib.simulate.scene.scene import PictureSpec

_TILT_RAD = np.radians(45.0)
_BEHIND = 0.35
_ROOM = 1.12
_FOCAL_PER_SIDE = 1.6
_FAR = 1e12


@dataclass(frozen=True)
class Conditions:
    """How a picture is taken.

    square_px : side of a square at the board's middle, seen face on.
    blur_px : standard deviation of the lens's Gaussian blur; the pixel's own area comes on top.
    noise : standard deviation of the grey levels (of 255).
    exposure : 1 puts the paper at about 210 of 255; from 1.2 on the paper saturates.
    """

    square_px: float
    blur_px: float
    noise: float = 2.0
    exposure: float = 1.0


@dataclass(frozen=True, eq=False)
class DrawnBoard:
    """A board before noise: grey (H, W) float, its true corners (corner_count, 2) px, and how it was taken."""

    grey: np.ndarray
    corners_px: np.ndarray
    conditions: Conditions

    def picture(self, rng: np.random.Generator) -> np.ndarray:
        """(H, W) uint8 with fresh noise."""
        return digitise(_picture_spec(self.conditions), self.grey, rng)


def draw_board(
    sheet: Sheet, conditions: Conditions, rng: np.random.Generator, tilt_rad: float = _TILT_RAD
) -> DrawnBoard:
    """The whole board through an ideal lens: random tilt up to `tilt_rad`, roll and place on the pixel grid."""
    spec = sheet.spec
    diagonal = float(np.hypot(spec.squares_x + 1, spec.squares_y + 1))
    side = int(np.ceil(_ROOM * diagonal * conditions.square_px))
    focal, middle = _FOCAL_PER_SIDE * side, (side - 1) / 2
    lens = Lens("opencv", (side, side), np.array([[focal, 0, middle], [0, focal, middle], [0, 0, 1.0]]), np.zeros(0))
    pose = _pose(spec, focal, conditions.square_px, rng, tilt_rad)
    ones = np.ones((side, side), np.float32)
    place = Studio(_picture_spec(conditions), ray_map(lens), np.float32(conditions.exposure) * ones, ones[:2, :2])
    # seen straight down, so that the board is lit alike in every picture
    patch = board_patch(place, sheet, pose, np.diag([1.0, -1.0, -1.0]))
    grey = expose(place, np.float32(_BEHIND) * ones, [] if patch is None else [patch])
    return DrawnBoard(grey, project(lens, pose @ corner_points(spec)), conditions)


def _pose(spec: BoardSpec, focal: float, square_px: float, rng: np.random.Generator, tilt_rad: float) -> Pose:
    around, roll = rng.uniform(0.0, 2 * np.pi, 2)
    tilt = Rotation.from_rotvec(rng.uniform(0.0, tilt_rad) * np.array([np.cos(around), np.sin(around), 0.0]))
    rotation = (tilt * Rotation.from_rotvec([0.0, 0.0, roll])).as_matrix()
    middle = spec.square_m * np.array([spec.squares_x, spec.squares_y, 0.0]) / 2
    distance = focal * spec.square_m / square_px
    shift = np.append(rng.uniform(-1.0, 1.0, 2) * spec.square_m / square_px, distance)
    return Pose(rotation, shift - rotation @ middle)


def _picture_spec(conditions: Conditions) -> PictureSpec:
    return PictureSpec(conditions.blur_px, conditions.noise, _FAR, 0.0, 0.0, _BEHIND, 0.0, 0.0, 0.0, 0.0)


_SQUARE_PX = (24.0, 40.0, 64.0)
_BLUR_PX = (0.5, 1.0, 2.0)
OPENCV, OURS = "OpenCV", "vbaa-calib"
_LEAST_CORNERS = 12

_Detector = Callable[[np.ndarray, BoardSpec], BoardView]


@dataclass(frozen=True)
class Row:
    """One detector under one condition.

    found : share of all corners.
    bias_px : mean error along u and v. rms_px : of the distances; worst_px : the largest. NaN where too few are found.
    median_px : of the distances, by which one wild corner does not show.
    error_per_std : rms of the errors in their predicted standard deviations, per coordinate; None without a prediction.
    """

    detector: str
    square_px: float
    blur_px: float
    found: float
    bias_px: tuple[float, float]
    rms_px: float
    median_px: float
    worst_px: float
    error_per_std: float | None

    @property
    def measured(self) -> bool:
        """Whether enough corners were found to measure errors."""
        return bool(np.isfinite(self.rms_px))

    def to_dict(self) -> dict[str, Any]:
        """For JSON, with null for what was not measured."""
        errors = ("bias_px", "rms_px", "median_px", "worst_px", "error_per_std")
        return asdict(self) | ({} if self.measured else dict.fromkeys(errors))


def opencv_corners(image: np.ndarray, spec: BoardSpec) -> BoardView:
    corners, ids, _, _ = cv2.aruco.CharucoDetector(opencv_board(spec)).detectBoard(image)
    height, width = image.shape
    found = np.zeros((0, 2)) if corners is None else np.asarray(corners, float).reshape(-1, 2)
    return BoardView("", np.zeros(0, int) if ids is None else np.asarray(ids, int).ravel(), found, (width, height))


DETECTORS: dict[str, _Detector] = {OPENCV: opencv_corners, OURS: detect_corners}


def try_detectors(
    spec: BoardSpec,
    pictures: int,
    seed: int,
    detectors: Mapping[str, _Detector] = DETECTORS,
    square_px: Sequence[float] = _SQUARE_PX,
    blur_px: Sequence[float] = _BLUR_PX,
) -> list[Row]:
    """Every detector on the same pictures: `pictures` random poses for each size of the squares and each blur.

    The pictures come from the simulator, which shares no code with OpenCV's detector; the corners are those of the
    pose, projected. Noise of 2 grey levels.
    """
    sheet, rng = print_sheet(spec), np.random.default_rng(seed)
    rows = []
    conditions = [Conditions(square, blur) for square in square_px for blur in blur_px]
    for condition in progress(conditions, "drawing and detecting the board"):
        errors: dict[str, list[np.ndarray]] = {name: [] for name in detectors}
        pulls: dict[str, list[np.ndarray]] = {name: [] for name in detectors}
        for _ in range(pictures):
            board = draw_board(sheet, condition, rng)
            picture = board.picture(rng)
            for name, detect in detectors.items():
                view = detect(picture, spec)
                error = view.corners_px - board.corners_px[view.ids]
                errors[name].append(error)
                if view.covariance_px2 is not None and len(error):
                    pulls[name].append(np.einsum("ni,nij,nj->n", error, np.linalg.inv(view.covariance_px2), error))
        for name in detectors:
            rows.append(_row(name, condition, errors[name], pulls[name], pictures * spec.corner_count))
    return rows


def _row(
    name: str, condition: Conditions, errors: Sequence[np.ndarray], pulls: Sequence[np.ndarray], corners: int
) -> Row:
    every = np.concatenate([np.zeros((0, 2)), *errors])
    head = name, condition.square_px, condition.blur_px, len(every) / corners
    if len(every) < _LEAST_CORNERS:
        return Row(*head, (np.nan, np.nan), np.nan, np.nan, np.nan, None)
    distance, bias = np.linalg.norm(every, axis=1), every.mean(axis=0)
    rms = float(np.sqrt((distance**2).mean()))
    pull = float(np.sqrt(np.concatenate(pulls).mean() / 2)) if pulls else None
    return Row(*head, (float(bias[0]), float(bias[1])), rms, float(np.median(distance)), float(distance.max()), pull)


_BIASED_PX = 0.08
"""Least mean error that counts as bias; sound detectors are below 0.02 px."""
_HALF_PX = (0.35, 0.65)
_GOOD_PX = 0.1
_FOUND = 0.5


def _measured(rows: Sequence[Row], detector: str) -> list[Row]:
    """A detector's rows under conditions in which it finds at least half the corners."""
    return [row for row in rows if row.detector == detector and row.measured and row.found >= _FOUND]


def mean_bias_px(rows: Sequence[Row], detector: str) -> np.ndarray:
    """(2,) mean error along u and v over those conditions; NaN if there are none."""
    biases = [row.bias_px for row in _measured(rows, detector)]
    return np.median(biases, axis=0) if biases else np.full(2, np.nan)


def is_sound(rows: Sequence[Row]) -> bool:
    """Whether both detectors find corners, without bias."""
    return bool((np.abs([mean_bias_px(rows, detector) for detector in (OPENCV, OURS)]) < _BIASED_PX).all())


def verdict(rows: Sequence[Row]) -> list[str]:
    """Sentences: whether OpenCV and our detector can be trusted, and down to which size of squares."""
    bias = mean_bias_px(rows, OPENCV)
    shift, size = f"({bias[0]:+.2f}, {bias[1]:+.2f}) px", np.abs(bias)
    rules = (
        (
            not np.isfinite(bias).all(),
            "finds this board under none of the conditions: are its squares too many, or its markers too thin?",
        ),
        (size.max() < _BIASED_PX, f"finds this board's corners without bias: {shift} in the mean."),
        (
            ((size > _HALF_PX[0]) & (size < _HALF_PX[1])).any(),
            f"is half a pixel off, {shift}: it counts pixels from a "
            "corner of the first one, as versions before 4.14 did. Update it.",
        ),
        (True, f"is off by {shift} in the mean. Update it, or report it."),
    )
    said = [f"OpenCV {cv2.__version__} {next(words for holds, words in rules if holds)}"]
    bias = mean_bias_px(rows, OURS)
    if not np.isfinite(bias).all():
        return said
    if np.abs(bias).max() >= _BIASED_PX:
        said += [f"The corners used here are off by ({bias[0]:+.2f}, {bias[1]:+.2f}) px: do not calibrate with them."]
    good = [row for row in _measured(rows, OURS) if row.rms_px <= _GOOD_PX]
    if not good:
        return [*said, f"Under no condition tried are corners within {_GOOD_PX} px rms: the markers leave no room."]
    smallest = min(row.square_px for row in good)
    said.append(f"Our corners are within {_GOOD_PX} px rms from squares of {smallest:g} px on.")
    pull = max((row.error_per_std for row in good if row.error_per_std is not None), default=0.0)
    if pull > 1.5:
        said.append(
            f"Errors are up to {pull:.1f} times what noise alone makes: in sharp pictures with little noise, the "
            "detector's own bias, which differs from corner to corner, is larger than the noise."
        )
    return said


def as_text(rows: Sequence[Row]) -> str:
    lines = [
        "square px  blur px  detector     found   bias u, v px        rms   median    worst  error/std",
        "----------------------------------------------------------------------------------------------",
    ]
    for row in rows:
        head = f"{row.square_px:9g} {row.blur_px:8g}  {row.detector:<11} {100 * row.found:5.0f} %"
        if not row.measured:
            lines.append(f"{head}   too few to measure")
            continue
        pull = "" if row.error_per_std is None else f"{row.error_per_std:10.2f}"
        bias = f"{row.bias_px[0]:+.3f}, {row.bias_px[1]:+.3f}"
        lines.append(f"{head}  {bias:>16} {row.rms_px:9.3f} {row.median_px:8.3f} {row.worst_px:8.3f} {pull}")
    return "\n".join(lines)
