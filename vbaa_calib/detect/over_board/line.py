"""The antenna in front of a printed board: centreline and ends, measured where the antenna differs from the print.

In front of squares of its own brightness the antenna is invisible and gets no points. The bare board is predicted from
the picture itself, and profiles across the line are compared with it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.polynomial import Polynomial
from numpy.polynomial.polynomial import polyval

from targets.board import AprilGrid, BoardWithIds, opencv_board
from vbaa_calib.camera import Camera
from vbaa_calib.core.robust import mad_std
from vbaa_calib.geometry import Pose


@dataclass(frozen=True)
class _OverBoardSettings:
    """Thresholds that distinguish the antenna from the board behind it, and of the measurement of its line and ends."""

    texels: int = 192  # of a square: a marker's bit begins within 1/400 of a square of its place
    subpixels: int = 3  # of a pixel, each way, over which the print is averaged
    window_squares: float = 3.0  # side of the window over which black and white levels count as alike
    least_contrast: float = 12.0  # of white and black, grey levels
    covered_std: float = 5.0  # standard deviations from which a pixel says nothing of the levels
    steep: float = 0.08  # slope of the pattern, 1/px, from which a pixel is on an edge
    flat: float = 0.01  # slope up to which it is on none
    steps: int = 5  # Gauss–Newton steps for a profile
    capture_px: float = 2.5  # distance from the guide within which a profile's line is sought
    least_flank: int = 3  # pixels on either side of the line in a profile
    least_grain: float = 0.01  # noise of the print, in units of the print
    black: float = 0.08  # what black print reflects, in units of the print: a shadow hardly dims it
    edge_doubt_px: float = 0.5  # error of a pattern edge's place where the line crosses it
    edge_reach: float = 1.5  # reach of that error to either side, in widths of the line
    shadow_width: float = 2.5  # how much wider than usual the profiles are cut to look for a shadow
    stretches: int = 6  # stretches along the line in which the brightness is compared
    least_white: int = 4  # white pixels of a column in a stretch
    white: float = 0.9  # reflectance from which print counts as white
    even: float = 0.05  # slope of the pattern, 1/px, up to which a white pixel is undisturbed
    stands_out: float = 5.0  # ridge response of a candidate pixel over its noise
    most_candidates: int = 20000  # most candidate pixels
    angles: int = 360  # angles of the Hough transform
    bin_m: float = 1e-3  # width of its bins on the board
    least_bin_px: float = 2.0  # width of its bins in the picture, least
    bands: tuple[float, ...] = (
        6.0,
        3.0,
        1.5,
    )  # half widths, in bins, of the band from which a path is fitted again
    step_px: float = 2.0  # from profile to profile along the path
    least_steps: int = 12  # fewest steps of a path
    least_visible: float = 0.5  # part of the visible steps along the line that must show it
    seen_ratio: float = 6.0  # amplitude over its standard deviation from which a profile shows the line
    faintest: float = 0.12  # cover: less is a shadow, a scratch or a misfit of the print
    worst_centre_px: float = 0.5  # standard deviation of a profile's centre that still counts
    disturbed: float = 2.0  # ratio to the usual residual beyond which a profile shows something else, too
    growth: float = 0.25  # part of its length by which the path is extended in a round
    growths: int = 8  # rounds of extending the path, most
    endward: float = 0.03  # part of the length near an end in which profiles say where it is
    fewest_points: int = 30  # fewest points of the line
    reweightings: int = 4  # reweightings in the robust fit of a path
    end_step_px: float = 0.1  # step between the places that are compared for an end
    end_std_px: float = 0.3  # least standard deviation of an end: its cut and its reflections are unknown
    presence_std: float = 0.15  # standard deviation of the line's amplitude from profile to profile
    worst_surprise: float = 9.0  # cap on a column's squared deviation in the likelihood of an end
    border_px: float = 3.0  # distance from the picture's border at which an end is none
    amplitudes: tuple[float, ...] = 0.5, 1.6  # range over the expected one in which a profile shows the line


@dataclass(frozen=True, eq=False)
class _BoardPicture:
    """A picture normalised to the print, 0 black and 1 white, independent of the light. Arrays (H, W) float32.

    pattern : the bare board, blurred like the picture; NaN off the board. slope : of the pattern, 1/px.
    noise : std of `seen - pattern`: grain, and at edges their uncertainty. blur_px : std of the blur.
    """

    seen: np.ndarray
    pattern: np.ndarray
    slope: np.ndarray
    noise: np.ndarray
    blur_px: float


def _board_picture(image: np.ndarray, camera: Camera, T_camera_board: Pose, spec: BoardWithIds) -> _BoardPicture | None:
    """Compare an (H, W) picture with its board at a known pose; None where the board has no contrast."""
    from scipy.optimize import minimize_scalar  # slow to load

    grey = np.asarray(image, np.float32)
    sharp, inside = _warped(camera, T_camera_board, spec)
    if not inside.any():
        return None
    # a square's side, or a tag's with its gap, by the outline's area in the picture
    squares = (spec.columns, spec.rows) if isinstance(spec, AprilGrid) else (spec.squares_x, spec.squares_y)
    window = int(_OverBoardSettings.window_squares * np.sqrt(inside.sum() / np.prod(squares))) | 1
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
        weight = on_board * (residual < _OverBoardSettings.covered_std * spread)
    if float(np.median(contrast[inside])) < _OverBoardSettings.least_contrast:
        return None
    seen = (grey - black) / np.maximum(contrast, _OverBoardSettings.least_contrast / 2)
    slope = np.hypot(*(cv2.Sobel(pattern, cv2.CV_32F, 1 - i, i, ksize=3, scale=0.125) for i in (0, 1)))
    noise = _noise(seen, pattern, slope, inside)
    return _BoardPicture(seen, np.where(inside, pattern, np.nan).astype(np.float32), slope, noise, blur_px)


def _pattern_texture(spec: BoardWithIds, texels: int = _OverBoardSettings.texels) -> np.ndarray:
    """The print, (H, W) float32, 1 white and 0 black, with about `texels` texels to a square or a tag."""
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
    fine_size = (width * _OverBoardSettings.subpixels, height * _OverBoardSettings.subpixels)
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

    flat, ones = inside & (slope < _OverBoardSettings.flat), np.ones_like(seen)
    dark, light = (spread(flat & side, ones) for side in (pattern < 0.5, pattern >= 0.5))
    grain = np.sqrt(np.clip(dark**2 + (light**2 - dark**2) * pattern, 1e-6, None))
    slack = spread(inside & (slope > _OverBoardSettings.steep), slope)
    return np.hypot(grain, slack * slope).astype(np.float32)


@dataclass(frozen=True, eq=False)
class _Profiles:
    """Raw pixels of N columns (or rows) that a guide crosses, T of each, normalised to the board's print.

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
class _LinePaint:
    """Appearance of the line: brightness relative to the print, coverage of a pixel at its middle, Gaussian width."""

    brightness: float
    cover: float
    scale_px: float


