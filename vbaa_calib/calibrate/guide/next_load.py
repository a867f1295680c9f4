"""How well EI is known by the loads so far, and which weight to hang where next."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vbaa_calib.calibrate.antenna.bundle_adjustment import BundleAdjustment
from vbaa_calib.calibrate.antenna.problem import GAIN
from vbaa_calib.geometry import Kinematics
from vbaa_calib.session import Load, LoadReadings, Session

from .load_candidates import LoadCandidate, Pull, load_candidates, pulls
from .load_uncertainty import StiffnessForecast, StiffnessStd

_AXES = {(0, 1): "+y", (0, -1): "−y", (1, 1): "+z", (1, -1): "−z"}
_ALONG = 0.5
"""Part of a force along an axis from which the load counts as one along it."""
_LEAST_LOADS = 3
"""A wrong row shows against two others."""
_GAIN_STD = 0.02
"""Standard deviation of the moment sensor's gain that is good enough; loads in plane C do not show it."""
_OUT_OF_PLANE = 0.5
"""Part of a pull along z from which on it shows that gain."""
_LEAST_GAIN = 0.05
"""A load is suggested if it lowers EI's standard deviation by more than this part."""
_AHEAD = 6
"""Number of further loads in the forecast."""


@dataclass(frozen=True, eq=False)
class LoadSuggestion:
    """The load to hang next.

    Attributes
    ----------
    load : joints, distance and force to note. mass_kg : which weight. over_pulley : it does not hang straight down.
    std_relative, std_relative_with_readings : of EI after it, see `LoadProgress`.
    """

    load: Load
    mass_kg: float
    over_pulley: bool
    std_relative: float
    std_relative_with_readings: float
    words: str


@dataclass(frozen=True, eq=False)
class LoadProgress:
    """How well EI is known.

    Attributes
    ----------
    std_relative : of EI by the pictures' noise, the loads being exact.
    systematic : of EI by places and weights. std_relative_with_readings : by everything.
    reachable_relative : by everything, after the best few loads of these weights; NaN without any.
    loads : how many took part.
    suggestion : what to hang next; None where no weight helps.
    enough : the goal is met, or no further load of these weights brings it nearer. reached : the goal is met.
    missing : what the loads do not show, in words.
    """

    std_relative: float
    systematic: float
    std_relative_with_readings: float
    goal_relative: float
    reachable_relative: float
    loads: int
    suggestion: LoadSuggestion | None
    enough: bool
    reached: bool
    missing: tuple[str, ...]
    words: str


def load_progress(
    joint: BundleAdjustment,
    session: Session,
    masses_kg: Sequence[float],
    goal_relative: float = 0.01,
    kinematics: Kinematics | None = None,
    readings: LoadReadings | None = None,
) -> LoadProgress:
    """The uncertainty of EI by the stills so far, and the load that lowers it most.

    Parameters
    ----------
    joint : of the stills so far, with or without loads.
    masses_kg : the weights at hand. One that is used twice counts with the same error.
    goal_relative : standard deviation of EI to reach, places and weights included.
    kinematics : with the joints' zeros by a sweep; the session's where it is not given.
    readings : how well places and weights are known, where the joint solve took them as exact: their errors then go
        into EI in full. None: as in the joint solve, which weighs the loads by it.

    Raises ValueError for a weight or a standard deviation that is not positive.
    """
    assumed = joint.problem.prior.readings if readings is None else readings
    if (
        min([*masses_kg, goal_relative], default=1.0) <= 0
        or min(assumed.distance_std_m, assumed.force_std_relative) < 0
    ):
        raise ValueError("weights and goal must be positive, and deviations not negative")
    kinematics = session.kinematics if kinematics is None else kinematics
    candidates = load_candidates(joint, session, kinematics, masses_kg)
    # the best load is chosen for a solve that weighs the loads, whatever the present one does
    best_case = StiffnessForecast.of(joint, candidates, assumed, weighed=True)
    forecast = best_case if readings is None else StiffnessForecast.of(joint, candidates, assumed)
    now = forecast.now()
    hung = [
        one.still for one, kept in zip(joint.noted, joint.kept, strict=True) if kept and isinstance(one.still, Load)
    ]
    gain_std = float(np.sqrt(joint.covariance[GAIN, GAIN]) / max(abs(joint.parameters[GAIN]), 1e-9))
    # a load that shows the gain comes first where the gain is not known, if any can
    showing_gain = [index for index, one in enumerate(candidates) if abs(one.pull.direction[1]) > _OUT_OF_PLANE]
    gain_open = gain_std > _GAIN_STD and bool(showing_gain)
    after = [std.total for std in best_case.after_each()]
    best = min(showing_gain if gain_open else range(len(candidates)), key=lambda index: after[index], default=None)
    reachable, best_reachable = _reachable(best_case, forecast)
    reached = now.total <= goal_relative
    helps = best is not None and best_reachable < (1 - _LEAST_GAIN) * best_case.now().total
    enough = len(hung) >= _LEAST_LOADS and not gain_open and (reached or not helps)
    suggestion = None
    if best is not None and (not enough or helps):
        suggestion = _suggestion(candidates[best], forecast.after(best).now())
    words = (
        f"EI is known to ± {_percent(now.total)} (pictures {_percent(now.noise)}, places {_percent(now.distance)}, "
        f"weights {_percent(now.mass)}); the goal is {_percent(goal_relative)}"
    )
    if enough and reached:
        words += ": enough, more is not needed"
    elif enough:
        words += f": more of these loads will not help. What limits it is {_limit(now)}"
    elif not masses_kg:
        words += ": name the weights at hand"
    elif suggestion is None:
        words += ": none of these weights fits: each bends the antenna too far, or out of the picture"
    elif not reached and not reachable <= goal_relative:
        words += f": the best few loads of these weights lead to {_percent(reachable)}. What limits it is {_limit(now)}"
    return LoadProgress(
        std_relative=now.noise,
        systematic=now.readings,
        std_relative_with_readings=now.total,
        goal_relative=goal_relative,
        reachable_relative=reachable,
        loads=len(hung),
        suggestion=suggestion,
        enough=enough,
        reached=reached,
        missing=_missing(hung, gain_std, pulls(session, kinematics, joint.problem.observations)),
        words=words,
    )


