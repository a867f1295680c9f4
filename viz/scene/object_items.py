"""What was felt, as a scene draws and says it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .markup import sentence
from .scene import Touch

if TYPE_CHECKING:
    from estimator.object.estimate import Felt
    from estimator.object.friction import Friction
    from estimator.object.surface import Compliance

VAGUE_RAD = np.radians(20)
"""A normal less well known than this is not drawn: it would show the force's direction, not the object's."""


def touch_of(felt: Felt) -> Touch:
    """Normals that are told, the friction cone if it is, and sentences."""
    normals = felt.normals
    known = normals.std_rad < VAGUE_RAD
    return Touch(
        row=felt.friction.row,
        normals=np.where(known[:, None], normals.normal, np.nan),
        cone_rad=float(felt.friction.cone_half_angle_rad) if felt.friction.told else None,
        facts=(
            _friction(felt.friction),
            _stiffness(felt.compliance),
            *(sentence(note) for note in felt.surface.notes),
        ),
    )


def _friction(friction: Friction) -> str:
    low, high = friction.interval
    if friction.told:
        return f"Friction: μ = {friction.mu:.3f} ± {friction.std:.3f} (95 %: {low:.3f} to {high:.3f})."
    return f"Friction cannot be told: {sentence(friction.reason)}"


def _stiffness(compliance: Compliance) -> str:
    if not compliance.told:
        return sentence(compliance.reason)
    low, high = compliance.interval_N_m
    ends = f"{low:.3g} to {high:.3g} N/m" if np.isfinite(high) else f"{low:.3g} N/m upwards"
    return f"The object's stiffness: {compliance.stiffness_N_m:.3g} N/m (95 %: {ends})."
