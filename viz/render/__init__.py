"""Rendering of a scene: PNG, HTML page, glTF, window."""