@dataclass(frozen=True, eq=False)
class _FittedLines:
    """Lines fitted to N profiles: offset from the guide, px; coverage over the expected; rms over noise. All (N,)."""

    centre: np.ndarray
    centre_std: np.ndarray
    amplitude: np.ndarray
    amplitude_std: np.ndarray
    chi: np.ndarray


def _profiles(picture: _BoardPicture, guide_px: np.ndarray, core_px: float) -> _Profiles:
    """Cut the columns (rows) out of a picture along a guide (K, 2), one column a pixel.

    Off the board, where the pattern is NaN, the background behind the line is interpolated linearly between its flanks,
    which begin `core_px` off the guide.
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
    return _Profiles(crossing, axis, np.sqrt(1.0 + slope**2), across, grey, behind, edge, grain)


def _with_flanks(
    grey: np.ndarray, known: np.ndarray, near: np.ndarray, across: np.ndarray, noise: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """`known` (N, T) with NaN replaced by a straight line through the same profile's flanks, and the noise there."""
    off_board = np.isnan(known)
    weight = (near & off_board).astype(float)
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
    doubt = np.hypot(grain + _OverBoardSettings.least_grain, (left - right)[:, None])
    enough = (np.min(counts, axis=0) >= _OverBoardSettings.least_flank)[:, None]
    return np.where(off_board, np.where(enough, line, np.nan), known), np.where(off_board, doubt, noise)


