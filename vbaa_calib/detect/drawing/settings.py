"""Sizes and colours of pictures with a detection drawn in them."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class DrawingSettings:
    """Sizes in canvas pixels for a line of unit thickness; colours blue, green, red, 0–255."""

    # the canvas and its legend
    widest_px: float = 1920.0  # width to which a wider picture is reduced
    narrowest_px: float = 960.0  # width to which a narrower picture is enlarged
    text_size: float = 0.5  # of the legend
    line_height_px: int = 22
    margin_px: int = 14
    legend: tuple[int, int, int] = (30, 26, 24)  # its background
    soft: tuple[int, int, int] = (190, 182, 176)  # its small print

    # the picture behind the marks
    brightest: float = 150.0  # grey level of its bright end, so that marks stand out
    outside_corridor: float = 0.5  # factor of brightness there
    least_span: float = 48.0  # range of grey levels that is stretched to full contrast, least
    gamma: float = 0.75  # exponent of grey levels, which brightens the dark ones

    # the marks
    corridor: tuple[int, int, int] = (150, 128, 112)
    free: tuple[int, int, int] = (255, 150, 90)  # the predicted free antenna
    other_line: tuple[int, int, int] = (70, 70, 255)
    sigma_range_px: tuple[float, float] = (0.02, 0.5)  # of the colour scale of deviations
    sure: tuple[int, int, int] = (255, 255, 0)  # its ends, cyan and magenta, which colour-blind people can tell
    unsure: tuple[int, int, int] = (255, 0, 255)  # apart, too
