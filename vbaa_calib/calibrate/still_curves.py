"""The antenna in stills as its model bends it: under each still's weight and load."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..antenna.shape import Curves, bend
from ..session import Load
from .joint_given import Observation

SWEEPS = 4
"""Of the antenna's model over its equilibrium, see `antenna.shape.bend`: more change nothing."""


def still_curves(
    observations: Sequence[Observation],
    antennas: np.ndarray,
    length_m: float,
    *,
    compliance: np.ndarray | None = None,
    loaded: bool = True,
) -> Curves:
    """Shapes of A antennas (A, 9) in each of F stills, still by still: (F·A) curves.

    compliance : (A, 2) factors on what bends each antenna to y and to z; 1 where not given.
    loaded : False takes the loads off; node `CONTACT` stays where they hang.
    """
    count, each = len(observations), len(antennas)
    factor = np.tile(np.ones((each, 2)) if compliance is None else compliance, (count, 1))
    gravity = np.repeat([one.gravity_m_s2 for one in observations], each, axis=0)
    load = np.repeat([one.load_N if loaded else np.zeros(2) for one in observations], each, axis=0)
    contact = [one.still.distance_m if isinstance(one.still, Load) else 0.5 * length_m for one in observations]
    return bend(
        np.tile(antennas, (count, 1)),
        length_m,
        gravity * np.hstack([np.ones((len(factor), 1)), factor]),
        np.repeat(contact, each),
        load * factor,
        dead=True,
        sweeps=SWEEPS,
    )
