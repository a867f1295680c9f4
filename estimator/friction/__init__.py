"""Friction between antenna and object, the force against the normal, and normals that the force has confirmed."""

from .measure import NORMAL_KNOWN_RAD
from .normals import Normals
from .of_touches import friction
from .result import Friction

__all__ = ["NORMAL_KNOWN_RAD", "Friction", "Normals", "friction"]
