"""Friction between antenna and object, the force against the normal, and normals that the force has confirmed."""

from .friction import NORMAL_KNOWN_RAD, Friction, friction, steady_slides

__all__ = ["NORMAL_KNOWN_RAD", "Friction", "friction", "steady_slides"]
