"""Where to touch next: what the antenna can reach of a known surface, and how much each touch would tell."""

from .plan import GOALS, JointLimits, NextTouch, next_touch

__all__ = ["FRICTION", "GOALS", "STIFFNESS", "SURFACE", "JointLimits", "NextTouch", "next_touch"]
