"""Contacts joined to the object's surface, with its uncertainty and its stiffness (Fig. 5)."""

from .build import Compliance, Surface, reconstruct
from .fit import Normals
from .touches import Touches, touches_of

__all__ = ["Compliance", "Normals", "Surface", "Touches", "reconstruct", "touches_of"]
