"""What the antenna's movement in the picture does while the shutter is open and while the sensor is read out.

Blur by an even movement moves no point: the line lies where the antenna is in the middle of the exposure. A rolling
shutter reads the rows one after the other: a point lies where the antenna is when its row is read, not the clamp's.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from estimator.table.contacts import LOCATED, Contact
from vbaa_calib.core.polyline import arc_lengths, resample
from vbaa_calib.session import Shutter

from .recording import FrameContact
from .settings import ContactSettings


@dataclass(frozen=True)
class _Movement:
    """The most that the antenna moves during the exposure and during the readout, px; how far that puts points off, px
    and deviations."""

    exposure_px: float = 0.0
    readout_px: float = 0.0
    off_px: float = 0.0
    off_std: float = 0.0


def checked(found: Iterable[FrameContact], shutter: Shutter, rows: int) -> Iterator[FrameContact]:
    """A recording's frames in order, those in which the movement matters marked; pictures of so many rows.

    Each comes out once the next one is known, where the shutter is known.
    """
    if not (shutter.exposure_s or shutter.readout_s):
        yield from found
        return
    before = waiting = None
    for item in chain(found, [None]):
        if waiting is not None:
            # an antenna that comes to rest, or starts from it, may be at rest in the picture itself
            others = (other for other in (before, item) if other is not None)
            moved = [_movement(waiting, other, shutter, rows) for other in others]
            yield _marked(waiting, min(moved, key=_carried_px, default=_Movement()))
        before, waiting = waiting, item


def _carried_px(moved: _Movement) -> float:
    return moved.readout_px + moved.exposure_px


def _movement(item: FrameContact, other: FrameContact, shutter: Shutter, rows: int) -> _Movement:
    """As fast as from this frame to the other."""
    after_s = abs(other.frame.time_s - item.frame.time_s)
    here, there = item.measured.points_px, other.measured.points_px
    if len(here) < 2 or len(there) < 2 or not after_s > 0.0:
        return _Movement()
    # points that are listed in no order make a path of any length
    spacing_px = max(0.1, float(arc_lengths(there)[-1]) / (100 * rows))
    from scipy.spatial import cKDTree  # slow to load

    gap, at = cKDTree(resample(there, spacing_px)[0]).query(here)
    gap[(at == 0) | (at == at.max())] = 0.0  # beyond its ends, the distance is along the line
    speed = gap / after_s
    off = speed * shutter.readout_s * np.abs(here[:, 1] - here[0, 1]) / rows
    worst = int((off / item.measured.sigma_px).argmax())
    most = float(speed.max())
    std = float(off[worst] / item.measured.sigma_px[worst])
    return _Movement(most * shutter.exposure_s, most * shutter.readout_s, float(off[worst]), std)


def _marked(item: FrameContact, moved: _Movement) -> FrameContact:
    contact = item.contact
    if contact.status in LOCATED and moved.off_std > ContactSettings.carried:
        reason = (
            f"the antenna moves by {moved.readout_px:.1f} px while the sensor is read out, which puts points "
            f"{moved.off_px:.2f} px off, {moved.off_std:.0f} std: move slower, or use a global shutter"
        )
        moment = contact.moment_residual_Nm
        contact = Contact(
            status="not_quasistatic",
            reason=reason,
            model=contact.model,
            in_contact=True,
            moment_residual_Nm=moment,
            outside_points=contact.outside_points,
            end_used=contact.end_used,
        )
    elif moved.exposure_px > ContactSettings.blurred_px:
        blur = f"moves by {moved.exposure_px:.0f} px during the exposure: expose shorter, or move slower"
        contact = replace(contact, reason="; ".join(said for said in (contact.reason, f"the antenna {blur}") if said))
    return replace(item, contact=contact)
