"""Facts about an object estimate in words, for reports and legends."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from estimator.object.estimate import ObjectEstimate


@dataclass(frozen=True)
class Fact:
    """A line of a verdict. `kind` is "undetermined", "look" for what is amiss, or empty."""

    label: str
    words: str
    kind: str = ""


def sentence(text: str) -> str:
    """With a capital at its begin and a full stop at its end."""
    text = text.strip().rstrip(".")
    return f"{text[:1].upper()}{text[1:]}."


def object_facts(estimate: ObjectEstimate) -> tuple[Fact, Fact]:
    """μ and the object's stiffness with their intervals, or why they are undetermined."""
    friction, compliance = estimate.friction, estimate.surface.compliance
    slides = Fact("Friction", sentence(f"Undetermined: {friction.reason}"), "undetermined")
    if friction.determined:
        low, high = friction.interval
        alpha = np.degrees(friction.cone_half_angle_rad)
        words = f"μ = {friction.mu:.3f} ± {friction.std:.3f} (95 %: {low:.3f} to {high:.3f}), cone half angle α = "
        slides = Fact("Friction", "; ".join(filter(None, [f"{words}{alpha:.1f}°", friction.reason.rstrip(".")])) + ".")
    low, high = compliance.interval_N_m
    if compliance.determined:
        most = f"to {high:.4g} N/m" if np.isfinite(high) else "upwards"
        return slides, Fact("Stiffness", f"{compliance.stiffness_N_m:.4g} N/m (95 %: {low:.4g} {most}).")
    bound = np.isfinite(low) and low > 0
    words = compliance.reason if bound else f"Undetermined: {compliance.reason}"
    return slides, Fact("Stiffness", sentence(words), "undetermined")
