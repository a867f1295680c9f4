"""A picture against the bare board that it shows, and profiles across a line in front of it."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.optimize import minimize_scalar

from targets.board import AprilGrid, BoardWithIds, opencv_board
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
    """A picture in units of the print, 0 black and 1 white, whatever the light. Arrays (H, W) float32.

    pattern : the bare board, blurred like the picture; NaN off the board. slope : of the pattern, 1/px.
    noise : std of `seen - pattern`: grain, and at edges their uncertainty. blur_px : std of the blur.
    """

    seen: np.ndarray
    pattern: np.ndarray
    slope: np.ndarray
    noise: np.ndarray
    blur_px: float


def board_picture(image: np.ndarray, camera: Camera, T_camera_board: Pose, spec: BoardWithIds) -> BoardPicture | None:
    """Compare an (H, W) picture with the board that it shows at a known pose; None where no contrast is left of it."""
    grey = np.asarray(image, np.float32)
    sharp, inside = _warped(camera, T_camera_board, spec)
    if not inside.any():
        return None
    # a square's side, or a tag's with its gap, by the outline's area in the picture
    squares = (spec.columns, spec.rows) if isinstance(spec, AprilGrid) else (spec.squares_x, spec.squares_y)
    window = int(_WINDOW_SQUARES * np.sqrt(inside.sum() / np.prod(squares))) | 1
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


def _pattern_texture(spec: BoardWithIds, texels: int = _TEXELS) -> np.ndarray:
    """The print, (H, W) float32, 1 white and 0 black, with about so many texels to a square or a tag."""
    if isinstance(spec, AprilGrid):
        return (spec.drawing(texels - texels % spec.modules) > 0).astype(np.float32)
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


def _warped(camera: Camera, T_camera_board: Pose, spec: BoardWithIds) -> tuple[np.ndarray, np.ndarray]:
    """The sharp pattern averaged over each pixel, (H, W) float32, and which pixels lie on the board."""
    width, height = camera.image_size
    pixels = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).astype(float)
    points, valid = camera.unproject_normalized(pixels)
    rotation = T_camera_board.rotation
    back = np.linalg.inv(np.stack([rotation[:, 0], rotation[:, 1], T_camera_board.translation_m], axis=1))
    x, y, w = np.moveaxis(points @ back[:, :2].T + back[:, 2], -1, 0)
    valid &= w > 0
    place = (np.stack([x, y], axis=-1) / np.where(valid, w, 1.0)[..., None] - spec.outline_m[0]) / spec.size_m
    place = np.where(valid[..., None], place, -1.0)
    inside = valid & (place > 0).all(axis=-1) & (place < 1).all(axis=-1)
    texture = _pattern_texture(spec)
    fine_size = (width * _SUBPIXELS, height * _SUBPIXELS)
    texels = cv2.resize(
        (place * texture.shape[::-1] - 0.5).astype(np.float32), fine_size, interpolation=cv2.INTER_LINEAR
    )
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


_GAUSS_NEWTON = 5
_CAPTURE_PX = 2.5
_LEAST_FLANK, _LEAST_GRAIN = 3, 0.01
_BLACK = 0.08
"""What black print reflects, in units of the print: a shadow dims white, and black hardly."""
_EDGE_DOUBT_PX, _EDGE_REACH = 0.5, 1.5
"""Where the line crosses an edge of the pattern, the edge's place is in doubt by so much, over so many widths."""


@dataclass(frozen=True, eq=False)
class Profiles:
    """Raw pixels along N columns (or rows) that a guide crosses, T of each, in units of the board's print.

    crossing_px : (N, 2) where the guide crosses the middle of each column.
    axis : the pixel coordinate along the profiles: 1 (v) where the guide runs sideways, 0 (u) where upward.
    stretch : (N,) length along the profile per length across the line, at most about √2.
    across : (N, T) place along the profile from the guide, px.
    seen, behind : (N, T) picture, and what is behind the line, as far as it is known.
    slope, noise : (N, T) the pattern's, 1/px; standard deviation of `seen - behind`, inf outside the picture.
    """

    crossing_px: np.ndarray
    axis: int
    stretch: np.ndarray
    across: np.ndarray
    seen: np.ndarray
    behind: np.ndarray
    slope: np.ndarray
    noise: np.ndarray


@dataclass(frozen=True)
class Paint:
    """The line: brightness in units of the print, how much of a pixel it covers at its middle, its Gaussian width."""

    brightness: float
    cover: float
    scale_px: float


@dataclass(frozen=True, eq=False)
class _Fitted:
    """Lines fitted to N profiles: centre from the guide, px; cover over the expected; rms over noise. All (N,)."""

    centre: np.ndarray
    centre_std: np.ndarray
    amplitude: np.ndarray
    amplitude_std: np.ndarray
    chi: np.ndarray


