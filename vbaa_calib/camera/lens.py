"""A lens made ready: the cheapest exact way through it, and how far it may be trusted.

The radial map ρ(r) = r·g(r²) is inverted by a table, which gives the start and the bracket, and Newton, the digits.

A lens with decentring or prism terms is trusted direction by direction: the symmetric part of the Jacobian is positive
definite from the axis to the rim. Without prism terms the Jacobian is symmetric, so the rim is where its determinant
first reaches zero, the fold. The region is convex (where the folds leave it notched, the largest disc inside is taken),
and on a convex region the map is then one to one: (F(a) − F(b))·(a − b) > 0 for any two of its points.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import product
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np

from vbaa_calib.core.arrays import Array, as_index, is_tensor

from .models import MODELS, Coefficients, LensModel

if TYPE_CHECKING:
    import torch

_FARTHEST = 1e3  # ideal radius at which a distorted perspective lens is cut off: 89.94° from the axis
_NODES = 2048
_FAST_STEPS, _SAFE_STEPS, _TABLE_STEPS = 2, 60, 12
_DIRECTIONS, _RADII, _HALVINGS = 90, 160, 30


@dataclass(frozen=True, eq=False)
class RadialTable:
    """r at even steps of ρ/(1 + ρ), over the branch on which ρ grows."""

    ideal_limit: float  # where the branch ends
    distorted_limit: float  # the same of ρ
    nodes: np.ndarray  # r at each node
    steps: np.ndarray  # from it to the next
    nodes_per_unit: float  # nodes for each unit of ρ/(1 + ρ)

    def start(self, xp: ModuleType, distorted: Array) -> tuple[Array, Array, Array]:
        """Table's radius for distorted radii in [0, distorted_limit], the node before it, and the step to the next; the
        true radius lies between one step before that node and two after it."""
        nodes, steps = self.nodes, self.steps
        if xp is not np:
            nodes, steps = (xp.as_tensor(a, dtype=distorted.dtype, device=distorted.device) for a in (nodes, steps))
        place = self.nodes_per_unit * (distorted / (1.0 + distorted))
        index = as_index(place)
        low, step = nodes[index], steps[index]
        return low + (place - index) * step, low, step


def tolerance(xp: ModuleType, distorted: Array) -> Array:
    """Residual that counts as none, (...): some tens of roundings of the largest term."""
    return (5e-14 if distorted.dtype == xp.float64 else 3e-6) * distorted + 1e-300


def invert_radial(
    xp: ModuleType, model: LensModel, c: Sequence[float], table: RadialTable, distorted: Array, thorough: bool
) -> tuple[Array, Array, Array, Array]:
    """Ideal radii of distorted ones (...) in [0, distorted_limit), whether each is on the branch and solved, and the
    gain and its slope by r². Not thorough: not valid where a few Newton steps do not converge."""
    radius, _, _ = table.start(xp, distorted)
    for _ in range(_FAST_STEPS):
        s = radius * radius
        gain, d_gain = model.radial(s, c)
        radius = radius - (radius * gain - distorted) / (gain + 2.0 * s * d_gain)
    found = _checked(xp, model, c, table, radius, distorted)
    if not thorough or bool(found[1].all()):
        return found
    rest = ~found[1]
    _, node, step = table.start(xp, distorted[rest])
    radius[rest] = _bracketed(xp, model, c, distorted[rest], (node - step, node + 2.0 * step), _SAFE_STEPS)
    return _checked(xp, model, c, table, radius, distorted)


def _checked(
    xp: ModuleType, model: LensModel, c: Sequence[float], table: RadialTable, radius: Array, distorted: Array
) -> tuple[Array, Array, Array, Array]:
    """Valid are radii at which the residual is at the rounding and ρ still grows."""
    s = radius * radius
    gain, d_gain = model.radial(s, c)
    solved = (xp.abs(radius * gain - distorted) <= tolerance(xp, distorted)) & (gain + 2.0 * s * d_gain > 0)
    return radius, solved & (radius >= 0) & (radius <= table.ideal_limit), gain, d_gain


def _bracketed(
    xp: ModuleType, model: LensModel, c: Sequence[float], distorted: Array, bracket: tuple[Array, Array], steps: int
) -> Array:
    """Radius for each distorted radius by Newton kept inside the bracket, halving where it would leave."""
    low, high = bracket
    radius, close = 0.5 * (low + high), 0.1 * tolerance(xp, distorted)
    for _ in range(steps):
        s = radius * radius
        gain, d_gain = model.radial(s, c)
        residual = radius * gain - distorted
        low, high = xp.where(residual <= 0, radius, low), xp.where(residual >= 0, radius, high)
        step = radius - residual / (gain + 2.0 * s * d_gain)
        # a Newton step that leaves the bracket, or is no number, is replaced; halving alone would do, more slowly
        following = xp.where((step > low) & (step < high), step, 0.5 * (low + high))
        done = (xp.abs(residual) <= close) | (following == radius)
        if bool(done.all()):
            break
        radius = xp.where(done, radius, following)
    return radius


def _radial_table(model: LensModel, c: Sequence[float]) -> RadialTable:
    """Follow ρ(r) from the axis to its fold, its pole, or the chart's end."""
    end = min(model.fold_radius(c), model.chart.radius_limit, _FARTHEST)
    # stop a hair before the end: at a pole there is no value
    radius = np.tan(np.linspace(0.0, math.atan(end) * (1.0 - 1e-12), _NODES))
    gain, _ = model.radial(radius * radius, c)
    distorted = radius * gain
    grows = np.isfinite(distorted[1:]) & (np.diff(distorted) > 0.0)
    count = _NODES if grows.all() else int(np.argmin(grows)) + 1
    radius, distorted = radius[:count], distorted[:count]
    if count == 1:
        return RadialTable(0.0, 0.0, np.zeros(2), np.zeros(2), 0.0)
    even = np.linspace(0.0, distorted[-1] / (1.0 + distorted[-1]), _NODES)
    targets = np.append(even[:-1] / (1.0 - even[:-1]), distorted[-1])
    upper = np.clip(np.searchsorted(distorted, targets), 1, count - 1)
    nodes = _bracketed(np, model, c, targets, (radius[upper - 1], radius[upper]), _TABLE_STEPS)
    nodes = np.maximum.accumulate(nodes)
    return RadialTable(
        ideal_limit=float(radius[-1]),
        distorted_limit=float(distorted[-1]),
        nodes=nodes,
        steps=np.append(np.diff(nodes), 0.0),
        nodes_per_unit=(_NODES - 1) / float(even[-1]),
    )