def _fit(
    cut: _Profiles,
    paint: _LinePaint,
    start: float | np.ndarray = 0.0,
    steps: int = _OverBoardSettings.steps,
    wary: bool = False,
) -> _FittedLines:
    """Weighted Gauss–Newton for the line's centre and coverage, with level and slope of the light, for all profiles
    at once.

    At each pixel the line adds its cover times (its brightness − what is behind).

    start : (N,) px from the guide. wary : less weight where the guide crosses edges of the pattern: the picture shows
        the blurred product of line and edge, the model the product of both blurred.
    """
    width = paint.scale_px * cut.stretch[:, None]
    variance = cut.noise**2
    if wary:
        near = np.exp(-0.5 * (cut.across / (_OverBoardSettings.edge_reach * width)) ** 2)
        variance = variance + (_OverBoardSettings.edge_doubt_px * paint.cover * cut.slope * near) ** 2
    weight = 1.0 / variance
    usable = weight > 0
    behind = np.where(usable, np.nan_to_num(cut.behind), 0.0)
    change = np.where(usable, cut.seen - behind, 0.0)
    against = paint.cover * (paint.brightness - behind)
    light = behind + _OverBoardSettings.black
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
    return _FittedLines(centre, std[:, 3] / np.abs(amplitude), found[:, 2], std[:, 2], chi)


def _rough_centres(cut: _Profiles, paint: _LinePaint) -> np.ndarray:
    """(N,) best-fitting place of the line along each profile, to half a pixel, within a few pixels of the guide."""
    candidates = np.arange(-_OverBoardSettings.capture_px, _OverBoardSettings.capture_px + 0.1, 0.5)
    tried = [_fit(cut, paint, place, steps=0) for place in candidates]
    gain = [np.where(one.amplitude > 0, one.amplitude / np.maximum(one.amplitude_std, 1e-9), 0.0) for one in tried]
    return candidates[np.argmax(gain, axis=0)]


def _fit_paint(cut: _Profiles, paint: _LinePaint) -> _LinePaint:
    """Brightness and coverage of the line on the guide, from all profiles together; then its width."""
    from scipy.optimize import minimize_scalar  # slow to load

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
        return _LinePaint(brightness, cover, paint.scale_px)

    def misfit(scale: float) -> float:
        return float(np.median(_fit(cut, _LinePaint(brightness, cover, scale), steps=2).chi))

    bounds = 0.5 * paint.scale_px, 2.0 * paint.scale_px
    best = minimize_scalar(misfit, bounds=bounds, method="bounded", options={"xatol": 0.02})
    return _LinePaint(brightness, cover, float(best.x))


def _darkest_band(cut: _Profiles, core_px: float) -> float:
    """Fraction by which the darkest band next to a line dims white print: the median over a few stretches.

    core_px : how far the line itself reaches to either side.
    """
    white = (
        np.isfinite(cut.noise)
        & (cut.slope < _OverBoardSettings.even)
        & (cut.behind > _OverBoardSettings.white)
        & (np.abs(cut.across) > core_px)
    )
    parts = (
        np.array_split(values, _OverBoardSettings.stretches)
        for values in (white, np.round(cut.across), cut.behind - cut.seen)
    )
    depths = []
    for chosen, place, dimmed in zip(*parts, strict=True):
        if chosen.any():
            column = (place[chosen] - place[chosen].min()).astype(int)
            count = np.bincount(column)
            means = np.bincount(column, dimmed[chosen]) / np.maximum(count, 1)
            depths.append(float(means[count >= _OverBoardSettings.least_white].max(initial=0.0)))
    return float(np.median(depths)) if depths else 0.0


