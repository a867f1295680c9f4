"""A session: one folder with everything that was measured on one rig. Read here, checked here, never written."""

from .centrelines import Centrelines, read_centrelines
from .drift import DRIFTS, LAB, Drift, FileDrift
from .rows import Frame, Load, Still, SweepPicture
from .settings import (
    SCHEMA,
    LoadReadings,
    MomentSensor,
    NominalAntenna,
    OverBoard,
    Session,
    gravity_antenna,
    has_over,
    has_sweep,
    load_session,
    read_pose,
    session_from,
)
from .tables import check_pictures, read_loads, read_noload, read_recording, read_sweep, refuse_measured

__all__ = [
    "DRIFTS",
    "LAB",
    "SCHEMA",
    "Centrelines",
    "Drift",
    "FileDrift",
    "Frame",
    "Load",
    "LoadReadings",
    "MomentSensor",
    "NominalAntenna",
    "OverBoard",
    "Session",
    "Still",
    "SweepPicture",
    "check_pictures",
    "gravity_antenna",
    "has_over",
    "has_sweep",
    "load_session",
    "read_centrelines",
    "read_loads",
    "read_noload",
    "read_pose",
    "read_recording",
    "read_sweep",
    "refuse_measured",
    "session_from",
]
