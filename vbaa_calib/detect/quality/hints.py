"""Faults of a picture of the board, reported while it can be taken again."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from targets.board import AprilGrid, Board, BoardWithIds, corner_points
from vbaa_calib.core.errors import Diagnosis, Severity
from vbaa_calib.detect.board.corners import BoardView, detect_corners
from vbaa_calib.detect.board.diagnosis import explain_mismatch
from vbaa_calib.detect.board.markers import Markers, marker_cells
from vbaa_calib.detect.board.view_quality import fixes_homography

from .screen import corner_std_px
from .settings import QualitySettings

_OUTLINE = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])  # a unit square, around


@dataclass(frozen=True, eq=False)
class _BoardMap:
    """The board's homography (3, 3), without distortion, from squares along x and y from the outline's corner to px.

    Of an AprilGrid a square is a tag with half of the gap around it.
    """

    spec: BoardWithIds
    homography: np.ndarray

    @property
    def squares(self) -> tuple[int, int]:
        """Numbers of squares along x and y."""
        return _counts(self.spec)

    def pixels(self, squares: np.ndarray) -> np.ndarray:
        """(N, 2) px of points (N, 2) in squares."""
        return cv2.perspectiveTransform(np.asarray(squares, float).reshape(1, -1, 2), self.homography)[0]

    @property
    def outline_px(self) -> np.ndarray:
        """(4, 2) px corners of the board's outline, in order around it."""
        return self.pixels(_OUTLINE * self.squares)

    @property
    def square_px(self) -> float:
        """Side of a square of the same area as the mean one, px."""
        area = abs(float(cv2.contourArea(self.outline_px.astype(np.float32))))
        return float(np.sqrt(area / np.prod(self.squares)))


def _counts(spec: BoardWithIds) -> tuple[int, int]:
    return (spec.columns, spec.rows) if isinstance(spec, AprilGrid) else (spec.squares_x, spec.squares_y)


def _board_map(view: BoardView, spec: BoardWithIds) -> _BoardMap | None:
    """The map from the corners or, for a ChArUco board, from three or more markers; None if neither suffice, or if
    distortion exceeds a third of a square."""
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
        if len(squares) < QualitySettings.fewest_markers * 4 or not fixes_homography(squares):
            return None
    found, _ = cv2.findHomography(squares, seen, cv2.LMEDS if len(squares) > 12 else 0)
    if found is None or not np.isfinite(found).all():
        return None
    outline = np.vstack([_OUTLINE, [0.5, 0.5]]) * _counts(spec)
    depth = found[2] @ np.column_stack([outline, np.ones(5)]).T
    if not (np.all(depth > 0) or np.all(depth < 0)):
        return None
    mapped = _BoardMap(spec, found)
    off_px = np.median(np.linalg.norm(mapped.pixels(squares) - seen, axis=1))
    return mapped if off_px < QualitySettings.most_bent * mapped.square_px else None


_Levels = tuple[np.ndarray, float, float]
"""Grey levels on the board: (squares_y, squares_x) median of each black square's middle, and of the darkest third of
each marker, NaN where the square is not wholly in the picture; the usual black, the median of these; the usual white,
that of the brighter rims of white squares."""


