"""Settings of the search for a rod in a photograph and of the fit of its bending."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class RodSettings:
    """Thresholds of the search for a rod and of the fit of its bending. Grey levels are of 255, evidence is in
    natural log odds; "tried" marks numbers chosen on 16 photographs of cables and yarns and 31 without a rod."""

    most_megapixels: float = 0.7
    """Millions of pixels that a photograph is reduced to at most before the search: 2 s of work."""
    narrowest_px: float = 2.4
    """Narrowest rod that is looked for, in pixels of the reduced photograph: it has three pixels across."""
    least_width_px: float = 1.5
    """Width in pixels of the photograph below which a line is a drawn one: a camera blurs edges over as much."""
    width_step: float = 1.5
    """Ratio of neighbouring widths: evidence stays above half of its best within it."""
    level_width_px: float = 3.5
    """Width in pixels of the picture that a wider rod is searched in."""
    correlation_share: float = 0.015
    """Length, in diagonals of the picture, along which evidence counts once where the rod is narrower: tried."""
    shading: tuple[float, float] = (4.0, 2.5)
    """Grey levels by which places of one surface differ, in luma and in chroma: usual of indoor light."""
    least_noise: float = 0.7
    """Least noise of a pixel in grey levels: JPEG hides what there is."""
    spread: float = 50.0
    """Grey levels by which two surfaces differ: standard deviation of colours in photographs."""
    chroma_spread: float = 12.0
    """The same in chroma, for a rod between known ends: 5 in the median and 18 in the upper quartile of 60 pictures,
    where light differs by 20."""
    flat: float = 0.7
    """Share of the background's places that have one colour on both sides."""
    edge: float = 0.25
    """Share of those with an edge, blurred or not."""
    chance: float = 0.05
    """Share of those with three colours: what one place can say is at most 3."""
    gap: float = -2.5
    """Least log odds of one correlation length: a rod may be hidden, or as bright as what is behind it."""
    length_cost: float = 0.02
    """Log odds against each correlation length."""
    most_cost: float = 40.0
    """Evidence that a path between clamp and tip may lack, turns included: one of 240 widths lacks 20."""
    most_cost_alone: float = 30.0
    """The same for either part of a path that may end anywhere."""
    least_gain: float = 0.05
    """Share by which a line found with another width must have more evidence: less is chance."""
    most_stations: int = 1000
    """Stations along a rod at which it is measured, at most: 0.1 s of work."""
    coloured_mean: float = 1.0
    """Mean evidence of a line from which it is looked for again in the colour of its ends."""
    least_path_mean: float = 0.5
    """Mean evidence below which a path is not measured."""
    one_edge: float = 3.0
    """Length in widths without two parallel edges from which one edge is enough: hairs are shorter."""
    parallel: float = 0.15
    """Part of the width by which it may differ from the usual one near by: plies of a yarn do less."""
    cuts: int = 4
    """Paths that are looked for between clamp and tip, each by cutting the weakest place of the one before."""
    widest: float = 0.3
    """Widest rod, in shorter sides of the picture."""
    other_colour: float = 8.0
    """Places of one rod differ in colour by so many times `shading`: highlights and shades of a cable."""
    slack: tuple[float, float] = (1.5, 8.0)
    """So many times the evidence that the best path lacks, and so much more, may others lack."""
    drop: float = 5.0
    """Evidence that is lost beyond an end before it is one: two correlation lengths without any."""
    enough: float = 2.5
    """Evidence of a correlation length that says all that a picture can: 3 at most, less what is rounded off."""
    turn_cost: float = 0.15
    """Log odds of a change of direction by 11 degrees in a step of 1.4 widths, growing with the square: tried."""
    click_share: float = 0.012
    """How far a click may be off an end, in diagonals of the picture, and half a width."""
    least_evidence: float = 12.0
    """Evidence below which a path is no candidate."""
    sharp_turn: float = 1.2
    """Radians within `sharp_widths` that no rod turns by next to its ends: right lines of 480 turned by up to 0.9."""
    sharp_widths: float = 2.0
    """Length along a line, in widths, of such a turn."""
    corner: float = 0.8
    """Radians within `corner_widths` to either side from which a path may leave the rod: a path rounds off corners."""
    corner_widths: float = 4.0
    """Length along a path, in widths, of either side of a corner."""
    candidates: int = 6
    """Number of candidates at most: what a person can compare."""
    good_mean: float = 2.7
    """Mean evidence of a line from clamp to tip above which nothing better is looked for."""
    least_aspect: float = 4.0
    """Length over width, below which it is no rod."""
    least_edges: float = 0.4
    """Share of places with both edges, below which a line is not measured."""
    good_edges: float = 0.9
    """Share of places with both edges above which nothing better is to be expected."""
    rod_odds: tuple[float, ...] = (
        *(1.82, 2.06, 0.27, 0.35, -1.08, -1.99, -3.89, -60.0, -3.58, -7.98),
        *(4.01, 3.98, 2.54, -1.53),
    )
    """Log odds of a rod, for each: 1, known ends, mean evidence below `usual_mean`, log contrast over
    `usual_contrast` up to 1, difference of both sides over the contrast, share that may be shadow (0 between clicks on
    the line), square root of the bend in radians where nothing is seen, squared share of the longest piece without
    evidence (a quarter may be anything), squared distance from clicks in tolerances, sharpest turn beyond
    `usual_sharpest`; unless both ends are known: share of places with both edges below `good_edges`, bend in radians up
    to `bent`, log length in diagonals; an end that may be covered. From logistic regression of the rod among a
    picture's lines and none: on half of 630 pictures and 90 without a rod, then, near to that, on 199 pictures with
    known ends, 180 without and 76 without a rod."""
    usual_sharpest: float = 0.45
    """Turn in radians, within `sharp_widths` to either side, from which a line is less likely a rod: one of 51
    right lines turned by more, and a third of 316 others."""
    usual_mean: float = 2.6
    """Mean evidence below which a line is less likely a rod."""
    usual_contrast: float = 18.0
    """Contrast with the more like side, in `shading`, of a line."""
    one_sided: float = 0.7
    """Difference of both sides over the contrast from which a line is one edge of something: halves of cables of two
    colours had 0.8 to 1.5, a cable beside its shadow 0.4."""
    bent: float = 0.6
    """Bend in radians from which more makes a rod no likelier; edges of sheets and boards turned by 0.2."""
    clear_end: float = 2.0
    """Log odds from which there is something beyond an end, or nothing but background: those of either are 5 to 20."""
    searches: int = 5
    """Searches for a line between two ends, at most; from the third on without the paths that are no rods."""
    no_rod: float = -3.0
    """Log odds below which a measured line is no rod, and the next search avoids its path."""
    least_probability: tuple[float, float] = (0.6, 0.5)
    """Probability from which a line is taken for the rod, without and with two known ends: with less, the wrong lines
    of 180 pictures, and of 199 with known ends, grow faster than the right ones."""
    least_holder_lead: float = 6.0
    """Log odds by which something must be beyond one end rather than the other for that to be the clamp."""
    whole_mean: float = 1.2
    """Mean evidence of a line that has both edges nearly everywhere, above which it is one thing."""
    sampled_rows: int = 100
    """Rows of a picture from which its noise and texture are taken: they are known to a few per cent then."""
    any_evidence: float = -1e4
    """Least log odds of a path between two ends that were clicked: the likeliest one is measured in any case."""
    pieces_along: float = 0.45
    """Nearer than so many widths one line runs along another; a rod's shadow is farther."""
    flank_widths: float = 1.0
    """Distance, in widths, at which neighbouring surfaces are compared."""
    patch_widths: float = 5.0
    """Room about a path, in widths, in which it is measured."""
    measured_width_px: float = 20.0
    """Width in pixels that wider rods are reduced to before they are measured."""
    light: float = 80.0
    """Grey levels by which light changes along one surface: a shadow, a highlight or a printed letter."""
    least_chroma: float = 10.0
    """Chroma, over that next to it, from which a rod has a hue."""
    one_colour: float = 12.0
    """Length in widths over which the rod has one colour and width: what crosses it is shorter."""
    fit_rounds: int = 5
    """Rounds in which edges are measured along the curve before."""
    smoothing_widths: float = 0.45
    """Length along the rod, in widths, that its curve is smoothed over: a yarn's plies are lumps of about one."""
    least_smoothing_px: float = 6.0
    """Least length, in pixels along a rod, that its curve is smoothed over."""
    smoothing_share: float = 0.004
    """The same as a part of the rod's length: a rod does not bend within it."""
    edge_contrast: float = 0.6
    """Part of the contrast that is left at an edge: a tangle of hairs along a yarn has about half of it."""
    least_points: int = 8
    """Fewest measured points of a rod."""
    bridged_widths: float = 3.0
    """Length in widths over which something may hide a rod that goes on behind it: a label, tape or a thread."""
    hidden: float = 0.02
    """Share of places at which something hides a rod that goes on behind it: 0.9 log odds against each, by `chance`."""
    ahead_widths: float = 4.0
    """Distance from an end, in widths, up to which a line of the rod's colour is one that goes on."""
    dark: float = 32.0
    """Grey levels of light that are added before chroma is taken relative to it: noise is all of it in the dark."""
    darkest_shadow: float = 0.3
    """Least light, over that next to it, in a shadow: tried."""

    pieces: int = 120
    """Pieces of the rod for its bending; curvature is constant on each."""
    most_points: int = 140
    """Measured points that its bending is fitted to, at most."""
    curls: tuple[float, ...] = (0.0, *np.geomspace(0.01, 30.0, 8))
    """Standard deviations of the rod's own curl that are tried, in radians per length of the rod."""
    curl_lengths: tuple[float, ...] = (0.03, 0.1, 0.3)
    """Lengths over which curl is correlated that are tried, in lengths of the rod."""
    error_lengths: tuple[float, ...] = (0.0, 0.01, 0.03)
    """Lengths over which points err together that are tried, in lengths of the rod."""
    law_steps: int = 4
    """Steps of the moment, on each of which a free law of bending is a cubic."""
    least_information: float = 1e-13
    """Information added on each coefficient, as a part of the sum of all."""
    samples: int = 20_000
    """Draws by which the quantiles of EI are taken."""
    camera_lengths: float = 2.0
    """Supposed distance of the camera in lengths of the rod, for the perspective of a tilt."""
