"""From the estimator's contacts to the object, for the paper's experiments."""

from __future__ import annotations

import numpy as np

from estimator.contact_row import ContactRow, ContactTable
from estimator.contacts import Contacts
from estimator.felt import Felt, feel

from ..rig import Rig
from ..session import Frame

RATE_HZ = 30.0
FELT = "all points, felt"
"""`estimator.felt`: shape, slip, friction and compliance together, of the estimator's contacts."""


def felt_of(rig: Rig, contacts: Contacts, pan_rad: np.ndarray, tilt_rad: np.ndarray, friction_rad: float) -> Felt:
    """What one recording's contacts say of the object; `friction_rad` as they were estimated with."""
    rows = [
        ContactRow.of(Frame(None, float(pan), float(tilt), np.nan, frame=i, time_s=i / RATE_HZ), contact)
        for i, (pan, tilt, contact) in enumerate(zip(pan_rad, tilt_rad, contacts, strict=True))
    ]
    return feel(ContactTable.from_rows(rows), rig, friction_rad)
