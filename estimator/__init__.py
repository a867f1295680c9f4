"""The inverse problem: from picture and moment to contact point and force."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from estimator.contact.estimate import ContactEstimator
    from estimator.diagnose.service import RigWatch
    from estimator.diagnose.watch import RecordingVerdict, RecordingWatch, recording_verdict
    from estimator.object.next_touch import NextTouch, next_touch
    from estimator.recording.refined import Refined, refine
    from estimator.table.contacts import Contact, Measured

__all__ = [
    "Contact",
    "ContactEstimator",
    "Measured",
    "NextTouch",
    "RecordingVerdict",
    "RecordingWatch",
    "Refined",
    "RigWatch",
    "next_touch",
    "recording_verdict",
    "refine",
]

_HOMES = {
    "Contact": ".table.contacts",
    "Measured": ".table.contacts",
    "ContactEstimator": ".contact.estimate",
    **dict.fromkeys(("RecordingVerdict", "RecordingWatch", "recording_verdict"), ".diagnose.watch"),
    "RigWatch": ".diagnose.service",
    "NextTouch": ".object.next_touch",
    "next_touch": ".object.next_touch",
    "Refined": ".recording.refined",
    "refine": ".recording.refined",
}


def __getattr__(name: str) -> Any:
    """Load modules on first use, so that `vbaa --help` need not wait for NumPy."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(_HOMES[name], __name__), name)