def profiles(picture: BoardPicture, guide_px: np.ndarray, core_px: float) -> Profiles:
    """Cut the columns (rows) out of a picture along a guide (K, 2), one column a pixel.

    Off the board, where the pattern is NaN, what is behind the line is a slope of light through its flanks, which begin
    `core_px` off the guide.
    """
    axis = 1 if np.ptp(guide_px[:, 0]) >= np.ptp(guide_px[:, 1]) else 0
    run = guide_px[:, 1 - axis]
    order = np.argsort(run, kind="stable")
    columns = np.arange(np.ceil(run.min()), np.floor(run.max()) + 1)
    cross = np.interp(columns, run[order], guide_px[order, axis])
    slope = np.gradient(cross) if len(cross) > 1 else np.zeros(1)
    half = int(np.ceil(2.0 * core_px + 4.0))
    place = np.round(cross)[:, None] + np.arange(-half, half + 1)
    where = np.stack(np.broadcast_arrays(columns[:, None], place)[:: 1 if axis == 1 else -1]).astype(int)
    size = np.array(picture.seen.shape[::-1])[:, None, None]
    inside = ((where >= 0) & (where < size)).all(axis=0)
    u, v = np.clip(where, 0, size - 1)
    across = place - cross[:, None]
    grey, known, noise, edge = (
        values[v, u].astype(float) for values in (picture.seen, picture.pattern, picture.noise, picture.slope)
    )
    edge = np.where(np.isnan(known), 0.0, edge)
    behind, grain = _with_flanks(grey, known, inside & (np.abs(across) > core_px), across, noise)
    crossing = np.stack([columns, cross][:: 1 if axis == 1 else -1], axis=1)
    grain = np.where(inside & np.isfinite(behind), grain, np.inf)
    return Profiles(crossing, axis, np.sqrt(1.0 + slope**2), across, grey, behind, edge, grain)


