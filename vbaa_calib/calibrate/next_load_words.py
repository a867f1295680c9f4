"""Progress and suggestion of loads, in short sentences."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..session import Load
from .next_load_candidates import Candidate, Pull
from .next_load_readings import StiffnessErrors

AXES = {(0, 1): "+y", (0, -1): "−y", (1, 1): "+z", (1, -1): "−z"}
ALONG = 0.5
"""Part of a force that must lie along an axis for the load to count as one along it."""


def percent(part: float) -> str:
    """Two digits of a relative standard deviation."""
    return f"{100 * part:.2g} %"


def axis_name(direction: np.ndarray) -> str:
    """The axis (y or z, with its sign) that a direction (2,) is nearest to."""
    axis = int(np.argmax(np.abs(direction)))
    return AXES[axis, int(np.sign(direction[axis]))]


def suggestion_words(one: Candidate, after: StiffnessErrors) -> str:
    """What to hang, where, and what it brings."""
    how = f"over a pulley, pulling to {axis_name(one.direction)}" if one.over_pulley else "straight down"
    at = f"pan {np.rad2deg(one.load.pan_rad):.0f}°, tilt {np.rad2deg(one.load.tilt_rad):.0f}°"
    return (
        f"hang {1e3 * one.mass_kg:.4g} g at {1e3 * one.load.distance_m:.0f} mm from the clamp, {how} ({at}): "
        f"EI to ± {percent(after.whole)}"
    )


def missing_words(
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


def progress_words(
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