def _levels(image: np.ndarray, where: _BoardMap) -> _Levels | None:
    """Grey levels of the board in a picture (H, W) uint8; None where it has no whole square of either colour."""
    columns, rows = where.squares
    texels = QualitySettings.texels
    # of a black square, and of a marker with some of its black border
    inner, bordered = slice(texels // 4, texels - texels // 4), slice(texels // 6, texels - texels // 6)
    from_texels = where.homography @ np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, texels]]) / texels
    flags, size = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP, (columns * texels, rows * texels)
    laid = cv2.warpPerspective(image, from_texels, size, flags=flags, borderMode=cv2.BORDER_CONSTANT)
    flat = laid.reshape(rows, texels, columns, texels).swapaxes(1, 2)
    nodes = np.stack(np.meshgrid(np.arange(columns + 1.0), np.arange(rows + 1.0)), axis=-1)
    pixels = where.pixels(nodes.reshape(-1, 2))
    last = np.array(image.shape[::-1]) - 1
    inside = np.all((pixels >= 0) & (pixels <= last), axis=1).reshape(nodes.shape[:2])
    whole = inside[:-1, :-1] & inside[1:, :-1] & inside[:-1, 1:] & inside[1:, 1:]
    is_grid = isinstance(where.spec, AprilGrid)  # all of whose squares hold a marker, and nearer to their rims
    is_black = ((np.indices(whole.shape).sum(axis=0) % 2 == 1) == where.spec.starts_with_marker) & (not is_grid)
    if not ((whole & is_black).any() or is_grid) or not (whole & ~is_black).any():
        return None
    middle, marker = (flat[:, :, part, part].reshape(*whole.shape, -1) for part in (inner, bordered))
    dark = np.where(is_black, np.median(middle, axis=-1), np.percentile(marker, 100.0 / 6.0, axis=-1))
    rim = flat[:, :, (0, texels - 1) if is_grid else (1, texels - 2), inner]
    black, white = np.median(dark[whole & (is_black | is_grid)]), np.percentile(rim[whole & ~is_black], 75.0)
    return np.where(whole, dark, np.nan), float(black), float(white)


def _blemishes(seen: _Levels) -> list[tuple[bool, int, tuple[float, float]]]:
    """Connected patches of squares without black: every square, or its marker, has black in its middle.

    For each patch: whether it is a reflection, as bright as paper (else an object or a shadow's edge covers the board);
    its number of squares; its centre in squares along the board's x and y.
    """
    dark, black, white = seen
    rise = (np.nan_to_num(dark, nan=black) - black) / max(white - black, 1.0)
    count, labels = cv2.connectedComponents((rise > QualitySettings.washed_out).astype(np.uint8), connectivity=8)
    shining = (dark >= QualitySettings.clipped_level) | (rise >= QualitySettings.paper)
    found = []
    for label in range(1, count):
        rows, columns = np.nonzero(labels == label)
        centre = float(columns.mean()) + 0.5, float(rows.mean()) + 0.5
        found.append((bool(shining[rows, columns].mean() > QualitySettings.covered), len(rows), centre))
    return found


def picture_hints(image: np.ndarray, view: BoardView, spec: BoardWithIds) -> list[Diagnosis]:
    """Faults of a picture (H, W) uint8 and its view, grave ones (corners missing or wrong) first."""
    where = _board_map(view, spec)
    seen = None if where is None else _levels(image, where)
    found = _blur(image, view, spec) + _light(view, seen)
    if where is not None:
        if seen is not None and not any(one.name in ("motion_blur", "out_of_focus", "overexposed") for one in found):
            found += _blemish(where, seen)
        found += _size(view, where) + _edge(view, where)
    if len(view.ids) < QualitySettings.least_corners:
        found += _missing(image, view)
    return sorted(found, key=lambda one: not one.grave)


def wrong_board(image: np.ndarray, view: BoardView, spec: BoardWithIds) -> Diagnosis | None:
    """Diagnosis of a picture (H, W) of another board, or a mirrored one; None if undetermined. Takes up to seconds."""
    markers = [Markers(view.marker_ids, view.marker_corners_px)]

    def detect(picture: np.ndarray, other: Board) -> tuple[np.ndarray, np.ndarray]:
        seen = detect_corners(picture, other)
        return seen.ids, seen.corners_px

    mismatch = explain_mismatch(lambda _: image, markers, spec, len(view.ids) >= QualitySettings.least_corners, detect)
    if mismatch is None or mismatch.name == "wrong_board":
        return mismatch and replace(mismatch, words=f"not the board named: {mismatch.words}")
    remedy = "switch off mirroring at the camera, or mirror the pictures back"
    return replace(mismatch, words="the board is found only in the mirror image", remedy=remedy)


