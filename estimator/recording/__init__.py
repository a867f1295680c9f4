"""All frames of a recording as one problem."""

from .refined import Refined, refine

__all__ = ["Refined", "refine"]
