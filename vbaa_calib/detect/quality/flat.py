"""The board rectified: its homography, grey levels, and patches that are not black where they should be."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from targets.board import AprilGrid, BoardWithIds
from vbaa_calib.detect.board.corners import BoardView
from vbaa_calib.detect.board.markers import marker_cells
from vbaa_calib.detect.board.view_quality import fixes_homography

_TEXELS = 12
"""Side of a square of the board laid flat."""
_MOST_BENT = 0.3
_FEWEST_MARKERS = 3
# of a black square, and of a marker with some of its black border
_MIDDLE, _MARKER = slice(_TEXELS // 4, _TEXELS - _TEXELS // 4), slice(_TEXELS // 6, _TEXELS - _TEXELS // 6)
_CLIPPED = 250
_WASHED_OUT, _BRIGHT, _COVERED = 0.5, 0.9, 0.25
_OUTLINE = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])


@dataclass(frozen=True, eq=False)
class BoardMap:
    """The board's homography (3, 3), without distortion: squares along x and y from the outline's corner, to px.

    Of an AprilGrid a square is a tag with half of the gap around it.
    """

    spec: BoardWithIds
    homography: np.ndarray

    @property
    def squares(self) -> tuple[int, int]:
        """How many along x and y."""
        return _counts(self.spec)

    def pixels(self, squares: np.ndarray) -> np.ndarray:
        """(N, 2) px of points (N, 2) in squares."""
        return cv2.perspectiveTransform(np.asarray(squares, float).reshape(1, -1, 2), self.homography)[0]

    @property
    def outline_px(self) -> np.ndarray:
        """(4, 2) px, the board's outline around."""
        return self.pixels(_OUTLINE * self.squares)

    @property
    def square_px(self) -> float:
        """Side of a square of the same area as the mean one, px."""
        area = abs(float(cv2.contourArea(self.outline_px.astype(np.float32))))
        return float(np.sqrt(area / np.prod(self.squares)))


def _counts(spec: BoardWithIds) -> tuple[int, int]:
    return (spec.columns, spec.rows) if isinstance(spec, AprilGrid) else (spec.squares_x, spec.squares_y)


def board_map(view: BoardView, spec: BoardWithIds) -> BoardMap | None:
    """From the corners, else, of a ChArUco board, from three or more markers; None if neither suffice, or distortion
    exceeds a third of a square."""
    columns, seen = spec.corner_columns, view.corners_px
    if isinstance(spec, AprilGrid):
        squares = (spec.lattice[view.ids] + 0.5 * spec.spacing) / (1.0 + spec.spacing)
    else:
        squares = np.stack([view.ids % columns, view.ids // columns], axis=1) + 1.0
    if len(squares) < 6 or not fixes_homography(squares):
        if isinstance(spec, AprilGrid):
            return None
        cells = marker_cells(np.arange(spec.marker_count), spec.squares_x, spec.starts_with_marker)
        order = np.argsort(spec.marker_ids)
        places = np.minimum(np.searchsorted(spec.marker_ids[order], view.marker_ids), len(order) - 1)
        known = spec.marker_ids[order][places] == view.marker_ids
        corners = cells[order[places[known]], None] + 0.5 + spec.marker_m / spec.square_m * (_OUTLINE - 0.5)
        squares, seen = corners.reshape(-1, 2), view.marker_corners_px[known].reshape(-1, 2)
        if len(squares) < _FEWEST_MARKERS * 4 or not fixes_homography(squares):
            return None
    found, _ = cv2.findHomography(squares, seen, cv2.LMEDS if len(squares) > 12 else 0)
    if found is None or not np.isfinite(found).all():
        return None
    outline = np.vstack([_OUTLINE, [0.5, 0.5]]) * _counts(spec)
    depth = found[2] @ np.column_stack([outline, np.ones(5)]).T
    if not (np.all(depth > 0) or np.all(depth < 0)):
        return None
    mapped = BoardMap(spec, found)
    off_px = np.median(np.linalg.norm(mapped.pixels(squares) - seen, axis=1))
    return mapped if off_px < _MOST_BENT * mapped.square_px else None


@dataclass(frozen=True, eq=False)
class Levels:
    """Grey levels on the board.

    Attributes
    ----------
    dark : (squares_y, squares_x) median of each black square's middle, and of the darkest third of each marker; NaN
        where the square is not wholly in the picture.
    black, white : what is usual: the median black square, and the brighter ones of the white squares' rims.
    """

    dark: np.ndarray
    black: float
    white: float


def levels(image: np.ndarray, where: BoardMap) -> Levels | None:
    """Of a picture (H, W) uint8; None where no whole square of either colour is in it."""
    columns, rows = where.squares
    from_texels = where.homography @ np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, _TEXELS]]) / _TEXELS
    flags, size = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP, (columns * _TEXELS, rows * _TEXELS)
    laid = cv2.warpPerspective(image, from_texels, size, flags=flags, borderMode=cv2.BORDER_CONSTANT)
    flat = laid.reshape(rows, _TEXELS, columns, _TEXELS).swapaxes(1, 2)
    nodes = np.stack(np.meshgrid(np.arange(columns + 1.0), np.arange(rows + 1.0)), axis=-1)
    pixels = where.pixels(nodes.reshape(-1, 2))
    last = np.array(image.shape[::-1]) - 1
    inside = np.all((pixels >= 0) & (pixels <= last), axis=1).reshape(nodes.shape[:2])
    whole = inside[:-1, :-1] & inside[1:, :-1] & inside[:-1, 1:] & inside[1:, 1:]
    is_grid = isinstance(where.spec, AprilGrid)  # all of whose squares hold a marker, and nearer to their rims
    is_black = ((np.indices(whole.shape).sum(axis=0) % 2 == 1) == where.spec.starts_with_marker) & (not is_grid)
    if not ((whole & is_black).any() or is_grid) or not (whole & ~is_black).any():
        return None
    middle, marker = (flat[:, :, part, part].reshape(*whole.shape, -1) for part in (_MIDDLE, _MARKER))
    dark = np.where(is_black, np.median(middle, axis=-1), np.percentile(marker, 100.0 / 6.0, axis=-1))
    rim = flat[:, :, (0, _TEXELS - 1) if is_grid else (1, _TEXELS - 2), _MIDDLE]
    black, white = np.median(dark[whole & (is_black | is_grid)]), np.percentile(rim[whole & ~is_black], 75.0)
    return Levels(np.where(whole, dark, np.nan), float(black), float(white))


def blemishes(seen: Levels) -> list[tuple[bool, int, tuple[float, float]]]:
    """Connected patches of squares without black: every square, or its marker, has black in its middle.

    Of each whether it is as bright as paper, a reflection (else something covers the board, or a shadow's edge), its
    number of squares, and its centre in squares along the board's x and y.
    """
    rise = (np.nan_to_num(seen.dark, nan=seen.black) - seen.black) / max(seen.white - seen.black, 1.0)
    count, labels = cv2.connectedComponents((rise > _WASHED_OUT).astype(np.uint8), connectivity=8)
    shining = (seen.dark >= _CLIPPED) | (rise >= _BRIGHT)
    found = []
    for label in range(1, count):
        rows, columns = np.nonzero(labels == label)
        centre = float(columns.mean()) + 0.5, float(rows.mean()) + 0.5
        found.append((bool(shining[rows, columns].mean() > _COVERED), len(rows), centre))
    return found
