"""Errors of a whole line in the picture: their smooth modes, and what pixels leave of them that it runs along."""

from __future__ import annotations

import numpy as np

LINE_MODES = 3  # offset, slope and curvature: the first Legendre polynomials of the place along a line


def locking_std(points_px: np.ndarray) -> np.ndarray:
    """(3,) standard deviations that errors of 1 px rms, periodic in a line's place among the pixels, leave in the modes
    of a line through points (N, 2) px in its order.

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
