"""Settings of the detector, one class a stage: search, profiles, ribbon, acceptance, looks, background.

All but those of the search are read from the class: without methods it takes a quarter of the time to build.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class SearchSettings:
    """Where the antenna may be, priors of its edges and shapes, and the number of shapes compared.

    Chosen on five path-traced sessions (steel and nylon on a cluttered bench, steel and paint on a patchwork, steel on
    a plain one) unless a line says otherwise.
    """

    # the corridor
    clamp_px: float = 8.0  # distance of the clamp from the free antenna's on a rig that is not calibrated
    clamp_rad: float = 0.12  # three standard deviations of its direction there
    reach: float = 0.9  # lateral distance of the antenna over that from the clamp: 42°
    least_length_px: float = 10.0  # of the free antenna in the picture: end on, there is no line
    perspective: float = 0.5  # change of the width from clamp to tip over its mean by the camera's nearness alone, from
    # which it is known beforehand: profiles show less

    # an antenna of one polarity: tabled paths
    largest_turn_rad: float = 1.75  # of the antenna's direction from clamp to tip
    blurred_px: float = 8.0  # blur with which it is searched again where it is not found in focus
    other_path: float = 0.75  # score of a second path over the best one's, from which it is measured, too

    # edges of either polarity
    surface_spread: float = 50.0  # grey levels: standard deviation of the colours of different surfaces
    edge_rate: float = 0.1  # share of a background's places at which there is an edge: limits what one edge says
    hidden_odds: float = -1.5  # least log odds of a place: the antenna may be hidden there
    hidden_root_odds: float = -3.0  # the same in its first fifth, where hardly anything hides an antenna
    look_odds: float = 2.0  # most log odds that the colour between the edges counts
    correlation_px: float = 6.0  # length along which log odds count once
    strain_std: float = 0.01  # standard deviation of the largest strain at the antenna's surface: steel yields
    calibrated_clamp_px: float = 1.5  # by how much a calibrated antenna may be moved at its clamp
    shapes: int = (
        3  # that are refined, and measured, at most: rough ones whose scores above the worst path's are at least
    )
    share: float = 0.4  # this part of the best one's, refined ones whose log odds are
    contacts: tuple[float, ...] = (0.08, 0.12, 0.18, 0.25, 0.35, 0.45, 0.55, 0.65, 0.75, 0.85, 0.95, 1.1, 1.8)
    # parts of the length at which a force may act; beyond one the bend is nearly an arc
    few_contacts: tuple[float, ...] = (0.15, 0.4, 0.7, 1.1, 1.8)  # the same of tabled paths, and on a rig that is not
    # calibrated


@dataclass(frozen=True, init=False, repr=False, eq=False)
class ProfileSettings:
    """The line fitted to profiles of grey levels. Chosen on drawn pictures and on ten path-traced sessions."""

    blur_px: float = 0.8  # standard deviation of a lens in focus
    uneven: float = 0.4  # deviation of its pull along a lopsided line, over that, from which it is no light's
    # noise of whole rows, or columns, of pixels
    row_run: int = 12  # points of a line on one row, from which it matters: as long as other errors are shared
    row_band: int = 32  # rows on either side of a line, in which what the pixels of a row share is measured
    row_pixels: int = 30  # next to a line, from which what a row's pixels share is taken off it


@dataclass(frozen=True, init=False, repr=False, eq=False)
class RibbonSettings:
    """Priors of an antenna's ribbon in a picture, and settings of its fit.

    Chosen on six path-traced sessions (steel, nylon and nitinol on a plain bench, paint and steel on a patchwork, thick
    paint on wood) unless a line says otherwise.
    """

    flank_widths: float = 0.5  # profiles reach so many widths
    flank_px: float = 3.5  # and so many pixels to either side
    width_std: float = 0.015  # prior standard deviation of the width, as a part of it
    blur_std: float = 0.1  # the same of the blur
    taper_std: float = 0.05  # part of its width by which it may be broader at one end
    shades: float = 0.8  # standard deviation of light from one side, and of what is brighter or darker in the middle,
    # over the antenna's contrast
    bend_px: float = 0.04  # standard deviation of the second difference over 20 px of how far the path is off
    knot_px: float = 30.0  # between which its look changes linearly
    alike: float = 0.8  # share of a profile's log odds that its neighbours do not have, too
    change_px: float = 80.0  # length after which it is hidden, or seen again
    cut: float = 1.2  # standard deviations at which a pixel counts half
    passes: int = 8  # Gauss–Newton steps


@dataclass(frozen=True, init=False, repr=False, eq=False)
class AcceptanceSettings:
    """Whether a measured line is the antenna, and why parts of it are not seen.

    Chosen on 500 drawn pictures of several hardships each, half of them empty, and on path-traced sessions and their
    empty benches, so that 7 in 10,000 empty pictures show an antenna.
    """

    # how much of the guide must be seen; of a line whose polarity may change, more
    least_seen: float = 0.3  # fraction of the guide
    least_seen_changing: float = 0.5  # the same
    least_root: float = 0.35  # fraction of the guide's first third: the antenna starts at the clamp
    faint: float = 0.4  # height over the usual one: a fainter line is another thing's
    broad: float = 1.8  # width over the expected one from which a line may be out of focus, or a soft edge
    least_seen_broad: float = 0.85  # fraction of the guide in the picture that must be seen of a line as broad as that
    # another line
    other_line: float = 0.7  # how likely it is, over the first one, from which the picture is ambiguous
    moved: float = (
        0.1  # mean distance from where the antenna is expected, in lengths, up to which a line is the likelier
    )
    # its shape; misfits as of `Corridor.misfit`
    likely_odds: float = 2.0  # mean log odds from which a shape is an antenna's though little of it is measured: in
    # 420 pictures without an antenna 1.9 at most, with one 2.3 to 6 (nylon before clutter 1.3)
    usual_misfit: float = 0.08  # most that lines have which lie on the antenna all along
    unsure_misfit: float = 0.25  # most for a changing line that is not surely one
    much_seen: float = 0.72  # fraction that must be seen, or surely seen, of a changing line for more
    depth_rad: float = 3.0  # prior standard deviation of the bend towards the camera, which perspective alone shows
    from_clamp: float = 0.35  # part of the length over which its direction at the clamp is measured
    bends_more: tuple[float, float] = (3.0, 0.15)  # error of that direction by a contact there, over the line's turn;
    # of one whose polarity may change


@dataclass(frozen=True, init=False, repr=False, eq=False)
class StretchSettings:
    """Why stretches of the antenna are not seen: words for whoever takes pictures; no measurement depends on them."""

    run: int = 9  # neighbouring profiles that are averaged, so that a faint line shows
    shortest: float = 0.02  # share of the length below which a stretch is merged with its neighbours
    shortest_px: float = 8.0  # length below which a stretch is merged with its neighbours
    clear: float = 4.5  # height of a visible line over its standard deviation
    alike: float = 0.2  # share of the usual height within which the antenna is as bright as its background
    nearly: float = 0.35  # the same within which it is nearly as bright
    disturbed: float = 1.8  # residual over noise that shows something else
    broader_px: tuple[float, float] = (2.0, 4.0)  # blurs that are tried
    much_broader: float = 0.8  # share of the residuals that they may leave


@dataclass(frozen=True, init=False, repr=False, eq=False)
class LookSettings:
    """The antenna's colours as learnt from pictures, and what of a line has others."""

    least_spread: float = 0.08  # standard deviation of a colour over its brightness: light changes as it bends
    least_spread_levels: float = 3.0  # the same in grey levels, added in quadrature
    partly_foreign: float = 1.0  # standard deviations from which a point may show something else in part
    hidden_part: float = 0.15  # widths that a line of one polarity lies off there
    shaded_unsure: float = 0.3  # widths to which a line in a shadow must be known: or it may be the edge of that
    strange_doubt: float = 0.3  # widths: error that points of another colour share along a shape that is likely


@dataclass(frozen=True, init=False, repr=False, eq=False)
class BackgroundSettings:
    """Registration of the empty scene to a picture."""

    fine_px: float = 1.2  # standard deviation of the blur that removes noise before pictures are compared
    coarse_px: int = 21  # side of the mean that removes the light's variation before pictures are compared
    most_pixels: int = 8_000  # that are compared, most
    detailed: float = 0.9  # quantile of the slopes above which pixels are compared
    most_shift_px: float = 6.0  # of the background
    gain: tuple[float, float] = (0.4, 2.5)  # least and most of its brightness
    least_correlation: float = 0.65  # of the background's detail with a picture's
    between_two: float = 0.5  # of the detail of two noisy pictures, least correlation
    least_pictures: int = 5  # from which a background is learnt
    least_uncovered: int = 3  # of these pictures that must show a pixel
    still: float = 1.0  # detail over scatter from which a background is used
