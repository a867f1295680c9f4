"""Which lens model is taken: the one with the least expected error, unless a simpler one is as good for all we know."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vbaa_calib.camera import Camera
from vbaa_calib.rig.rig_file import can_hold

from .information import Candidate, excess_in_errors
from .models import LENS_MODELS, pole_distance
from .settings import LensSettings
from .uncertainty import expected_errors_px


@dataclass(frozen=True, eq=False)
class Assessed:
    """A lens model's solution, as it is compared with others of the same V views."""

    candidate: Candidate
    camera: Camera  # with its covariance
    squares_px2: np.ndarray  # (V,) held-out squared errors by view
    left_out: np.ndarray  # (V, 4 + k) change of the camera's parameters without each view

    @property
    def pole_distance(self) -> float:
        """Distance of the nearest pole from the picture, as `models.pole_distance`."""
        camera = self.camera
        return pole_distance(LENS_MODELS[self.candidate.model], camera.parameters, camera.image_size)


def choose(solutions: Sequence[Assessed], corners_px: np.ndarray) -> tuple[str, tuple[Candidate, ...]]:
    """Name of the lens model to take, and the comparison; corners_px : (N, 2) of all views.

    Models with a held-out error that is larger by 0.5 % and significantly so (over views), or by 10 %, are wrong. Of
    the others the one of least expected error over the picture is taken, bias and noise together
    (`expected_errors_px`), but a simpler one, if its expected error is larger by no more than the standard error of the
    difference, from leaving out each view in turn (jackknife), and by no more than 35 %, or if views that it was not
    fitted to fit it as well. A lens without decentring must be 15 % better than opencv4, which has it.

    Models beyond the bounds of rig.json are not taken; models that fold inside the picture only if every other is 10 %
    worse on held-out views, those with halves that disagree or with a pole near the picture only if every other is
    0.5 % worse.
    """
    rules, every = LensSettings(), {one.candidate.model: one for one in solutions}
    reasons: dict[str, str] = {}

    def preferred(names: Sequence[str], good: Sequence[str], may_cost: float, why: str) -> Sequence[str]:
        """The good ones, unless all of them are too dear; why the others are passed over."""
        least = min(every[name].candidate.held_out_rms_px for name in names)
        if all(every[name].candidate.held_out_rms_px > may_cost * least for name in good):
            return names
        reasons.update({name: why for name in names if name not in good})
        return good

    sound = (
        (lambda one: can_hold(one.camera), np.inf, "has coefficients beyond the bounds of rig.json"),
        (lambda one: one.candidate.monotonic, rules.monotonic_may_cost, "folds inside the picture"),
        (lambda one: one.candidate.split_half_agrees, rules.agreement_may_cost, "differs between halves of the views"),
        (
            lambda one: one.pole_distance >= rules.least_pole_distance,
            rules.far_pole_may_cost,
            "has a pole near the picture",
        ),
    )
    names: Sequence[str] = list(every)
    for is_sound, may_cost, why in sound:
        names = preferred(names, [name for name in names if is_sound(every[name])], may_cost, why)
    best = min(names, key=lambda name: every[name].candidate.held_out_rms_px)

    def is_good(name: str) -> bool:
        ratio = every[name].candidate.held_out_rms_px / every[best].candidate.held_out_rms_px
        uncertain = excess_in_errors(every[name].squares_px2, every[best].squares_px2) <= rules.excess
        return ratio <= rules.negligible_cost or (ratio <= rules.most_cost and uncertain)

    good = [name for name in names if is_good(name)]
    names = preferred(names, good, np.inf, "misses held-out views by clearly more")
    cameras = {name: one.camera for name, one in every.items()}
    off_px = expected_errors_px(cameras, best, corners_px, {name: one.left_out for name, one in every.items()})
    expected_px, free = (
        {n: float(off_px[n][0]) for n in every},
        {n: every[n].candidate.free_parameters for n in every},
    )

    def is_no_worse(name: str, richer: str) -> bool:
        ratios = np.log(off_px[name] / off_px[richer])
        standard_error = np.sqrt((len(ratios) - 2) * np.var(ratios[1:]))
        as_small = ratios[0] <= min(rules.better_by * standard_error, np.log(rules.most_larger))
        return bool(as_small or every[name].squares_px2.sum() <= every[richer].squares_px2.sum())

    least = min(names, key=expected_px.__getitem__)
    simpler = [name for name in names if free[name] < free[least] and is_no_worse(name, least)]
    chosen = min([*simpler, least], key=lambda name: (free[name], expected_px[name]))
    # every lens is a little decentred: a model without it must be clearly better
    if chosen in ("none", "radial", "fisheye") and "opencv4" in names:
        ratio = expected_px["opencv4"] / expected_px[chosen]
        as_good = ratio <= 1.0 or "opencv4" in (*simpler, least)
        chosen = "opencv4" if as_good and ratio < rules.centred_may_cost else chosen
    for name in names:
        if name != chosen and expected_px[name] <= expected_px[chosen]:
            richer = "is richer, and better by no more than the difference's own error"
            reasons[name] = richer if free[name] > free[chosen] else "has no decentring, and is not clearly better"
    rows = [
        replace(one.candidate, expected_error_px=expected_px[name], passed_over=reasons.get(name, ""))
        for name, one in every.items()
    ]
    return chosen, tuple(rows)
