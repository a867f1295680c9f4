"""Thresholds of the camera pose: a board in its jig, the sweep of the joints, hand-eye calibration."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class PoseSettings:
    """Thresholds of the camera's pose in the antenna frame, by jig and by sweep. σ is the robust standard deviation
    (from the median) of the corners' residuals."""

    # a board in its jig
    same_start_rad: float = 0.02  # turn between two closed-form poses, below which they are one start
    same_pose_rad: float = 1e-3  # turn between two refined poses, below which they are one
    moved_px: float = 2.0  # median distance of a picture's corners from their medians, above which the board moved
    gross_corner: float = 20.0  # distance of an outlying corner in σ, least
    gross_corner_px: float = 0.5  # distance of an outlying corner, least
    ambiguous: float = 1.2  # ratio of the errors of a plane's second pose and its first, below which it may be either
    corner_bias_px: float = 0.02  # common offset of corners, by edges, from centrelines: 0.015 px in rendered pictures
    contradiction: float = 1e-4  # p-value below which two estimates of one pose contradict each other

    # robust fit of a sweep
    soft: float = 1.5  # distance in σ from which a corner counts less, soft L1
    reweightings: int = 15  # of the corners, most
    weights_change: float = 1e-2  # largest change of a weight with which they end
    rounding_px: float = 1e-7  # least noise of a corner
    outlier: float = 6.4  # distance of an outlying corner in σ, least: one good corner in 1e9 lies further off
    outlier_px: float = 0.25  # distance of an outlying corner, least
    outlier_rounds: int = 6  # of leaving out corners, most
    ratio_powers: tuple[float, float] = (-2.0, 12.0)  # of ten, between which the variance of the angles is sought
    ratio_rounds: int = 6  # of estimating that variance, most
    ratio_change: float = 1e-4  # relative change of that variance with which they end

    # which pictures of a sweep agree
    fewest_pictures: int = 5  # four do not determine the readings' scatter: at 0.3 mrad 14 of 120 were off by 6 σ
    least_turn_rad: float = 0.01  # range of a joint's readings, below which it did not move
    gross_picture: float = 5.0  # median error of an outlying picture over the median of all, least
    gross_picture_px: float = 0.5  # median error of an outlying picture, least
    gross_angle: float = 5.0  # error of a picture's own angles in their scatter, up to which it is taken back
    picture_rounds: int = 6  # of leaving out pictures, and of taking them back, most
    few_pictures: int = 8  # of so few one wrong row bends the fit, and each in turn is left out
    wrong_row_rad: float = 5e-3  # scatter of the angles from which a row may be wrong: joints at rest scatter less
    agreement: float = 0.1  # scatter of the angles without a row over that with it, below which that row is wrong
    own_steps: int = 20  # of Gauss–Newton for the angles that one picture shows
    own_step_rad: float = 0.2  # longest of them
    own_fit_px: float = 5.0  # median error of the corners above which no angles fit the picture
    explained: float = 0.6  # share of the pictures that must agree

    # the joints' axes, and what is refused
    axis_skew_std_rad: float = 5e-3  # prior of the axes' skew about the stated one: a careful workshop's
    axis_offset_std_m: float = 5e-4  # the same of the offset: if fixed, 0.3 mrad and 0.02 mm shift the camera by 7 σ
    axes_contradicted: float = 0.05  # p-value below which the pictures contradict that prior, and it is left out
    loose_rad: float = 0.02  # standard deviation of the camera's turn that is refused
    loose_share: float = 0.05  # standard deviation of its place, over the board's distance, that is refused
    loose_angles_rad: float = 0.02  # scatter of the angles that is refused


@dataclass(frozen=True)
class HandEyeSettings:
    """Thresholds of hand-eye calibration. σ is the robust standard deviation (from the median) of the corners'
    residuals; the misfit of an initial value is the distance of the board's points from where the robot's pose puts
    them."""

    # corners of a view
    fewest_corners: int = 6  # of a view that is used
    outlier: float = 6.4  # distance of an outlying corner in σ, least: one good corner in 1e9 lies further off
    outlier_px: float = 0.25  # distance of an outlying corner, least
    second_pose: float = 3.0  # error of a plane's second pose over the first's, up to which it may be the right one
    same_pose_rad: float = 1e-2  # turn between two poses below which they are one
    soft: float = 1.5  # distance in σ from which a corner counts less, soft L1
    rounding_px: float = 1e-6  # least noise of a corner
    point_share: float = 0.1  # size of the artificial board for a measured pose, over its distance
    least_size_m: float = 1e-3  # size of that artificial board, least

    # start: consensus of most views
    absolute_rounds: int = 20  # of reweighting for the least sum of distances
    sharp_rad: float = 0.01  # misfit of turns below which views count alike
    sharp_m: float = 1e-3  # misfit of places below which views count alike
    good_share: float = 0.6  # of the views that a start must explain; others may be wrong
    fewest_good: int = 4  # views that a start must explain
    subsets: int = 40  # random subsets of views that are tried
    few_subsets: int = 10  # the same for another reading of the rows
    subset: int = 4  # views in each
    concentrations: int = 3  # rounds in which a start is fitted anew to its best views
    well_explained: float = 0.002  # misfit over the board's distance, below which the poses are of these views
    explained: float = 0.05  # misfit over the board's distance, above which they are not
    far_better: float = 4.0  # ratio of misfits from which the rows are read in another way
    better_of_few: float = 12.0  # the same with few views
    few: int = 5  # number of views below which they are few

    # which views agree
    fewest_views: int = 3
    least_turn_rad: float = 0.02  # rms turn of the hand about an axis, below which it did not turn
    outlier_chance: float = 1e-5  # p-value of a view that the others contradict
    outlier_rounds: int = 8  # of leaving out views, most
    few_to_judge: int = 8  # of fewer views it hardly shows which are wrong
    many: float = 0.2  # share of contradicting views that is warned of
    loose_rad: float = 0.02  # standard deviation of the camera's turn that is refused
    loose_share: float = 0.05  # standard deviation of its place, over the board's distance, that is refused
    turned_well_deg: float = 10.0  # rms turn about the second axis above which more turning is not the remedy
    scale_significant: float = 3.3  # difference of the board's scale, in standard deviations, that is warned of

    # variances of the robot's errors
    variance_rounds: int = 8  # of estimating them, most
    variance_change: float = 1e-3  # change of a deviation's logarithm with which they end
    std_starts: tuple[float, ...] = (1e-5, 1e-4, 1e-3, 1e-2)  # deviations of turns, rad, and shifts, m, first tried
    std_step: float = 0.05  # of a deviation's logarithm, in finite differences
    fewest_freedom: float = 3.0  # degrees of freedom of the covariance, least
    freedom_power: float = 1.5  # 1 where each direction has its own variance, 2 where all have the same part of each

    # tables
    unit_quaternion: float = 0.02  # difference of a quaternion's length from 1 that is refused
    largest: float = 1e4  # number that is refused, in whatever unit
