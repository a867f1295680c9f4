"""A recording in time: first contact and loss, slip and stick, ringing; and contacts made smooth."""

from .follow import follow
from .onset import Event, Track
from .smooth import smooth

__all__ = ["Event", "Track", "follow", "smooth"]
