"""What a lens model has to say for itself; everything else is done for all models alike.

A model maps the ideal point (x, y) in its chart to the distorted point on the sensor's normalized plane:
a radial gain g, the rest (decentring, thin prism), then possibly a tilted sensor. Coefficients come as a sequence of
floats, or of tensors where gradients are wanted.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from vbaa_calib.core.arrays import Array

from .charts import Chart


def smallest_positive_root(coefficients: Sequence[float] | np.ndarray, limit: float) -> float:
    """Smallest real root in (0, limit] of Σ c_i s^i, coefficients (n,), or inf.

    Terms that do not matter anywhere up to the limit are left out: their roots lie beyond it.
    """
    scaled = np.asarray(coefficients, float) * limit ** np.arange(len(coefficients), dtype=float)
    kept = np.flatnonzero(np.abs(scaled) > 1e-15 * np.abs(scaled).max(initial=0.0))
    if kept.size == 0 or kept[-1] == 0:
        return math.inf
    roots = np.roots(scaled[kept[-1] :: -1])
    # a pair that rounding has lifted off the real axis still counts: the lens is flat there
    real = roots.real[np.abs(roots.imag) <= 1e-7 * np.abs(roots)]
    inside = real[(real > 0.0) & (real <= 1.0)]
    return float(inside.min() * limit) if inside.size else math.inf


Coefficients = Sequence[Array]
Path = Literal["none", "radial", "full"]


@dataclass(frozen=True)
class LensModel:
    """A camera model as data.

    name : as it stands in camera.json.
    chart : where its ideal points live.
    coefficient_names : of the longest vector, in file order.
    counts : lengths of the coefficient vector that are allowed.
    radial : (s = x² + y², c) → (g, dg/ds); a purely radial lens maps (x, y) to g·(x, y).
    path : c → the cheapest exact way through the map, the tilt aside: "none" (it changes nothing), "radial", "full".
    distort : (x, y, c) → distorted point before the sensor's tilt.
    beside : (x, y, c) → what of that is not radial: (xd, yd) − g·(x, y).
    linearize : (x, y, c) → that point and its derivatives: (xd, yd, dxd/dx, dxd/dy, dyd/dx, dyd/dy).
    by_coefficient : (x, y, c) → [(dxd/dc_i, dyd/dc_i), …] for the coefficients before the tilt.
    tilt : c → the sensor's two tilt angles, rad, or None.
    fold_radius : c → smallest radius at which the radial map stops growing or has a pole; may be inf.
    """

    name: str
    chart: Chart
    coefficient_names: tuple[str, ...]
    counts: tuple[int, ...]
    radial: Callable[[Array, Coefficients], tuple[Array, Array]]
    path: Callable[[Coefficients], Path]
    distort: Callable[[Array, Array, Coefficients], tuple[Array, Array]]
    beside: Callable[[Array, Array, Coefficients], tuple[Array, Array]]
    linearize: Callable[[Array, Array, Coefficients], tuple[Array, Array, Array, Array, Array, Array]]
    by_coefficient: Callable[[Array, Array, Coefficients], list[tuple[Array, Array]]]
    tilt: Callable[[Coefficients], tuple[Array, Array] | None]
    fold_radius: Callable[[Sequence[float]], float]


def absent(*coefficients: Array) -> bool:
    """Whether these are all plain zeros, so that their terms need not be computed.

    A tensor never counts as absent: its term has a derivative even where it is zero.
    """
    return set(map(type, coefficients)) <= {float} and not any(coefficients)
