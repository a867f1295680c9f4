"""Pictures and readings with their times: from bags, videos, folders, cameras and sockets, brought together."""

from .messages import CHANNELS, Reading, Source, Taken
from .synchronize import Synchronizer, Timing
