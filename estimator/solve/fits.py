"""Where fits of many frames stand, and what the model looks like there."""

from __future__ import annotations

from dataclasses import dataclass, replace

from vbaa_calib.arrays import Array, namespace

from .batch import written
from .frames import Frames
from .match import match, nearest_feet
from .normal import Equations, Problem, cost, equations, problem
from .view import RigTable, View, look


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
