"""How far anything in a picture moved since another one, in pixels, whatever lamps and sensor noise do.

The picture is made small and cut into tiles. In each tile the change between the pictures is laid to a shift and to a
change of light, which may vary smoothly across the tile: a rolling shutter turns flicker into bands. The shift counts
as far as its own noise does not explain it. A change that no small shift explains counts as a large one.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

_SMALL_PX = 320
_TILE_PX = 20
_SIGMAS = 5.0
_FEWEST_CORNERS = 4
_LEAST_SLOPE = 3.0
"""Root mean square slope of a tile, grey levels per small pixel, below which there is nothing to see motion by."""
_LEAST_SLOPE_PER_NOISE = 3.0
_NOISE_MARGIN = 1.5
"""Bright parts of a picture are noisier than the dark ones, and small pixels of a JPEG than white noise makes them."""
_QUARTILE_OF_NOISE = 0.3186
"""The lower quartile of |x| for x normal, in standard deviations."""
_WEAK_SHARE = 0.1
"""Of the squared slope in a tile's strongest direction, that another must have to be looked along."""
_UNLIKE_PX = 0.8
"""Unexplained change over slope, small pixels, from which a tile shows something else."""
_FAR_PX = 16.0
"""What such a tile counts as, small pixels."""


_X, _Y = (each.ravel() for each in np.meshgrid(*2 * [np.linspace(-1, 1, _TILE_PX, dtype=np.float32)]))
_BENDS = (np.ones_like(_X), _X, _Y, _X**2, _Y**2)
"""How the light's factor may vary across a tile."""


@dataclass(frozen=True, eq=False)
class Look:
    """What is kept of a frame.

    Attributes
    ----------
    time_s, size : its time, and its (width, height) px.
    scale : pixels of the picture per small pixel.
    noise : standard deviation of a small pixel, grey levels.
    tiles : (T, P) grey levels of the small picture, by tile.
    basis : (T, P, 8) slope along u and v, then what a change of light does, in each tile.
    slope : (T,) root mean square slope of each tile, grey levels per small pixel.
    sharpness : slope over contrast, 1/px; light does not change it.
    corners_px, ids : (N, 2), (N,) of a board; None where none was told.
    """

    time_s: float
    size: tuple[int, int]
    scale: float
    noise: float
    tiles: np.ndarray
    basis: np.ndarray
    slope: np.ndarray
    sharpness: float
    corners_px: np.ndarray | None
    ids: np.ndarray | None


def look_at(image: np.ndarray, time_s: float, corners_px: np.ndarray | None, ids: np.ndarray | None) -> Look:
    """Keep of an (H, W) uint8 picture what motion is measured by."""
    height, width = image.shape
    scale = max(1.0, max(width, height) / _SMALL_PX)
    columns, rows = (max(1, round(side / scale / _TILE_PX)) for side in (width, height))
    means = cv2.resize(image, (columns * _TILE_PX, rows * _TILE_PX), interpolation=cv2.INTER_AREA)
    # area means of sharp edges are rough, and a shift read off rough slopes comes out too large
    small = cv2.GaussianBlur(means.astype(np.float32), (3, 3), 0)
    slopes = (cv2.Sobel(small, cv2.CV_32F, 1, 0, scale=1 / 8), cv2.Sobel(small, cv2.CV_32F, 0, 1, scale=1 / 8))
    tiles, along, down = (_cut(each) for each in (small, *slopes))
    light = tiles - tiles.mean(axis=1, keepdims=True)
    basis = np.stack([along, down, np.ones_like(tiles), *(tiles * bend for bend in _BENDS)], axis=-1)
    energy = (along**2 + down**2).mean(axis=1)
    contrast = float((light**2).mean())
    sharpness = float(np.sqrt(energy.mean() / contrast)) / scale if contrast > 0 else 0.0
    corners = None if corners_px is None else np.asarray(corners_px, float).reshape(-1, 2)
    noise = _noise(image) / scale
    return Look(time_s, (width, height), scale, noise, tiles, basis, np.sqrt(energy), sharpness, corners, ids)


