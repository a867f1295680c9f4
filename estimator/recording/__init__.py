"""Refinement: all frames of a recording in one least-squares problem."""

from .refined import Refined, refine

__all__ = ["Refined", "refine"]
