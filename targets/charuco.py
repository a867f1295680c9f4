"""The board as OpenCV knows it."""

from __future__ import annotations

import cv2
import numpy as np

from .board import BoardSpec


def opencv_board(spec: BoardSpec) -> cv2.aruco.CharucoBoard:
    """OpenCV's board object for a spec."""
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, spec.dictionary))
    board = cv2.aruco.CharucoBoard((spec.squares_x, spec.squares_y), spec.square_m, spec.marker_m, dictionary)
    board.setLegacyPattern(spec.legacy_pattern)
    return board


def corner_points(spec: BoardSpec) -> np.ndarray:
    """(corner_count, 3) inner corners in the board frame, m, in the order of OpenCV's corner ids."""
    return np.asarray(opencv_board(spec).getChessboardCorners(), float).reshape(-1, 3)
