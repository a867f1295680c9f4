"""Do two halves of the views tell of the same lens? Their difference over the picture, in units of the predicted."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .bundle import Bundle, lens_covariance, refine
from .corner_stack import Observation
from .lens_models import LensModel, camera_of
from .lens_uncertainty import compensate, pixel_grid, projection_jacobian

AGREE = 2.5
"""Halves of good data differ by more than this many predicted deviations about once in a thousand."""

_ITERATIONS = 30
_LEAST_VIEWS = 6


def disagreement_of_halves(
    model: LensModel,
    bundle: Bundle,
    observations: Sequence[Observation],
    directions: np.ndarray,
    image_size: tuple[int, int],
) -> float | None:
    """The halves' difference over its predicted deviation, rms over the picture; about 1 when all is well.

    The views are dealt out in turn. What a turn of the camera explains is left out of both. None with under 6 views, or
    when a half leaves the lens open.
    """
    if len(observations) < _LEAST_VIEWS:
        return None
    lenses, covariances = [], []
    for first in (0, 1):
        views = observations[first::2]
        half = refine(
            model,
            bundle.intrinsics,
            bundle.poses[first::2],
            views,
            directions,
            iterations=_ITERATIONS,
            sagittas_m=bundle.sagittas_m,
            shrink_px2=bundle.shrink_px2,
        )
        own = lens_covariance(model, half, views, directions)
        if own is None:
            return None
        lenses.append(camera_of(model, half.intrinsics, image_size))
        covariances.append(own)
    camera = camera_of(model, bundle.intrinsics, image_size)
    pixels = pixel_grid(image_size)
    rays, _ = camera.unproject(pixels)
    shift = lenses[0].project(rays)[0] - lenses[1].project(rays)[0]
    difference = compensate(camera, pixels, shift[..., None])[..., 0]
    jacobian = compensate(camera, pixels, projection_jacobian(camera, pixels))
    covariance = covariances[0] + covariances[1]
    predicted = np.trace(jacobian @ covariance @ np.swapaxes(jacobian, -1, -2), axis1=-2, axis2=-1)
    squares = np.sum(difference**2, axis=-1) / predicted
    known = np.isfinite(squares)
    return float(np.sqrt(np.mean(squares[known]))) if known.any() else None
