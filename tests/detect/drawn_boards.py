"""Boards drawn in pictures: sharp or blurred, smeared, in any light."""

from __future__ import annotations

import dataclasses
import functools

import cv2
import numpy as np

from targets.board import BoardSpec
from vbaa_calib.doctor.detector_test import Conditions, DrawnBoard, draw_board
from vbaa_calib.simulate.render.board import print_sheet

SPEC = BoardSpec(7, 5, 0.02, 0.014)
GOOD = Conditions(55, 0.8)

_sheet = functools.cache(print_sheet)


@functools.cache
def drawn(seed: int, conditions: Conditions = GOOD, spec: BoardSpec = SPEC) -> DrawnBoard:
    return draw_board(_sheet(spec), conditions, np.random.default_rng(seed), tilt_rad=0.6)


def picture(board: DrawnBoard, seed: int = 0) -> np.ndarray:
    return board.picture(np.random.default_rng(seed))


def smeared(board: DrawnBoard, motion_px: np.ndarray) -> DrawnBoard:
    """The picture of a camera that moved by (u, v) px at constant speed."""
    shifts = np.linspace(-0.5, 0.5, 41)[:, None] * motion_px
    size, keep = board.grey.shape[::-1], cv2.BORDER_REPLICATE
    moved = [cv2.warpAffine(board.grey, np.array([[1, 0, u], [0, 1, v]]), size, borderMode=keep) for u, v in shifts]
    return dataclasses.replace(board, grey=np.mean(moved, axis=0))
