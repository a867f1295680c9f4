"""Thresholds of warnings and failures in a check."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class CheckSettings:
    """Thresholds of `vbaa check`. A change below its floor has no consequence, however significant it is."""

    # every question
    look_chance: float = 2.7e-3 / 7  # p-value of a warning: 3 deviations, over the seven questions on new pictures
    fail_chance: float = 5.7e-7  # p-value of a failure: 5 deviations of one normal number
    fail_floors: float = 2.0  # floors from which a difference fails a rig
    significant: float = 3.0  # deviations of a direction from which its change is reported

    # the board's pictures
    noticeable_focal: float = 0.01  # relative change of the focal length, the scale of the score test
    noticeable_centre_px: float = 10.0  # the same of the centre
    more_rms_percent: float = 50.0  # floor: excess scatter of corners that light and blur may explain
    lens_floor_px: float = 0.1  # floor of the movement over the picture
    shared_corners: float = 4.0  # corners with one error, as far as smooth changes go: rendered pictures give 1.7² = 3
    jig_floor_mm: float = 0.1  # floor on plane C: a board taken out of its jig and put back lies within it
    along_sight: float = 0.97  # cosine between movement and line of sight, from which it may be a refocus

    # the antenna's pictures
    neighbours: int = 25  # points whose median a point is compared with
    outlying_point: float = 5.0  # deviations from it
    free_floor_mm: float = 0.1  # floor of the free antenna's movement
    number_floor_percent: float = 0.5  # floor of EI and of the gain
    wrong_row: float = 5.0  # deviations of a load's row that counts as wrong
    unseen_mm: float = 2.0  # deviation of the tip in a direction that the pictures do not show

    # the rig by itself
    map_grid: tuple[int, int] = (49, 37)  # columns and rows of the maps
    reach_lengths: float = 1.5  # distance from the clamp up to which plane C is mapped, in antenna lengths
    along: tuple[float, ...] = (0.0, 0.25, 0.5, 0.75, 1.0)  # places on the antenna's axis, over its length
    plane_look_mm: float = 0.2  # deviation of a point on plane C that is warned of
    plane_fail_mm: float = 1.0  # and that fails the rig
    stiffness_look: float = 0.01  # relative deviation of EI that is warned of
    stiffness_fail: float = 0.05
    nominal_look: float = 0.15  # relative difference of EI from E·πd⁴/64 that is warned of
    gain_look: float = 0.02  # relative deviation of the sensor's gain that is warned of
    gain_fail: float = 0.1
