"""The free antenna: its shape and the moment sensor's zero."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from vbaa_calib.core.errors import VbaaError
from vbaa_calib.wizard.sources.offered import Offered
from vbaa_calib.wizard.state.progress import Judged, Progress
from vbaa_calib.wizard.state.session_state import Known

from .pictures import found_antenna
from .step import Step

LEAST, ENOUGH = 2, 5
NEXT = ((0.0, 0.0), (0.0, 20.0), (0.0, -20.0), (20.0, 0.0), (-20.0, 0.0))


def judge(known: Known, offered: Offered, readings: Mapping[str, float] | None) -> Judged:
    """A picture of the free antenna."""
    return found_antenna(known, "noload", offered, readings)


def look(known: Known) -> Progress:
    """How far the free antenna is."""
    taken = known.taken("noload")
    seen = [f"{len(taken)} picture{'' if len(taken) == 1 else 's'} of the free antenna"]
    tilts = [np.degrees(one.readings["tilt_rad"]) for one in taken]
    missing = []
    if len(taken) < ENOUGH:
        more = ENOUGH - len(taken)
        missing.append(f"{more} more picture{'' if more == 1 else 's'}")
    if taken and np.ptp(tilts) < 20.0:
        missing.append("another tilt: how the antenna sags under its weight shows gravity and the moment sensor's gain")
    diagnoses, solved = [], False
    if len(taken) >= LEAST:
        try:
            diagnoses = known.still_diagnoses()
            solved = True
        except VbaaError as error:
            missing.append(str(error))
    pan, tilt = NEXT[min(len(taken), len(NEXT) - 1)]
    enough = len(taken) >= ENOUGH and not missing
    return Progress(
        seen=tuple(seen),
        missing=tuple(missing),
        next="enough, more will not help" if enough else f"free antenna at pan {pan:g}°, tilt {tilt:g}°, at rest",
        enough=enough,
        usable=solved,
        diagnoses=tuple(diagnoses),
    )


STEP = Step(
    "noload",
    "Free antenna",
    "Let nothing touch the antenna. Turn it to a few pan and tilt angles, wait until it rests, read the moment sensor.",
    "Nothing is straight and nothing weighs nothing: bow, sag and the sensor's zero have to be known before a contact.",
    look,
    judge,
)
