"""Where the wizard's pictures come from: a folder that fills up, a camera, a video, a stream."""

from .choose import open_source
from .picture import Picture, Source, SourceLost

__all__ = ["Picture", "Source", "SourceLost", "open_source"]
