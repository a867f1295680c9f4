"""A recording over time: first contact and loss, slip and stick, vibration; and smoothed contacts."""

from .follow import follow
from .onset import Event, Track
from .smooth import smooth

__all__ = ["Event", "Track", "follow", "smooth"]
