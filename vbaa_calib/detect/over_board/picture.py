"""What a picture of the board would show with nothing in front of it, and how the picture differs from that."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.optimize import minimize_scalar

from targets.board import BoardSpec, opencv_board
from vbaa_calib.camera import Camera
from vbaa_calib.core.robust import mad_std
from vbaa_calib.geometry import Pose

_TEXELS = 192
"""Texels per square: a marker's bit begins within 1/400 of a square of its place."""
_SUBPIXELS = 3
_WINDOW_SQUARES = 3.0
"""Side of the window over which black and white levels count as alike: both are in it wherever it lies."""
_LEAST_CONTRAST = 12.0
"""Least difference of white and black, grey levels."""
_COVERED = 5.0
"""Pixels that differ by more than this many deviations say nothing of the levels."""
_STEEP, _FLAT = 0.08, 0.01
"""Slopes of the pattern, 1/px, from which on a pixel lies on an edge, and up to which it lies on none."""


@dataclass(frozen=True, eq=False)
class BoardPicture:
    """A picture in units of the board's own print: 0 is its black, 1 its white, wherever the light falls.

    Attributes
    ----------
    seen : (H, W) float32, the picture.
    pattern : (H, W) float32, the bare board, blurred like the picture; NaN off the board's outline.
    slope : (H, W) float32, how steep the pattern is, 1/px.
    noise : (H, W) float32, standard deviation of `seen - pattern`: grain, and at edges how well they are known.
    blur_px : standard deviation of the blur.
    """

    seen: np.ndarray
    pattern: np.ndarray
    slope: np.ndarray
    noise: np.ndarray
    blur_px: float


def board_picture(image: np.ndarray, camera: Camera, T_camera_board: Pose, spec: BoardSpec) -> BoardPicture | None:
    """Compare an (H, W) picture with the board that it shows at a known pose; None where no contrast is left of it."""
    grey = np.asarray(image, np.float32)
    sharp, inside = _warped(camera, T_camera_board, spec)
    if not inside.any():
        return None
    # a square's side by the outline's area in the picture
    window = int(_WINDOW_SQUARES * np.sqrt(inside.sum() / (spec.squares_x * spec.squares_y))) | 1
    on_board = inside.astype(np.float32)

    def misfit(sigma_px: float) -> float:
        """Mean absolute residual over the board."""
        blurred = cv2.GaussianBlur(sharp, (0, 0), sigma_px)
        black, contrast = _fit_levels(grey, blurred, on_board, window)
        return float((on_board * np.abs(grey - black - contrast * blurred)).sum() / on_board.sum())

    blur_px = float(minimize_scalar(misfit, bounds=(0.2, 4.0), method="bounded", options={"xatol": 0.05}).x)
    pattern = cv2.GaussianBlur(sharp, (0, 0), blur_px)
    weight = on_board
    for _ in range(2):
        black, contrast = _fit_levels(grey, pattern, weight, window)
        residual = np.abs(grey - black - contrast * pattern)
        spread = mad_std(residual[inside]) + 0.3
        weight = on_board * (residual < _COVERED * spread)
    if float(np.median(contrast[inside])) < _LEAST_CONTRAST:
        return None
    seen = (grey - black) / np.maximum(contrast, _LEAST_CONTRAST / 2)
    slope = np.hypot(*(cv2.Sobel(pattern, cv2.CV_32F, 1 - i, i, ksize=3, scale=0.125) for i in (0, 1)))
    noise = _noise(seen, pattern, slope, inside)
    return BoardPicture(seen, np.where(inside, pattern, np.nan).astype(np.float32), slope, noise, blur_px)


def pattern_texture(spec: BoardSpec, texels: int = _TEXELS) -> np.ndarray:
    """(squares_y·texels, squares_x·texels) float32: 1 white, 0 black."""
    board = opencv_board(spec)
    modules = spec.modules
    tile = (np.arange(texels) + 0.5) / texels * spec.square_m
    place = np.floor((tile - (spec.square_m - spec.marker_m) / 2) / spec.marker_m * modules).astype(int)
    on_marker = (place >= 0) & (place < modules)
    texture = np.zeros((spec.squares_y * texels, spec.squares_x * texels), np.float32)
    for corners, name in zip(board.getObjPoints(), np.asarray(board.getIds()).ravel(), strict=True):
        column, row = np.floor(np.asarray(corners)[:, :2].mean(axis=0) / spec.square_m).astype(int)
        bits = cv2.aruco.generateImageMarker(board.getDictionary(), int(name), modules, borderBits=1) > 0
        square = np.ones((texels, texels), np.float32)
        square[np.ix_(on_marker, on_marker)] = bits[np.ix_(place[on_marker], place[on_marker])]
        texture[row * texels : (row + 1) * texels, column * texels : (column + 1) * texels] = square
    return texture