@dataclass(frozen=True, eq=False)
class PlaneAbove:
    """The plane parallel to a board, `height_m` nearer to the viewer; (x, y) on it are those of the board frame."""

    camera: Camera
    T_camera_board: Pose
    height_m: float

    def to_plane(self, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Coordinates (N, 2) m of pixels (N, 2), and validity (N,)."""
        rays, valid = self.camera.unproject(pixels)
        rays = np.where(valid[:, None], rays, 0.0)
        rotation, shift = self.T_camera_board.rotation, self.T_camera_board.translation_m
        away = rays @ rotation[:, 2]
        valid = valid & (away > 1e-6)
        reach = (rotation[:, 2] @ shift - self.height_m) / np.where(valid, away, 1.0)
        return ((rays * reach[:, None] - shift) @ rotation)[:, :2], valid & (reach > 0)

    def to_pixels(self, points_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Pixels (N, 2) of coordinates (N, 2) m, and validity (N,)."""
        raised = np.column_stack([points_m, np.full(len(points_m), -self.height_m)])
        return self.camera.project(self.T_camera_board @ raised)

    def metres_per_pixel(self) -> float:
        """Metres per pixel at the board frame's origin, seen squarely."""
        focal_px = np.sqrt(np.prod(np.diag(self.camera.matrix)[:2]))
        return float(np.linalg.norm(self.T_camera_board.translation_m) / focal_px)


@dataclass(frozen=True, eq=False)
class _PlanePath:
    """A bent line on the plane: origin + s·direction + (c0 + c1·s + …)·normal, from s = start to end, m."""

    origin: np.ndarray
    direction: np.ndarray
    coefficients: np.ndarray
    start: float
    end: float

    @property
    def normal(self) -> np.ndarray:
        return np.array([-self.direction[1], self.direction[0]])

    def along(self, points_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Coordinate s (N,) and distance (N,) of points (N, 2) from the path, m."""
        offset = points_m - self.origin
        s = offset @ self.direction
        return s, offset @ self.normal - polyval(s, self.coefficients)

    def points(self, s: np.ndarray) -> np.ndarray:
        """(N, 2) points of the path at coordinates s (N,), m."""
        lateral = polyval(s, self.coefficients)
        return self.origin + s[:, None] * self.direction + lateral[:, None] * self.normal

    def fitted(self, points_m: np.ndarray, weights: np.ndarray, degree: int = 2) -> _PlanePath:
        """Fits the path to points (N, 2) with weights (N,) on their squared distances."""
        s, lateral = (points_m - self.origin) @ self.direction, (points_m - self.origin) @ self.normal
        coefficients = Polynomial.fit(s, lateral, degree, w=np.sqrt(weights)).convert().coef
        return _PlanePath(self.origin, self.direction, coefficients, float(s.min()), float(s.max()))


def _search(picture: _BoardPicture, plane: PlaneAbove, width_px: float, bright: bool) -> _PlanePath | None:
    """The path of a bright or dark antenna, within the board, where the background is known; None without one."""
    pixels, strength = _candidates(picture, width_px, bright)
    points, valid = plane.to_plane(pixels)
    points, strength = points[valid], strength[valid]
    if len(points) < _OverBoardSettings.least_steps:
        return None
    scale = plane.metres_per_pixel()
    width = max(_OverBoardSettings.bin_m, _OverBoardSettings.least_bin_px * scale)
    path = _strongest_line(points, strength, width)
    for band in _OverBoardSettings.bands:
        near = np.abs(path.along(points)[1]) < band * width
        if near.sum() < _OverBoardSettings.least_steps:
            return None
        path = path.fitted(points[near], strength[near], 1 if band == _OverBoardSettings.bands[0] else 2)
    # its ends, if it shows often enough
    s = path.along(points[np.abs(path.along(points)[1]) < width])[0]
    step = scale * _OverBoardSettings.step_px
    steps = np.arange(path.start, path.end, step)
    if len(s) < _OverBoardSettings.least_steps or len(steps) < _OverBoardSettings.least_steps:
        return None
    pixels, valid = plane.to_pixels(path.points(steps))
    height, width_of = picture.pattern.shape
    column, row = np.clip(np.round(np.nan_to_num(pixels)), 0, [width_of - 1, height - 1]).astype(int).T
    behind = np.where(valid, picture.pattern[row, column], np.nan)
    shows = behind < 0.2 if bright else behind > 0.8
    hit = np.isin(np.arange(len(steps)), np.round((s - path.start) / step).astype(int))
    if (shows & hit).sum() < max(_OverBoardSettings.least_steps, _OverBoardSettings.least_visible * shows.sum()):
        return None
    return replace(path, start=float(s.min()), end=float(s.max()))


def _candidates(picture: _BoardPicture, width_px: float, bright: bool) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (N, 2) on ridges of the difference and their weights (N,)."""
    known = np.isfinite(picture.pattern)
    difference = np.where(known, picture.seen - np.nan_to_num(picture.pattern), 0.0) * (1.0 if bright else -1.0)
    over_noise = (difference / picture.noise).astype(np.float32)
    smooth = cv2.GaussianBlur(over_noise, (0, 0), max(0.4 * width_px, 0.8))
    xx, yy = (cv2.Sobel(smooth, cv2.CV_32F, 2 * (1 - i), 2 * i, ksize=3) for i in (0, 1))
    xy = cv2.Sobel(smooth, cv2.CV_32F, 1, 1, ksize=3)
    ridge = 0.5 * (np.hypot(xx - yy, 2 * xy) - xx - yy)
    inner = cv2.erode(known.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    noise = float(np.median(ridge[inner])) if inner.any() else np.inf
    response = np.where(inner & (smooth > 2.0), ridge / max(noise, 1e-6), 0.0)
    rows, columns = np.nonzero(response > _OverBoardSettings.stands_out)
    strength = np.minimum(response[rows, columns], 4 * _OverBoardSettings.stands_out)
    best = np.argsort(-strength, kind="stable")[: _OverBoardSettings.most_candidates]
    return np.column_stack([columns[best], rows[best]]).astype(float), strength[best]


def _strongest_line(points: np.ndarray, strength: np.ndarray, width: float) -> _PlanePath:
    """The line of the greatest summed strength, by Hough's transform about the points' middle."""
    middle = points.mean(axis=0)
    offset = points - middle
    reach = int(np.ceil(np.linalg.norm(offset, axis=1).max() / width)) + 2
    best, chosen = -1.0, (0.0, 0)
    for angle in np.arange(_OverBoardSettings.angles) * np.pi / _OverBoardSettings.angles:
        bins = np.round(offset @ [-np.sin(angle), np.cos(angle)] / width).astype(int) + reach
        votes = np.convolve(np.bincount(bins, strength, 2 * reach + 1), [0.5, 1.0, 0.5], mode="same")
        if votes.max() > best:
            best, chosen = float(votes.max()), (float(angle), int(votes.argmax()) - reach)
    direction = np.array([np.cos(chosen[0]), np.sin(chosen[0])])
    return _PlanePath(middle, direction, np.array([chosen[1] * width]), 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class LineEnd:
    """An end of the line in the picture: pixel (2,) and its standard deviation along the line."""

    point_px: np.ndarray
    std_px: float


@dataclass(frozen=True, eq=False)
class BoardLine:
    """The antenna's line over a board.

    points_px : (N, 2) points of the centreline in their order along it.
    sigma_px : (N,) standard deviation across it.
    ends : where it ends beyond the first and the last point; None where it leaves the picture.
    bright : whether it is brighter than the black of the print, rather than darker than the white.
    width_px : its apparent width.
    shadow : part, in units of the print, by which a band next to it darkens white print.
    """

    points_px: np.ndarray
    sigma_px: np.ndarray
    ends: tuple[LineEnd | None, LineEnd | None]
    bright: bool
    width_px: float
    shadow: float

    def reversed(self) -> BoardLine:
        """The line in the opposite order."""
        return replace(self, points_px=self.points_px[::-1], sigma_px=self.sigma_px[::-1], ends=self.ends[::-1])

    def distance_px(self, pixels: np.ndarray) -> np.ndarray:
        """(M,) distance of pixels (M, 2) from the polyline through points and ends."""
        ends = [end.point_px[None] if end else np.empty((0, 2)) for end in self.ends]
        path = np.concatenate([ends[0], self.points_px, ends[1]])
        a, along = path[:-1], np.diff(path, axis=0)
        offset = pixels[:, None] - a
        share = np.clip((offset * along).sum(-1) / np.maximum((along**2).sum(-1), 1e-12), 0.0, 1.0)
        return np.linalg.norm(offset - share[..., None] * along, axis=-1).min(axis=1)


def find_over_board(
    image: np.ndarray, plane: PlaneAbove, spec: BoardWithIds, diameter_m: float, bright: bool | None = None
) -> BoardLine | None:
    """The thin line on a plane above a board, in an (H, W) picture; None without one.

    bright : whether the line is brighter than the board. With None both are sought, and the one that covers the board
    more is taken: an antenna covers, its shadow only dims.
    """
    picture = _board_picture(image, plane.camera, plane.T_camera_board, spec)
    if picture is None:
        return None
    width = diameter_m / plane.metres_per_pixel()
    sides = (True, False) if bright is None else (bright,)
    found = [line for side in sides if (line := _Tracker(picture, plane, width, side).measured()) is not None]
    return max(found, key=lambda one: one[0])[1] if found else None


@dataclass(frozen=True, eq=False)
class _Tracker:
    """Measures one bright or dark line, from the rough path to its ends."""

    picture: _BoardPicture
    plane: PlaneAbove
    width_px: float
    bright: bool

    @property
    def _core_px(self) -> float:
        """Half width of the line in the picture, blur included."""
        return 0.5 * self.width_px + 2.0 * self.picture.blur_px + 0.5

    def measured(self) -> tuple[float, BoardLine] | None:
        """Measures the line and its cover; None where none is convincing."""
        path = _search(self.picture, self.plane, self.width_px, self.bright)
        if path is None:
            return None
        scale = float(np.hypot(0.3 * self.width_px, self.picture.blur_px))
        paint = _LinePaint(1.0 if self.bright else 0.0, min(1.0, 0.4 * self.width_px / scale), scale)
        for _ in range(2):
            points, sigma = self._along(path, paint, rough=True)
            if len(points) < _OverBoardSettings.fewest_points // 2:
                return None
            path = self._refitted(path, points, sigma)
            paint = _fit_paint(self._cut(path, 0.0), paint)
            if paint.cover < _OverBoardSettings.faintest:
                return None
        for _ in range(_OverBoardSettings.growths):
            reach, (points, sigma) = path.end - path.start, self._along(path, paint, _OverBoardSettings.growth)
            if len(points) < _OverBoardSettings.fewest_points:
                break
            path = self._refitted(path, points, sigma)
            if path.end - path.start < 1.02 * reach:
                break
        points, sigma = self._along(path, paint, _OverBoardSettings.endward, wary=True)
        ends = self._end(path, paint, -1), self._end(path, paint, 1)
        s = self._places(path, points)
        first, last = (
            missing if end is None else self._places(path, end.point_px[None])[0]
            for end, missing in zip(ends, (-np.inf, np.inf), strict=True)
        )
        order = np.argsort(s)
        order = order[(s[order] > first) & (s[order] < last)]
        if len(order) < _OverBoardSettings.fewest_points:
            return None
        shadow = _darkest_band(self._cut(path, 0.0, _OverBoardSettings.shadow_width), self._core_px)
        return paint.cover, BoardLine(points[order], sigma[order], ends, self.bright, self.width_px, shadow)

    def _places(self, path: _PlanePath, pixels: np.ndarray) -> np.ndarray:
        """Coordinates (N,) along the path of pixels (N, 2)."""
        return path.along(self.plane.to_plane(pixels)[0])[0]

    def _cut(self, path: _PlanePath, beyond: float, wider: float = 1.0) -> _Profiles:
        more = beyond * (path.end - path.start)
        steps = np.linspace(path.start - more, path.end + more, 600)
        pixels, valid = self.plane.to_pixels(path.points(steps))
        inside = valid & ((pixels > -1) & (pixels < self.picture.seen.shape[::-1])).all(axis=1)
        return _profiles(self.picture, pixels[inside], wider * self._core_px)

    def _along(
        self, path: _PlanePath, paint: _LinePaint, beyond: float = 0.0, *, rough: bool = False, wary: bool = False
    ) -> tuple[np.ndarray, np.ndarray]:
        """Measured points (N, 2) px along a path, and their standard deviations (N,) across it.

        beyond : part of the path's length that is searched beyond either end. rough : whether to start at rough
            centres of the profiles instead of at the path. wary : as of `_fit`.
        """
        cut = self._cut(path, beyond)
        fitted = _fit(cut, paint, _rough_centres(cut, paint) if rough else 0.0, wary=wary)
        wider = np.maximum(fitted.chi, 1.0)
        good = (fitted.amplitude > _OverBoardSettings.amplitudes[0]) & (
            fitted.amplitude < _OverBoardSettings.amplitudes[1]
        )
        good &= fitted.amplitude > _OverBoardSettings.seen_ratio * fitted.amplitude_std * wider
        good &= fitted.centre_std * wider < _OverBoardSettings.worst_centre_px
        good &= np.abs(fitted.centre) < self.width_px + 2.5
        if good.any():
            good &= fitted.chi < _OverBoardSettings.disturbed * max(float(np.median(fitted.chi[good])), 0.5)
        points = cut.crossing_px.copy()
        points[:, cut.axis] += fitted.centre
        return points[good], (fitted.centre_std * wider / cut.stretch)[good]

    def _refitted(self, path: _PlanePath, pixels: np.ndarray, sigma: np.ndarray) -> _PlanePath:
        points, valid = self.plane.to_plane(pixels)
        points, weight = points[valid], 1.0 / (sigma[valid] ** 2 + 0.05**2)
        fresh = path.fitted(points, weight)
        for _ in range(_OverBoardSettings.reweightings):
            off = np.abs(fresh.along(points)[1])
            fresh = path.fitted(points, weight / np.maximum(1.0, off / (2.0 * np.median(off) + 1e-9)))
        return fresh

    def _end(self, path: _PlanePath, paint: _LinePaint, way: int) -> LineEnd | None:
        """The line's end beyond the path's start (−1) or end (+1)."""
        cut = self._cut(path, _OverBoardSettings.growth)
        from scipy.special import ndtr  # slow to load

        # how much of the line is on the guide itself: about 1 where it is, 0 where not
        there = _fit(cut, paint, steps=0)
        amplitude, std = there.amplitude, there.amplitude_std * np.maximum(there.chi, 1.0)
        s = self._places(path, cut.crossing_px)
        order = np.argsort(way * s)
        place = cut.crossing_px[order]
        along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(place, axis=0), axis=1))])
        outer = way * s[order] > way * 0.5 * (path.start + path.end)
        seen, std = amplitude[order][outer], np.hypot(std[order][outer], _OverBoardSettings.presence_std)
        at = along[outer]
        if len(at) < 2:
            return None
        candidates = np.arange(at[0], at[-1], _OverBoardSettings.end_step_px)
        blur = max(self.picture.blur_px, 0.3)
        there = ndtr((candidates[:, None] - at) / blur)
        surprise = np.minimum(((seen - there) / std) ** 2, _OverBoardSettings.worst_surprise).sum(axis=1)
        likely = np.exp(-0.5 * (surprise - surprise.min()))
        likely /= likely.sum()
        mean = float(likely @ candidates)
        spread = float(np.sqrt(likely @ (candidates - mean) ** 2))
        point = np.array([np.interp(mean, along, axis) for axis in place.T])
        room = np.minimum(point, np.array(self.picture.seen.shape[::-1]) - 1 - point).min()
        if room < _OverBoardSettings.border_px + 2.0 * spread:
            return None
        return LineEnd(point, float(np.hypot(spread, _OverBoardSettings.end_std_px)))
