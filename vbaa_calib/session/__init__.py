"""A session: one folder with everything that was measured on one rig. Read here, checked here, never written."""

from .centrelines import Centrelines, centrelines_of, read_centrelines
from .drift import DRIFTS, LAB, Drift, FileDrift, drift_of
from .settings import (
    SCHEMA,
    STANDARD_GRAVITY_M_S2,
    KnownObject,
    LoadReadings,
    MomentSensor,
    NominalAntenna,
    NominalTip,
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
    SweepPicture,
    check_pictures,
    pictures_of,
    read_loads,
    read_noload,
    read_recording,
    read_sweep,
    recording_of,
    refuse_measured,
    without_moments,
)
