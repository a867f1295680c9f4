"""Thresholds of a picture's quality, and of the faults that are named."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class QualitySettings:
    """Thresholds of a picture's faults, measured on drawn boards; grey levels are of 255."""

    # which views are calibrated from
    least_corners: int = 6  # fewest corners of a view
    most_blur_per_gap: float = 0.5  # blur over the gap to the markers: corners are right at 0.4, off by 0.7 px at 0.55
    clipped: float = 0.5  # share of clipped white pixels that is too much where the edges' level is above `grown`
    grown: float = 0.85  # level at the squares' edges above which clipping counts: corners err 1.5 times the usual
    noisier: float = 4.0  # standard deviation of the corners over the median view's, from which a view is dropped
    noisy_px: float = 0.1  # least standard deviation of the corners of a view that is dropped for noise
    blurred: float = 1.5  # blur over the median view's from which it explains a view's noise
    pale_share: float = 0.5  # contrast over the median view's below which it explains a view's noise

    # the board laid flat
    texels: int = 12  # side of a square
    most_bent: float = 0.3  # median distance of the corners from a homography, most, over the side of a square
    fewest_markers: int = 3  # fewest markers that place a board without corners
    clipped_level: int = 250  # grey level from which black is clipped
    washed_out: float = 0.5  # grey level over the contrast from which a square has lost its black
    paper: float = 0.9  # grey level over the contrast from which a black square is as bright as paper: a reflection
    covered: float = 0.25  # share of shining squares from which a patch is a reflection

    # faults that are named
    near_limit: float = 0.7  # blur over the most allowed from which it is reported
    motion: float = 1.6  # ratio of the larger blur to the smaller one from which a picture moved
    motion_px: float = 1.3  # larger blur, least, of a picture that moved
    smear_per_std: float = 3.0  # length of a uniform movement over the blur's deviation
    dark: float = 80.0  # level of white below which a picture is too dark
    bright: float = 170.0  # grey level of veiled black, less the least contrast
    pale: float = 60.0  # contrast below which a picture is too pale
    small_square_px: float = 16.0  # side of a square below which a board is too small in the picture
    small_share: float = 0.05  # part of the picture below which a board is too small in it
    few_share: float = 0.5  # part of the board's corners below which it is reported as outside the picture
    ellipse_corners: int = 4  # fewest corners by which the blur's directions are measured

    # blur of a whole picture's edges
    unsharp_px: float = 1.6  # blur from which a picture is out of focus
    motion_edges: float = 3.0  # ratio of the edges' blurs from which a picture moved
    again_px: float = 2.0  # standard deviation of the second smoothing
    smoothed_px: float = 0.7  # standard deviation of the first smoothing
    least_slope: float = 1.0  # grey levels per px of an edge
    edge_pixels: int = 200  # fewest pixels of strong edges
    crest: float = 0.6  # slope over the steepest from which an edge pixel is measured
    direction_share: float = 0.2  # part of all slopes from which a direction's blur is known
