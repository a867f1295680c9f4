"""What comes of an antenna that strokes an object: the contact in each frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..antenna.rod import RodShape
from ..geometry import Pose


@dataclass(frozen=True, eq=False)
class Touch:
    """The contact in each of B frames.

    Attributes
    ----------
    in_contact : (B,) bool.
    contact_m : (B,) arc length of the contact from the clamp; NaN without contact.
    force_antenna_N : (B, 3) the object's force on the antenna, antenna frame; zero without contact.
    contact_antenna_m : (B, 3) point of the centreline at the contact, antenna frame; NaN without contact.
    touched_world_m, normal_world : (B, 3) the touched point of the object's undeformed surface and the outward normal
        there; NaN without contact.
    sticks : (B,) bool; touched in the frame before too, and not slid since (`strokes.STICKS_M`).
    slip_world_m : (B, 3) way of the antenna's material point at the contact along the object since the frame before;
        zero where there was no contact.
    shape : the antenna under its weight and this force.
    """

    in_contact: np.ndarray
    contact_m: np.ndarray
    force_antenna_N: np.ndarray
    contact_antenna_m: np.ndarray
    touched_world_m: np.ndarray
    normal_world: np.ndarray
    sticks: np.ndarray
    slip_world_m: np.ndarray
    shape: RodShape


def stacked(poses: Sequence[Pose]) -> tuple[np.ndarray, np.ndarray]:
    """Rotations (B, 3, 3) and translations (B, 3) of poses."""
    return np.stack([pose.rotation for pose in poses]), np.stack([pose.translation_m for pose in poses])
