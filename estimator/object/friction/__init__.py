"""Friction between antenna and object, the force against the normal, and normals that the force has confirmed."""

from .friction import NORMAL_KNOWN_RAD, Friction, friction

__all__ = ["NORMAL_KNOWN_RAD", "Friction", "friction"]
