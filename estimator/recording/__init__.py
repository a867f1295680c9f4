"""All frames of a recording as one problem."""

from .refined import Refined, refine
from .views import View

__all__ = ["Refined", "View", "refine"]
