"""What users give, checked and brought to one shape."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch

from estimator.table.contacts import Measured
from vbaa_calib.core.errors import InputError

SLIGHTLY = 1e-6
"""By so much of the other coordinate points of one column are told apart."""


def padded(centrelines_px: np.ndarray | Sequence[np.ndarray]) -> np.ndarray:
    """(B, N, 2) of centrelines of one length or of many; NaN where there is no point. Raises InputError."""
    if isinstance(centrelines_px, np.ndarray) and centrelines_px.ndim == 3 and centrelines_px.shape[2] == 2:
        return centrelines_px.astype(float, copy=False)
    lines = [np.asarray(line, float) for line in centrelines_px]
    for line in lines:
        if line.ndim != 2 or line.shape[1] != 2:
            raise InputError(f"a centreline has shape {line.shape}", remedy="give (N, 2) pixels for every frame")
    points = np.full((len(lines), max((len(line) for line in lines), default=0), 2), np.nan)
    for row, line in zip(points, lines, strict=True):
        row[: len(line)] = line
    return points


def stacked(several: Sequence[Measured]) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Points, deviations, readings, pans and tilts of frames, points padded to one length."""
    points = padded([each.points_px for each in several])
    sigma = np.ones(points.shape[:2])
    for row, each in zip(sigma, several, strict=True):
        row[: len(each.sigma_px)] = each.sigma_px
    numbers = np.array([[each.moment_Nm, each.moment_z_Nm, each.pan_rad, each.tilt_rad] for each in several])
    return points, sigma, numbers[:, :2], numbers[:, 2], numbers[:, 3]


def started(several: Sequence[Measured], warm: np.ndarray | None = None) -> np.ndarray | None:
    """(B, 4) where to look first: each frame's own start, else `warm` (4,); None where nothing is known of any."""
    starts = np.stack([each.start for each in several])
    if warm is not None:
        starts = np.where(np.isfinite(starts).all(axis=1, keepdims=True), starts, warm)
    return starts if np.isfinite(starts).all(axis=1).any() else None


def column(name: str, values: Sequence[float | None] | np.ndarray | None, count: int) -> np.ndarray:
    """(count,) floats, NaN for what is missing. Raises InputError."""
    if values is None:
        return np.full(count, np.nan)
    try:
        numbers = np.array([np.nan if value is None else value for value in values], float)
    except (TypeError, ValueError):
        raise InputError(f"{name} are {values!r:.60}", remedy="give a number for every frame") from None
    if numbers.shape != (count,):
        raise InputError(f"{name} number {len(numbers)}, centrelines {count}", remedy="give one for every frame")
    return numbers


def deviations(points_px: np.ndarray, sigma_px: np.ndarray | float) -> np.ndarray:
    """(B, N) deviations of points (B, N, 2) from one, (B, 1) or (B, N). Raises InputError where there is a point."""
    sigma = np.asarray(sigma_px, float)
    try:
        sigma = np.broadcast_to(sigma, points_px.shape[:2])
    except ValueError:
        raise InputError(f"sigma_px has shape {sigma.shape}", remedy="give one number or one for each point") from None
    if not ((sigma > 0) & np.isfinite(sigma))[np.isfinite(points_px).all(axis=-1)].all():
        raise InputError("sigma_px is not everywhere positive and finite", remedy="give standard deviations in px")
    return sigma


def in_order(points_px: np.ndarray, sigma_px: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points (B, N, 2) and deviations (B, N) along the longer side of each frame's points, missing ones last.

    First looks take every n-th point: they must not depend on the order in which the points were listed.
    """
    if points_px.shape[1] == 0:
        return points_px, sigma_px
    with np.errstate(all="ignore"):
        wide, high = (
            np.fmax.reduce(side, axis=1) - np.fmin.reduce(side, axis=1) for side in np.moveaxis(points_px, -1, 0)
        )
    sideways = (wide >= high)[:, None]
    u, v = points_px[..., 0], points_px[..., 1]
    order = np.argsort(np.where(sideways, u + SLIGHTLY * v, v + SLIGHTLY * u), axis=1)
    return np.take_along_axis(points_px, order[..., None], 1), np.take_along_axis(sigma_px, order, 1)


def checked_device(name: str) -> torch.device:
    """The torch device. Raises InputError when it cannot be used."""
    try:
        torch.ones(1, dtype=torch.float64, device=name).item()
    except (RuntimeError, TypeError, AssertionError) as error:
        what = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError(f"device {name!r}: {what}", remedy="cpu is always there") from None
    return torch.device(name)