@dataclass(frozen=True, eq=False)
class _Rim:
    """A closed curve around the axis, as a radius in each of evenly spaced directions from −π on."""

    radii: np.ndarray  # in each direction
    steps: np.ndarray  # from it to the next
    inner: float  # the smallest radius

    @staticmethod
    def of(radii: np.ndarray) -> _Rim:
        """From one radius for each direction."""
        closed = np.append(radii, radii[0])
        return _Rim(closed, np.append(np.diff(closed), 0.0), float(radii.min()))

    def encloses(self, xp: ModuleType, x: Array, y: Array) -> Array:
        """Whether points (...) lie inside."""
        radius2 = x * x + y * y
        inside = radius2 < self.inner * self.inner
        if bool(inside.all()):
            return inside
        radii, steps = self.radii, self.steps
        if xp is not np:
            radii, steps = (xp.as_tensor(a, dtype=x.dtype, device=x.device) for a in (radii, steps))
        place = (xp.arctan2(y, x) + math.pi) * (_DIRECTIONS / (2.0 * math.pi))
        index = as_index(xp.where(xp.isfinite(place), place, 0.0))
        return xp.sqrt(radius2) < radii[index] + (place - index) * steps[index]


@dataclass(frozen=True, eq=False)
class Sectors:
    """The trusted region of a lens."""

    ideal: _Rim  # its rim
    reach: _Rim  # nothing inside is distorted to a point outside this rim
    distorted_radius: float  # smallest distorted radius on the region's rim


