"""All frames of a recording as one problem."""

from .known_object import KnownLine
from .refined import Refined, refine

__all__ = ["KnownLine", "Refined", "refine"]
