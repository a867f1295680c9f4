"""The metric layer: pixels to rays to points in metres, exact or marked, in NumPy and torch."""

from .camera import Camera

__all__ = ["Camera"]
