"""The metric layer: pixels to rays to points in metres, exact or marked, in NumPy and torch."""

from .camera import Camera, ValidRegion
from .plane import CameraOnPlane, in_plane_axes, intersect_hinge_plane, intersect_plane

__all__ = [
    "Camera",
    "CameraOnPlane",
    "ValidRegion",
    "in_plane_axes",
    "intersect_hinge_plane",
    "intersect_plane",
]
