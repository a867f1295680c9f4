"""Where the whole board lies in a picture of which some corners or markers are known, and the board laid flat."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from targets.board import BoardSpec
from vbaa_calib.detect.board.corners import BoardView
from vbaa_calib.detect.board.layout import marker_cells
from vbaa_calib.detect.board.view_quality import fixes_homography

TEXELS = 12
"""Side of a square of the board laid flat."""
_MOST_BENT = 0.3
_FEWEST_MARKERS = 3


@dataclass(frozen=True, eq=False)
class BoardMap:
    """The plane map from the board to a picture; the lens is taken as ideal.

    Attributes
    ----------
    homography : (3, 3) from squares along the board's x and y, origin at its outline's first corner, to px.
    """

    homography: np.ndarray

    def pixels(self, squares: np.ndarray) -> np.ndarray:
        """(N, 2) px of points (N, 2) in squares."""
        return cv2.perspectiveTransform(np.asarray(squares, float).reshape(1, -1, 2), self.homography)[0]

    def outline_px(self, spec: BoardSpec) -> np.ndarray:
        """(4, 2) px, the board's outline around."""
        return self.pixels(np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * (spec.squares_x, spec.squares_y))

    def square_px(self, spec: BoardSpec) -> float:
        """Side of a square of the same area as the mean one, px."""
        area = abs(float(cv2.contourArea(self.outline_px(spec).astype(np.float32))))
        return float(np.sqrt(area / (spec.squares_x * spec.squares_y)))

    def flat(self, image: np.ndarray, spec: BoardSpec) -> np.ndarray:
        """(squares_y, squares_x, TEXELS, TEXELS) uint8, every square seen face on; 0 beyond the picture."""
        size = (spec.squares_x * TEXELS, spec.squares_y * TEXELS)
        from_texels = self.homography @ np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, TEXELS]]) / TEXELS
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        laid = cv2.warpPerspective(image, from_texels, size, flags=flags, borderMode=cv2.BORDER_CONSTANT)
        return laid.reshape(spec.squares_y, TEXELS, spec.squares_x, TEXELS).swapaxes(1, 2)


def board_map(view: BoardView, spec: BoardSpec) -> BoardMap | None:
    """From the corners where they fix it, else from three or more markers; None where neither do, or where the lens
    bends the board by more than a third of a square."""
    columns = spec.squares_x - 1
    squares = np.stack([view.ids % columns, view.ids // columns], axis=1) + 1.0
    seen = view.corners_px
    if len(squares) < 6 or not fixes_homography(squares):
        squares, seen = _marker_corners(view, spec)
        if len(squares) < _FEWEST_MARKERS * 4 or not fixes_homography(squares):
            return None
    found, _ = cv2.findHomography(squares, seen, cv2.LMEDS if len(squares) > 12 else 0)
    if found is None or not np.isfinite(found).all():
        return None
    outline = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0.5, 0.5]]) * (spec.squares_x, spec.squares_y)
    depth = found[2] @ np.column_stack([outline, np.ones(5)]).T
    if not (np.all(depth > 0) or np.all(depth < 0)):
        return None
    mapped = BoardMap(found)
    off_px = np.median(np.linalg.norm(mapped.pixels(squares) - seen, axis=1))
    return mapped if off_px < _MOST_BENT * mapped.square_px(spec) else None


def _marker_corners(view: BoardView, spec: BoardSpec) -> tuple[np.ndarray, np.ndarray]:
    """Corners of the board's markers, in squares (N, 2) and px (N, 2)."""
    cells = marker_cells(
        spec.squares_x, spec.legacy_pattern and spec.squares_y % 2 == 0, spec.squares_x * spec.squares_y // 2
    )
    known = view.marker_ids < len(cells)
    half = 0.5 * spec.marker_m / spec.square_m
    around = half * np.array([[-1.0, -1], [1, -1], [1, 1], [-1, 1]])
    squares = cells[view.marker_ids[known], None] + 0.5 + around
    return squares.reshape(-1, 2), view.marker_corners_px[known].reshape(-1, 2)
