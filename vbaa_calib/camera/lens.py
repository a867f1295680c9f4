"""A lens made ready: the cheapest exact way through it, and how far it may be trusted."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from itertools import product
from types import ModuleType
from typing import Any

import numpy as np
import torch

from vbaa_calib.camera.models.model import Coefficients
from vbaa_calib.core.arrays import Array

from .limits import Sectors, definite, sectors
from .models import MODELS, LensModel
from .radial import RadialTable, radial_table


@dataclass(frozen=True, eq=False)
class Lens:
    """A lens model with its coefficients, and all that is worked out once for them.

    table : start values and the end of the monotonic branch; None on the path "none".
    sectors : the trusted region; only on the path "full".
    """

    model: LensModel
    coefficients: tuple[float, ...]
    table: RadialTable | None
    sectors: Sectors | None

    @property
    def ideal_limit(self) -> float:
        """Largest ideal radius trusted in every direction."""
        if self.sectors is not None:
            return self.sectors.ideal.inner
        return self.model.chart.radius_limit if self.table is None else self.table.ideal_limit

    @property
    def distorted_limit(self) -> float:
        """Its distorted radius, before the sensor's tilt."""
        if self.sectors is not None:
            return self.sectors.distorted_radius
        return self.model.chart.radius_limit if self.table is None else self.table.distorted_limit

    def contains(self, xp: ModuleType, x: Array, y: Array) -> Array:
        """Whether ideal points (...) lie in the region that hangs together with the axis. No gradients."""
        radius2 = x * x + y * y
        inside = radius2 < self.ideal_limit**2
        if self.sectors is None or bool(inside.all()):
            return inside
        _, _, *jacobian = self.model.linearize(x, y, self.coefficients)
        return definite(*jacobian) & self.sectors.ideal.encloses(xp, x, y)


@lru_cache(maxsize=128)
def _prepare(name: str, coefficients: tuple[float, ...]) -> Lens:
    """The lens of that model and these coefficients. A few milliseconds; the latest 128 are remembered."""
    model = MODELS[name]
    with np.errstate(all="ignore"):
        path = model.path(coefficients)
        if path == "none":
            return Lens(model, coefficients, None, None)
        table = radial_table(model, coefficients)
        if path == "radial":
            return Lens(model, coefficients, table, None)
        # never past the radial part's own fold or pole: what lies beyond a pole is another branch
        return Lens(model, coefficients, table, sectors(model, coefficients, table.ideal_limit))


def lens_of(model: LensModel, c: Coefficients | torch.Tensor) -> Lens:
    """The one lens of these coefficients, (k,) numbers or a tensor."""
    return _prepare(model.name, tuple(c.tolist() if isinstance(c, torch.Tensor) else c))


def each_lens(model: LensModel, c: torch.Tensor, shape: tuple[int, ...]) -> Iterator[tuple[Any, Lens]]:
    """Which of the points, in an array of that shape, belong to which lens of c, (..., k) broadcast against them."""
    if c.ndim == 1:
        yield ..., lens_of(model, c)
        return
    sizes = (1,) * (len(shape) + 1 - c.ndim) + tuple(c.shape[:-1])
    lenses = c.detach().reshape((*sizes, c.shape[-1]))
    for place in product(*map(range, sizes)):
        # a dimension that the lenses do not have belongs to one lens as a whole
        where = tuple(slice(None) if size == 1 else i for i, size in zip(place, sizes, strict=True))
        yield where, lens_of(model, lenses[place])