def _warped(camera: Camera, T_camera_board: Pose, spec: BoardSpec) -> tuple[np.ndarray, np.ndarray]:
    """The sharp pattern averaged over each pixel, (H, W) float32, and which pixels lie on the board."""
    width, height = camera.image_size
    pixels = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).astype(float)
    points, valid = camera.unproject_normalized(pixels)
    rotation = T_camera_board.rotation
    back = np.linalg.inv(np.stack([rotation[:, 0], rotation[:, 1], T_camera_board.translation_m], axis=1))
    x, y, w = np.moveaxis(points @ back[:, :2].T + back[:, 2], -1, 0)
    valid &= w > 0
    square = np.stack([x, y], axis=-1) / np.where(valid, w, 1.0)[..., None] / spec.square_m
    square = np.where(valid[..., None], square, -1.0)
    inside = valid & (square > 0).all(axis=-1) & (square < [spec.squares_x, spec.squares_y]).all(axis=-1)
    texture = pattern_texture(spec)
    fine_size = (width * _SUBPIXELS, height * _SUBPIXELS)
    texels = cv2.resize((square * _TEXELS - 0.5).astype(np.float32), fine_size, interpolation=cv2.INTER_LINEAR)
    limit = 30000.0
    fine = cv2.remap(texture, np.clip(texels, -limit, limit), np.empty(0), cv2.INTER_LINEAR, borderValue=1.0)
    return cv2.resize(fine, (width, height), interpolation=cv2.INTER_AREA), inside


def _fit_levels(
    grey: np.ndarray, pattern: np.ndarray, weight: np.ndarray, window: int
) -> tuple[np.ndarray, np.ndarray]:
    """Black level and contrast around every pixel, (H, W) each, by least squares over a window."""

    def mean(values: np.ndarray) -> np.ndarray:
        return cv2.blur(weight * values, (window, window), borderType=cv2.BORDER_CONSTANT)

    ones = np.ones_like(grey)
    norm = np.maximum(mean(ones), 1e-6)
    grey_mean, pattern_mean = mean(grey) / norm, mean(pattern) / norm
    covariance = mean(grey * pattern) / norm - grey_mean * pattern_mean
    variance = mean(pattern * pattern) / norm - pattern_mean**2
    contrast = covariance / np.maximum(variance, 1e-3)
    # windows with little of the board, or of one colour only, take what their neighbours found
    trust = norm * np.maximum(variance, 0.0) ** 2 + 1e-9
    total = cv2.blur(trust, (window, window))
    contrast = cv2.blur(trust * contrast, (window, window)) / total
    black = cv2.blur(trust * (grey_mean - contrast * pattern_mean), (window, window)) / total
    far = total < 1e-6
    middle = weight > 0
    return (
        np.where(far, np.median(black[middle]), black).astype(np.float32),
        np.where(far, np.median(contrast[middle]), contrast).astype(np.float32),
    )


def _noise(seen: np.ndarray, pattern: np.ndarray, slope: np.ndarray, inside: np.ndarray) -> np.ndarray:
    residual = np.abs(seen - pattern)

    def spread(where: np.ndarray, by: np.ndarray) -> float:
        return mad_std(residual[where] / by[where]) if where.sum() > 50 else 0.0

    flat, ones = inside & (slope < _FLAT), np.ones_like(seen)
    dark, light = (spread(flat & side, ones) for side in (pattern < 0.5, pattern >= 0.5))
    grain = np.sqrt(np.clip(dark**2 + (light**2 - dark**2) * pattern, 1e-6, None))
    slack = spread(inside & (slope > _STEEP), slope)
    return np.hypot(grain, slack * slope).astype(np.float32)
