"""Where fits of many frames stand, and what the model looks like there."""

from __future__ import annotations

from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any, TypeVar

from vbaa_calib.core.arrays import Array, namespace

from .frames import Frames
from .normal_equations import Equations, Problem, cost, equations, problem
from .prediction import RigTable, View, look
from .residuals import match, nearest_feet

T = TypeVar("T")


def picked(values: T, which: Array) -> T:
    """The rows by index or mask, of the dataclasses inside as well; what is no array stays."""
    made = {}
    for f in fields(_data(values)):
        value = getattr(values, f.name)
        if hasattr(value, "picked"):
            made[f.name] = value.picked(which)
        elif isinstance(value, dict):
            made[f.name] = {key: entry[which] for key, entry in value.items()}
        elif is_dataclass(value):
            made[f.name] = picked(value, which)
        elif hasattr(value, "ndim"):
            made[f.name] = value[which]
    return replace(_data(values), **made)


def chosen(first_is: Array, first: T, second: T) -> T:
    """Row by row from the first where the mask says so, else from the second."""
    xp = namespace(first_is)
    made = {}
    for f in fields(_data(first)):
        a, b = getattr(first, f.name), getattr(second, f.name)
        made[f.name] = xp.where(first_is.reshape((-1,) + (1,) * (a.ndim - 1)), a, b)
    return replace(_data(first), **made)


def written(whole: T, rows: Array, part: T) -> T:
    """The whole with the rows of these indices, in rising order, replaced by a part."""
    made = {}
    for f in fields(_data(whole)):
        values, new = getattr(whole, f.name), getattr(part, f.name)
        if is_dataclass(values):
            made[f.name] = written(values, rows, new)
        elif hasattr(values, "ndim"):
            made[f.name] = new if len(rows) == len(values) else _overwritten(values, rows, new)
    return replace(_data(whole), **made)


def gathered(parts: list[T], order: Array) -> T:
    """Parts of a whole, one after the other and then in this order."""
    xp, made = namespace(order), {}
    for f in fields(_data(parts[0])):
        values = [getattr(part, f.name) for part in parts]
        if is_dataclass(values[0]):
            made[f.name] = gathered(values, order)
        elif hasattr(values[0], "ndim"):
            made[f.name] = xp.concat(values)[order]
    return replace(_data(parts[0]), **made)


def _overwritten(values: Array, rows: Array, new: Array) -> Array:
    changed = values.clone() if hasattr(values, "clone") else values.copy()
    changed[rows] = new
    return changed


def _data(values: Any) -> Any:
    return values


@dataclass(frozen=True, eq=False)
class State:
    """Where B fits stand.

    Attributes
    ----------
    unknowns : (B, 4), see `known.UNKNOWNS`.
    steps : (B, R) how far the rig went along its independent axes, in deviations.
    foot_m : (B, N) feet of the points on the curves.
    at_tip : (B,) bool, the distance is held at the tip.
    scatter : (B,) factor on the points' deviations.
    converged : (B,) bool.
    cost : (B,) robust cost with the priors, infinite before the first step.
    """

    unknowns: Array
    steps: Array
    foot_m: Array
    at_tip: Array
    scatter: Array
    converged: Array
    cost: Array

    @property
    def values(self) -> Array:
        """(B, 4 + R) unknowns and rig steps."""
        return namespace(self.unknowns).concat([self.unknowns, self.steps], -1)


def begin(frames: Frames, view: View, unknowns: Array, feet_m: Array | None = None) -> State:
    """States at unknowns (B, 4) and their view, with the rig as calibrated, from feet (B, N) near the right ones."""
    xp = namespace(unknowns)
    feet = nearest_feet(frames, view) if feet_m is None else feet_m
    no = unknowns[:, 0] < 0.0
    ones = xp.ones_like(unknowns[:, 0])
    return State(unknowns, frames.known.still(len(frames)), feet, no, ones, no, xp.inf * ones)


@dataclass(frozen=True, eq=False)
class Settled:
    """B frames fitted on one rung, or on their way.

    Attributes
    ----------
    state : where they stand.
    view, table : the prediction there, and the rig's influence as it is used.
    problem, equations : linearised there, the rig's steps in the residuals.
    """

    frames: Frames
    rung: str
    state: State
    view: View
    table: RigTable
    problem: Problem
    equations: Equations

    @property
    def plain_cost(self) -> Array:
        """(B,) the cost with the deviations that the points came with: only these compare between fits."""
        if not bool((self.state.scatter != 1.0).any()):
            return self.equations.cost
        plain = replace(self.problem, scatter=namespace(self.state.scatter).ones_like(self.state.scatter))
        return cost(plain, self.state.values)

    def having(self, rows: Array, part: Settled) -> Settled:
        """The same with some fits, of these indices in rising order, replaced by others."""
        parts = ("state", "view", "table", "problem", "equations")
        return replace(self, **{name: written(getattr(self, name), rows, getattr(part, name)) for name in parts})


def linearised(frames: Frames, rung: str, table: RigTable, state: State, view: View | None = None) -> Problem:
    """The problem about a state, the rig's steps in its residuals."""
    view = look(frames, rung, state.unknowns) if view is None else view
    found = match(frames, view, state.foot_m)
    return problem(frames.known, view, table, found, state.scatter).stepped(state.steps)


def evaluated(frames: Frames, rung: str, table: RigTable, state: State, view: View | None = None) -> Settled:
    """What fits look like where they stand; nothing is searched for. Feet come out nearer to the right ones."""
    view = look(frames, rung, state.unknowns) if view is None else view
    about = linearised(frames, rung, table, state, view)
    here = equations(about, state.values)
    return Settled(frames, rung, replace(state, foot_m=about.found.foot_m, cost=here.cost), view, table, about, here)
