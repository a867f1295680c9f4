"""Sheets of boards with markers, drawn independently of the product's sheets, and pictures of them."""

from __future__ import annotations

import cv2
import numpy as np

from targets.board import AprilGrid, BoardSpec, opencv_board

TAG_PX, PX = 80, 50
"""Pixels of a drawn tag and of a drawn square."""
K = np.array([[700.0, 0, 319.5], [0, 700, 239.5], [0, 0, 1]])


def charuco_sheet(spec: BoardSpec) -> tuple[np.ndarray, float]:
    """The print, white around it, and its pixels per metre; the board begins half a square from the border."""
    size = ((spec.squares_x + 1) * PX, (spec.squares_y + 1) * PX)
    return opencv_board(spec).generateImage(size, marginSize=PX // 2), PX / spec.square_m


def grid_sheet(spec: AprilGrid, turns: int = 2) -> tuple[np.ndarray, float]:
    """As `charuco_sheet`; the tags turned by quarter turns, by two as Kalibr prints them."""
    family = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, spec.dictionary))
    gap = round(spec.spacing * TAG_PX)
    step, margin = TAG_PX + gap, TAG_PX // 2
    size = ((spec.rows - 1) * step + TAG_PX + 2 * margin, (spec.columns - 1) * step + TAG_PX + 2 * margin)
    sheet = np.full(size, 255, np.uint8)
    for number in range(spec.rows * spec.columns):
        row, column = spec.rows - 1 - number // spec.columns, number % spec.columns
        mark = cv2.aruco.generateImageMarker(family, spec.first_id + number, TAG_PX, borderBits=spec.border)
        top, left = margin + row * step, margin + column * step
        sheet[top : top + TAG_PX, left : left + TAG_PX] = np.rot90(mark, turns)
        for y in (top - gap, top + TAG_PX):
            for x in (left - gap, left + TAG_PX):
                sheet[y : y + gap, x : x + gap] = 0
    return sheet, TAG_PX / spec.tag_m


def view(sheets: list[tuple[np.ndarray, float]], seed: int, zoom: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """Sheets side by side in a picture, and the map (3, 3) from the first board's plane, m, to its pixels."""
    rng = np.random.default_rng(seed)
    turn = cv2.Rodrigues(np.append(rng.uniform(-0.5, 0.5, 2), rng.uniform(-0.4, 0.4)))[0]
    wide = sum(sheet.shape[1] / scale for sheet, scale in sheets)
    high = max(sheet.shape[0] / scale for sheet, scale in sheets)
    far = max(1.15 * wide * K[0, 0] / 640, 1.2 * high * K[0, 0] / 480) / zoom
    shift = np.array([0, 0, far]) - turn @ np.array([wide / 2, high / 2, 0])
    plane = K @ np.column_stack([turn[:, 0], turn[:, 1], shift])
    # half a square, or half a tag, of white
    margin = (TAG_PX if sheets[0][0].shape[0] % PX else PX) / 2
    large, left, first = np.full((960, 1280), 150, np.uint8), 0.0, np.eye(3)
    for sheet, scale in sheets:
        on_sheet = np.array([[1 / scale, 0, left + 0.5 / scale], [0, 1 / scale, 0.5 / scale], [0, 0, 1]])
        doubled = np.array([[2, 0, 0.5], [0, 2, 0.5], [0, 0, 1.0]])
        place = doubled @ plane @ on_sheet
        seen = cv2.warpPerspective(np.full_like(sheet, 255), place, (1280, 960))
        large = np.where(seen > 127, cv2.warpPerspective(sheet, place, (1280, 960)), large)
        begin = margin / scale
        first = first if left else plane @ np.array([[1, 0, begin], [0, 1, begin], [0, 0, 1]])
        left += sheet.shape[1] / scale
    grey = cv2.GaussianBlur(cv2.resize(large, (640, 480), interpolation=cv2.INTER_AREA), (0, 0), 0.6)
    return np.clip(20 + 0.8 * grey + rng.normal(0, 1.5, grey.shape), 0, 255).astype(np.uint8), first
