"""A scene's arrays as triangles: what each part of the picture is made of, and what of it each instant shows."""
