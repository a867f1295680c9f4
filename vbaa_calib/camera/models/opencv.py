"""OpenCV's lens: rational radial terms, decentring, thin prism, tilted sensor; 0, 4, 5, 8, 12 or 14 coefficients.

Coefficient order k1 k2 p1 p2 [k3 [k4 k5 k6 [s1 s2 s3 s4 [tau_x tau_y]]]]. With g = (1 + k1 s + k2 s² + k3 s³) /
(1 + k4 s + k5 s² + k6 s³) and s = x² + y² on the z = 1 plane:

    xd = g x + 2 p1 x y + p2 (s + 2 x²) + s1 s + s2 s²
    yd = g y + p1 (s + 2 y²) + 2 p2 x y + s3 s + s4 s²

and then the sensor's tilt. No coefficients: a pinhole.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from numpy.polynomial import polynomial

from vbaa_calib.core.arrays import Array

from .charts import PERSPECTIVE
from .model import Coefficients, LensModel, Path, absent, smallest_positive_root

_NAMES = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4", "tau_x", "tau_y")
_POLYNOMIAL, _RATIONAL, _BEFORE_TILT = 5, 8, 12
_BEYOND = 1e6
"""Folds farther out than 1000 focal lengths (s = 1e6) are of no concern."""


def _padded(c: Coefficients) -> Coefficients:
    return (*c, *(0.0,) * (len(_NAMES) - len(c)))


def _radial(s: Array, c: Coefficients) -> tuple[Array, Array]:
    k1, k2, _, _, k3, k4, k5, k6, *_ = _padded(c)
    numerator, d_numerator = _series(s, k1, k2, k3)
    if len(c) <= _POLYNOMIAL or absent(k4, k5, k6):
        return numerator, d_numerator
    denominator, d_denominator = _series(s, k4, k5, k6)
    inverse = 1.0 / denominator
    gain = numerator * inverse
    return gain, (d_numerator - gain * d_denominator) * inverse


def _series(s: Array, a: Array, b: Array, c: Array) -> tuple[Array, Array]:
    """1 + a s + b s² + c s³ and its derivative by s; powers that are absent at the end cost nothing."""
    if not absent(c):
        return 1.0 + s * (a + s * (b + s * c)), a + s * (2.0 * b + s * (3.0 * c))
    if not absent(b):
        return 1.0 + s * (a + s * b), a + s * (2.0 * b)
    return 1.0 + s * a, a


def _path(c: Coefficients) -> Path:
    k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4, *_ = _padded(c)
    if not absent(p1, p2, s1, s2, s3, s4):
        return "full"
    return "none" if absent(k1, k2, k3, k4, k5, k6) else "radial"


def _distort(x: Array, y: Array, c: Coefficients) -> tuple[Array, Array]:
    if isinstance(x, torch.Tensor) and len(c):
        return _distort_by_kornia(x, y, c)
    gain, _ = _radial(x * x + y * y, c)
    if _path(c) != "full":
        return x * gain, y * gain
    dx, dy = _beside(x, y, c)
    return x * gain + dx, y * gain + dy


def _beside(x: Array, y: Array, c: Coefficients) -> tuple[Array, Array]:
    _, _, p1, p2, _, _, _, _, s1, s2, s3, s4, *_ = _padded(c)
    s = x * x + y * y
    twist = (2.0 * p1) * y + (2.0 * p2) * x
    dx, dy = x * twist + p2 * s, y * twist + p1 * s
    if not absent(s1, s2, s3, s4):
        dx, dy = dx + s * (s1 + s2 * s), dy + s * (s3 + s4 * s)
    return dx, dy


def _distort_by_kornia(x: torch.Tensor, y: torch.Tensor, c: Coefficients) -> tuple[torch.Tensor, torch.Tensor]:
    """Tensors go through kornia, whose forward map is right and whose gradients others have tested.

    The tilt is left to us: it must also be undone. One point to each of kornia's batches, so that coefficients may
    broadcast against points.
    """
    # importing kornia costs a second, and only those who work with tensors need it
    from kornia.geometry.calibration import distort_points

    terms = [torch.as_tensor(value, dtype=x.dtype, device=x.device) for value in c[:_BEFORE_TILT]]
    eye = torch.eye(3, dtype=x.dtype, device=x.device)
    points = torch.stack(torch.broadcast_tensors(x, y), -1)[..., None, :]
    distorted = distort_points(points, eye, torch.stack(torch.broadcast_tensors(*terms), -1), eye)[..., 0, :]
    return distorted[..., 0], distorted[..., 1]


def _linearize(x: Array, y: Array, c: Coefficients) -> tuple[Array, Array, Array, Array, Array, Array]:
    _, _, p1, p2, _, _, _, _, s1, s2, s3, s4, *_ = _padded(c)
    s = x * x + y * y
    gain, d_gain = _radial(s, c)
    twice = 2.0 * d_gain
    along_x, along_y = twice * x, twice * y
    if absent(p1, p2):
        xd, yd = x * gain, y * gain
        xx, xy, yy = gain + x * along_x, x * along_y, gain + y * along_y
    else:
        # decentring is a gain of 2 (p1 y + p2 x) and (p2 s, p1 s)
        gain = gain + (2.0 * p1) * y + (2.0 * p2) * x
        xd, yd = x * gain + p2 * s, y * gain + p1 * s
        xx, yy = gain + x * (along_x + 4.0 * p2), gain + y * (along_y + 4.0 * p1)
        xy = x * (along_y + 2.0 * p1) + (2.0 * p2) * y
    yx = xy
    if len(c) > _RATIONAL and not absent(s1, s2, s3, s4):
        xd, yd = xd + s * (s1 + s2 * s), yd + s * (s3 + s4 * s)
        slope_x, slope_y = 2.0 * s1 + 4.0 * s2 * s, 2.0 * s3 + 4.0 * s4 * s
        xx, xy, yx, yy = xx + x * slope_x, xy + y * slope_x, yx + x * slope_y, yy + y * slope_y
    return xd, yd, xx, xy, yx, yy


def _by_coefficient(x: Array, y: Array, c: Coefficients) -> list[tuple[Array, Array]]:
    _, _, _, _, _, k4, k5, k6, *_ = _padded(c)
    x2, y2 = x * x, y * y
    s = x2 + y2
    inverse = 1.0 if absent(k4, k5, k6) else 1.0 / _series(s, k4, k5, k6)[0]
    xy2 = 2.0 * x * y
    columns = _along(x, y, s, s * inverse)
    columns[2:2] = [(xy2, s + 2.0 * y2), (s + 2.0 * x2, xy2)]
    if len(c) > _POLYNOMIAL:
        columns += _along(x, y, s, -s * _radial(s, c)[0] * inverse)
    if len(c) > _RATIONAL:
        s2, zero = s * s, 0.0 * s
        columns += [(s, zero), (s2, zero), (zero, s), (zero, s2)]
    return columns[: len(c)]


def _along(x: Array, y: Array, s: Array, first: Array) -> list[tuple[Array, Array]]:
    """(x, y) times the first power's factor, and that times s and s²."""
    powers = first, s * first, s * s * first
    return [(x * power, y * power) for power in powers]


