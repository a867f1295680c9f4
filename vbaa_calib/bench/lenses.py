"""The lenses that the metric benchmark runs over: real calibrations, and shapes that are known to be hard."""

from __future__ import annotations

import numpy as np

from ..camera import Camera


def _camera(model: str, size: tuple[int, int], focal: float, centre: tuple[float, float], *distortion: float) -> Camera:
    matrix = np.array([[focal, 0.0, centre[0]], [0.0, focal, centre[1]], [0.0, 0.0, 1.0]])
    return Camera(model, size, matrix, np.array(distortion))


def lenses() -> dict[str, Camera]:
    """Name → camera."""
    return {
        "mild barrel, 4": _camera("opencv", (960, 720), 1004.0, (476.5, 363.2), -0.182, 0.061, 7e-4, -5e-4),
        "radial, 5": _camera("opencv", (1280, 720), 900.0, (643.2, 355.1), -0.25, 0.09, 0.0, 0.0, -0.01),
        "GoPro, 5": _camera("opencv", (1280, 720), 587.0, (640.2, 355.4), -0.2717, 0.1042, 5e-4, -6e-4, -0.0215),
        "endoscope, 5": _camera("opencv", (720, 576), 870.0, (280.2, 276.0), -0.3159, 0.4299, -1.7e-3, 7.6e-3, 0.742),
        "rational, 8": _camera(
            "opencv", (1280, 720), 587.0, (641.0, 356.2), 0.31, 0.025, 4e-4, -3e-4, 1e-3, 0.56, 0.061, 5e-3
        ),
        "strong barrel, 5": _camera("opencv", (1280, 720), 600.0, (643.2, 355.1), -0.38, 0.17, 8e-4, -5e-4, -0.035),
        "fisheye 170°": _camera("fisheye", (1600, 1200), 640.0, (803.1, 596.4), 0.02, -0.006, 0.002, -0.0006),
    }
