"""Lens models, one file and one row each."""

from .fisheye import FISHEYE
from .model import LensModel
from .opencv import OPENCV

MODELS: dict[str, LensModel] = {model.name: model for model in (OPENCV, FISHEYE)}
"""Name in camera.json → model."""

__all__ = ["MODELS", "LensModel"]
