"""Goals and thresholds of a guided calibration: pictures of the board and the jig, and known loads."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class GuideSettings:
    """Thresholds of the guide."""

    # when there are enough pictures
    goal_m: float = 1e-4  # standard deviation of points on plane C that is good enough
    fewest_views: int = 8  # fewer show no outlier, and no halves to compare
    fewest_of_jig: int = 3  # pictures of the board in the jig
    least_view_gain: float = 0.025  # least part of that standard deviation by which a further picture must lower it

    # the plane and lens that uncertainty is predicted for
    work_grid: tuple[int, int] = (13, 7)  # points along and across the work area
    half_width_per_length: float = 0.25  # half width of the work area over the antenna's length
    focal_prior: float = 0.3  # relative standard deviation of the focal length before any picture
    aspect_prior: float = 0.01  # relative standard deviation of fx/fy
    centre_prior: float = 0.05  # standard deviation of the centre, over the picture's longer side
    radial_prior: float = 0.1  # standard deviation of a radial coefficient's shift, over half the picture's diagonal
    tangential_prior: float = 0.01  # the same of the other coefficients
    least_jig_corners: int = 6  # fewest corners in the picture of a board on the plane
    least_rays: float = 0.5  # share of the picture with rays, from which a lens is used
    nominal_focal_per_width: float = 1.1  # a field of view of 49°, as most webcams and machine lenses have
    nominal_sigma_px: float = 0.2  # standard deviation of a corner before a lens was solved
    least_sigma_px: float = 0.02  # least standard deviation of a corner

    # which pose of the board is suggested
    nearest: float = 0.6  # board's distance over plane C's: nearer, a camera that is sharp on plane C is out of focus
    furthest: float = 1.7  # and farther, too
    fills: tuple[float, ...] = (0.9, 0.6, 0.4)  # sizes of the board, over the picture's shorter relative side
    places: tuple[float, ...] = (0.1, 0.3, 0.5, 0.7, 0.9)  # of the board's middle, over the picture's width and height
    tilt_rad: float = np.radians(38.0)  # tilt of a tilted board
    tilts: int = 8  # directions in which a board is tilted
    least_share: float = 0.35  # least share of the board's corners in a picture
    whole_share: float = 0.95  # the same in the first pictures
    whole_pictures: int = 3  # number of these first pictures
    least_corners: int = 8  # fewest corners in a picture
    least_module_px: float = 3.0  # least size of a module of a marker that is read
    edge_px: float = 3.0  # distance of a corner's squares from the picture's border
    rounds: int = 2  # rounds of poses near the best one so far

    # whether a live picture matches it
    facing_rad: float = np.radians(8.0)  # tilt below which the board faces the camera
    upright_rad: float = np.radians(60.0)  # roll from which its long side is upright
    match_corners: int = 6  # fewest corners of a live picture that is compared
    place_off: float = 0.12  # difference that counts as one, over the picture's size
    distance_off: float = 0.2  # the same of the logarithm of the distance
    tilt_off_rad: float = np.radians(15.0)
    roll_off_rad: float = np.radians(40.0)
    mentioned: float = 0.6  # difference from which a change is asked for

    # which load is suggested
    steepest_rad: float = np.deg2rad(35.0)  # slope at the load up to which the antenna's model is exact enough
    nearest_load: float = 0.35  # nearest place of a load to the clamp, over the length
    load_to_tip_m: float = 5e-3  # nearest place of a load to the tip
    ruler_m: float = 5e-3  # step between places that are easily found on a ruler
    load_places: int = 9  # places of a load that are tried
    sideways: float = 0.02  # part of a hanging weight along the antenna: only the force across it is known
    straight: float = np.cos(np.deg2rad(10.0))  # cosine between pull and gravity, below which it hangs over a pulley
    least_visible: float = 0.97  # part of the visible free antenna that is also visible of the loaded one
    along: float = 0.5  # part of a force along an axis from which the load counts as one along it
    fewest_loads: int = 3  # a wrong row shows against two others
    gain_std: float = 0.02  # standard deviation of the sensor's gain that is enough; loads in plane C do not show it
    out_of_plane: float = 0.5  # part of a pull along z from which it shows that gain
    least_load_gain: float = 0.05  # least part of EI's standard deviation by which a further load must lower it
    ahead: int = 6  # further loads in the forecast

    # observations that are tried against the distance's shared error
    weighty_places: tuple[float, ...] = (0.6, 0.95)  # places, over the length, at which further weights would hang
    weighty_slopes: tuple[float, ...] = (0.4, 0.95)  # slopes at further weights, over `steepest_rad`
    free_tilts_rad: tuple[float, ...] = (-1.0, -0.5, 0.0, 0.5, 1.0)  # tilts of the joints with a free antenna
    points: int = 300  # most points of a forecast line
    free_pictures: int = 3  # pictures at each tilt
    sweep_turns_rad: tuple[float, ...] = (0.3, 0.2, 0.14, 0.1)  # turns to either side while the board stays in view
    tried: int = 4  # observations that are compared in full: the best by the contacts' present weights
    steps: int = 3  # most observations that are advised
