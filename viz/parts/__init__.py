"""A scene's arrays as triangles: what each part of the picture is made of, and what of it each instant shows."""

from .assemble import all_parts
from .part import LOOK, Part, layers_of

__all__ = ["LOOK", "Part", "all_parts", "layers_of"]
