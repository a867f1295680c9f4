"""Pictures and readings with their times, from bags, videos, folders, cameras and sockets, and their
synchronisation."""

from .messages import MessageSource, Reading, Taken, now_s
from .synchronize import Synchronizer, Timing, taken_frames
