"""The metric layer: pixels to rays to points in metres, exact where valid and marked where not, in NumPy and torch."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from .camera import Camera, ValidRegion
from .plane import in_plane_axes, intersect_hinge_plane, intersect_plane

if TYPE_CHECKING:
    from .on_plane import CameraOnPlane

__all__ = ["Camera", "CameraOnPlane", "ValidRegion", "in_plane_axes", "intersect_hinge_plane", "intersect_plane"]


def __getattr__(name: str) -> Any:
    """Load `CameraOnPlane` on first use: it is a torch module, and torch takes a second to load."""
    if name != "CameraOnPlane":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from .on_plane import CameraOnPlane

    return CameraOnPlane