def _missing(image: np.ndarray, view: BoardView) -> list[Diagnosis]:
    """The reason why the board is missing or incomplete, by the light and the edges of the whole picture."""
    low, high = np.percentile(image[::4, ::4], (5.0, 95.0)) if image.size else (0.0, 0.0)
    if view.marker_count:
        seen = f"{view.marker_count} marker{'s are' if view.marker_count > 1 else ' is'} seen"
        words = f"{seen} and {len(view.ids)} corners, at least {QualitySettings.least_corners} are needed"
        missing = Diagnosis("few_corners", words, "show more of the board, nearer, sharp and evenly lit", "wrong")
    elif high < 0.5 * QualitySettings.dark:
        words = f"the picture is dark (its brightest parts: {high:.0f} of 255)"
        return [Diagnosis("too_dark", words, "add light, or expose longer", "wrong")]
    elif low > 250.0:
        words = "nearly all of the picture is clipped white"
        return [Diagnosis("overexposed", words, "less light, or expose for a shorter time", "wrong")]
    else:
        remedy = "show the whole board, near enough and sharp"
        missing = Diagnosis("no_board", "no marker of the board is seen", remedy, "wrong")
    edges = _edge_blur(image)
    if edges is None or edges[0] < QualitySettings.unsharp_px:
        return [missing]
    long_px, short_px, direction_rad = edges
    if view.marker_count and long_px > QualitySettings.motion_edges * short_px:
        # without a marker the soft edges may belong to other things
        words = f"edges are blurred by {long_px:.1f} px {_direction(direction_rad)}, others are sharp"
        return [missing, Diagnosis("motion_blur", words, "if something moved: hold board and camera still")]
    if short_px < QualitySettings.unsharp_px:
        return [missing]
    words = f"nothing in the picture is sharp: its edges are blurred by {short_px:.1f} px or more"
    return [missing, Diagnosis("out_of_focus", words, "focus on the board, and hold it still", "wrong")]


def _blur(image: np.ndarray, view: BoardView, spec: BoardWithIds) -> list[Diagnosis]:
    quality = view.quality
    if quality is None or not np.isfinite(quality.mean_blur_px):
        return []
    limit = QualitySettings.most_blur_per_gap * quality.gap_px
    ellipse = _blur_ellipse(image, view, spec)
    severity: Severity = "wrong" if quality.mean_blur_px > limit else "doubt"
    long_px, short_px, direction_rad = ellipse or (0.0, 0.0, 0.0)
    if long_px > max(QualitySettings.motion * short_px, QualitySettings.motion_px):
        smear = QualitySettings.smear_per_std * np.sqrt(max(long_px**2 - short_px**2, 0.0))
        words = f"moved by about {smear:.0f} px {_direction(direction_rad)} while it was taken"
        return [Diagnosis("motion_blur", words, "hold board and camera still, or add light", severity)]
    if quality.mean_blur_px > QualitySettings.near_limit * limit:
        words = f"blurred by {quality.mean_blur_px:.1f} px, {limit:.1f} px is the most that the corners bear"
        remedy = "focus on the board (then leave the focus alone), or show it larger"
        return [Diagnosis("out_of_focus", words, remedy, severity)]
    return []


def _direction(angle_rad: float) -> str:
    """A direction in words, for an angle in the picture (clockwise)."""
    names = ("sideways", "along the diagonal \\", "up or down", "along the diagonal /")
    return names[round(angle_rad / (np.pi / 4.0)) % 4]


def _light(view: BoardView, seen: _Levels | None) -> list[Diagnosis]:
    quality = view.quality
    if quality is None or not np.isfinite(quality.contrast):
        return []
    if quality.saturated > QualitySettings.clipped and quality.edge_level > QualitySettings.grown:
        words = f"overexposed: {100 * quality.saturated:.0f} % of the white is clipped and has grown over the edges"
        return [Diagnosis("overexposed", words, "less light, or expose for a shorter time", "wrong")]
    noisy = corner_std_px(view) > QualitySettings.noisy_px
    uncertain = f", its corners are uncertain by {corner_std_px(view):.2f} px" if noisy else ""
    differ = f"black and white differ by {quality.contrast:.0f} grey levels{uncertain}"
    if seen is not None and seen[2] < QualitySettings.dark and (noisy or quality.contrast < QualitySettings.pale):
        return [Diagnosis("too_dark", f"dark: {differ}", "add light, or expose longer")]
    if quality.contrast < QualitySettings.pale:
        veiled = seen is not None and seen[1] > QualitySettings.bright - QualitySettings.pale
        remedy = "turn the board out of the light's reflection, clean the lens" if veiled else "light the board better"
        return [Diagnosis("pale", f"pale: {differ}", remedy)]
    if noisy:
        return [Diagnosis("noisy", f"noisy: {differ}", "add light, or show the board larger")]
    return []