def motion_px(look: Look, other: Look) -> float:
    """The largest shift of anything between two frames of one size, px; NaN where nothing is there to see it by.

    0 where no shift is larger than noise explains; up to twice too large while small. Those above some 2
    small pixels are not told apart: they count as 16.
    """
    shared = _shared_corners(look, other)
    if shared is not None:
        return float(np.quantile(np.linalg.norm(shared[0] - shared[1], axis=1), 0.9))
    slope = np.maximum(look.slope, other.slope)
    noise = max(look.noise, other.noise)
    least_slope = max(_LEAST_SLOPE, _LEAST_SLOPE_PER_NOISE * noise)
    usable = slope > least_slope
    shift, unexplained = _shifts(look.basis[usable], look.tiles[usable] - other.tiles[usable], least_slope)
    shift[unexplained > np.hypot(_UNLIKE_PX * slope[usable], np.sqrt(2) * _NOISE_MARGIN * noise)] = _FAR_PX
    told = shift[np.isfinite(shift)]
    return float(np.clip(told.max(), 0.0, _FAR_PX)) * look.scale if len(told) else float("nan")


def _shifts(basis: np.ndarray, change: np.ndarray, least_slope: float) -> tuple[np.ndarray, np.ndarray]:
    """Each tile's shift beyond its noise, small pixels (T,), and the change that is left, grey levels (T,).

    A shift is told along a direction only in which the tile's slopes are at least `least_slope`, and not far below
    those across it: along an edge, what is rough about the pixels would be taken for a shift. -inf where there is none.
    """
    across = basis.swapaxes(1, 2)
    normal = (across @ basis).astype(float)
    right = (across @ change[..., None])[..., 0].astype(float)
    # light is eliminated, so that what is left tells the shift alone
    light = normal[:, 2:, 2:] + 1e-3 * np.eye(normal.shape[1] - 2)
    gain = np.linalg.solve(light, np.concatenate([normal[:, 2:, :2], right[:, 2:, None]], axis=2))
    matrix = normal[:, :2, :2] - normal[:, :2, 2:] @ gain[:, :, :2]
    vector = right[:, :2] - (normal[:, :2, 2:] @ gain[:, :, 2:])[..., 0]
    values, axes = np.linalg.eigh(matrix)
    values = np.maximum(values, 1e-3)
    along = np.einsum("tij,ti->tj", axes, vector)
    explained = np.einsum("ti,ti->t", right[:, 2:], gain[:, :, 2]) + (along**2 / values).sum(axis=1)
    left = np.maximum((change**2).sum(axis=1) - explained, 0.0) / (change.shape[1] - basis.shape[2])
    # twice the slope's noise is in the change, and a grey level's rounding is never less than this
    noise = np.sqrt((left[:, None] + 0.02) / values)
    weak = (values < change.shape[1] * least_slope**2) | (values < _WEAK_SHARE * values[:, 1:])
    beyond = np.where(weak, -np.inf, np.abs(along) / values - _SIGMAS * noise)
    return beyond.max(axis=1), np.sqrt(left)


def _noise(image: np.ndarray) -> float:
    """Standard deviation of a pixel's noise, grey levels, from the second differences of every eighth row.

    Their lower quartile, since edges and texture only make differences larger.
    """
    rows = image[::8].astype(np.int16)
    bends = np.abs(rows[:, :-2] - 2 * rows[:, 1:-1] + rows[:, 2:])
    return float(np.quantile(bends, 0.25)) / (_QUARTILE_OF_NOISE * np.sqrt(6)) if bends.size else 0.0


def _shared_corners(look: Look, other: Look) -> tuple[np.ndarray, np.ndarray] | None:
    """The corners that both frames show, (M, 2) each; None for fewer than 4."""
    if look.corners_px is None or other.corners_px is None:
        return None
    if look.ids is None or other.ids is None:
        same = len(look.corners_px) == len(other.corners_px) >= _FEWEST_CORNERS
        return (look.corners_px, other.corners_px) if same else None
    _, here, there = np.intersect1d(look.ids, other.ids, return_indices=True)
    return (look.corners_px[here], other.corners_px[there]) if len(here) >= _FEWEST_CORNERS else None


def _cut(small: np.ndarray) -> np.ndarray:
    """(rows · 20, columns · 20) to (T, 400)."""
    rows, columns = (side // _TILE_PX for side in small.shape)
    cut = small.reshape(rows, _TILE_PX, columns, _TILE_PX).swapaxes(1, 2)
    return cut.reshape(rows * columns, _TILE_PX * _TILE_PX)
