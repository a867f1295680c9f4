"""Friction between antenna and object, the force relative to the normal, and normals corrected by the force."""

from .friction import Friction, FrictionSettings, friction, steady_slides

__all__ = ["Friction", "FrictionSettings", "friction", "steady_slides"]
