"""How much of a lens can be used, as a thing to ask for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .lens import Lens, lens_of
from .projection import Intrinsics, pixel_to_chart

_SAMPLES_PER_SIDE = 64


@dataclass(frozen=True)
class ValidRegion:
    """Where a lens maps one to one, around its axis.

    Attributes
    ----------
    ideal_radius : largest radius of X/Z, Y/Z (angle from the axis in rad for the fisheye) trusted in every direction.
    distorted_radius : what it becomes on the sensor's normalized plane. Both are inf where nothing ends.
    half_angle_rad : the same as an angle from the axis.
    image_fraction : share of the image whose pixels have a ray.
    """

    ideal_radius: float
    distorted_radius: float
    half_angle_rad: float
    image_fraction: float


def valid_region(intrinsics: Intrinsics, image_size: tuple[int, int]) -> ValidRegion:
    """Region of a lens and the share of an image (width, height) that it covers, border pixels included."""
    lens: Lens = lens_of(intrinsics.model, intrinsics.coefficients)
    columns, rows = (np.linspace(-0.5, size - 0.5, _SAMPLES_PER_SIDE) for size in image_size)
    u, v = np.meshgrid(columns, rows)
    _, _, valid = pixel_to_chart(intrinsics, u, v)
    return ValidRegion(
        ideal_radius=lens.ideal_limit,
        distorted_radius=lens.distorted_limit,
        half_angle_rad=lens.model.chart.half_angle(lens.ideal_limit),
        image_fraction=float(valid.mean()),
    )
