"""The next touch: what the antenna can reach of a known surface, and the information of each touch."""

from .plan import GOALS, JointLimits, NextTouch, next_touch

__all__ = ["GOALS", "JointLimits", "NextTouch", "next_touch"]
