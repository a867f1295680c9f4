"""Errors of a whole line in the picture: their smooth modes, and what the pixels along it leave of them."""

from __future__ import annotations

import numpy as np

from vbaa_calib.core.robust import MAD_SCALE
from vbaa_calib.native import core

from .settings import SearchSettings

LINE_MODES = 3  # offset, slope and curvature: the first Legendre polynomials of the place along a line


def locking_std(points_px: np.ndarray) -> np.ndarray:
    """(3,) standard deviations, in the modes of a line through ordered points (N, 2) px, of errors of 1 px rms that
    are periodic in the line's position on the pixel grid.

    A line that crosses n rows averages them to about 1/πn; one along a row keeps them. Their phase is unknown.
    """
    count = len(points_px)
    if count < LINE_MODES:
        return np.zeros(LINE_MODES)
    along = np.gradient(points_px, axis=0)
    across = np.abs(along[:, ::-1]) / np.maximum(np.linalg.norm(along, axis=1), 1e-12)[:, None]
    waves = np.exp(2j * np.pi * points_px) * across
    modes = np.polynomial.legendre.legvander(np.linspace(-1.0, 1.0, count), LINE_MODES - 1)
    parts = (2.0 * np.arange(LINE_MODES) + 1.0)[:, None] / count * (modes.T @ waves)
    return np.asarray(np.linalg.norm(parts, axis=1))


def _row_noise(image: np.ndarray) -> float:
    """Standard deviation of the noise that all pixels of a row share in a picture (H, W[, C]), grey levels.

    From second differences of neighbouring rows, averaged in blocks along them: only what the blocks share makes the
    products of different ones positive. The median over rows leaves out the few in which an edge runs along them.
    """
    import cv2  # slow to load

    blocks = SearchSettings.row_blocks
    means = cv2.resize(image.astype(np.float32), (blocks, len(image)), interpolation=cv2.INTER_AREA)
    each = means.reshape(len(image), blocks, -1).mean(axis=2).T
    bend = each[:, 1:-1] - 0.5 * (each[:, :-2] + each[:, 2:])
    shared = (bend.sum(axis=0) ** 2 - (bend**2).sum(axis=0)) / (blocks * (blocks - 1))
    return float(MAD_SCALE * np.sqrt(max(core.search.median(shared), 0.0) / 1.5))


def _evened(image: np.ndarray, points_px: np.ndarray, reach_px: int) -> tuple[np.ndarray, float]:
    """A picture (H, W) without what the pixels of each row near a line's points (N, 2) px share, apart from a parabola
    across the rows; and the standard deviation of what is left of that, infinite where too little shows it. Pixels up
    to `reach_px` from the line do not, nor those behind its first point."""
    first = max(int(points_px[:, 1].min()) - 2 * reach_px, 0)
    rows = np.arange(first, min(int(points_px[:, 1].max()) + 2 * reach_px + 2, len(image)))
    columns, along = np.arange(image.shape[1]), np.argsort(points_px[:, 0])
    near = np.abs(rows[:, None] - np.interp(columns, *points_px[along].T)) <= reach_px
    onwards = np.sign(points_px[-1, 0] - points_px[0, 0])
    near[:, onwards * (columns - points_px[-1, 0]) > reach_px] = False
    values = np.where(near, np.nan, image[rows[0] : rows[-1] + 1].astype(np.float32))
    values -= np.nanmean(np.where(near.all(axis=0), 0.0, values), axis=0)
    enough = (~near).sum(axis=1) >= SearchSettings.row_pixels
    if enough.sum() < SearchSettings.row_run:
        return image, np.inf
    shared = np.where(enough, np.nanmedian(np.where(enough[:, None], values, 0.0), axis=1), 0.0)
    shared -= enough * np.polynomial.Polynomial.fit(rows[enough], shared[enough], 2)(rows)
    noise = MAD_SCALE * float(np.nanmedian(np.abs(values - shared[:, None])[enough]))
    evened = image.astype(np.float32)
    evened[rows] -= shared[:, None]
    # a median is by a quarter less sure than a mean
    return evened, 1.25 * noise / float(np.sqrt(np.median((~near).sum(axis=1)[enough])))


def row_errors(
    image: np.ndarray, points_px: np.ndarray, sigma_px: np.ndarray, noise: float, reach_px: int
) -> tuple[np.ndarray, np.ndarray | None]:
    """(N,) deviations that noise of whole rows and columns of a picture adds to those of a line's points (N, 2) px in
    its order, where these count as independent; sigma_px : (N,) of each by a pixel's own `noise`, grey levels. And the
    picture without most of that noise, where it is grey and that pays: the deviations are those that it has then.

    All points on a row share its error, so that a line along rows keeps it, and one across them has none. reach_px :
    how far from the line pixels are its own.
    """
    found, step = np.zeros(len(points_px)), SearchSettings.row_run
    evened: np.ndarray | None = None
    if len(points_px) <= step:
        return found, None
    along = points_px[step:] - points_px[:-step]
    for axis, rows in ((1, image), (0, np.swapaxes(image, 0, 1))):
        if np.abs(along[:, axis]).min() > 1.0:
            continue  # it crosses the rows
        places = np.sort(points_px[:, axis])
        alike = np.searchsorted(places, points_px[:, axis] + 0.5) - np.searchsorted(places, points_px[:, axis] - 0.5)
        if alike.max() < step:
            continue
        across = np.abs(along[:, 1 - axis]).mean() / np.linalg.norm(along, axis=1).mean()
        band = SearchSettings.row_band
        shared = _row_noise(rows[max(int(places[0]) - band, 0) : int(places[-1]) + band + 1])
        own = max(noise**2 - shared**2, 0.25 * noise**2) ** 0.5
        more = sigma_px * across * shared / max(own, 1e-9) * np.sqrt(alike)
        if image.ndim == 2 and core.search.median(more) > core.search.median(sigma_px):
            better, left = _evened(rows, points_px if axis else points_px[:, ::-1], reach_px)
            if left < shared:
                more, evened = more * left / shared, better if axis else np.ascontiguousarray(better.T)
        found = np.hypot(found, more)
    return found, evened
