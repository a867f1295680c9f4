"""A recording's contacts in order, each tested for motion with the frames around it."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence

import numpy as np

from estimator.table.contacts import Contact, Measured
from vbaa_calib.rig import Rig

from .contacts import Contacts
from .motion import Beam, Inertia, Motion, Shapes
from .status import FAILED, NO_ANTENNA, NO_CONTACT, OK, TIP

LARGEST_SHIFT = 1 / 3
"""Inertia that would move the distance by more than this part of its deviation is too much."""


class MotionCheck:
    """Contacts in, contacts out in the same order; some of them only once later frames are known.

    Parameters
    ----------
    live : test each frame with earlier ones alone, so that nothing waits.
    """

    def __init__(self, rig: Rig, live: bool) -> None:
        self.beam = Beam.of(rig)
        self._rig, self._motion = rig, Motion(self.beam, live)
        self._waiting: deque[tuple[Contact, np.ndarray]] = deque()

    def push(self, several: Sequence[Measured], found: Contacts) -> Iterator[Contact]:
        """The contacts that are ready once these frames are known."""
        times = np.array([each.time_s for each in several], float)
        if not self._waiting and not np.isfinite(times).any():
            return iter(found)
        pan, tilt = (np.array([getattr(each, name) for each in several]) for name in ("pan_rad", "tilt_rad"))
        rotation, translation = self._rig.kinematics.world_antenna(pan, tilt)
        numbers = found.numbers
        fitted = ~np.isin(found.status, (NO_ANTENNA, FAILED)) & numbers.finite
        points = np.einsum("bij,bgj->bgi", rotation, numbers.pieces_m) + translation[:, None]
        points = np.where(fitted[:, None, None], points, np.nan)
        distance = np.where(found.status == NO_CONTACT, np.nan, numbers.unknowns[:, 0])
        # a load's components along y and z of the antenna, from those along the world's axes
        push = numbers.push @ np.swapaxes(rotation[:, :, 1:], 1, 2)
        self._waiting.extend(zip(found, push, strict=True))
        shapes = Shapes(times, points, numbers.pieces_std_m, distance)
        return self._ready(self._motion.push(shapes))

    def finish(self) -> Iterator[Contact]:
        """The contacts that still wait."""
        loads = self._motion.finish()
        return iter(()) if loads is None else self._ready(loads)

    def _ready(self, loads: Inertia) -> Iterator[Contact]:
        for load, significant in zip(np.asarray(loads.load_N_m), np.asarray(loads.significant), strict=True):
            contact, push = self._waiting.popleft()
            shift = float(np.sum(push * load)) if significant else 0.0
            yield _moving(contact, abs(shift)) if abs(shift) > LARGEST_SHIFT else contact


def _moving(contact: Contact, shift: float) -> Contact:
    """A contact that moves too much to be believed, by this shift in deviations of its distance."""
    if contact.status not in (OK, TIP):
        return contact
    off = 1e3 * shift * contact.distance_std_m
    return Contact(
        status="not_quasistatic",
        reason=f"the antenna swings: its inertia puts the distance {off:.1f} mm off, {shift:.1f} std",
        model=contact.model,
        in_contact=True,
        moment_residual_Nm=contact.moment_residual_Nm,
    )
