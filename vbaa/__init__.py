"""The public calls of vbaa-calib under one name: `from vbaa import Rig, ContactEstimator`.

The packages behind it (`vbaa_calib`, `estimator`) keep their names; `estimator` is a word that other programs use, too.
"""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from estimator import RecordingVerdict, RecordingWatch, RigWatch, next_touch, recording_verdict, refine
    from estimator.object.estimate import estimate_object
    from estimator.table.contacts import Contact, Measured
    from estimator.table.files import read_contacts
    from estimator.torch import ContactLayer
    from vbaa_calib import Camera, Rig, __version__, calibrate_lens
    from vbaa_calib.calibrate.pipeline import calibrate
    from vbaa_calib.core.errors import InputError
    from vbaa_calib.export.simulators import export
    from vbaa_calib.session import load_session

    from .contact_estimator import SessionContactEstimator as ContactEstimator

__all__ = [
    "Camera",
    "Contact",
    "ContactEstimator",
    "ContactLayer",
    "InputError",
    "Measured",
    "RecordingVerdict",
    "RecordingWatch",
    "Rig",
    "RigWatch",
    "__version__",
    "calibrate",
    "calibrate_lens",
    "estimate_object",
    "export",
    "load_session",
    "next_touch",
    "read_contacts",
    "recording_verdict",
    "refine",
]

_HOMES = {
    **dict.fromkeys(("Camera", "Rig", "calibrate_lens", "__version__"), "vbaa_calib"),
    **dict.fromkeys(("Contact", "Measured", "next_touch", "refine"), "estimator"),
    **dict.fromkeys(("RecordingVerdict", "RecordingWatch", "RigWatch", "recording_verdict"), "estimator"),
    "ContactEstimator": "vbaa.contact_estimator:SessionContactEstimator",
    "ContactLayer": "estimator.torch",
    "InputError": "vbaa_calib.core.errors",
    "calibrate": "vbaa_calib.calibrate.pipeline",
    "export": "vbaa_calib.export.simulators",
    "load_session": "vbaa_calib.session",
    "estimate_object": "estimator.object.estimate",
    "read_contacts": "estimator.table.files",
}


def __getattr__(name: str) -> Any:
    """Load names on first use. Raises ImportError naming the folder that hides a package of ours."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module, _, own = _HOMES[name].partition(":")
    top = module.partition(".")[0]
    package = importlib.import_module("estimator" if top == "vbaa" else top)
    home, place = Path(__file__).parents[1], Path(package.__file__ or "").parent
    if place.parent != home:
        raise ImportError(
            f"the package {package.__name__} is taken from {place}, not from {home}: rename that or leave it out "
            "of PYTHONPATH (`vbaa doctor` says more)"
        )
    return getattr(importlib.import_module(module), own or name)
