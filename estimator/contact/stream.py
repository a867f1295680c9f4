"""A recording's contacts in order, each judged for motion by the frames around it."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from estimator.table.contacts import Contact, Measured
from vbaa_calib.rig import Rig

from .contacts import Contacts
from .motion import Beam, Inertia, Motion, Shapes, inertia
from .verdict import FAILED, NO_ANTENNA, NO_CONTACT, OK, TIP

MEMORY = 64
"""Earlier frames that a live judge keeps."""
BIASED = 1 / 3
"""Inertia that would move the distance by more than this part of its deviation is too much."""


@dataclass(frozen=True, eq=False)
class Waiting:
    """A contact that waits for the frames after it: its turn to the world, and what inertia would do to it (G, 2)."""

    contact: Contact
    rotation: np.ndarray
    push: np.ndarray


def beam(rig: Rig) -> Beam:
    """The rig's antenna to its own motion."""
    antenna = rig.antenna
    return Beam(antenna.length_m, antenna.stiffness_Nm2, antenna.mass_per_length_kg_m)


class Stream:
    """Contacts in, contacts out in the same order; some of them only once later frames are known.

    Parameters
    ----------
    live : judge each frame by earlier ones alone, so that nothing waits.
    """

    def __init__(self, rig: Rig, live: bool) -> None:
        self._rig, self._live, self._beam = rig, live, beam(rig)
        self._motion = Motion(self._beam)
        self._waiting: deque[Waiting] = deque()
        self._past: Shapes | None = None

    def push(self, several: Sequence[Measured], found: Contacts) -> Iterator[Contact]:
        """The contacts that can be given out once these frames are known."""
        if not self._waiting and not np.isfinite([each.time_s for each in several]).any():
            return iter(found)
        pan, tilt = (np.array([getattr(each, name) for each in several]) for name in ("pan_rad", "tilt_rad"))
        rotation, translation = self._rig.kinematics.world_antenna(pan, tilt)
        shapes = _shapes(several, found, rotation, translation)
        for index, contact in enumerate(found):
            self._waiting.append(Waiting(contact, rotation[index], found.numbers.push[index]))
        if self._live:
            return self._given_out(self._judged_live(shapes))
        return self._given_out(self._motion.push(shapes))

    def finish(self) -> Iterator[Contact]:
        """The contacts that still wait."""
        verdicts = None if self._live else self._motion.finish()
        return iter(()) if verdicts is None else self._given_out(verdicts)

    def _judged_live(self, shapes: Shapes) -> Inertia:
        past = 0 if self._past is None else len(self._past)
        held = shapes if self._past is None else self._past.followed_by(shapes)
        self._past = held.picked(slice(-MEMORY, None))
        return inertia(held, self._beam, slice(past, None), live=True)

    def _given_out(self, verdicts: Inertia) -> Iterator[Contact]:
        significant = np.asarray(verdicts.significant)
        for load, moves in zip(np.asarray(verdicts.load_N_m), significant, strict=True):
            item = self._waiting.popleft()
            yield _judged(item, load) if moves else item.contact


def _judged(item: Waiting, load_N_m: np.ndarray) -> Contact:
    """The contact as it is, or as one that moves too much to be believed."""
    contact = item.contact
    if contact.status not in (OK, TIP):
        return contact
    shift = float(np.sum(item.push * (load_N_m @ item.rotation)[:, 1:]))
    if not abs(shift) > BIASED:
        return contact
    off = 1e3 * abs(shift) * contact.distance_std_m
    why = f"the antenna swings: its inertia puts the distance {off:.1f} mm off, {abs(shift):.1f} std"
    return Contact("not_quasistatic", why, contact.model, True, moment_residual_Nm=contact.moment_residual_Nm)


def _shapes(several: Sequence[Measured], found: Contacts, rotation: np.ndarray, translation: np.ndarray) -> Shapes:
    numbers = found.numbers
    fitted = ~np.isin(found.status, (NO_ANTENNA, FAILED)) & numbers.finite
    points = np.einsum("bij,bgj->bgi", rotation, numbers.pieces_m) + translation[:, None]
    points = np.where(fitted[:, None, None], points, np.nan)
    touched = np.where(found.status == NO_CONTACT, np.nan, numbers.unknowns[:, 0])
    return Shapes(np.array([each.time_s for each in several], float), points, numbers.pieces_std_m, touched)
