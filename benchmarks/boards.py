"""What the synthetic calibrations share: lenses, the board, and noisy views of it."""

from __future__ import annotations

import numpy as np

from targets.board import BoardSpec, corner_points
from vbaa_calib.calibrate.lens.information import bend
from vbaa_calib.detect.board.corners import BoardView

BOARD = BoardSpec(squares_x=11, squares_y=8, square_m=0.015, marker_m=0.011)
HD, SQUARE, TALL, VGA = (1280, 720), (2048, 2048), (1280, 960), (640, 480)
MILD = np.array([900.0, 902.0, 645.0, 352.0, -0.12, 0.04, 4e-4, -3e-4, 0.0])
LONG = np.array([2800.0, 2804.0, 1015.0, 1032.0, -0.08, 0.15, 2e-4, 3e-4, 0.0])
WIDE = np.array([590.0, 591.0, 641.0, 356.2, 0.31, 0.025, 4e-4, -3e-4, 1e-3, 0.56, 0.061, 5e-3])
BARREL = np.array([520.0, 521.0, 325.0, 236.0, -0.32, 0.14, 5e-4, -4e-4, -0.03])
FISHEYE = np.array([420.0, 421.0, 641.0, 478.0, 0.05, -0.01, 0.003, -0.001])
"""fx, fy, cx, cy and distortion in OpenCV's order; five coefficients, eight (WIDE), or its fisheye's four."""
_CORNER_PX = 0.15
"""Standard deviation of a corner, per axis."""
_OUTLIER_PX = (2.0, 20.0)


def bent_corners(sagittas_m: tuple[float, float]) -> np.ndarray:
    """(C, 3) corners of the board bent by so much along its two axes, in its frame."""
    return corner_points(BOARD) + (bend(BOARD) @ sagittas_m)[:, None] * np.array([0.0, 0.0, 1.0])


def noisy_view(
    name: str, ids: np.ndarray, pixels: np.ndarray, size: tuple[int, int], outliers: float, rng: np.random.Generator
) -> tuple[BoardView, np.ndarray]:
    """A view of corners (N,) at true pixels (N, 2), a share of them 2 to 20 px off, and which (N,) are not."""
    noisy = pixels + _CORNER_PX * rng.normal(size=pixels.shape)
    wrong = rng.random(len(ids)) < outliers
    angle, length = rng.uniform(0, 2 * np.pi, len(ids)), rng.uniform(*_OUTLIER_PX, len(ids))
    noisy[wrong] += (length[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1))[wrong]
    return BoardView(name, ids, noisy, size, np.arange(40)), ~wrong
