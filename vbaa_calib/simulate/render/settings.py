"""Sampling and brightness of antenna, board, object and bench in drawn pictures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class _PaintSettings:
    """Samples, sizes and brightness (0 to 1) of what is drawn."""

    antenna_subpixels: int = 4  # samples per pixel and axis, of the antenna
    board_subpixels: int = 3  # of the board
    board_rows: int = 48  # of pixels, which are drawn and blurred before they leave the processor's cache
    ink: float = 0.05  # brightness of a board's ink
    paper: float = 0.88  # brightness of its paper
    margin_squares: float = 0.5  # width of the paper around the board, in its squares
    tube_facets: int = 32  # of a mesh of the antenna, around it
    wedge_facets: int = 255  # of a wedge's rounding
    object_subpixels: int = 4  # of the object
    blade_half_angle_rad: float = float(np.deg2rad(3.0))  # of a knife's edge
    blade_depth_m: float = 0.025  # of a knife behind its edge
    ambient: float = 0.35  # light that comes from everywhere, of all
    bench_texels: int = 1600  # of the bench's texture, a side
    bench_reach: float = 1.3  # of the texture: tangent of the angle of view at its border
    bench_things: int = 60  # that lie on the bench, in each of three degrees of focus


PAINT = _PaintSettings()
