"""Cameras in other programs' files: one module a format, one row in `table.FORMATS`.

Inside, everything has this project's conventions (docs/conventions.md): pixel (0, 0) is the centre of the first pixel,
coefficients in OpenCV's order, x right, y down, z forward, metres, `T_reference_camera` the pose of the camera. What a
format does otherwise is said, and undone, in its module alone.
"""
