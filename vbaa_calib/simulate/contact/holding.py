"""What the steps of a stroke work on: antenna and object, where the base is, how the object holds the antenna."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from vbaa_calib.antenna.rod import Rod, RodShape
from vbaa_calib.geometry import Pose
from vbaa_calib.simulate.scene.objects import TouchObject


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


STICK = 1e5
"""Stiffness K of a sticking contact in EI/L³: 28 kN/m for the steel whisker, whose own stiffness at the tip is 3."""


@dataclass(frozen=True, eq=False)
class Setting:
    """What does not change in a recording. `antenna_radius_m` is half the antenna's diameter."""

    rod: Rod
    antenna_radius_m: float
    object: TouchObject

    @property
    def moment_unit_Nm(self) -> float:
        """EI/L."""
        return self.rod.bending_stiffness_Nm2 / self.rod.length_m

    @property
    def force_unit_N(self) -> float:
        """EI/L²."""
        return self.moment_unit_Nm / self.rod.length_m

    @property
    def stick_N_m(self) -> float:
        """K."""
        return STICK * self.force_unit_N / self.rod.length_m


@dataclass(frozen=True, eq=False)
class Bases:
    """Where the antenna's base is in B strokes: R_world_antenna, its origin in the world, gravity in the antenna frame.

    Attributes
    ----------
    rotation : (B, 3, 3). origin_m : (B, 3). gravity : (B, 3) m/s².
    """

    rotation: np.ndarray
    origin_m: np.ndarray
    gravity: np.ndarray

    def picked(self, rows: np.ndarray) -> Bases:
        """Some of them."""
        return Bases(*(getattr(self, each.name)[rows] for each in fields(self)))

    def world(self, points_m: np.ndarray) -> np.ndarray:
        """(B, ..., 3) points of the antenna frames in the world."""
        turned = np.einsum("bij,b...j->b...i", self.rotation, points_m)
        return turned + self.origin_m.reshape(len(turned), *(1,) * (turned.ndim - 2), 3)


@dataclass(frozen=True, eq=False)
class Held:
    """B contacts.

    Attributes
    ----------
    moment_Nm : (B, 3) M(0), antenna frame. arclength_m, press_N : (B,).
    grip_N : (B, 3) friction force on the antenna. place_m : (B, 3) p. normal : (B, 3) there.
    point_m, tangent : (B, 3) of the centreline at the contact. All of these in the world frame.
    slipped_m : (B, 3) way along the object in the step, world frame.
    """

    moment_Nm: np.ndarray
    arclength_m: np.ndarray
    press_N: np.ndarray
    grip_N: np.ndarray
    place_m: np.ndarray
    normal: np.ndarray
    point_m: np.ndarray
    tangent: np.ndarray
    slipped_m: np.ndarray

    def picked(self, rows: np.ndarray) -> Held:
        """Some of them."""
        return Held(*(getattr(self, each.name)[rows] for each in fields(self)))

    def put(self, rows: np.ndarray, others: Held) -> None:
        """Overwrite some of them."""
        for each in fields(self):
            getattr(self, each.name)[rows] = getattr(others, each.name)

    @staticmethod
    def nowhere(count: int) -> Held:
        """No contacts yet."""
        return Held(*(np.full((count,) if n in ("arclength_m", "press_N") else (count, 3), np.nan) for n in _NAMES))


_NAMES = tuple(each.name for each in fields(Held))
