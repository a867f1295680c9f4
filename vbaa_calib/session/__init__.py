"""A session: one folder with everything that was measured on one rig. Read and checked here, never written."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from .drift import DRIFTS, Drift, MovingClamp, drift_of
from .moment_sensor import CHANNELS, READINGS, SILENT, MomentSensor

if TYPE_CHECKING:
    from .centrelines import Centrelines, antennas_of, centrelines_of, read_centrelines
    from .settings import (
        SCHEMA,
        STANDARD_GRAVITY_M_S2,
        FileDrift,
        KnownObject,
        LoadReadings,
        NominalAntenna,
        NominalTip,
        NominalWrenchSensor,
        OverBoard,
        Session,
        Shutter,
        gravity_antenna,
        has_over,
        has_sweep,
        load_session,
        read_pose,
        session_from,
    )
    from .tables import (
        Frame,
        Load,
        Still,
        check_pictures,
        numbers_of,
        pictures_of,
        read_loads,
        read_noload,
        read_recording,
        read_sweep,
        recording_of,
        refuse_measured,
        without_moments,
    )


def __getattr__(name: str) -> Any:
    """Load the rest on first use: files and their tables, which a rig in memory does not need."""
    for home in ("settings", "tables", "centrelines"):
        if not name.startswith("_") and hasattr(module := importlib.import_module(f".{home}", __name__), name):
            return getattr(module, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
