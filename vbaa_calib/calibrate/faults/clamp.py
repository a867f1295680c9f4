"""A clamp that slips, or an antenna that bends, between two stills; a bow beyond the ordinary; a soft clamp."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vbaa_calib.antenna.shape import PARAMETERS
from vbaa_calib.calibrate.antenna.bundle_adjustment import BundleAdjustment
from vbaa_calib.calibrate.antenna.problem import ANTENNA
from vbaa_calib.core.errors import Diagnosis
from vbaa_calib.session import Load

from .fit_quality import fits, scatter_with_change
from .linearized import Further, StillRows

_USUAL = 3.0
"""A bow is reported beyond so many standard deviations of a careful builder's wire."""
_LEAST_CHI_SQUARE = 50.0
"""A change between stills above this is no chance, however many places were tried."""
_LEAST = {"turn": 4e-3, "place": 3e-4, "bow": 0.04}
"""Least changes that are reported, rad, m and per m: a millimetre at the tip of 240 mm. Half a millimetre on the ruler
and half a per cent on the balance look like a quarter of that."""
_MOST = {"turn": 0.15, "place": 5e-3, "bow": 1.5}
"""Beyond these, rows are wrong, or gravity."""
_PRIOR_STD = {"turn": 0.05, "place": 1e-3, "bow": 0.3}
_CLEARER = 1.5
"""Ratio of χ² of a slip and of a bend from which only one of the two is named."""
_CLEAR_STD = 4.0
_GIVE_STD = 3.0
_KINDS = {
    "turn": ("clamp_about_y_rad", "clamp_about_z_rad"),
    "place": ("clamp_y_m", "clamp_z_m"),
    "bow": ("bow_about_y_per_m", "bow_about_z_per_m"),
}
_UNITS = {"turn": ("° about", np.rad2deg(1.0)), "place": (" mm along", 1e3), "bow": (" per m about", 1.0)}


def _indices(kind: str) -> list[int]:
    """Of a kind's parameters in the joint solve."""
    return [ANTENNA.start + PARAMETERS.index(name) for name in _KINDS[kind]]


def bow_diagnosis(joint: BundleAdjustment) -> Diagnosis | None:
    """A bow beyond the ordinary."""
    length, which = joint.problem.length_m, _indices("bow")
    found = Further(joint.parameters[which], joint.covariance[np.ix_(which, which)])
    bow, prior = found.values, joint.problem.prior.std[np.array(which) - ANTENNA.start]
    if not (np.abs(bow) > _USUAL * np.maximum(prior, found.std)).any():
        return None
    return Diagnosis(
        "antenna_bent",
        f"the free antenna is bowed by {_words('bow', found)}: "
        f"{0.5e3 * float(np.linalg.norm(bow)) * length**2:.0f} mm at the tip of {1e3 * length:.0f} mm",
        "straighten or replace the wire, or set it with its bow in plane C, and check gravity_world",
    )


@dataclass(frozen=True, eq=False)
class _Step:
    """A lasting change of a kind, from the still `first` on; `after` are the stills after it, in time."""

    kind: str
    first: int
    found: Further
    after: tuple[int, ...]


def _steps(rows: StillRows) -> list[_Step]:
    """For each kind the change, at the place in time, that explains most; stills without times count in order."""
    times = [one.still.time_s for one in rows.joint.noted]
    whole = list(range(len(times)))
    if not any(time is None for time in times):
        whole = np.argsort(np.array(times, float), kind="stable").tolist()
    order = [index for index in whole if rows.moments[index] >= 0]
    best = []
    for kind in _KINDS:
        columns = rows.solution.jacobian[:, _indices(kind)]
        found = []
        for split in range(1, len(order)):
            change = rows.further(np.where(rows.of_stills(order[split:])[:, None], columns, 0.0), _PRIOR_STD[kind])
            if change is not None:
                found.append(_Step(kind, order[split], change, tuple(whole[whole.index(order[split]) :])))
        if found:
            best.append(max(found, key=lambda step: step.found.chi_square))
    return best


def step_diagnosis(joint: BundleAdjustment, rows: StillRows, own_scatter: float) -> Diagnosis | None:
    """A slip of the clamp or a bend of the antenna between two stills, whichever explains the pictures better.

    own_scatter : of the points, see `picture_scatter`. None where neither explains all of the residuals.
    """
    found = sorted(_steps(rows), key=lambda step: step.found.chi_square, reverse=True)
    if not found or found[0].found.chi_square < _LEAST_CHI_SQUARE:
        return None
    best = found[0]
    if not _LEAST[best.kind] <= float(np.linalg.norm(best.found.values)) <= _MOST[best.kind]:
        return None
    if fits(joint.noise_scale, own_scatter) and not (np.abs(best.found.values) > _CLEAR_STD * best.found.std).any():
        # the stills fit as they are: only a change that is clear in itself is one
        return None
    scatter = scatter_with_change(joint, _indices(best.kind), best.after, _PRIOR_STD[best.kind])
    if not fits(scatter, own_scatter):
        return None
    rivals = [step for step in found[1:] if step.found.chi_square * _CLEARER > best.found.chi_square]
    still = joint.noted[best.first].still
    kind = "load" if isinstance(still, Load) else "no-load frame"
    named = f"{kind} {still.image.name}" if still.image else f"a {kind} at tilt {np.rad2deg(still.tilt_rad):.0f}°"
    since = f"from {named} on"
    if best.kind == "bow" and not rivals:
        return Diagnosis(
            "antenna_bent_between",
            f"the antenna is bent by {_words(best.kind, best.found)} more {since} than before",
            "a load has bent it for good: straighten or replace the wire, then take no-load frames and loads anew, "
            "with lighter loads",
            grave=True,
        )
    slip = next((step for step in found if step.kind != "bow"), best)
    other = ", or the antenna was bent" if any(step.kind == "bow" for step in (*rivals, best)) else ""
    moved = "moved" if slip.kind == "place" else "turned"
    return Diagnosis(
        "clamp_slipped_or_antenna_bent" if other else "clamp_slipped",
        f"the clamp has {moved} by {_words(slip.kind, slip.found)} {since}, which the loads do not explain{other}",
        "tighten the clamp, then take no-load frames and loads anew",
        grave=True,
    )


def soft_clamp(rows: StillRows) -> Diagnosis | None:
    """A clamp that turns elastically, by more than one that is screwed tight does."""
    index = ANTENNA.start + PARAMETERS.index("clamp_give_m")
    parameters, covariance = rows.estimate()
    value, std = float(parameters[index]), float(np.sqrt(covariance[index, index]))
    usual = float(rows.joint.problem.prior.std[index - ANTENNA.start])
    if value < _GIVE_STD * max(usual, std):
        return None
    return Diagnosis(
        "clamp_soft",
        f"the clamp turns with the load as {1e3 * value:.2f} ± {1e3 * std:.2f} mm more of the antenna would, a tight "
        f"one by {1e3 * usual:.1f} mm at most",
        "clamp it over a longer piece, between metal, and check where the distances are measured from",
    )


def _words(kind: str, found: Further) -> str:
    unit, factor = _UNITS[kind]
    (y, z), (y_std, z_std) = factor * found.values, factor * found.std
    return f"{y:.2f} ± {y_std:.2f}{unit} y and {z:.2f} ± {z_std:.2f}{unit} z"
