"""Kannala and Brandt's fisheye: the image radius is θ (1 + k1 θ² + k2 θ⁴ + k3 θ⁶ + k4 θ⁸), θ the angle from the axis.

On the equidistant chart this is a purely radial polynomial with s = θ², regular on the axis and beyond 90°.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from vbaa_calib.core.arrays import Array

from .charts import EQUIDISTANT
from .model import Coefficients, LensModel, Path, absent, smallest_positive_root


def _radial(s: Array, c: Coefficients) -> tuple[Array, Array]:
    k1, k2, k3, k4 = c
    gain = 1.0 + s * (k1 + s * (k2 + s * (k3 + s * k4)))
    return gain, k1 + s * (2.0 * k2 + s * (3.0 * k3 + s * (4.0 * k4)))


def _distort(x: Array, y: Array, c: Coefficients) -> tuple[Array, Array]:
    gain, _ = _radial(x * x + y * y, c)
    return x * gain, y * gain


def _beside(x: Array, y: Array, c: Coefficients) -> tuple[Array, Array]:
    return 0.0 * x, 0.0 * y


def _linearize(x: Array, y: Array, c: Coefficients) -> tuple[Array, Array, Array, Array, Array, Array]:
    x2, y2 = x * x, y * y
    gain, d_gain = _radial(x2 + y2, c)
    twice = 2.0 * d_gain
    shear = twice * x * y
    return x * gain, y * gain, gain + twice * x2, shear, shear, gain + twice * y2


def _by_coefficient(x: Array, y: Array, c: Coefficients) -> list[tuple[Array, Array]]:
    s = x * x + y * y
    return [(x * power, y * power) for power in (s, s * s, s * s * s, s * s * s * s)]


def _path(c: Coefficients) -> Path:
    return "none" if absent(*c) else "radial"


def _tilt(c: Coefficients) -> None:
    return None


def _fold_radius(c: Sequence[float]) -> float:
    growth = [1.0] + [(2 * i + 3) * k for i, k in enumerate(c)]
    return math.sqrt(smallest_positive_root(growth, math.pi**2))


FISHEYE = LensModel(
    name="fisheye",
    chart=EQUIDISTANT,
    coefficient_names=("k1", "k2", "k3", "k4"),
    counts=(4,),
    radial=_radial,
    path=_path,
    distort=_distort,
    beside=_beside,
    linearize=_linearize,
    by_coefficient=_by_coefficient,
    tilt=_tilt,
    fold_radius=_fold_radius,
)
