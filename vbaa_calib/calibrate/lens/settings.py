"""Thresholds for solving a lens, choosing its model and judging it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class LensSettings:
    """Thresholds of a lens calibration. A cost is the largest ratio of cross-validated errors at which a model that
    is preferable otherwise is taken."""

    # what a lens is solved from
    min_corners: int = 6  # fewest corners of a view
    min_views: int = 3  # fewest views
    candidates: tuple[str, ...] = (
        "none",
        "radial",
        "opencv4",
        "opencv5",
        "fisheye",
        "rational",
    )  # of auto, simple first
    screening: tuple[str, ...] = ("opencv5", "fisheye", "rational")  # rich: their residuals are noise and outliers
    rounds: int = 3  # of choosing lens model and outliers by turns, most

    # starting values
    focal_per_width: tuple[float, ...] = (0.7, 1.4, 3.0, 8.0, 0.35)  # focal lengths over the longer side, tried in turn
    divisions: tuple[float, ...] = (
        0.0,
        -0.1,
        -0.2,
        -0.35,
        -0.5,
        -0.65,
        -0.8,
        0.15,
    )  # λ of x/(1 + λr²), corner at r = 1
    start_views: int = 10  # by which starts are compared
    start_corners: int = 40  # corners of each of these views
    same_start: float = 1.05  # ratio of two starts' noise up to which they count as one
    same_start_px: float = 0.02  # further difference of two starts' noise up to which they count as one
    wrong_pose: float = 3.0  # median error of a view over that of all, from which it is posed anew
    least_ray_z: float = 0.1  # z of a ray's unit vector from which its corner helps to pose a view
    homography_samples: int = 64  # samples of four corners among which a homography is sought
    usual_noise_px: float = 0.2  # noise of a corner before it is measured
    least_noise_px: float = 1e-3  # least noise of a corner against which the board's prior is weighed

    # folding
    unfolding_slopes: tuple[float, ...] = (0.1, 0.2, 0.35)  # least slopes of the radial curve, tried in turn
    unfolding_weight: float = 1e4  # weight of the penalty on a smaller slope, over the corners' variance
    unfolding_may_cost: float = 0.01  # largest part of the squared residuals that the penalty may add
    unfolding_chance: float = 20.0  # number of parameters; what they explain by chance is allowed to the penalty, too
    radii: int = 160  # at which a radial curve is sampled
    widest_rad: float = 1.5  # angle off the axis up to which one lens is fitted to another
    nearly_real: float = 0.02  # imaginary over absolute value of a squared pole that counts as real
    before_pole: float = 0.95  # part of a pole's radius in which the curve must leave the picture

    # the board's shape: what printers and mounts do; some are ten times worse, so the prior has long tails
    bow_per_extent: float = 1e-3  # prior deviation of bow and twist over the board's extent: 0.25 mm of 250 mm
    stretch_std: float = 5e-4  # prior deviation of the ratio of a print's axes
    shear_std: float = 3e-4  # rad, prior deviation of its angle
    shape_tail: float = 3.0  # degrees of freedom of the prior, a Student's t distribution
    shape_clear: float = 4.0  # standard deviations from which a shape is reported
    shape_per_extent: float = 3e-4  # bow or twist over the board's extent from which it is reported
    shape_share: float = 1e-3  # stretch, or shear in rad, from which it is reported

    # outlying corners and noisy views
    outlier_chance: float = 1e-6  # probability that a good corner lies beyond the limit
    outlier_px: float = 0.25  # distance from which a corner may be an outlier
    outlier_rounds: int = 8  # of finding the limit, and of leaving out corners, most
    first_limit: float = 5.0  # limit from which the search begins, in median distances
    blurred: float = 5.0  # most by which a noisy view's limit may exceed the usual one
    noisier: float = 1.2  # noise over the median view's from which a view counts less
    usual_corners: int = 10  # corners of usual noise that count in addition to a view's own in its noise
    outlying: float = 3.5  # scaled median deviations above the median rms, from which a view is reported as outlying

    # held-out views, and halves of the views
    folds: int = 5  # into which views are dealt
    solved_anew: float = 1.1  # ratio of held-out to fitted squares above which each fold is solved anew
    determined: float = 1e-10  # least over largest singular value from which all parameters are determined
    left_by_poses: float = 1e-7  # part of a parameter's column that poses leave, from which it is no rounding
    halved_views: int = 6  # fewest whose halves are compared
    half_open: float = 1e6  # condition number of the shared directions from which a half does not determine the lens
    halves_agree: float = 1e-4  # p-value below which they contradict each other: so of one good set in 10,000

    # expected error over the picture
    uncertainty_grid: tuple[int, int] = (17, 13)  # columns and rows of pixels at which a lens is judged
    unseen_px: float = 1e3  # error of a pixel without a ray
    least_error_px: float = 1e-4  # error of a pixel, least
    chance_bias: float = 2.0  # times the variance of a difference that its square is reduced by, as chance adds as much

    # a known lens; its assumed deviations are those of OpenCV's solutions of two thirds of the views of four real sets
    focal_std: float = 0.003  # relative deviation of the focal length, where the file states none: they were 0.07–0.5 %
    aspect_std: float = 0.001  # relative deviation of fx/fy: they were 0.02–0.13 %
    centre_per_width: float = 0.0025  # deviation of the centre over the width: they were 0.1–0.8 %
    corner_per_width: float = 0.0008  # standard deviation of the distortion at the picture's corner: it was 0.03–0.7 %
    uncorrected_per_width: float = 0.02  # the same where all coefficients are zero: ordinary lenses have up to this
    vague_start: float = 0.05  # relative deviation of the focal length from which a lens is no start
    known_floor_px: float = 0.1  # difference from the pictures' own lens up to which nothing follows
    known_least_px: float = 0.02  # uncertainty of any two lenses' difference
    correlated: float = 2.0  # ratio of the pictures' own lens' deviations to those of independent corners

    # corners that others have found
    most_rise: float = 0.02  # largest height of a board's points along z, over its extent
    furthest_px: float = 1e6  # largest coordinate of a corner
    most_px: int = 100_000  # largest width or height of a picture

    # what is reported of a lens
    vague_focal: float = 0.02  # relative standard deviation of the focal length from which it is reported as vague
    covered: float = 0.5  # share of the cells of an 8 x 6 grid with corners below which the lens is reported
    scattered: float = 2.0  # contradictions of views over the scatter of corners from which they are reported
    most_rms_px: float = 3.0  # largest rms of a lens that may be used: beyond, corners are of other boards or cameras

    # between lens models
    monotonic_may_cost: float = 1.1  # of lenses that do not fold: one that does maps two directions to one pixel
    agreement_may_cost: float = 1.005  # of lenses whose halves agree: the others are worse than they state
    far_pole_may_cost: float = 1.005  # of lenses without a pole near the picture
    least_pole_distance: float = 0.15  # over the picture's largest ideal radius; a depth camera's own lens had 0.22
    negligible_cost: float = 1.005  # of lenses that count as good, however certain the difference is
    most_cost: float = 1.1  # of lenses that count as good, however uncertain the difference is
    excess: float = 3.0  # standard errors, over views, by which the held-out errors of a wrong model are larger
    better_by: float = 1.0  # standard errors by which the expected error of a richer model must be smaller
    most_larger: float = 1.35  # ratio of expected errors up to which a simpler model is taken, however uncertain it is
    centred_may_cost: float = 1.15  # ratio of expected errors: every lens is a little decentred

    # views that contradict the others
    view_noise: float = 5.0  # most noise of a view over the median view's; corners of blurred views have no more room
    least_px: float = 0.25  # noise, rms of a corner, that is never too much
    fewest_views: int = 6  # of fewer, those that are right are not known
    solved_without: int = 9  # most views of which each in turn is left out: so few bend the lens to fit a wrong one
    halved: float = 0.5  # rms without the wrong view over that of all, most
    unchanged: float = 0.75  # rms without any other view over that of all, least
    most_left_out: float = 0.15  # largest part of the views, but one at least; if more contradict, they are no outliers
    changed_by: float = 3e-3  # relative change of the focal length, over consistent views in order, that is reported

    # how far a step of the lens counts as linear
    shares: tuple[float, ...] = (1.0, 0.3, 0.1, 0.03, 0.01, 3e-3, 1e-3)  # steps, in standard deviations, tried in turn
    bend: float = 0.3  # part of a linear displacement of the picture by which the true one may differ from it, at most
    negligible_px: float = 0.02  # rms over the picture below which a difference does not count
    grid: tuple[int, int] = (9, 7)  # columns and rows of the pixels that are compared