def _reachable(best_case: StiffnessForecast, forecast: StiffnessForecast) -> tuple[float, float]:
    """EI's relative standard deviation after the best few further loads, by `forecast` and at best; NaN without any."""
    if not len(best_case.added):
        return np.nan, np.nan
    reachable, best_reachable = np.inf, np.inf
    for _ in range(_AHEAD):
        index = int(np.argmin([std.total for std in best_case.after_each()]))
        best_case, forecast = best_case.after(index), forecast.after(index)
        reachable, best_reachable = min(reachable, forecast.now().total), min(best_reachable, best_case.now().total)
    return reachable, best_reachable


def _suggestion(one: LoadCandidate, after: StiffnessStd) -> LoadSuggestion:
    load, direction = one.load, one.pull.direction
    axis = int(np.argmax(np.abs(direction)))
    pulling = f"over a pulley, pulling to {_AXES[axis, int(np.sign(direction[axis]))]}"
    words = (
        f"hang {1e3 * one.mass_kg:.4g} g at {1e3 * load.distance_m:.0f} mm from the clamp, "
        f"{pulling if one.pull.over_pulley else 'straight down'} (pan {np.rad2deg(load.pan_rad):.0f}°, tilt "
        f"{np.rad2deg(load.tilt_rad):.0f}°): EI to ± {_percent(after.total)}"
    )
    return LoadSuggestion(load, one.mass_kg, one.pull.over_pulley, after.noise, after.total, words)


def _missing(hung: Sequence[Load], gain_std: float, possible: Sequence[Pull]) -> tuple[str, ...]:
    """What the loads so far do not show."""
    found = []
    if len(hung) < _LEAST_LOADS:
        found.append(f"{len(hung)} of {_LEAST_LOADS} loads: a wrong row shows only against two others")
    forces = np.array([[load.force_y_N, load.force_z_N] for load in hung]).reshape(-1, 2)
    size = np.linalg.norm(forces, axis=1)
    for axis, name in enumerate("yz"):
        if not hung or (np.abs(forces[:, axis]) > _ALONG * size).any():
            continue
        how = f"it takes a thread over a pulley along {name}, or an antenna rolled by a quarter turn"
        if any(abs(pull.direction[axis]) > _ALONG for pull in possible):
            how = "hang one so"
        found.append(f"no load along {name}: equal compliance (assumption 4) is not tested; {how}")
    if hung and gain_std > _GAIN_STD:
        found.append(f"the moment sensor's gain is known to ± {_percent(gain_std)} only: it needs a load along z")
    return tuple(found)


def _limit(now: StiffnessStd) -> str:
    """The largest part of EI's uncertainty, and what would lower it."""
    if now.noise > now.readings:
        return "the pictures: a heavier weight bends the antenna more"
    if now.distance > now.mass:
        return "the places: measure them from the clamp with a calliper"
    return "the weights: weigh them on a better balance"


def _percent(part: float) -> str:
    return f"{100 * part:.2g} %"
