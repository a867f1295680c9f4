"""Settings of the search for shapes along which a picture has two edges, and of the measurement there."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class SearchSettings:
    """Priors of an antenna's edges and shapes, and the number of shapes compared.

    Chosen on five path-traced sessions (steel and nylon on a cluttered bench, steel and paint on a patchwork, steel on
    a plain one) unless a line says otherwise.
    """

    perspective: float = 0.5  # change of the width from clamp to tip over its mean by the camera's nearness alone, from
    # which it is known beforehand: profiles show less
    row_blocks: int = 16  # in which pixels of a row are averaged to see what they share: many, and each of many pixels
    row_run: int = (
        12  # points of a line on one row, from which noise of rows matters: as long as other errors are shared
    )
    row_band: int = 64  # rows on either side of a line, in which what the pixels of a row share is measured
    row_pixels: int = 30  # next to a line, from which what a row's pixels share is taken off it
    surface_spread: float = 50.0  # grey levels: deviation of the luma of different surfaces
    colour_spread: float = 15.0  # grey levels: the same of differences of colour
    edge_rate: float = 0.1  # share of a background's places at which there is an edge: limits what one edge says
    hidden_odds: float = -1.5  # least log odds of a place: the antenna may be hidden there
    hidden_root_odds: float = -3.0  # the same in its first fifth, where hardly anything hides an antenna
    look_odds: float = 2.0  # most log odds that the colour between the edges counts
    correlation_px: float = 6.0  # length along which log odds count once
    strain_std: float = 0.01  # deviation of the strain of the antenna's surface where it is bent the most: steel yields
    clamp_px: float = 1.5  # by how much a calibrated antenna may be moved at its clamp
    shapes: int = 4  # rough paths that are refined
    measured: int = 3  # shapes that are measured, whose log odds are at least
    measured_share: float = 0.4  # this share of the best one's
    likely_odds: float = 2.0  # mean log odds from which a shape is an antenna's though little of it is measured: in
    # 420 pictures without an antenna 1.9 at most, with one 2.3 to 6 (nylon before clutter 1.3)
    strange_doubt: float = 0.3  # widths: deviation that points of another colour share along a shape that is likely
    contacts: tuple[float, ...] = (0.08, 0.12, 0.18, 0.25, 0.35, 0.45, 0.55, 0.65, 0.75, 0.85, 0.95, 1.1, 1.8)
    # parts of the length at which a force may act; beyond one the bend is nearly an arc
    few_contacts: tuple[float, ...] = (0.15, 0.3, 0.5, 0.7, 0.85, 1.1, 1.8)  # the same, on a rig that is not calibrated
    less_seen: float = 0.05  # part of a line less that may be seen of it where it is measured by both of its edges
    shaded_unsure: float = 0.3  # widths to which a line in a shadow must be known: or it may be the edge of that


@dataclass(frozen=True)
class RibbonSettings:
    """Priors of an antenna's ribbon in a colour picture, and settings of its fit.

    Chosen on six path-traced sessions (steel, nylon and nitinol on a plain bench, paint and steel on a patchwork, thick
    paint on wood) unless a line says otherwise.
    """

    flank_widths: float = 0.5  # profiles reach so many widths
    flank_px: float = 3.5  # and so many pixels to either side
    blur_px: float = 0.8  # standard deviation of a lens in focus
    width_std: float = 0.015  # prior deviation of the width, as a part of it
    blur_std: float = 0.1  # the same of the blur
    taper_std: float = 0.05  # part of its width by which it may be broader at one end
    sides: float = 0.8  # deviation of light from one side, over the antenna's contrast
    middles: float = 0.8  # the same of what is brighter or darker in the middle
    bend_px: float = 0.04  # deviation of the second difference over 20 px of how far the path is off
    knot_px: float = 30.0  # between which its look changes linearly
    alike: float = 0.4  # share of a profile's log odds that its neighbours do not have, too
    hidden: float = -1.5  # log odds of being seen before a profile is looked at
    change_px: float = 80.0  # length after which it is hidden, or seen again
    cut: float = 1.2  # deviations at which a pixel counts half
    passes: int = 8  # Gauss–Newton steps
