"""Detects when the scene rests, so that pictures are taken without a key press."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np


@dataclass(frozen=True)
class _TileSettings:
    """Settings of the motion measurement between two frames, by tiles. Small pixels are those of a frame reduced to
    `small_px`."""

    small_px: int = 320  # longer side of a shrunk frame
    tile_px: int = 20  # side of a tile, small pixels
    sigmas: float = 5.0  # standard deviations of its noise that a shift must exceed
    fewest_corners: int = 4  # of a board that two frames share, to be compared by these alone
    least_slope: float = 3.0  # rms slope of a tile, grey levels per small pixel, below which no motion is visible
    slope_per_noise: float = 3.0  # the same, in standard deviations of a pixel's noise
    noise_margin: float = 1.5  # bright parts, and a JPEG's small pixels, are noisier than white noise
    weak_share: float = 0.1  # of the squared slope in a tile's strongest direction that another one needs to be used
    unlike_px: float = 0.8  # unexplained change over slope, small pixels, above which the tile's content is another
    far_px: float = 16.0  # shift that such a tile counts as, small pixels


_TILES = _TileSettings()


_NO_CORNERS, _NO_IDS = np.zeros((0, 2)), np.zeros(0, int)


@dataclass(frozen=True, eq=False)
class _FrameFeatures:
    """A reduced frame, cut into T tiles of P small pixels. size : (width, height) px of the frame.

    scale : pixels per small pixel. noise : std of a small pixel, grey levels. tiles : (T, P) grey levels.
    basis : (T, P, 8) slopes along u and v, then the effect of light. slope : (T,) rms, grey levels per small pixel.
    sharpness : slope over contrast, 1/px. corners_px, ids : (N, 2), (N,) of a board.
    """

    time_s: float
    size: tuple[int, int]
    scale: float
    noise: float
    tiles: np.ndarray
    basis: np.ndarray
    slope: np.ndarray
    sharpness: float
    corners_px: np.ndarray
    ids: np.ndarray


def _features_of(image: np.ndarray, time_s: float, corners_px: np.ndarray, ids: np.ndarray) -> _FrameFeatures:
    """Features of an (H, W) uint8 picture."""
    height, width = image.shape
    scale = max(1.0, max(width, height) / _TILES.small_px)
    columns, rows = (max(1, round(side / scale / _TILES.tile_px)) for side in (width, height))
    means = cv2.resize(image, (columns * _TILES.tile_px, rows * _TILES.tile_px), interpolation=cv2.INTER_AREA)
    # area means of sharp edges are rough, and a shift read off rough slopes comes out too large
    small = cv2.GaussianBlur(means.astype(np.float32), (3, 3), 0)
    slopes = (cv2.Sobel(small, cv2.CV_32F, 1, 0, scale=1 / 8), cv2.Sobel(small, cv2.CV_32F, 0, 1, scale=1 / 8))
    tiles, along, down = (_cut(each) for each in (small, *slopes))
    light = tiles - tiles.mean(axis=1, keepdims=True)
    # polynomials by which the light's factor may vary across a tile
    x, y = (each.ravel() for each in np.meshgrid(*2 * [np.linspace(-1, 1, _TILES.tile_px, dtype=np.float32)]))
    bends = (np.ones_like(x), x, y, x**2, y**2)
    basis = np.stack([along, down, np.ones_like(tiles), *(tiles * bend for bend in bends)], axis=-1)
    energy = (along**2 + down**2).mean(axis=1)
    contrast = float((light**2).mean())
    sharpness = float(np.sqrt(energy.mean() / contrast)) / scale if contrast > 0 else 0.0
    noise, slope = _noise(image) / scale, np.sqrt(energy)
    return _FrameFeatures(time_s, (width, height), scale, noise, tiles, basis, slope, sharpness, corners_px, ids)


def _motion_px(frame: _FrameFeatures, other: _FrameFeatures) -> float:
    """The largest shift between two frames of the same size, px; NaN without texture, 0 within the noise.

    Small shifts come out up to twice too large; those above about 2 small pixels count as 16.
    """
    _, here, there = np.intersect1d(frame.ids, other.ids, return_indices=True)
    if len(here) >= _TILES.fewest_corners:
        return float(np.quantile(np.linalg.norm(frame.corners_px[here] - other.corners_px[there], axis=1), 0.9))
    slope = np.maximum(frame.slope, other.slope)
    noise = max(frame.noise, other.noise)
    least_slope = max(_TILES.least_slope, _TILES.slope_per_noise * noise)
    usable = slope > least_slope
    shift, unexplained = _shifts(frame.basis[usable], frame.tiles[usable] - other.tiles[usable], least_slope)
    shift[unexplained > np.hypot(_TILES.unlike_px * slope[usable], np.sqrt(2) * _TILES.noise_margin * noise)] = (
        _TILES.far_px
    )
    measured = shift[np.isfinite(shift)]
    return float(np.clip(measured.max(), 0.0, _TILES.far_px)) * frame.scale if len(measured) else float("nan")


def _shifts(basis: np.ndarray, change: np.ndarray, least_slope: float) -> tuple[np.ndarray, np.ndarray]:
    """Each tile's shift beyond its noise, small pixels (T,), and the unexplained change, grey levels (T,).

    Directions with slopes below `least_slope`, or far below those across them, are ignored (-inf if none is left):
    along an edge, rough pixels would look like a shift.
    """
    across = basis.swapaxes(1, 2)
    normal = (across @ basis).astype(float)
    right = (across @ change[..., None])[..., 0].astype(float)
    # the light is eliminated (Schur complement)
    light = normal[:, 2:, 2:] + 1e-3 * np.eye(normal.shape[1] - 2)
    gain = np.linalg.solve(light, np.concatenate([normal[:, 2:, :2], right[:, 2:, None]], axis=2))
    matrix = normal[:, :2, :2] - normal[:, :2, 2:] @ gain[:, :, :2]
    vector = right[:, :2] - (normal[:, :2, 2:] @ gain[:, :, 2:])[..., 0]
    values, axes = np.linalg.eigh(matrix)
    values = np.maximum(values, 1e-3)
    along = np.einsum("tij,ti->tj", axes, vector)
    explained = np.einsum("ti,ti->t", right[:, 2:], gain[:, :, 2]) + (along**2 / values).sum(axis=1)
    unexplained = np.maximum((change**2).sum(axis=1) - explained, 0.0) / (change.shape[1] - basis.shape[2])
    # twice the slope's noise is in the change, and a grey level's rounding is never less than this
    noise = np.sqrt((unexplained[:, None] + 0.02) / values)
    weak = (values < change.shape[1] * least_slope**2) | (values < _TILES.weak_share * values[:, 1:])
    beyond = np.where(weak, -np.inf, np.abs(along) / values - _TILES.sigmas * noise)
    return beyond.max(axis=1), np.sqrt(unexplained)


def _noise(image: np.ndarray) -> float:
    """Standard deviation of a pixel's noise in grey levels, from the lower quartile of second differences, which
    edges only enlarge."""
    rows = image[::8].astype(np.int16)
    bends = np.abs(rows[:, :-2] - 2 * rows[:, 1:-1] + rows[:, 2:])
    # 0.3186 is the lower quartile of |x| for standard normal x
    return float(np.quantile(bends, 0.25)) / (0.3186 * np.sqrt(6)) if bends.size else 0.0


def _cut(small: np.ndarray) -> np.ndarray:
    rows, columns = (side // _TILES.tile_px for side in small.shape)
    cut = small.reshape(rows, _TILES.tile_px, columns, _TILES.tile_px).swapaxes(1, 2)
    return cut.reshape(rows * columns, _TILES.tile_px * _TILES.tile_px)


@dataclass(frozen=True)
class _StillnessSettings:
    """Thresholds for a scene at rest; the defaults are for a board in the hand.

    hold_s, hold_frames : duration and number of frames. gap_s : pause between frames that restarts the hold.
    step_px, speed_px_s : motion between frames that counts as none, whichever is more: 30 px/s blur 1/60 s by 0.5 px.
    drift_px, clear_px : the same against the hold's first frame; motion that must follow a taken frame.
    All px for pictures up to 1280 px wide, in proportion above. sharp_share : of the hold's sharpest frame.
    same : whether what looks like the taken frame is taken again, once it has moved.
    """

    hold_s: float = 0.7
    hold_frames: int = 4
    step_px: float = 0.5
    speed_px_s: float = 30.0
    drift_px: float = 6.0
    clear_px: float = 12.0
    gap_s: float = 1.0
    sharp_share: float = 0.9
    same: bool = False


ON_A_STAND = _StillnessSettings(speed_px_s=0.0, drift_px=1.5, clear_px=6.0, same=True)
"""For an antenna, which may still vibrate while all else is at rest, and looks the same at all angles of the joints."""


_Stillness = tuple[float, bool, str]
"""Fraction of the required rest that has passed, whether to take this frame, and why."""


class StillnessDetector:
    """Decides for each frame whether the scene has been at rest long enough to take it.

    A frame must be nearly as sharp as the sharpest since the scene came to rest: the lens may be focusing. Before
    another is taken, the scene must move clearly, and differ from the taken frame. Deterministic in frames and times.
    """

    def __init__(self, settings: _StillnessSettings | None = None) -> None:
        self._settings = settings or _StillnessSettings()
        self._last: _FrameFeatures | None = None
        self._hold: tuple[_FrameFeatures, int, float] | None = None  # first frame, how many, largest sharpness
        self._taken: _FrameFeatures | None = None
        self._moved = True

    def rearm(self) -> None:
        """Allow the same scene to be taken again, as after a refused picture."""
        self._taken, self._moved, self._hold = None, True, None

    def feed(
        self, image: np.ndarray, time_s: float, corners_px: np.ndarray = _NO_CORNERS, ids: np.ndarray = _NO_IDS
    ) -> _Stillness:
        """Judge the next frame, (H, W) uint8, at a time on any monotonic clock.

        corners_px, ids : (N, 2), (N,) of a board in it; two frames that share 4 or more are compared by these alone.
        """
        frame = _features_of(image, time_s, corners_px, ids)
        last, self._last = self._last, frame
        if last is None:
            return self._restart(frame, "hold still")
        if frame.size != last.size:
            self.rearm()
            return self._restart(frame, "the picture's size has changed: hold still")
        if not 0 < frame.time_s - last.time_s <= self._settings.gap_s:
            return self._restart(frame, "frames are missing: hold still")
        return self._judge(frame, last)

    def _judge(self, frame: _FrameFeatures, last: _FrameFeatures) -> _Stillness:
        scale = max(1.0, max(frame.size) / 1280)
        step_px = _motion_px(frame, last)
        if math.isnan(step_px):
            return self._restart(frame, "nothing is seen that could be held still: more light, or focus")
        if self._taken is not None and not self._moved:
            self._moved = _motion_px(frame, self._taken) > self._settings.clear_px * scale
        allowed_px = max(self._settings.step_px, self._settings.speed_px_s * (frame.time_s - last.time_s))
        if step_px > min(allowed_px, self._settings.drift_px) * scale:
            return self._restart(frame, "moving: hold still")
        if not self._moved:
            self._hold = None
            return (0.0, False, "taken: now move on")
        if self._hold is None or _motion_px(frame, self._hold[0]) > self._settings.drift_px * scale:
            return self._restart(frame, "hold still")
        return self._go_on(frame, self._hold, scale)

    def _go_on(self, frame: _FrameFeatures, hold: tuple[_FrameFeatures, int, float], scale: float) -> _Stillness:
        settings = self._settings
        first, frames, best = self._hold = (hold[0], hold[1] + 1, max(hold[2], frame.sharpness))
        hold_s = frame.time_s - first.time_s
        # a frame's time stamp is rounded, to milliseconds in videos
        share = min((hold_s + 1e-3) / settings.hold_s, frames / settings.hold_frames)
        if share < 1:
            return (share, False, "hold still")
        before = None if settings.same else self._taken
        if before is not None and _motion_px(frame, before) <= 2 * settings.step_px * scale:
            return (0.0, False, "nothing has changed since the last picture: move on")
        if frame.sharpness < settings.sharp_share * best:
            if hold_s > 2 * settings.hold_s:
                return self._restart(frame, "the focus has changed: hold still")
            return (1.0, False, "hold still: waiting for a sharp frame")
        self._taken, self._moved, self._hold = frame, False, None
        return (1.0, True, "taken")

    def _restart(self, frame: _FrameFeatures, words: str) -> _Stillness:
        self._hold = (frame, 1, frame.sharpness)
        return (0.0, False, words)
