"""How well EI is known by the loads so far, and which weight to hang where next."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vbaa_calib.calibrate.antenna.bundle_adjustment import BundleAdjustment
from vbaa_calib.calibrate.antenna.problem import GAIN
from vbaa_calib.geometry import Kinematics
from vbaa_calib.session import Load, LoadReadings, Session

from .load_candidates import Candidate, Pull, candidates, pulls
from .load_uncertainty import Planner, StiffnessErrors

AXES = {(0, 1): "+y", (0, -1): "−y", (1, 1): "+z", (1, -1): "−z"}
ALONG = 0.5
"""Part of a force that must lie along an axis for the load to count as one along it."""


def percent(part: float) -> str:
    """Two digits of a relative standard deviation."""
    return f"{100 * part:.2g} %"


def _axis_name(direction: np.ndarray) -> str:
    """The axis (y or z, with its sign) that a direction (2,) is nearest to."""
    axis = int(np.argmax(np.abs(direction)))
    return AXES[axis, int(np.sign(direction[axis]))]


def _suggestion_words(one: Candidate, after: StiffnessErrors) -> str:
    """What to hang, where, and what it brings."""
    how = f"over a pulley, pulling to {_axis_name(one.direction)}" if one.over_pulley else "straight down"
    at = f"pan {np.rad2deg(one.load.pan_rad):.0f}°, tilt {np.rad2deg(one.load.tilt_rad):.0f}°"
    return (
        f"hang {1e3 * one.mass_kg:.4g} g at {1e3 * one.load.distance_m:.0f} mm from the clamp, {how} ({at}): "
        f"EI to ± {percent(after.whole)}"
    )


def _missing_words(
    hung: Sequence[Load], gain_std: float, gain_known: float, least_loads: int, at_hand: Sequence[Pull]
) -> tuple[str, ...]:
    """What the loads so far do not show."""
    found = []
    if len(hung) < least_loads:
        found.append(f"{len(hung)} of {least_loads} loads: a row noted wrong shows only against two others")
    forces = np.array([[load.force_y_N, load.force_z_N] for load in hung]).reshape(-1, 2)
    size = np.linalg.norm(forces, axis=1)
    for axis, name in enumerate("yz"):
        if not hung or (np.abs(forces[:, axis]) > ALONG * size).any():
            continue
        sides = [pull for pull in at_hand if abs(pull.direction[axis]) > ALONG]
        how = "hang one so"
        if not sides:
            how = f"it takes a thread over a pulley along {name}, or an antenna rolled by a quarter turn"
        found.append(f"no load along {name}: equal compliance (assumption 4) is not tested; {how}")
    if hung and gain_std > gain_known:
        found.append(
            f"the moment sensor's gain is known to ± {percent(gain_std)} only: it needs a load that pulls along z"
        )
    return tuple(found)


def _progress_words(
    now: StiffnessErrors,
    goal: float,
    reachable: float,
    enough: bool,
    reached: bool,
    has_suggestion: bool,
    has_weights: bool,
) -> str:
    """Where EI stands."""
    words = (
        f"EI is known to ± {percent(now.whole)} (pictures {percent(now.noise)}, places {percent(now.distance)}, "
        f"weights {percent(now.mass)}); the goal is {percent(goal)}"
    )
    if enough and reached:
        return f"{words}: enough, more is not needed"
    limit = (
        "the places: measure them from the clamp with a calliper"
        if now.distance > now.mass
        else ("the weights: weigh them on a better balance")
    )
    if now.noise > now.readings:
        limit = "the pictures: a heavier weight bends the antenna more"
    if enough:
        return f"{words}: more of these loads will not help. What limits it is {limit}"
    if not has_weights:
        return f"{words}: name the weights at hand"
    if not has_suggestion:
        return f"{words}: none of these weights fits: each bends the antenna too far, or out of the picture"
    if not reached and not reachable <= goal:
        return f"{words}: the best few loads of these weights lead to {percent(reachable)}. What limits it is {limit}"
    return words


LEAST_LOADS = 3
"""A load that was noted wrong is seen against two others."""
GAIN_KNOWN = 0.02
"""Standard deviation of the moment sensor's gain that is good enough; loads in plane C do not show it."""
OUT_OF_PLANE = 0.5
"""Part of a pull along z from which on it shows that gain."""
HELPS = 0.05
"""A load is worth hanging when it lowers EI's standard deviation by more than this part."""
AHEAD = 6
"""How many further loads are looked ahead."""


@dataclass(frozen=True, eq=False)
class LoadSuggestion:
    """The load to hang next.

    Attributes
    ----------
    mass_kg, distance_m : which weight, and where along the antenna from the clamp.
    pan_rad, tilt_rad : where the joints stand meanwhile.
    direction : (2,) unit (y, z) of its pull in the antenna frame. over_pulley : it does not hang straight down.
    force_y_N, force_z_N : what to note.
    std_relative, std_relative_with_readings : of EI after it, see `LoadProgress`.
    """

    mass_kg: float
    distance_m: float
    pan_rad: float
    tilt_rad: float
    direction: np.ndarray
    over_pulley: bool
    force_y_N: float
    force_z_N: float
    std_relative: float
    std_relative_with_readings: float
    words: str


