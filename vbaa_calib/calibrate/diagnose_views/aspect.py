"""A print whose scale differs in x and y, seen from the pictures alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...diagnosis import Diagnosis
from .scores import SetScores

FEWEST_VIEWS = 6
KNOWN = 2e-3
"""Standard deviation up to which the pictures tell the print's aspect: those rolled by a quarter turn or a half of it
do, for the others a long board and a lens with fy > fx are the same."""
SURE, MATTERS = 5.0, 1e-3
_GRAVE = 5e-3


@dataclass(frozen=True)
class PrintAspect:
    """How much longer the print is along its y than the spec says, relative to its x, with its standard deviation."""

    excess: float
    std: float

    @property
    def known(self) -> bool:
        """Whether the pictures tell."""
        return self.std < KNOWN


def print_aspect(scores: SetScores) -> PrintAspect | None:
    """From all views, lens and poses solved along; None where too few.

    The standard deviation is the larger of that from the corners' scatter and that from the scatter between the views.
    """
    direction, residuals = scores.common(SetScores.ASPECT)
    information, count = float(direction @ direction), len(scores.names)
    if count < FEWEST_VIEWS or not information > 0.0:
        return None
    excess = float(direction @ residuals) / information
    pull = np.add.reduceat(direction * (residuals - excess * direction), scores.bounds[:-1])
    between = float(pull @ pull) * count / (count - 1)
    std = np.sqrt(max(scores.variance_px2 * information, between)) / information
    return PrintAspect(excess, float(std))


def print_stretched(scores: SetScores) -> Diagnosis | None:
    """Whether the print's x and y differ in scale; None too where the pictures cannot tell."""
    aspect = print_aspect(scores)
    if aspect is None or not aspect.known or abs(aspect.excess) < max(SURE * aspect.std, MATTERS):
        return None
    longer, other = ("y", "x") if aspect.excess > 0 else ("x", "y")
    return Diagnosis(
        "print_stretched",
        f"the print is longer along its {longer} than along its {other} by {100 * abs(aspect.excess):.2f} ± "
        f"{100 * aspect.std:.2f} %",
        "measure both rulers of the print; print it anew without scaling, or on another printer",
        abs(aspect.excess) > _GRAVE,
    )
