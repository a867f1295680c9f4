"""Goals and thresholds of a guided calibration: pictures of the board and the jig, and known loads."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class GuideSettings:
    """Thresholds of the guide."""

    # when there are enough pictures
    goal_m: float = 1e-4  # deviation of points on plane C that is good enough
    fewest_views: int = 8  # fewer show no outlier, and no halves to compare
    fewest_of_jig: int = 3  # pictures of the board in the jig
    least_view_gain: float = 0.025  # part of that deviation that a further picture must take off

    # the plane and lens that uncertainty is predicted for
    work_grid: tuple[int, int] = (13, 7)  # points along and across the work area
    half_width_per_length: float = 0.25  # of the work area
    focal_prior: float = 0.3  # relative deviation of the focal length, before anything was seen
    aspect_prior: float = 0.01  # relative deviation of fx from fy
    centre_prior: float = 0.05  # deviation of the centre, over the picture's longer side
    radial_prior: float = 0.1  # deviation of what a coefficient moves, over half the picture's diagonal
    tangential_prior: float = 0.01  # the same of a coefficient that is not radial
    least_jig_corners: int = 6  # of a board on the plane, in the picture
    least_rays: float = 0.5  # share of the picture with rays, from which a lens is used
    nominal_focal_per_width: float = 1.1  # a field of view of 49°, as most webcams and machine lenses have
    nominal_sigma_px: float = 0.2  # of a corner, before a lens was solved
    least_sigma_px: float = 0.02  # of a corner

    # which pose of the board is suggested
    nearest: float = 0.6  # board's distance over plane C's: nearer, a camera that is sharp on plane C is out of focus
    furthest: float = 1.7  # and farther, too
    fills: tuple[float, ...] = (0.9, 0.6, 0.4)  # of the picture's shorter relative side that the board takes up
    places: tuple[float, ...] = (0.1, 0.3, 0.5, 0.7, 0.9)  # of its middle, over the picture's width and height
    tilt_rad: float = np.radians(38.0)  # of a tilted board
    tilts: int = 8  # directions in which a board is tilted
    least_share: float = 0.35  # of the board's corners that a picture must show
    whole_share: float = 0.95  # the same in the first pictures
    whole_pictures: int = 3  # how many first pictures
    least_corners: int = 8  # that a picture must show
    least_module_px: float = 3.0  # of a marker that is read
    edge_px: float = 3.0  # distance of a corner's squares from the picture's border
    rounds: int = 2  # of poses near the best one so far

    # whether a live picture matches it
    facing_rad: float = np.radians(8.0)  # tilt below which the board faces the camera
    upright_rad: float = np.radians(60.0)  # roll from which its long side is upright
    match_corners: int = 6  # of a picture that is compared
    place_off: float = 0.12  # difference that counts as one, over the picture's size
    distance_off: float = 0.2  # the same of the logarithm of the distance
    tilt_off_rad: float = np.radians(15.0)
    roll_off_rad: float = np.radians(40.0)
    mentioned: float = 0.6  # difference from which a change is asked for

    # which load is suggested
    steepest_rad: float = np.deg2rad(35.0)  # slope at the load up to which the antenna's model is exact enough
    nearest_load: float = 0.35  # of the length, from the clamp
    load_to_tip_m: float = 5e-3  # from the tip
    ruler_m: float = 5e-3  # between distances that are easily found on a ruler
    load_places: int = 9  # that are tried
    sideways: float = 0.02  # part of a hanging weight along the antenna: only the force across it is known
    straight: float = np.cos(np.deg2rad(10.0))  # cosine between pull and gravity, below which it hangs over a pulley
    least_visible: float = 0.97  # part of the visible free antenna that is also visible of the loaded one
    along: float = 0.5  # part of a force along an axis from which the load counts as one along it
    fewest_loads: int = 3  # a wrong row shows against two others
    gain_std: float = 0.02  # of the moment sensor, that is good enough; loads in plane C do not show it
    out_of_plane: float = 0.5  # part of a pull along z from which it shows that gain
    least_load_gain: float = 0.05  # part of EI's deviation that a further load must take off
    ahead: int = 6  # further loads in the forecast

    # what is tried for the distance's shared error
    weighty_places: tuple[float, ...] = (0.6, 0.95)  # of the length, at which further weights would hang
    weighty_slopes: tuple[float, ...] = (0.4, 0.95)  # of `steepest_rad`, to which further weights would bend it
    free_tilts_rad: tuple[float, ...] = (-1.0, -0.5, 0.0, 0.5, 1.0)  # of the joints, with the antenna free
    points: int = 300  # of a line that is forecast, most
    free_pictures: int = 3  # at a tilt
    sweep_turns_rad: tuple[float, ...] = (0.3, 0.2, 0.14, 0.1)  # to either side, as far as the board stays in view
    tried: int = 4  # the best by the contacts' present weights, of which the best is taken
    steps: int = 3  # observations that are advised, most
