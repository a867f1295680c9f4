"""A scene's arrays as triangle meshes, and the part of them visible at each instant."""
