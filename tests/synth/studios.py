"""Small studios for the rendering tests."""

from __future__ import annotations

import functools

import numpy as np

from vbaa_calib.simulate.render.picture import Studio, studio
from vbaa_calib.simulate.scene.lens import Lens
from vbaa_calib.simulate.scene.scene import PictureSpec

MATRIX = np.array([[1004.0, 0.0, 476.5], [0.0, 1001.0, 363.2], [0.0, 0.0, 1.0]])
WIDE = np.array([[520.0, 0.0, 476.5], [0.0, 522.0, 363.2], [0.0, 0.0, 1.0]])
LENSES = {
    "pinhole": Lens("opencv", (960, 720), MATRIX, np.zeros(0)),
    "brown": Lens("opencv", (960, 720), MATRIX, np.array([-0.182, 0.061, 0.0007, -0.0005])),
    "rational": Lens("opencv", (960, 720), WIDE, np.array([0.9, 0.25, 3e-4, -2e-4, 0.02, 1.25, 0.45, 0.06])),
    "fisheye": Lens("fisheye", (960, 720), WIDE, np.array([-0.01, 0.004, -0.002, 0.0003])),
}


def spec(**changes: float) -> PictureSpec:
    """Even light and a plain grey background, unless told otherwise."""
    plain = {
        "blur_px": 0.7,
        "read_noise": 0.0,
        "electrons_per_grey": 1e12,
        "vignette": 0.0,
        "gradient": 0.0,
        "background": 0.2,
        "clutter": 0.0,
        "antenna": 0.9,
        "object": 0.4,
        "shading_asymmetry": 0.0,
    }
    return PictureSpec(**(plain | changes))


@functools.cache
def place(lens: str = "brown", **changes: float) -> Studio:
    """A studio with one of the lenses."""
    return studio(LENSES[lens], spec(**changes), np.random.default_rng(0))
