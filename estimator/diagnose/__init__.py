"""Diagnosis of a recording: hypotheses about readings, pictures and rig, and the frames' evidence for each."""

from .service import RigWatch
from .watch import RecordingVerdict, RecordingWatch, recording_verdict

__all__ = ["RecordingVerdict", "RecordingWatch", "RigWatch", "recording_verdict"]
