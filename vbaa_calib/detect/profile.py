"""Measure the antenna to a fraction of a pixel: a line profile fitted across it at every step along a guide."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.ndimage import binary_erosion, gaussian_filter1d
from scipy.optimize import minimize_scalar

from .corridor import normals, resample

STEP_PX = 2.0
"""Spacing of the measured points: far enough apart that neighbours share little noise."""
SEEN_RATIO = 6.0
"""Least amplitude over its standard deviation for a profile to count as seen."""
LEAST_SEEN = 0.2
"""Least fraction of the guide that must be seen for there to be an antenna at all."""


@dataclass(frozen=True, eq=False)
class Centreline:
    """The antenna's centreline in one picture, ordered from clamp to tip.

    Attributes
    ----------
    points_px : (N, 2).
    sigma_px : (N,) standard deviation across the antenna.
    seen : fraction of the guide where the antenna was seen.
    amplitude : median height of the line above its background, grey levels.
    """

    points_px: np.ndarray
    sigma_px: np.ndarray
    seen: float
    amplitude: float

    @property
    def found(self) -> bool:
        """Whether enough of the antenna was seen to speak of one."""
        return self.seen >= LEAST_SEEN and len(self.points_px) >= 12


def _sample(image: np.ndarray, points: np.ndarray, normal: np.ndarray, across: np.ndarray) -> np.ndarray:
    """(N, T) grey levels across the guide, averaged over one step along it; NaN outside the picture."""
    tangent = np.stack([normal[:, 1], -normal[:, 0]], axis=1)
    total = 0.0
    for along in (-0.5, 0.5):
        where = points[:, None] + across[None, :, None] * normal[:, None] + along * tangent[:, None]
        grid = where.astype(np.float32)
        values = cv2.remap(image, grid[..., 0], grid[..., 1], cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
        height, width = image.shape
        inside = (where >= 1).all(-1) & (where[..., 0] < width - 2) & (where[..., 1] < height - 2)
        total = total + 0.5 * np.where(inside, values, np.nan)
    return np.asarray(total)


def _fit(profiles: np.ndarray, across: np.ndarray, scale: float, centre: np.ndarray) -> tuple[np.ndarray, ...]:
    """Gauss–Newton for a Gaussian line on a sloping background, all profiles at once.

    Returns centre (N,), amplitude (N,), residuals (N, T) and the (N,) unit-noise standard deviations of both.
    """
    window = np.exp(-0.5 * (across / (0.5 * across[-1])) ** 4)
    for _ in range(6):
        t = (across[None] - centre[:, None]) / scale
        line = np.exp(-0.5 * t**2)
        basis = np.stack([np.ones_like(line), np.broadcast_to(across, line.shape), line, line * t / scale], axis=-1)
        weighted = basis * window[None, :, None]
        normal_matrix = np.swapaxes(weighted, 1, 2) @ basis + 1e-9 * np.eye(4)
        coefficients = np.linalg.solve(normal_matrix, np.swapaxes(weighted, 1, 2) @ profiles[..., None])[..., 0]
        amplitude = coefficients[:, 2]
        safe = np.where(np.abs(amplitude) > 1e-6, amplitude, 1e-6)
        centre = np.clip(centre + np.clip(coefficients[:, 3] / safe, -1.0, 1.0), across[0], across[-1])
    residuals = profiles - (basis @ coefficients[..., None])[..., 0]
    inverse = np.linalg.inv(normal_matrix)
    spread = inverse @ (np.swapaxes(weighted, 1, 2) @ weighted) @ inverse
    unit = np.sqrt(np.clip(np.diagonal(spread, axis1=1, axis2=2), 0.0, None))
    return centre, amplitude, residuals * window, unit[:, 3] / np.abs(safe), unit[:, 2]


def _line_scale(profiles: np.ndarray, across: np.ndarray, guess: float, centre: np.ndarray) -> float:
    """The Gaussian width that fits this picture's profiles best."""
    sample = slice(None, None, max(1, len(profiles) // 60))

    def misfit(scale: float) -> float:
        residuals = _fit(profiles[sample], across, scale, centre[sample])[2]
        return float(np.median((residuals**2).sum(axis=1)))

    return float(
        minimize_scalar(misfit, bounds=(0.6 * guess, 2.5 * guess), method="bounded", options={"xatol": 0.02}).x
    )


def measure(image: np.ndarray, guide_px: np.ndarray, width_px: float, bright: bool = True) -> Centreline:
    """The centreline near a guide.

    Parameters
    ----------
    image : (H, W) float32 grey levels.
    guide_px : (K, 2) a path within about one antenna width of the truth, from clamp to tip.
    width_px : the antenna's width.
    bright : brighter than its background.

    Notes
    -----
    A point is kept where the line's amplitude stands out from its noise, agrees with the rest of the antenna, and the
    profile leaves no large residual; points beside a gap are dropped: half of their profile shows what hides the rest.
    """
    points, _ = resample(guide_px, STEP_PX)
    if len(points) < 4:
        return Centreline(np.empty((0, 2)), np.empty(0), 0.0, 0.0)
    points = gaussian_filter1d(points, 2.0, axis=0, mode="nearest")
    normal = normals(points)
    guess = float(np.hypot(0.3 * width_px, 0.7))
    half = max(5.0, 2.2 * width_px + 2.0)
    across = np.arange(-half, half + 0.5)
    profiles = _sample(image if bright else -image, points, normal, across)
    inside = np.isfinite(profiles).all(axis=1)
    profiles = np.where(np.isfinite(profiles), profiles, 0.0)
    if not inside.any():
        return Centreline(np.empty((0, 2)), np.empty(0), 0.0, 0.0)

    near = np.abs(across) <= max(2.5, width_px)
    start = across[near][profiles[:, near].argmax(axis=1)]
    scale = _line_scale(profiles[inside], across, guess, start[inside])
    centre, amplitude, residuals, unit_centre, unit_amplitude = _fit(profiles, across, scale, start)
    rms = np.sqrt((residuals**2).mean(axis=1))
    noise = float(np.median(rms[inside])) * np.sqrt(len(across) / max(len(across) - 4, 1)) + 1e-6
    local = np.maximum(rms, noise)
    seen = inside & (amplitude > SEEN_RATIO * local * unit_amplitude) & (np.abs(centre) < half - 2.0)
    if not seen.any():
        return Centreline(np.empty((0, 2)), np.empty(0), 0.0, 0.0)
    typical = float(np.median(amplitude[seen]))
    seen &= (amplitude > 0.3 * typical) & (amplitude < 3.0 * typical) & (rms < 4.0 * noise + 0.1 * typical)
    seen = binary_erosion(seen, iterations=1, border_value=1)
    measured = points + centre[:, None] * normal
    return Centreline(measured[seen], (local * unit_centre)[seen], float(seen.mean()), typical)
