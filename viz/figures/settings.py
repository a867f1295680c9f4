"""Colours, sizes and limits that all figures share."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class _FigureSettings:
    """Colours, sizes and limits of the figures. Colours are those of a page in light mode; lengths are px of the
    drawing."""

    ink: str = "#1f2937"  # text, means, axes
    soft: str = "#5b6676"  # what accompanies: noise, secondary lines
    teal: str = "#0f766e"  # good; estimates
    amber: str = "#b45309"  # look at; truth
    red: str = "#dc2626"  # wrong
    slate: str = "#64748b"  # undetermined, or of an object
    estimate: str = "#0f766e"  # and its band
    truth: str = "#b45309"  # where known
    # from early to late, dark to light: readable without colour vision, by day and by night
    ramp: tuple[str, ...] = ("#375a8c", "#2c738e", "#228b8d", "#20a386", "#3bbb75", "#6ece58", "#b0dd2f")
    letter_px: float = 7.2  # mean width of a tick's letter, from which the room for titles and keys is estimated
    # maps over a picture
    # of standard deviations, from low to high
    map: tuple[str, ...] = ("#f3faf7", "#bfe3d8", "#6cbfb4", "#23878f", "#15506f", "#1b2a4e")
    pale: str = "#3b9c91"  # corners
    # of static frames, one a colour
    frames: tuple[str, ...] = ("#0f766e", "#1d4ed8", "#b45309", "#7c3aed", "#be185d", "#475569")
    cells: tuple[int, int] = (8, 6)  # of the picture, in which corners are counted: across and down
    map_px: float = 420.0  # width of a map
    most_arrows: int = 4000  # of residuals, in a map
    most_views: int = 30  # of the board, the worst ones
    most_levels: int = 6  # of contours
    # contacts
    sliding: str = "#0072b2"
    sticking: str = "#c2410c"
    unused: str = "#94a3b8"  # contacts that friction takes nothing from
    most_ellipses: int = 300
    most_points: int = 1500
    most_triangles: int = 3000
    side_px: float = 276.0  # side of a map of contacts
    visible_px: float = 5.0  # radius below which ellipses are enlarged, and the key says how much
    size: tuple[float, float] = (480.0, 440.0)  # width and height of the figures of force and friction
    steep: float = 1.5  # bounds on the coefficient of friction beyond this are not drawn
    # the scene
    most_balls: int = 600
    most_faces: int = 6000
    # curves over time
    lines: tuple[str, ...] = ("#0072b2", "#c2410c", "#334155", "#7c3aed")  # of several in one figure, in this order
    left_px: float = 148.0  # margins, and width of the whole
    right_px: float = 14.0
    top_px: float = 34.0
    width_px: float = 960.0
    most_dots: int = 1500  # more frames than this are drawn as the range of each column of pixels
    most_events: int = 40
    gap: float = 3.0  # usual steps between two frames from which on they are not joined

    @property
    def plot_px(self) -> float:
        """Width of the plotting area of a curve over time, px."""
        return self.width_px - self.left_px - self.right_px


STYLE = _FigureSettings()
