"""How well EI is known by the loads so far, and which weight to hang where next."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vbaa_calib.calibrate.antenna.bundle_adjustment import BundleAdjustment
from vbaa_calib.calibrate.antenna.problem import GAIN
from vbaa_calib.geometry import Kinematics
from vbaa_calib.session import Load, Session

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
    """The load to hang next: joints, distance and force to note, EI's deviations after it, and what a person does."""

    load: Load
    after: StiffnessStd
    words: str


@dataclass(frozen=True, eq=False)
class LoadProgress:
    """How well EI is known.

    now : EI's deviations. suggestion : what to hang next; None where no weight helps.
    enough : the goal is met, or no further load of these weights brings it nearer. reached : the goal is met.
    missing : what the loads do not show, in words.
    """

    now: StiffnessStd
    suggestion: LoadSuggestion | None
    enough: bool
    reached: bool
    missing: tuple[str, ...]
    words: str


def load_progress(
    joint: BundleAdjustment,
    session: Session,
    masses_kg: Sequence[float],
    kinematics: Kinematics,
    goal_relative: float = 0.01,
) -> LoadProgress:
    """The uncertainty of EI by the stills so far, and the load that lowers it most.

    joint : of the stills so far, with or without loads.
    masses_kg : the weights at hand, positive. One that is used twice counts with the same error.
    kinematics : with the joints' zeros by a sweep.
    goal_relative : standard deviation of EI to reach, places and weights included.
    """
    candidates = load_candidates(joint, session, kinematics, masses_kg)
    forecast = StiffnessForecast.of(joint, candidates, joint.problem.prior.readings)
    now, after = forecast.now(), [std.total for std in forecast.after_each()]
    kept = zip(joint.noted, joint.kept, strict=True)
    hung = [one.still for one, inside in kept if inside and isinstance(one.still, Load)]
    gain_std = float(np.sqrt(joint.covariance[GAIN, GAIN]) / max(abs(joint.parameters[GAIN]), 1e-9))
    # a load that shows the gain comes first where the gain is not known, if any can
    showing_gain = [index for index, one in enumerate(candidates) if abs(one.pull.direction[1]) > _OUT_OF_PLANE]
    gain_open = gain_std > _GAIN_STD and bool(showing_gain)
    best = min(showing_gain if gain_open else range(len(candidates)), key=lambda index: after[index], default=None)
    reachable = _reachable(forecast)
    reached, helps = now.total <= goal_relative, reachable < (1 - _LEAST_GAIN) * now.total
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
    missing = _missing(hung, gain_std, pulls(session, kinematics, joint.problem.observations))
    return LoadProgress(now, suggestion, enough, reached, missing, words)


def _reachable(forecast: StiffnessForecast) -> float:
    """EI's relative standard deviation after the best few further loads; NaN without any."""
    reachable = np.inf if len(forecast.added) else np.nan
    for _ in range(_AHEAD if len(forecast.added) else 0):
        forecast = forecast.after(int(np.argmin([std.total for std in forecast.after_each()])))
        reachable = min(reachable, forecast.now().total)
    return reachable


def _suggestion(one: LoadCandidate, after: StiffnessStd) -> LoadSuggestion:
    load, direction = one.load, one.pull.direction
    axis = int(np.argmax(np.abs(direction)))
    pulling = f"over a pulley, pulling to {_AXES[axis, int(np.sign(direction[axis]))]}"
    words = (
        f"hang {1e3 * one.mass_kg:.4g} g at {1e3 * load.distance_m:.0f} mm from the clamp, "
        f"{pulling if one.pull.over_pulley else 'straight down'} (pan {np.rad2deg(load.pan_rad):.0f}°, tilt "
        f"{np.rad2deg(load.tilt_rad):.0f}°): EI to ± {_percent(after.total)}"
    )
    return LoadSuggestion(load, after, words)


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
    if now.noise > np.hypot(now.distance, now.mass):
        return "the pictures: a heavier weight bends the antenna more"
    if now.distance > now.mass:
        return "the places: measure them from the clamp with a calliper"
    return "the weights: weigh them on a better balance"


def _percent(part: float) -> str:
    return f"{100 * part:.2g} %"