def _tilt(c: Coefficients) -> tuple[Array, Array] | None:
    return None if len(c) < len(_NAMES) or absent(*c[12:]) else (c[12], c[13])


def _fold_radius(c: Sequence[float]) -> float:
    k1, k2, _, _, k3, k4, k5, k6, *_ = _padded(c)
    numerator, denominator = (1.0, k1, k2, k3), (1.0, k4, k5, k6)
    # d(r g)/dr has the sign of N D + 2 s (N' D − N D')
    d_numerator, d_denominator = polynomial.polyder(numerator), polynomial.polyder(denominator)
    wronskian = polynomial.polysub(
        polynomial.polymul(d_numerator, denominator), polynomial.polymul(numerator, d_denominator)
    )
    growth = polynomial.polyadd(polynomial.polymul(numerator, denominator), polynomial.polymulx(2.0 * wronskian))
    fold, pole = smallest_positive_root(growth, _BEYOND), smallest_positive_root(denominator, _BEYOND)
    return float(np.sqrt(min(fold, pole)))


OPENCV = LensModel(
    name="opencv",
    chart=PERSPECTIVE,
    coefficient_names=_NAMES,
    counts=(0, 4, 5, 8, 12, 14),
    radial=_radial,
    path=_path,
    distort=_distort,
    beside=_beside,
    linearize=_linearize,
    by_coefficient=_by_coefficient,
    tilt=_tilt,
    fold_radius=_fold_radius,
)
