"""The metric layer: pixels to rays to points in metres, exact or marked, in NumPy and torch."""

from .camera import Camera
from .intersection import in_plane_axes, intersect_hinge_plane, intersect_plane
from .on_plane import CameraOnPlane
from .region import ValidRegion

__all__ = [
    "Camera",
    "CameraOnPlane",
    "ValidRegion",
    "in_plane_axes",
    "intersect_hinge_plane",
    "intersect_plane",
]
