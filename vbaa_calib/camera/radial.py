"""The inverse of a radial map ρ(r) = r·g(r²): a table gives the start and the bracket, Newton the digits."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from types import ModuleType
from typing import NamedTuple

import numpy as np

from vbaa_calib.core.arrays import Array, as_index

from .models import LensModel

FARTHEST = 1e3
"""Ideal radius at which a distorted perspective lens is cut off: 89.94° from the axis."""

_NODES = 2048
_FAST_STEPS = 2
_SAFE_STEPS = 60
_TABLE_STEPS = 12


@dataclass(frozen=True, eq=False)
class RadialTable:
    """r at even steps of ρ/(1 + ρ), over the branch on which ρ grows.

    ideal_limit, distorted_limit : where the branch ends.
    nodes, steps : r at each node, and from it to the next.
    nodes_per_unit : nodes for each unit of ρ/(1 + ρ).
    """

    ideal_limit: float
    distorted_limit: float
    nodes: np.ndarray
    steps: np.ndarray
    nodes_per_unit: float

    def start(self, xp: ModuleType, distorted: Array) -> tuple[Array, Array, Array]:
        """Table's radius for distorted radii in [0, distorted_limit], the node before it, and how far the next one is.

        The true radius lies between one step before that node and two after it.
        """
        nodes, steps = self.nodes, self.steps
        if xp is not np:
            nodes, steps = (xp.as_tensor(a, dtype=distorted.dtype, device=distorted.device) for a in (nodes, steps))
        place = self.nodes_per_unit * (distorted / (1.0 + distorted))
        index = as_index(place)
        low, step = nodes[index], steps[index]
        return low + (place - index) * step, low, step


class _RadialSolution(NamedTuple):
    """Radii (...) of distorted radii, whether each is on the branch and solved, and the gain and its slope by r²."""

    radius: Array
    valid: Array
    gain: Array
    d_gain: Array


def tolerance(xp: ModuleType, distorted: Array) -> Array:
    """Residual that counts as none, (...): some tens of roundings of the largest term."""
    return (5e-14 if distorted.dtype == xp.float64 else 3e-6) * distorted + 1e-300


def invert_radial(
    xp: ModuleType, model: LensModel, c: Sequence[float], table: RadialTable, distorted: Array, thorough: bool
) -> _RadialSolution:
    """Ideal radii of distorted ones (...) in [0, distorted_limit).

    Not thorough: where a few Newton steps do not arrive the radius is not valid.
    """
    radius, _, _ = table.start(xp, distorted)
    for _ in range(_FAST_STEPS):
        s = radius * radius
        gain, d_gain = model.radial(s, c)
        radius = radius - (radius * gain - distorted) / (gain + 2.0 * s * d_gain)
    found = _checked(xp, model, c, table, radius, distorted)
    if not thorough or bool(found.valid.all()):
        return found
    rest = ~found.valid
    _, node, step = table.start(xp, distorted[rest])
    radius[rest] = _bracketed(xp, model, c, distorted[rest], node - step, node + 2.0 * step)
    return _checked(xp, model, c, table, radius, distorted)


def _checked(
    xp: ModuleType, model: LensModel, c: Sequence[float], table: RadialTable, radius: Array, distorted: Array
) -> _RadialSolution:
    """Valid are radii at which the residual is at the rounding and ρ still grows."""
    s = radius * radius
    gain, d_gain = model.radial(s, c)
    solved = (xp.abs(radius * gain - distorted) <= tolerance(xp, distorted)) & (gain + 2.0 * s * d_gain > 0)
    return _RadialSolution(radius, solved & (radius >= 0) & (radius <= table.ideal_limit), gain, d_gain)


def _bracketed(
    xp: ModuleType,
    model: LensModel,
    c: Sequence[float],
    distorted: Array,
    low: Array,
    high: Array,
    steps: int = _SAFE_STEPS,
) -> Array:
    """Radius for each distorted radius by Newton kept inside [low, high], halving where it would leave."""
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


def radial_table(model: LensModel, c: Sequence[float]) -> RadialTable:
    """Follow ρ(r) from the axis to its fold, its pole, or the chart's end."""
    end = min(model.fold_radius(c), model.chart.radius_limit, FARTHEST)
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
    nodes = _bracketed(np, model, c, targets, radius[upper - 1], radius[upper], _TABLE_STEPS)
    nodes = np.maximum.accumulate(nodes)
    return RadialTable(
        ideal_limit=float(radius[-1]),
        distorted_limit=float(distorted[-1]),
        nodes=nodes,
        steps=np.append(np.diff(nodes), 0.0),
        nodes_per_unit=(_NODES - 1) / float(even[-1]),
    )
