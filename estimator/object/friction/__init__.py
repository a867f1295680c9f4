"""Friction between antenna and object, the force against the normal, and normals that the force has confirmed."""

from .friction import Friction, FrictionSettings, friction, steady_slides

__all__ = ["Friction", "FrictionSettings", "friction", "steady_slides"]
