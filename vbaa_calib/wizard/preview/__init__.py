"""The wizard's live page on 127.0.0.1."""

from .preview import Preview
from .snapshot import KINDS, Command, Snapshot, State

__all__ = ["KINDS", "Command", "Preview", "Snapshot", "State"]