def definite(xx: Array, xy: Array, yx: Array, yy: Array) -> Array:
    """Whether the symmetric part of [[xx, xy], [yx, yy]] is positive definite (the determinant is then positive)."""
    shear = 0.5 * (xy + yx)
    return (xx + yy > 0) & (xx * yy - shear * shear > 0)


def _sectors(model: LensModel, c: Sequence[float], farthest: float) -> Sectors:
    """Follow each direction from the axis until the Jacobian is no longer definite, or `farthest`."""
    angle = np.linspace(-math.pi, math.pi, _DIRECTIONS, endpoint=False)[:, None]
    cosine, sine = np.cos(angle), np.sin(angle)
    radius = np.tan(np.linspace(0.0, math.atan(farthest) * (1.0 - 1e-12), _RADII))
    xd, yd, *jacobian = model.linearize(radius * cosine, radius * sine, c)
    good = definite(*jacobian) & np.isfinite(xd) & np.isfinite(yd)
    good[:, 0] = True
    end = np.where(good.all(axis=1), _RADII, np.argmin(good, axis=1))
    low, high = radius[end - 1], radius[np.minimum(end, _RADII - 1)]
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        _, _, *jacobian = model.linearize(middle * cosine[:, 0], middle * sine[:, 0], c)
        good_there = definite(*jacobian)
        low, high = np.where(good_there, middle, low), np.where(good_there, high, middle)
    if not _is_convex(low * cosine[:, 0], low * sine[:, 0]):
        # a rim with a notch can enclose two points with one image: fall back to the disc
        low = np.full_like(low, low.min())
        end = np.searchsorted(radius, low, side="right")
    edge_x, edge_y = model.distort(low * cosine[:, 0], low * sine[:, 0], c)
    inside = np.arange(_RADII) < end[:, None]
    every_x, every_y = np.append(xd[inside], edge_x), np.append(yd[inside], edge_y)
    return Sectors(_Rim.of(low), _reach(every_x, every_y), float(np.hypot(edge_x, edge_y).min()))


def _is_convex(x: np.ndarray, y: np.ndarray) -> bool:
    """Whether a polygon around the axis, given anticlockwise, turns left at every corner."""
    edge_x, edge_y = np.roll(x, -1) - x, np.roll(y, -1) - y
    return bool((edge_x * np.roll(edge_y, -1) - edge_y * np.roll(edge_x, -1) > 0.0).all())


def _reach(x: np.ndarray, y: np.ndarray) -> _Rim:
    """A rim around points: their greatest radius in each direction's neighbourhood, and a little more."""
    place = np.rint((np.arctan2(y, x) + math.pi) * (_DIRECTIONS / (2.0 * math.pi))).astype(int) % _DIRECTIONS
    farthest = np.zeros(_DIRECTIONS)
    np.maximum.at(farthest, place, np.hypot(x, y))
    around = np.max([np.roll(farthest, shift) for shift in (-1, 0, 1)], axis=0)
    return _Rim.of(1.003 * around)


@dataclass(frozen=True, eq=False)
class Lens:
    """A lens model with its coefficients, and all that is worked out once for them."""

    model: LensModel
    coefficients: tuple[float, ...]
    table: RadialTable | None  # start values and the end of the monotonic branch; None on the path "none"
    sectors: Sectors | None  # the trusted region; only on the path "full"

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
        table = _radial_table(model, coefficients)
        if path == "radial":
            return Lens(model, coefficients, table, None)
        # never past the radial part's own fold or pole: what lies beyond a pole is another branch
        return Lens(model, coefficients, table, _sectors(model, coefficients, table.ideal_limit))


def lens_of(model: LensModel, c: Coefficients | torch.Tensor) -> Lens:
    """The one lens of these coefficients, (k,) numbers or a tensor."""
    return _prepare(model.name, tuple(c.tolist() if is_tensor(c) else c))


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