def _blemish(where: _BoardMap, seen: _Levels) -> list[Diagnosis]:
    """The largest patch of the board that has lost its black."""
    patch = max(_blemishes(seen), key=lambda one: one[:2], default=None)
    if patch is None or seen[2] - seen[1] < 0.5 * QualitySettings.pale:
        return []
    shining, squares, centre = patch
    place = _place(where, np.array(centre))
    many = f"{squares} square{'s' if squares > 1 else ''}"
    severity: Severity = "wrong" if squares > 0.25 * seen[0].size else "doubt"
    if shining:
        words = f"light is reflected {place} of the board: {many} washed out"
        return [Diagnosis("reflection", words, "turn the board or move the lamp until the patch is gone", severity)]
    words = f"something covers the board {place}: {many} not black where it should be"
    return [Diagnosis("covered", words, "keep fingers and things off the squares", severity)]


def _place(where: _BoardMap, centre: np.ndarray) -> str:
    """A place on the board as it appears in the picture: "in the upper left"."""
    outline, point = where.outline_px, where.pixels(centre)[0]
    low, high = outline.min(axis=0), outline.max(axis=0)
    u, v = (3.0 * (point - low) / np.maximum(high - low, 1e-9)).astype(int).clip(0, 2)
    names = (
        ("in the upper left", "at the top", "in the upper right"),
        ("at the left", "in the middle", "at the right"),
        ("in the lower left", "at the bottom", "in the lower right"),
    )
    return names[v][u]


def _size(view: BoardView, where: _BoardMap) -> list[Diagnosis]:
    width, height = view.image_size
    share = where.square_px**2 * np.prod(where.squares) / (width * height)
    if share >= QualitySettings.small_share and where.square_px >= QualitySettings.small_square_px:
        return []
    words = f"the board is small: {100 * share:.0f} % of the picture, squares of {where.square_px:.0f} px"
    return [Diagnosis("board_small", words, "bring it nearer, until it fills a third of the picture or more")]


def _edge(view: BoardView, where: _BoardMap) -> list[Diagnosis]:
    """Diagnosis of a board that crosses the picture's border, with fewer than half of its corners in view."""
    low, high = where.outline_px.min(axis=0), where.outline_px.max(axis=0) - view.image_size
    beyond = np.array([-low[0], high[0], -low[1], high[1]])
    count, seen = where.spec.corner_count, len(view.ids)
    if beyond.max() <= 0.0 or seen / count >= QualitySettings.few_share:
        return []
    side = ("left", "right", "top", "bottom")[int(beyond.argmax())]
    words = f"the board leaves the picture at the {side}: {seen} of {count} corners are seen"
    return [Diagnosis("board_outside", words, "bring it further in")]


