"""Lenses to try: published calibrations, typical shapes of each model, and hostile ones."""

from __future__ import annotations

import math

import numpy as np

from vbaa_calib.camera import Camera


def camera(model: str, size: tuple[int, int], fx: float, fy: float, cx: float, cy: float, distortion) -> Camera:
    """A camera from bare numbers."""
    return Camera(model, size, np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]), np.array(distortion, float))


def _opencv(focal: float, *distortion: float) -> Camera:
    return camera("opencv", (1280, 720), focal, 1.01 * focal, 643.2, 355.1, distortion)


def _fisheye(focal: float, *distortion: float) -> Camera:
    return camera("fisheye", (1600, 1200), focal, focal, 803.1, 596.4, distortion)


_GOPRO = (5.70126130e-1, -5.70435346e-1, 3.89275117e-4, -5.89263800e-4, -4.88942040e-2)
_GOPRO += (8.65418192e-1, -5.13053770e-1, -1.78884281e-1)
_REALSENSE = (1.19206199e-2, 7.23205593e-1, 3.61752994e-4, -3.81619183e-4, -2.46726240)
_LAPAROSCOPE_LEFT = (-0.23737592, -0.24352789, 0.00298872, -0.00141349, 1.35717676)
_LAPAROSCOPE_RIGHT = (-0.20811931, -0.49619427, -0.00654033, 0.00033924, 2.31680455)
_RATIONAL = (0.31, 0.025, 4e-4, -3e-4, 1e-3, 0.56, 0.061, 5e-3)
_PRISM = (1e-3, -4e-4, 7e-4, 3e-4)

REAL = {
    "gopro rational": camera("opencv", (1280, 720), 586.82908524, 586.82908524, 641.01812808, 356.16960629, _GOPRO),
    "gopro five": camera(
        "opencv", (1280, 720), 587.27, 586.88, 640.24, 355.44, (-0.2717, 0.1042, 5e-4, -6e-4, -0.0215)
    ),
    "realsense author": camera(
        "opencv", (1280, 720), 898.29013566, 901.06978764, 649.37165774, 362.52689739, _REALSENSE
    ),
    "realsense measured": camera(
        "opencv", (1280, 720), 898.74, 901.55, 648.61, 362.64, (0.0101, 0.7388, 5e-4, -5e-4, -2.503)
    ),
    "endoscope left": camera(
        "opencv", (720, 576), 833.51, 909.43, 280.19, 275.98, (-0.3159, 0.4299, -0.0017, 0.0076, 0.742)
    ),
    "laparoscope left": camera("opencv", (1920, 1080), 2007.32021, 2013.72377, 945.46865, 619.10350, _LAPAROSCOPE_LEFT),
    "laparoscope right": camera("opencv", (1920, 1080), 2030.49, 2046.28, 1046.13, 552.05, _LAPAROSCOPE_RIGHT),
}

TYPICAL = {
    "pinhole": _opencv(900.0),
    "zero coefficients": _opencv(900.0, 0, 0, 0, 0, 0),
    "barrel": _opencv(900.0, -0.25, 0.09, 0, 0, -0.01),
    "barrel folding": _opencv(700.0, -0.35, 0, 0, 0),
    "pincushion": _opencv(900.0, 0.2, 0.1, 0, 0),
    "mustache": _opencv(800.0, -0.3, 0.35, 0, 0, -0.02),
    "tele": _opencv(8000.0, -1.5, 60.0, 2e-3, -1e-3),
    "decentred": _opencv(900.0, -0.25, 0.09, 2e-3, -3e-3, -0.01),
    "only decentred": _opencv(900.0, 0, 0, 1e-2, -1e-2),
    "rational radial": _opencv(600.0, 0.31, 0.025, 0, 0, 1e-3, 0.56, 0.061, 5e-3),
    "rational": _opencv(600.0, *_RATIONAL),
    "rational with a pole": _opencv(500.0, 0.1, 0, 0, 0, 0, -0.9, 0, 0),
    "rational, numerator = denominator": _opencv(500.0, 0.4, 0.1, 0, 0, 0.02, 0.4, 0.1, 0.02),
    "prism": _opencv(800.0, *_RATIONAL, *_PRISM),
    "prism strong": _opencv(800.0, -0.2, 0.05, 0, 0, 0, 0, 0, 0, 2e-2, -1e-2, -3e-2, 1e-2),
    "only prism": _opencv(800.0, 0, 0, 0, 0, 0, 0, 0, 0, 1e-2, 0, -1e-2, 0),
    "tilted": _opencv(800.0, *_RATIONAL, *_PRISM, 0.03, -0.05),
    "tilted strongly": _opencv(1200.0, -0.1, 0.02, 1e-3, 1e-3, 0, 0, 0, 0, 0, 0, 0, 0, 0.25, -0.3),
    "only tilted": _opencv(900.0, *(0.0,) * 12, 0.1, 0.05),
    "tilted radial": _opencv(900.0, -0.2, 0.05, *(0.0,) * 10, -0.1, 0.07),
    "fisheye equidistant": _fisheye(500.0, 0, 0, 0, 0),
    "fisheye 170": _fisheye(520.0, -0.02, 0.006, -0.002, 2e-4),
    "fisheye 200": _fisheye(430.0, -0.03, 0.004, -9e-4, 4e-5),
    "fisheye folding": _fisheye(500.0, -0.2, 0, 0, 0),
    "fisheye tele": _fisheye(3000.0, 0.3, -0.5, 0.2, -0.1),
}

LENSES = REAL | TYPICAL


def border_and_grid(of: Camera, count: int = 41) -> np.ndarray:
    """(count², 2) pixels over the whole image, its border included."""
    width, height = of.image_size
    u, v = np.meshgrid(np.linspace(-0.5, width - 0.5, count), np.linspace(-0.5, height - 0.5, count))
    return np.stack([u.ravel(), v.ravel()], -1)


def random_camera(rng: np.random.Generator) -> Camera:
    """A lens of any model, from mild to absurd: folds and poles anywhere."""
    focal = 10 ** rng.uniform(2.5, 3.5)
    strength = 10 ** rng.uniform(-2.5, 0.3)
    if rng.random() < 0.2:
        return _fisheye(focal, *(rng.normal(size=4) * strength * [1, 0.5, 0.2, 0.1]))
    count = int(rng.choice([4, 5, 8, 12, 14]))
    d = np.zeros(14)
    d[[0, 1, 4]] = rng.normal(size=3) * strength * [1, 1, 0.5]
    d[5:8] = (d[[0, 1, 4]] if rng.random() < 0.5 else 0.0) + rng.normal(size=3) * 0.3 * strength
    d[2:4] = rng.normal(size=2) * 10 ** rng.uniform(-4, -1) * (rng.random() < 0.8)
    d[8:12] = rng.normal(size=4) * 10 ** rng.uniform(-4, -1)
    d[12:] = rng.normal(size=2) * 0.1
    return _opencv(focal, *d[:count])


def random_directions(rng: np.random.Generator, count: int, half_angle_rad: float) -> np.ndarray:
    """(count, 3) unit vectors within an angle of the axis."""
    theta, azimuth = half_angle_rad * np.sqrt(rng.random(count)), rng.uniform(-math.pi, math.pi, count)
    return np.stack([np.sin(theta) * np.cos(azimuth), np.sin(theta) * np.sin(azimuth), np.cos(theta)], -1)
