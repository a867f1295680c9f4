"""Which further observations would lower the shared error of distance, as the calibration's own solve forecasts it."""

from __future__ import annotations

from typing import Any

import numpy as np

from vbaa_calib.calibrate.antenna.problem import GAIN, OFFSET
from vbaa_calib.calibrate.guide.next_observation import further_observations
from vbaa_calib.calibrate.guide.settings import GuideSettings
from vbaa_calib.calibrate.pipeline import Calibration
from vbaa_calib.core.errors import VbaaError

from .budget import SharedError


def next_observations(made: Calibration) -> dict[str, Any]:
    """The entry `guide` of rig.json: the shared error of distance over ordinary contacts, and up to three observations
    that would lower it most, one after the other, each with the error after it; and in words. Empty for a wrong
    calibration, for several cameras, and where no contact would come with numbers.
    """
    try:
        error = None if made.rig.others or made.rig.verdict.severity == "wrong" else SharedError.of(made.rig)
        left = [] if error is None else further_observations(made)
    except VbaaError:
        # the lens folds, or the antenna has no shape: there is nothing to forecast by
        return {}
    if error is None:
        return {}

    def forecast(rows: np.ndarray) -> np.ndarray:
        found = made.joint.forecast(rows)
        if not made.session.with_sensor:
            found[GAIN : OFFSET + 1] = found[:, GAIN : OFFSET + 1] = 0.0
        return found

    rows, steps = np.zeros((0, made.joint.problem.size)), list[dict[str, Any]]()
    now = std = error.std_m(made.rig.covariance)
    while left and len(steps) < GuideSettings.steps:
        after = [forecast(np.vstack([rows, more])) for _, more in left]
        # with the contacts weighed anew the shared error may be another: only the best are tried
        best = np.argsort([error.variance_m2(each) for each in after])[: GuideSettings.tried]
        stds = [error.std_m(after[index]) for index in best]
        described, more = left[best[int(np.argmin(stds))]]
        if min(stds) > (1.0 - GuideSettings.least_load_gain) * std:
            break
        rows, std = np.vstack([rows, more]), min(stds)
        steps.append({**described, "distance_shared_std_m": std})
    return {"distance_shared_std_m": now, "next": steps, "words": _words(now, steps)}


def _words(now_m: float, steps: list[dict[str, Any]]) -> str:
    """A sentence for a person."""
    if not steps:
        least = f"{100 * GuideSettings.least_load_gain:.0f} %"
        return (
            f"No further load or picture would lower the shared error of distance, {1e3 * now_m:.2g} mm, by more than "
            f"{least}."
        )
    first, *rest = steps
    std_m = first["distance_shared_std_m"]
    halves = next((n for n, one in enumerate(steps) if one["distance_shared_std_m"] <= 0.5 * now_m), None)
    verb = "would halve" if halves == 0 else f"would take {100 * (1.0 - std_m / now_m):.0f} % off"
    words = f"{first['words']} {verb} the shared error of distance: {1e3 * now_m:.2g} → {1e3 * std_m:.2g} mm"
    words += "".join(f"; then {one['words']}: {1e3 * one['distance_shared_std_m']:.2g} mm" for one in rest)
    return words[:1].upper() + words[1:] + "."
