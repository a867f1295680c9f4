"""What decides between lens models, which views contradict the others, and how far a lens counts as linear."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class LensSettings:
    """Thresholds of a lens calibration.

    The first decide between lens models: costs are ratios of held-out errors up to which a lens that is better
    otherwise is taken. The next say when a view contradicts the others, and how many may; the last how far a step of
    the lens counts as linear.
    """

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
    view_noise: float = 5.0  # times that of the median view; corners of blurred views have no more room either
    least_px: float = 0.25  # noise, rms of a corner, that is never too much
    fewest_views: int = 6  # of fewer, those that are right are not known
    solved_without: int = 9  # views at most of which each in turn is left out: so few bend the lens to fit a wrong one
    halved: float = 0.5  # of the rms of all views, without the one that is wrong
    unchanged: float = 0.75  # of the rms of all views, without any other
    most_left_out: float = 0.15  # of the views, but one at least; if more contradict, they are no outliers
    changed_by: float = 3e-3  # of the focal length, relative, of views at the beginning or the end that agree
    shares: tuple[float, ...] = (1.0, 0.3, 0.1, 0.03, 0.01, 3e-3, 1e-3)  # of a standard deviation, tried in turn
    bend: float = 0.3  # part of a linear displacement of the picture by which the true one may differ from it, at most
    negligible_px: float = 0.02  # rms over the picture below which a difference does not count
    grid: tuple[int, int] = (9, 7)  # columns and rows of the pixels that are compared
