"""Tunable numbers of the search for shapes along which a picture shows two edges, and of colours along them."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class SearchSettings:
    """What is supposed of an antenna's edges and shapes, and how many shapes are compared.

    Chosen on five path-traced sessions (steel and nylon on a cluttered bench, steel and paint on a patchwork, steel on
    a plain one) unless a line says otherwise.
    """

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
    own_share: float = 0.2  # of its width, to either side of its middle: where an antenna's own colour is sampled
    flanks_px: tuple[float, float] = (1.5, 2.5)  # beyond its edges: where that next to it is
    alike_places: int = 15  # so many of these along it, twice, are averaged
    faint_contrast: float = 2.5  # grey levels in each channel: with less the plane of contrast is nearly grey
    contrast_reach_px: float = 10.0  # beyond the width: how far from the antenna that plane is weighted
    less_seen: float = 0.05  # part of a line less that may be seen of it where it is measured by both of its edges
    shaded_unsure: float = 0.3  # widths to which a line in a shadow must be known: or it may be the edge of that
