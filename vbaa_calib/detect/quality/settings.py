"""Thresholds of a picture's quality, and of the faults that are named."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class QualitySettings:
    """Thresholds of a picture's faults, measured on drawn boards; grey levels are of 255."""

    # which views are calibrated from
    least_corners: int = 6  # of a view
    most_blur_per_gap: float = 0.5  # over the gap to the markers: corners are right at 0.4, at 0.55 off by 0.7 px
    clipped: float = 0.5  # share of clipped white pixels that is too much where the edges' level is above `grown`
    grown: float = 0.85  # level at the squares' edges above which clipping counts: corners err 1.5 times the usual
    noisier: float = 4.0  # standard deviation of the corners over the median view's, from which a view is dropped
    noisy_px: float = 0.1  # least standard deviation of the corners of a view that is dropped for noise
    blurred: float = 1.5  # blur over the median view's that explains it
    pale_share: float = 0.5  # contrast over the median view's that explains it

    # the board laid flat
    texels: int = 12  # side of a square
    most_bent: float = 0.3  # of a square, by which corners may be off a homography
    fewest_markers: int = 3  # without corners
    clipped_level: int = 250  # grey level from which black is clipped
    washed_out: float = 0.5  # of the contrast, from which a square has lost its black
    paper: float = 0.9  # of the contrast, from which a black square is as bright as paper, and shines
    covered: float = 0.25  # share of shining squares from which a patch is a reflection

    # faults that are named
    near_limit: float = 0.7  # of the most blur
    motion: float = 1.6  # ratio of the larger blur to the smaller one from which a picture moved
    motion_px: float = 1.3  # larger blur, least, of a picture that moved
    smear_per_std: float = 3.0  # length of a uniform movement over the blur's deviation
    dark: float = 80.0  # grey level of white
    bright: float = 170.0  # grey level of veiled black, less the least contrast
    pale: float = 60.0  # contrast
    small_square_px: float = 16.0  # side of a square
    small_share: float = 0.05  # of the picture that the board fills
    few_share: float = 0.5  # of the corners, where the board crosses the picture's border
    ellipse_corners: int = 4  # for the blur's directions

    # blur of a whole picture's edges
    unsharp_px: float = 1.6  # from which it is out of focus
    motion_edges: float = 3.0  # ratio of the edges' blurs from which it moved
    again_px: float = 2.0  # standard deviation of the second smoothing
    smoothed_px: float = 0.7  # standard deviation of the first smoothing
    least_slope: float = 1.0  # grey levels per px of an edge
    edge_pixels: int = 200  # least
    crest: float = 0.6  # of the steepest slopes, that are measured
    direction_share: float = 0.2  # of all slopes, from which a direction's blur is known
