"""All frames of a recording as one problem."""

from .known_object import KnownLine
from .refine import Refined, refine

__all__ = ["KnownLine", "Refined", "refine"]
