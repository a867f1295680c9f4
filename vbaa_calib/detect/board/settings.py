"""Thresholds of the detection of a board."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class DetectionSettings:
    """Thresholds: neighbouring markers, refinement of corners and circles, a picture's quality, and the fit of
    another specification."""

    # markers: which are neighbours
    miss: float = 0.4  # distance of a neighbour from its predicted place, most, in steps of the grid
    diagonal: float = 0.5  # shorter over longer side of a step from which on it is one of a ChArUco board
    diagonals: float = 0.25  # share of nearest neighbours along diagonals from which on the grid is a ChArUco board's
    agreed: float = 0.8  # share of the pictures that must show the same pair of neighbours

    threshold_px: int = 13  # side of the surroundings that a marker's black stands out from, tried first
    least_room_px: float = 3.0  # room from a marker to the picture's edges, least, in which it can be found

    # corners: how they are found and refined
    workers: int = 2  # threads
    few_corners: int = 6  # fewest corners of a view in which the board counts as found
    found: float = 0.3  # share of such views from which on the board counts as found
    window_per_gap: float = 0.9  # half window over the distance from a corner to the nearest marker
    smallest_window_px: int = 3  # half window
    largest_window_px: int = 10
    smoothing_px: float = 1.0  # of a picture in which corners are refined, σ: sharp edges lock them to the pixels
    furthest_px: float = 1.5  # longest step of a corner that is refined
    rounds: int = 3  # of an AprilGrid's corners, each from where their neighbours predict them
    of_a_gap: float = 0.1  # step of an AprilGrid's corner, longest, over the room around it, where that is more
    of_a_square: float = 0.6  # room around a chessboard's corner over the distance to the next
    other_sizes: float = 0.15  # share of the pictures that may be of another size, and are left out
    fewest: int = 6  # fewest pictures of which one may be of another size

    # another spec
    votes: int = 6  # fewest pairs of neighbours, over all pictures, that tell anything
    clear: int = 2  # fewest pairs that contradict the spec where none contradicts the other
    contradicted: float = 0.2  # most contradictions of the other spec, over the given one's
    wrong: float = 0.1  # share of the pairs that may contradict a layout
    # In drawn pictures an error of 0.1 raises the corners' error from 0.03 to 0.05 px, one of 0.25 from 0.04 to 0.4 px.
    ratio: float = 0.08  # error of the marker-to-square ratio that is reported
    ratio_px: float = 2.0  # the same, in pixels of a marker's side
    gap: float = 0.006  # error of an AprilGrid's gap that is corrected, in sides of a tag; of a spec twice as much
    widest: int = 60  # most columns that are tried
    glance_px: float = 1.5e6  # size of the pictures in which markers are looked for
    glances: int = 2  # most pictures that are mirrored or inverted to find markers
    tried: int = 4  # pictures in which other boards are looked for
    corners: float = 0.5  # corners over markers of a picture from which a proposed board counts as found
    part_texels: int = 8  # samples per square by which parts of a chessboard are compared
    part_beyond: float = 3.5  # squares beyond the board's outer corners up to which pictures may be compared
    part_reach: float = 3.0  # squares around the part that are compared
    part_squares: float = 6.0  # fewest of these squares that both pictures show
    part_alike: float = 0.85  # least correlation of these squares
    part_lead: float = 2.5  # ratio of another part's missing correlation to the best one's, from which the best counts
    part_lead_least: float = 0.05  # excess of that missing correlation, in addition
    part_corners: int = 12  # fewest corners of a part
    part_into: float = 0.3  # distance from a corner at which black and white are told apart, in squares
    references: int = 2  # most pictures of a whole chessboard by which a part of it is placed
    least_corners: int = 20  # fewest corners of a chessboard that is named
    markers_amid: int = 3  # fewest markers within a plain chessboard that make it a ChArUco board

    # circles; from a circle's edge (0) to its neighbour's (1) where it says "of the way"
    circle_rounds: int = 3  # of measuring their areas
    area_reach: float = 0.4  # of the way to the neighbouring circles, up to which a circle's area is summed
    ring_reach: float = 0.7  # of the way to the neighbouring circles, up to which the ring of background reaches
    core: float = 0.6  # of the radius, within which a circle's own level is measured
    core_pixels: int = 12  # fewest pixels of this core, and of the ring
    edge_blurs: float = 4.0  # half width of an edge in standard deviations of its blur
    cubic_needs: int = 30  # marks from which the ten coefficients per axis of a cubic are well known

    # grids of marks without ids
    search_px: int = 1_500_000  # larger pictures are reduced for the search; marks are refined at full size
    least_side_px: int = 16  # least side of a picture that is searched
    least_blob_px2: float = 20.0  # area of a spot
    widest_blob: float = 0.5  # area of a spot over the picture's area per mark
    blob_levels: tuple[float, float] = (20.0, 240.0)  # grey levels between which spots are sought
    irregular: float = 0.35  # distance of a mark from the place that its neighbours predict, in their spacing
    most_spots: int = 3  # per circle, among which a grid is sought
    goes_on: float = 0.2  # share of places next to the grid that hold a spot, from which it goes on

    # noise and covariance of corners
    least_variance: float = 1.0 / 12.0  # of a pixel, grey levels squared: rounding to whole ones
    flat: float = 0.2  # of the contrast from black or white, within which a pixel is flat
    flat_kept: float = 0.8  # share of the flat pixels that is used; dirt and print grain are in the rest
    flat_pixels: int = 60  # fewest flat pixels
    largest_sample: int = 40  # most windows in which noise is measured
    least_fixed: float = 1e-4  # determinant of M over its trace squared, from which a window shows a corner
    least_kept: float = 0.25  # share of M that J is assumed to keep

    # quality of a view
    most_edges: int = 40  # most edges between corners, of each direction, that are measured
    edge_step_px: float = 0.5  # between samples across an edge
    into_black: float = 0.35  # of a square: depth within black at which a profile begins
    most_steps: int = 40  # most samples of a profile
    whitest: float = 253.5  # grey level above which white is saturated
    blackest: float = 0.5  # grey level below which black is clipped
    moved: float = 1.4  # ratio of the larger blur to the smaller from which it is reported as motion
