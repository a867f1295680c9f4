"""Nodes at which the antenna's shape is computed: see `nodes.hpp` of the core."""

from __future__ import annotations

import numpy as np

from vbaa_calib.native import core

CONTACT: int = core.antenna.NODES_TO_CONTACT - 1  # the contact's node


def aligned_arclength(contact_m: np.ndarray, length_m: float) -> np.ndarray:
    """(B, N) arc lengths of nodes from clamp to tip, one of them at the contact, where the shape's curvature has a
    kink."""
    contact = contact_m[:, None]
    beyond = contact + (length_m - contact) * np.linspace(0.0, 1.0, core.antenna.NODES_BEYOND + 1)[1:]
    return np.concatenate([contact * np.linspace(0.0, 1.0, core.antenna.NODES_TO_CONTACT), beyond], -1)