@dataclass(frozen=True, eq=False)
class LoadProgress:
    """How well EI is known.

    Attributes
    ----------
    std_relative : of EI by the pictures' noise, as the joint solve has it: the loads count as exact.
    systematic : of EI by the readings of places and weights. std_relative_with_readings : by everything.
    reachable_relative : by everything, after the best few loads that these weights allow; NaN without any.
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
    """What the stills so far say of EI, and the load that lowers its uncertainty most.

    Parameters
    ----------
    joint : of the stills so far, with or without loads.
    masses_kg : the weights at hand. One that is used twice counts with the same error.
    goal_relative : standard deviation of EI to reach, with the readings' errors.
    kinematics : with what a sweep found of the joints; the session's where it is not given.
    readings : how well places and weights are known, where the joint solve took them as exact: what they are off by
        then goes into EI in full. None: as the joint solve has them, and weighs the loads by it.

    Raises ValueError for a weight or a standard deviation that is not positive.
    """
    weighed = readings is None
    known = joint.problem.prior.readings if readings is None else readings
    if min([*masses_kg, goal_relative], default=1.0) <= 0 or min(known.distance_std_m, known.force_std_relative) < 0:
        raise ValueError("weights and goal must be positive, and deviations not negative")
    kinematics = session.kinematics if kinematics is None else kinematics
    offered = candidates(joint, session, kinematics, masses_kg)
    # which load says most is one question, what the solve at hand makes of it another
    best_use = Planner.of(joint, offered, known, weighed=True)
    planner = best_use if weighed else best_use.unweighed()
    now = planner.now()
    hung = [
        one.still for one, kept in zip(joint.noted, joint.kept, strict=True) if kept and isinstance(one.still, Load)
    ]
    gain_std = float(np.sqrt(joint.covariance[GAIN, GAIN]) / max(abs(joint.parameters[GAIN]), 1e-9))
    # a load that shows the gain comes first where the gain is not known, if any can
    wanted = [index for index, one in enumerate(offered) if gain_std <= GAIN_KNOWN or _shows_gain(one)]
    wanted = wanted or list(range(len(offered)))
    worth = [errors.whole for errors in best_use.after_each()]
    best = min(wanted, key=lambda index: worth[index]) if wanted else None
    ahead, ahead_at_best = _reachable(best_use, planner)
    few, blind = len(hung) < LEAST_LOADS, gain_std > GAIN_KNOWN and any(map(_shows_gain, offered))
    reached = now.whole <= goal_relative
    helps = best is not None and ahead_at_best < (1 - HELPS) * best_use.now().whole
    enough = not few and not blind and (reached or not helps)
    suggestion = None
    if best is not None and (not enough or helps):
        suggestion = suggested(offered[best], planner.after(best).now())
    missing = _missing_words(
        hung, gain_std, GAIN_KNOWN, LEAST_LOADS, pulls(session, kinematics, joint.problem.observations)
    )
    return LoadProgress(
        std_relative=now.noise,
        systematic=now.readings,
        std_relative_with_readings=now.whole,
        goal_relative=goal_relative,
        reachable_relative=ahead,
        loads=len(hung),
        suggestion=suggestion,
        enough=enough,
        reached=reached,
        missing=missing,
        words=_progress_words(now, goal_relative, ahead, enough, reached, suggestion is not None, bool(masses_kg)),
    )


def _shows_gain(one: Candidate) -> bool:
    """Whether a load pulls far enough out of plane C for the moment sensor to feel it."""
    return bool(abs(one.direction[1]) > OUT_OF_PLANE)


def _reachable(best_use: Planner, planner: Planner) -> tuple[float, float]:
    """EI's relative standard deviation after the best few further loads, one by one; NaN without any.

    As the solve at hand has it (`planner`), and at best.
    """
    if not len(best_use.added):
        return np.nan, np.nan
    lowest, lowest_at_best = np.inf, np.inf
    for _ in range(AHEAD):
        index = int(np.argmin([errors.whole for errors in best_use.after_each()]))
        best_use, planner = best_use.after(index), planner.after(index)
        lowest, lowest_at_best = min(lowest, planner.now().whole), min(lowest_at_best, best_use.now().whole)
    return lowest, lowest_at_best


def suggested(one: Candidate, after: StiffnessErrors) -> LoadSuggestion:
    """A candidate, in words."""
    load = one.load
    return LoadSuggestion(
        mass_kg=one.mass_kg,
        distance_m=load.distance_m,
        pan_rad=load.pan_rad,
        tilt_rad=load.tilt_rad,
        direction=one.direction,
        over_pulley=one.over_pulley,
        force_y_N=load.force_y_N,
        force_z_N=load.force_z_N,
        std_relative=after.noise,
        std_relative_with_readings=after.whole,
        words=_suggestion_words(one, after),
    )
