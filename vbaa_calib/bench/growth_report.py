"""What was found of growth, as text, rows and numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from .growth_fit import Power
from .growth_follow import Grown


@dataclass(frozen=True)
class GrowthRow:
    """One size of one series.

    Attributes
    ----------
    seconds : of the processor, least of several timings.
    risen_MB, peak_MB : of the resident set; None where the system does not tell.
    time_exponent, time_exponent_std, memory_exponent, memory_exponent_std : of the series, over its upper half.
    time_allowed, memory_allowed : the largest exponents that are all right.
    """

    series: str
    unit: str
    size: int
    seconds: float
    risen_MB: float | None
    peak_MB: float | None
    time_exponent: float | None
    time_exponent_std: float | None
    time_allowed: float
    memory_exponent: float | None
    memory_exponent_std: float | None
    memory_allowed: float


def as_rows(grown: Sequence[Grown]) -> list[GrowthRow]:
    """Every size of every series."""
    return [
        GrowthRow(
            series=each.series.name,
            unit=each.series.unit,
            size=size,
            seconds=cost.seconds,
            risen_MB=_known(cost.risen_MB),
            peak_MB=_known(cost.peak_MB),
            time_exponent=_known(each.time.exponent),
            time_exponent_std=_known(each.time.std),
            time_allowed=each.series.time_exponent,
            memory_exponent=_known(each.memory.exponent),
            memory_exponent_std=_known(each.memory.std),
            memory_allowed=each.series.memory_exponent,
        )
        for each in grown
        for size, cost in zip(each.sizes, each.costs, strict=True)
    ]


def _known(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def table(grown: Sequence[Grown]) -> str:
    """A line for each series."""
    lines = [
        "cost ∝ sizeᵉ, e ± std over the upper half; seconds of the processor; MB: rise of the resident set",
        f"{'':25s} {'sizes':>22s}  {'seconds':>15s} {'e, time':>13s} {'≤':>4s} {'MB':>11s} {'e, memory':>13s}    ≤",
    ]
    for each in grown:
        series, ends = each.series, f"{each.sizes[0]} to {each.sizes[-1]} {each.series.unit}"
        seconds = f"{each.seconds[0]:.3g} to {each.seconds[-1]:.3g}"
        memory = f"{each.risen_MB[0]:.0f} to {each.risen_MB[-1]:.0f}"
        lines.append(
            f"{series.name:25s} {ends:>22s}  {seconds:>15s} {told(each.time):>13s} {series.time_exponent:4.1f} "
            f"{memory:>11s} {told(each.memory):>13s} {series.memory_exponent:4.1f}{'  WORSE' if each.worse else ''}"
        )
    return "\n".join([*lines, "", *(f"{each.series.name}: {each.series.why}" for each in grown)])


def told(power: Power) -> str:
    """An exponent with its deviation."""
    return f"{power.exponent:.2f} ± {power.std:.2f}" if np.isfinite(power.exponent) else "–"


def numbers(grown: Sequence[Grown]) -> dict[str, Any]:
    """For --json."""
    return {
        each.series.name: {
            "sizes": list(each.sizes),
            "seconds": each.seconds.tolist(),
            "risen_MB": each.risen_MB.tolist(),
            "time_exponent": each.time.exponent,
            "time_exponent_std": each.time.std,
            "memory_exponent": each.memory.exponent,
            "memory_exponent_std": each.memory.std,
            "worse": each.worse,
        }
        for each in grown
    }
