"""Friction between antenna and object, the force against the normal, and normals that the force has confirmed."""

from .friction import friction
from .normals import Friction, Normals
from .touches import NORMAL_KNOWN_RAD

__all__ = ["NORMAL_KNOWN_RAD", "Friction", "Normals", "friction"]