def _with_flanks(
    grey: np.ndarray, known: np.ndarray, beside: np.ndarray, across: np.ndarray, noise: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """`known` (N, T) with NaN replaced by a straight line through the same profile's flanks, and the noise there."""
    off_board = np.isnan(known)
    weight = (beside & off_board).astype(float)
    sides = [weight * (across < 0), weight * (across > 0)]
    counts = [side.sum(axis=1) for side in sides]
    left, right = ((side * grey).sum(axis=1) / np.maximum(n, 1) for side, n in zip(sides, counts, strict=True))
    total = weight.sum(axis=1, keepdims=True)
    middle, mean = ((weight * values).sum(axis=1, keepdims=True) / np.maximum(total, 1.0) for values in (across, grey))
    spread = (weight * (across - middle) ** 2).sum(axis=1, keepdims=True)
    slope = (weight * (across - middle) * (grey - mean)).sum(axis=1, keepdims=True) / np.maximum(spread, 1.0)
    line = mean + slope * (across - middle)
    grain = np.sqrt((weight * (grey - line) ** 2).sum(axis=1, keepdims=True) / np.maximum(total - 2, 1.0))
    # an edge of the sheet between the flanks is no straight slope of light
    doubt = np.hypot(grain + _LEAST_GRAIN, (left - right)[:, None])
    enough = (np.min(counts, axis=0) >= _LEAST_FLANK)[:, None]
    return np.where(off_board, np.where(enough, line, np.nan), known), np.where(off_board, doubt, noise)


def fit(
    cut: Profiles, paint: Paint, start: float | np.ndarray = 0.0, steps: int = _GAUSS_NEWTON, wary: bool = False
) -> _Fitted:
    """Weighted Gauss–Newton for the line's centre and cover, with the light's level and slope, all profiles at once.

    At each pixel the line adds its cover times (its brightness − what is behind).

    start : (N,) px from the guide. wary : less weight where the guide crosses edges of the pattern: the picture has the
        blur of the product of line and edge, the model the product of their blurs.
    """
    width = paint.scale_px * cut.stretch[:, None]
    variance = cut.noise**2
    if wary:
        near = np.exp(-0.5 * (cut.across / (_EDGE_REACH * width)) ** 2)
        variance = variance + (_EDGE_DOUBT_PX * paint.cover * cut.slope * near) ** 2
    weight = 1.0 / variance
    usable = weight > 0
    behind = np.where(usable, np.nan_to_num(cut.behind), 0.0)
    change = np.where(usable, cut.seen - behind, 0.0)
    against = paint.cover * (paint.brightness - behind)
    light = behind + _BLACK
    reach = np.abs(cut.across).max()
    centre = np.zeros(len(cut.stretch)) + start
    for _ in range(max(steps, 1)):
        t = (cut.across - centre[:, None]) / width
        line = np.exp(-0.5 * t**2) * against
        basis = np.stack([light, light * cut.across / reach, line, line * t / width], axis=-1)
        weighted = basis * weight[..., None]
        information = np.swapaxes(weighted, 1, 2) @ basis
        information += np.eye(4) * (1e-9 * np.trace(information, axis1=1, axis2=2)[:, None, None] + 1e-9)
        inverse = np.linalg.inv(information)
        found = (inverse @ (np.swapaxes(weighted, 1, 2) @ change[..., None]))[..., 0]
        amplitude = np.where(np.abs(found[:, 2]) > 0.05, found[:, 2], 0.05)
        if steps:
            centre = np.clip(centre + np.clip(found[:, 3] / amplitude, -1.0, 1.0), -reach, reach)
    residual = np.where(usable, change - (basis @ found[..., None])[..., 0], 0.0) * np.sqrt(weight)
    freedom = np.maximum(usable.sum(axis=1) - 4, 1)
    std = np.sqrt(np.clip(np.diagonal(inverse, axis1=1, axis2=2), 0.0, None))
    chi = np.sqrt((residual**2).sum(axis=1) / freedom)
    return _Fitted(centre, std[:, 3] / np.abs(amplitude), found[:, 2], std[:, 2], chi)


def rough_centres(cut: Profiles, paint: Paint) -> np.ndarray:
    """(N,) where along each profile the line fits best, to half a pixel, within a few pixels of the guide."""
    candidates = np.arange(-_CAPTURE_PX, _CAPTURE_PX + 0.1, 0.5)
    tried = [fit(cut, paint, place, steps=0) for place in candidates]
    gain = [np.where(one.amplitude > 0, one.amplitude / np.maximum(one.amplitude_std, 1e-9), 0.0) for one in tried]
    return candidates[np.argmax(gain, axis=0)]


def fit_paint(cut: Profiles, paint: Paint) -> Paint:
    """The brightness and cover of the line on the guide from all profiles together; then its width."""
    usable = np.isfinite(cut.noise)
    behind = np.where(usable, np.nan_to_num(cut.behind), 0.0)
    shape = np.exp(-0.5 * (cut.across / (paint.scale_px * cut.stretch[:, None])) ** 2)
    near = usable & (shape > 0.1)
    basis = np.stack([shape[near], -(shape * behind)[near]], axis=1) / cut.noise[near][:, None]
    change = (cut.seen - behind)[near] / cut.noise[near]
    weight = np.ones(len(change))
    for _ in range(4):
        found = np.linalg.lstsq(basis * weight[:, None], change * weight, rcond=None)[0]
        residual = np.abs(change - basis @ found)
        weight = np.sqrt(np.minimum(1.0, 2.0 * float(np.median(residual)) / np.maximum(residual, 1e-9)))
    cover = float(found[1])
    brightness = float(found[0]) / cover if cover > 1e-3 else paint.brightness
    if cover < 1e-3:
        return Paint(brightness, cover, paint.scale_px)

    def misfit(scale: float) -> float:
        return float(np.median(fit(cut, Paint(brightness, cover, scale), steps=2).chi))

    bounds = 0.5 * paint.scale_px, 2.0 * paint.scale_px
    best = minimize_scalar(misfit, bounds=bounds, method="bounded", options={"xatol": 0.02})
    return Paint(brightness, cover, float(best.x))


BESIDE = 2.5
"""How much wider than usual the profiles are cut to look for a shadow."""
_STRETCHES, _LEAST_WHITE = 6, 4
_WHITE, _EVEN = 0.9, 0.05


def darkest_beside(cut: Profiles, core_px: float) -> float:
    """By how much the darkest band beside a line dims white print, in units of the print: median of a few stretches.

    core_px : how far the line itself reaches to either side.
    """
    white = np.isfinite(cut.noise) & (cut.slope < _EVEN) & (cut.behind > _WHITE) & (np.abs(cut.across) > core_px)
    parts = (np.array_split(values, _STRETCHES) for values in (white, np.round(cut.across), cut.behind - cut.seen))
    depths = []
    for chosen, place, dimmed in zip(*parts, strict=True):
        if chosen.any():
            column = (place[chosen] - place[chosen].min()).astype(int)
            count = np.bincount(column)
            means = np.bincount(column, dimmed[chosen]) / np.maximum(count, 1)
            depths.append(float(means[count >= _LEAST_WHITE].max(initial=0.0)))
    return float(np.median(depths)) if depths else 0.0
