"""Where the wizard's pictures come from: a folder that fills up, a camera, a video, a stream."""

from .choose import open_source
from .offered import Offered, Source, SourceLost, without_secrets

__all__ = ["Offered", "Source", "SourceLost", "open_source", "without_secrets"]
