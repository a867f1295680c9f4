"""Thresholds of the detection of a board."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class DetectionSettings:
    """Thresholds: neighbouring markers, refinement of corners and circles, a picture's quality, and the fit of
    another specification."""

    # markers: which are neighbours
    miss: float = 0.4  # steps of the grid, largest distance of a neighbour from its place
    diagonal: float = 0.5  # shorter over longer side of a step from which on it is one of a ChArUco board
    diagonals: float = 0.25  # share of nearest neighbours that are so, from which on the grid is one
    agreed: float = 0.8  # share of the pictures that must see a pair alike

    threshold_px: int = 13  # side of the surroundings that a marker's black stands out from, tried first
    least_room_px: float = 3.0  # around a marker to the picture's edges, with which it can be found

    # corners: how they are found and refined
    workers: int = 2  # threads
    few_corners: int = 6  # of a view, least that counts as found
    found: float = 0.3  # share of the pictures with so many from which on the board counts as found
    window_per_gap: float = 0.9  # half window over the room around a corner
    smallest_window_px: int = 3  # half window
    largest_window_px: int = 10
    smoothing_px: float = 1.0  # of a picture in which corners are refined, σ: sharp edges lock them to the pixels
    furthest_px: float = 1.5  # step of a corner that is refined, longest
    rounds: int = 3  # of an AprilGrid's corners, each from where their neighbours predict them
    of_a_gap: float = 0.1  # step of an AprilGrid's corner, longest, over the room around it, where that is more
    of_a_square: float = 0.6  # room around a chessboard's corner over the distance to the next
    other_sizes: float = 0.15  # share of the pictures that may be of another size, and are left out
    fewest: int = 6  # pictures of which one may be

    # another spec
    votes: int = 6  # pairs of neighbours over all pictures, least for any conclusion
    clear: int = 2  # pairs that contradict the spec, least where none contradicts the other
    contradicted: float = 0.2  # the other's contradictions over the spec's, most
    wrong: float = 0.1  # share of the pairs that may contradict a layout
    # In drawn pictures an error of 0.1 raises the corners' error from 0.03 to 0.05 px, one of 0.25 from 0.04 to 0.4 px.
    ratio: float = 0.08  # error of the marker-to-square ratio that is reported
    ratio_px: float = 2.0  # the same, in pixels of a marker's side
    gap: float = 0.006  # error of an AprilGrid's gap, in sides of a tag, that is mended; of a spec twice as much
    widest: int = 60  # columns that are tried
    glance_px: float = 1.5e6  # of a picture in which it is looked which markers there are
    glances: int = 2  # pictures that are mirrored or inverted for that, most
    tried: int = 4  # pictures in which other boards are looked for
    corners: float = 0.5  # corners over markers of a picture in which a proposed board counts as found
    part_texels: int = 8  # to a square, of what is compared about a part of a chessboard
    part_beyond: float = 3.5  # squares beyond the board's outer corners that may be compared
    part_reach: float = 3.0  # squares around the part that are
    part_squares: float = 6.0  # of those, seen in both pictures, least
    part_alike: float = 0.85  # least correlation of them
    part_lead: float = 2.5  # ratio of another part's missing correlation to the best one's, from which the best counts
    part_lead_least: float = 0.05  # excess of that missing correlation, in addition
    part_corners: int = 12  # of a part, least
    part_into: float = 0.3  # of a square, how far from a corner black and white are told
    references: int = 2  # pictures of a whole chessboard by which a part of it is placed, most
    least_corners: int = 20  # of a chessboard that is named
    markers_amid: int = 3  # markers within a plain chessboard, least that make it a ChArUco board

    # circles; from a circle's edge (0) to its neighbour's (1) where it says "of the way"
    circle_rounds: int = 3  # of measuring their areas
    area_reach: float = 0.4  # of the way to the neighbouring circles, up to which a circle's area is summed
    ring_reach: float = 0.7  # of the way to the neighbouring circles, up to which the ring of background reaches
    core: float = 0.6  # of the radius, within which a circle's own level is measured
    core_pixels: int = 12  # of it, and of the ring, least
    edge_blurs: float = 4.0  # half width of an edge in standard deviations of its blur
    cubic_needs: int = 30  # marks from which the ten coefficients per axis of a cubic are well known

    # grids of marks without ids
    search_px: int = 1_500_000  # larger pictures are reduced for the search; marks are refined at full size
    least_side_px: int = 16  # of a picture that is searched
    least_blob_px2: float = 20.0  # area of a spot
    widest_blob: float = 0.5  # area of a spot over the picture's area per mark
    blob_levels: tuple[float, float] = (20.0, 240.0)  # grey levels between which spots are sought
    irregular: float = 0.35  # distance of a mark from the place that its neighbours predict, in their spacing
    most_spots: int = 3  # per circle, among which a grid is sought
    goes_on: float = 0.2  # share of places next to the grid that hold a spot, from which it goes on

    # noise and covariance of corners
    flat: float = 0.2  # of the contrast from black or white, within which a pixel is flat
    flat_kept: float = 0.8  # share of the flat pixels that is used; dirt and print grain are in the rest
    flat_pixels: int = 60  # least
    largest_sample: int = 40  # windows in which noise is measured, most
    least_fixed: float = 1e-4  # determinant of M over its trace squared, from which a window shows a corner
    least_kept: float = 0.25  # share of M that J is assumed to keep

    # quality of a view
    most_edges: int = 40  # between corners, of each direction, that are measured
    edge_step_px: float = 0.5  # between samples across an edge
    into_black: float = 0.35  # of a square: depth within black at which a profile begins
    most_steps: int = 40  # samples of a profile, most
    whitest: float = 253.5  # grey level above which white is saturated
    blackest: float = 0.5  # grey level below which black is
    moved: float = 1.4  # ratio of the larger blur to the smaller from which it is reported as motion
