"""What a rod in a photograph is supposed to be like, and where a finder of rods draws its lines."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class RodSettings:
    """Tunable numbers of the search for a rod. Grey levels are of 255, evidence is in natural log odds; "tried" are
    numbers chosen on 16 photographs of cables and yarns and 31 without a rod."""

    most_megapixels: float = 1.0
    """Millions of pixels that a photograph is reduced to at most before the search: 3 s of work."""
    narrowest_px: float = 2.4
    """Narrowest rod that is looked for, in pixels of the reduced photograph: it has three pixels across."""
    widest_px: float = 140.0
    """Widest rod, in pixels: the widest of the photographs that were gathered."""
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
    flat: float = 0.7
    """Share of the background's places that have one colour on both sides."""
    edge: float = 0.25
    """Share of those with an edge, blurred or not."""
    chance: float = 0.05
    """Share of those with three colours: what one place can say is at most 3."""
    gap: float = -2.5
    """Least log odds of one correlation length: a rod may be hidden, or as bright as what is behind it."""
    turn_cost: float = 0.5
    """Log odds of a change of direction by 5.6 degrees in a step of 1.7 widths, growing with its square: tried."""
    click_share: float = 0.012
    """How far a click may be off an end, in diagonals of the picture, beside half a width."""
    least_evidence: float = 12.0
    """Evidence below which a path is no candidate."""
    candidates: int = 6
    """Number of candidates at most: what a person can compare."""
    least_growth: float = 6.0
    """Evidence that a piece beyond an end must have to be added: tried."""
    winding_lead: float = 0.1
    """By how much the mean evidence of a line that winds from clamp to tip must exceed that of a direct one: tried."""
    good_mean: float = 2.85
    """Mean evidence above which a direct line from clamp to tip is not compared with winding ones: tried."""
    good_gaps: float = 0.02
    """Share of such a line without evidence, up to which it is not."""
    detour: float = 1.5
    """Length of a rod at most, in distances from clamp to tip, before winding ones are tried: an arc of 180 degrees."""
    least_aspect: float = 6.0
    """Length over width, below which it is no rod."""
    least_edges: float = 0.5
    """Share of places with both edges, below which a line is not measured."""
    longest_gap: float = 0.15
    """Longest piece without evidence, in lengths of the rod."""
    least_turn: float = 0.12
    """Turning in radians below which a line is straight; rods bent for a measurement turn by 0.2 to 1.6."""
    straight_cost: float = 15.0
    """Log odds against a line for being straight: edges of furniture are."""
    straight_share: float = 0.3
    """Share of the evidence that is left to a straight line that ends in the picture at both ends: tried."""
    most_turn: float = 2.3
    """Turning in radians beyond which `turned_cost` counts for each further radian."""
    turned_cost: float = 5.0
    """Log odds against each radian beyond `most_turn`; wrong lines turned by 2.8 to 41."""
    winding_cost: float = 2.0
    """Log odds against each radian of turning to and fro."""
    shadow_cost: float = 0.5
    """Share of the evidence that a line loses if it has a side's hue in less light all along: it may be a shadow."""
    no_tip_cost: float = 40.0
    """Log odds against a line that leaves the picture at both ends."""
    least_holder_lead: float = 6.0
    """Log odds by which something must be beyond one end rather than the other for that to be the clamp."""
    least_evidence_alone: float = 60.0
    """Evidence that a rod must have where not both ends are known: the most of 30 pictures without one is 57."""
    least_evidence_hanging: float = 35.0
    """The same where it comes from the picture's border and its other end is before plain background."""
    least_evidence_known: float = 15.0
    """Evidence that it must have between known ends."""
    least_mean: float = 2.5
    """Mean evidence along it between known ends, of 3 at most: right lines had 2.7 and more, wrong ones less."""
    least_mean_alone: float = 2.6
    """Mean evidence along it where not both ends are known."""
    rival_share: float = 0.5
    """Share of the best line's evidence from which another may be the rod as well."""
    rival_share_known: float = 0.6
    """The same between known ends."""
    main_directions: int = 4
    """Directions of the picture, a right angle apart, in which paths are followed: a rod runs along one of them."""
    sampled_rows: int = 100
    """Rows of a picture from which its noise and texture are taken: they are known to a few per cent then."""
    any_evidence: float = -1e4
    """Least log odds of a path between two ends that were clicked: the likeliest one is measured in any case."""
    most_pieces: int = 6
    """Pieces that are added to a path that goes on beyond its end, at most."""
    pieces_along: float = 0.45
    """Nearer than so many widths one line runs along another; a rod's shadow beside it is farther."""
    pieces_forward: float = 0.3
    """Least cosine between a path's end and the main direction in which it is followed."""
    flank_widths: float = 1.0
    """Distance, in widths, at which neighbouring surfaces are compared."""
    fit_rounds: int = 6
    """Rounds in which edges are measured along the curve before."""
    smoothing_widths: float = 0.5
    """Length along the rod, in widths, that its curve is smoothed over: a yarn's plies are lumps of about one."""
    least_smoothing_px: float = 6.0
    """Least length, in pixels along a rod, that its curve is smoothed over."""
    smoothing_share: float = 0.004
    """The same as a part of the rod's length: a rod does not bend within it."""
    edge_contrast: float = 0.6
    """Part of the contrast that is left at an edge: a tangle of hairs beside a yarn has about half of it."""
    least_points: int = 8
    """Fewest measured points of a rod."""
    ring_widths: float = 1.7
    """Distance from an end, in widths, at which what goes on is looked for."""
    darkest_shadow: float = 0.3
    """Least light, over that next to it, in a shadow: tried."""
    width_tolerance: float = 4.0
    """Standard deviations of the width from its neighbours' beyond which a point is left out."""
    grown_rounds: int = 2
    """So many of the likeliest paths are followed beyond their ends."""
    winding_rounds: int = 3
    """So many of them are tried where no direct line leads from clamp to tip."""
