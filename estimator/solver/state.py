"""States of many fits, and the model linearised there."""

from __future__ import annotations

from dataclasses import dataclass, replace

from vbaa_calib.core.arrays import Array, namespace

from .frames import Frames
from .normal_equations import NormalEquations, Problem, cost, linear_problem, normal_equations
from .prediction import Prediction, RigJacobian, predict
from .residuals import nearest_feet, point_residuals
from .rows import with_rows


@dataclass(frozen=True, eq=False)
class State:
    """Where B fits are.

    Attributes
    ----------
    unknowns : (B, 4), see `rig_arrays.UNKNOWNS`.
    rig_steps : (B, R) along the rig's independent axes, in deviations.
    foot_m : (B, N) feet of the points on the curves.
    at_tip : (B,) bool, the distance is fixed at the tip.
    scatter : (B,) factor on the points' deviations.
    converged : (B,) bool.
    cost : (B,) robust cost with the priors, infinite before the first step.
    """

    unknowns: Array
    rig_steps: Array
    foot_m: Array
    at_tip: Array
    scatter: Array
    converged: Array
    cost: Array

    @property
    def values(self) -> Array:
        """(B, 4 + R) unknowns and rig steps."""
        return namespace(self.unknowns).concat([self.unknowns, self.rig_steps], -1)


def initial_state(frames: Frames, prediction: Prediction, unknowns: Array, feet_m: Array | None = None) -> State:
    """States at unknowns (B, 4), with the rig as calibrated. `feet_m` (B, N): feet near the right ones, if known."""
    xp = namespace(unknowns)
    feet = nearest_feet(frames, prediction) if feet_m is None else feet_m
    no = unknowns[:, 0] < 0.0
    ones = xp.ones_like(unknowns[:, 0])
    return State(unknowns, frames.rig_arrays.zero_rig_steps(len(frames)), feet, no, ones, no, xp.inf * ones)


@dataclass(frozen=True, eq=False)
class Fits:
    """B frames fitted on one rung, or on their way.

    Attributes
    ----------
    prediction : at the state. by_rig : its derivatives by the rig, as used in the fit.
    problem, equations : linearised at the state, the rig's steps in the residuals.
    """

    frames: Frames
    rung: str
    state: State
    prediction: Prediction
    by_rig: RigJacobian
    problem: Problem
    equations: NormalEquations

    @property
    def unscaled_cost(self) -> Array:
        """(B,) the cost with the deviations that the points came with: only these compare between fits."""
        if not bool((self.state.scatter != 1.0).any()):
            return self.equations.cost
        unscaled = replace(self.problem, scatter=namespace(self.state.scatter).ones_like(self.state.scatter))
        return cost(unscaled, self.state.values)

    def with_rows(self, rows: Array, part: Fits) -> Fits:
        """The same with some fits, of these indices in rising order, replaced by others."""
        parts = ("state", "prediction", "by_rig", "problem", "equations")
        return replace(self, **{name: with_rows(getattr(self, name), rows, getattr(part, name)) for name in parts})


def linearise(
    frames: Frames, rung: str, by_rig: RigJacobian, state: State, prediction: Prediction | None = None
) -> Problem:
    """The problem about a state, the rig's steps in its residuals."""
    prediction = predict(frames, rung, state.unknowns) if prediction is None else prediction
    points = point_residuals(frames, prediction, state.foot_m)
    return linear_problem(frames.rig_arrays, prediction, by_rig, points, state.scatter).with_rig_steps(state.rig_steps)


def evaluate(
    frames: Frames, rung: str, by_rig: RigJacobian, state: State, prediction: Prediction | None = None
) -> Fits:
    """Fits as they are at a state, without a step. Feet come out nearer to the right ones."""
    prediction = predict(frames, rung, state.unknowns) if prediction is None else prediction
    problem = linearise(frames, rung, by_rig, state, prediction)
    equations = normal_equations(problem, state.values)
    state = replace(state, foot_m=problem.points.foot_m, cost=equations.cost)
    return Fits(frames, rung, state, prediction, by_rig, problem, equations)