def _edge_blur(image: np.ndarray) -> tuple[float, float, float] | None:
    """Blur of the strong edges of a picture (H, W) uint8, at half its size; None without any. Directions: k·π/4.

    Returns its largest and its smallest standard deviation, px, pixel's area included, and the direction of the
    largest, rad, from u towards v.

    Blurred once more by s, the slope of an edge of blur b falls by √(1 + s²/b²).
    """
    if min(image.shape) < 32:
        return None
    half = cv2.resize(image, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA).astype(np.float32)
    first = cv2.GaussianBlur(half, (0, 0), QualitySettings.smoothed_px)
    again = cv2.GaussianBlur(first, (0, 0), QualitySettings.again_px)
    slope_u, slope_v, after_u, after_v = (
        cv2.Sobel(smooth, cv2.CV_32F, *axis, scale=0.125) for smooth in (first, again) for axis in ((1, 0), (0, 1))
    )
    slope, after = cv2.magnitude(slope_u, slope_v), cv2.magnitude(after_u, after_v)
    chosen = slope > QualitySettings.least_slope
    if chosen.sum() < QualitySettings.edge_pixels:
        return None
    slopes = slope[chosen]
    spread = QualitySettings.again_px / np.sqrt(np.maximum((slopes / np.maximum(after[chosen], 1e-3)) ** 2 - 1.0, 1e-2))
    own = 2.0 * np.sqrt(np.maximum(spread**2 - QualitySettings.smoothed_px**2, 1.0 / 48.0))
    count = 4  # of directions
    bins = np.round(np.arctan2(slope_v[chosen], slope_u[chosen]) / (np.pi / count)).astype(int) % count
    known = {}
    for one in range(count):
        within = bins == one
        # blur lowers an edge's slope and leaves their sum
        if slopes[within].sum() > QualitySettings.direction_share * slopes.sum():
            crest = slopes[within] > QualitySettings.crest * np.percentile(slopes[within], 99.0)
            known[one] = float(np.median(own[within][crest]))
    most = max(known, key=lambda one: known[one])
    return known[most], min(known.values()), most * np.pi / count


def _blur_ellipse(image: np.ndarray, view: BoardView, spec: BoardWithIds) -> tuple[float, float, float] | None:
    """Blur from a view with its quality and the picture (H, W) uint8; None unless both directions are seen.

    Edges determine the blur along the squares' sides, b₁ and b₂, not along diagonals. With correlation ρ the grey level
    at a corner is off the mean by asin(ρ) / π of the contrast, up at every other corner and down at the rest.
    """
    quality = view.quality
    if quality is None or not np.isfinite([*quality.blur_px, quality.contrast]).all() or quality.contrast <= 0.0:
        return None
    if not view.marker_count or len(view.ids) < QualitySettings.ellipse_corners or quality.collinear:
        return None
    axes = _axes(view, corner_points(spec)[view.ids, :2])
    # blur_px[0] is seen at edges that run along the board's y: it goes along x, across them
    wide, high = quality.blur_px
    both = _correlation(image, view, spec, quality.contrast) * wide * high
    values, vectors = np.linalg.eigh(axes @ np.array([[wide**2, both], [both, high**2]]) @ axes.T)
    direction = float(np.arctan2(*vectors[::-1, 1]))
    return float(np.sqrt(values[1])), float(np.sqrt(max(values[0], 1.0 / 12.0))), direction


def _axes(view: BoardView, corners_m: np.ndarray) -> np.ndarray:
    """Unit vectors (2, 2), as columns, of the mean directions across the board's edges; corners_m : (N, 2) on the
    board."""
    about_m, about_px = corners_m - corners_m.mean(axis=0), view.corners_px - view.corners_px.mean(axis=0)
    typical = np.linalg.lstsq(about_m, about_px, rcond=None)[0].T
    across = np.linalg.inv(typical).T
    # the blur across edges is that along the edges' normals; back from normals to axes
    return np.linalg.inv((across / np.linalg.norm(across, axis=0)).T)


def _correlation(image: np.ndarray, view: BoardView, spec: BoardWithIds, contrast: float) -> float:
    """Correlation of the blurs along the board's x and y."""
    columns = spec.corner_columns
    # whether the square before the corner, left and above, is black
    after_black = ((view.ids % columns + view.ids // columns) % 2 == 0) == spec.starts_with_marker
    where = view.corners_px.astype(np.float32).reshape(1, -1, 2)
    grey = cv2.remap(image, where, np.empty(0), cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)[0].astype(float)
    if after_black.all() or not after_black.any():
        return 0.0
    # more than half of the contrast up: only noise or a covered corner makes it so
    lift = (np.median(grey[after_black]) - np.median(grey[~after_black])) / (2.0 * contrast)
    return float(np.sin(np.clip(np.pi * lift, -1.2, 1.2)))
