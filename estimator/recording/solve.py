"""The recording's problem solved: Gauss–Newton, and what does not belong to the rest given less weight or none."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc

from estimator.solver.convergence import NEAREST

from .problem import Equations, Problem, State

_ITERATIONS, _ENOUGH = 12, 0.02
"""Steps are taken until none is longer than this part of a deviation."""
_LONGEST = 0.2
"""Longest step of a distance, in its own size."""
_ROUNDS = 4
_SEEN = 0.05
"""Directions of the shared errors that a group of frames tells to more than this part of what is known beforehand."""
_DOUBTED, _FOREIGN = 1e-2, 1e-6
"""Probabilities below which a frame or stroke counts less, and below which it does not belong."""


@dataclass(frozen=True, eq=False)
class Solution:
    """A recording solved.

    Attributes
    ----------
    state, equations : where it ended, and the contacts' equations there, about that state.
    covariance : (S, S) of the shared steps. weight : (B,) of each frame in them, 0 for one that does not belong.
    frame_p : (B,) probability that a frame that belongs disagrees as much with the rest. stroke_p : of each stroke.
    prior_p : that a rig as it was calibrated is off by as much. offness : how far that is, in its deviations.
    converged : whether the steps came to an end.
    """

    state: State
    equations: Equations
    covariance: np.ndarray
    weight: np.ndarray
    frame_p: np.ndarray
    stroke_p: np.ndarray
    prior_p: float
    offness: float
    converged: bool


def disagreement(information: np.ndarray, pull: np.ndarray, total: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """χ² and degrees of freedom (G,) with which groups disagree with all the rest.

    A group that belongs, with information S, pulls at the common solution with a force r of covariance S − S·H⁻¹·S,
    H the information of all. Only directions are counted in which it tells something.

    information : (G, S, S), pull : (G, S), in units of the prior's deviations. total : (S, S).
    """
    values, vectors = np.linalg.eigh(information)
    told = values > _SEEN
    along = np.einsum("gsk,gs->gk", vectors, pull)
    mixed = np.swapaxes(vectors, 1, 2) @ information
    covariance = values[:, :, None] * np.eye(values.shape[1]) - mixed @ np.linalg.solve(total, np.swapaxes(mixed, 1, 2))
    both = told[:, :, None] & told[:, None, :]
    scale = np.where(told, 1.0 / np.sqrt(np.where(told, values, 1.0)), 0.0)
    unit = np.where(both, covariance * scale[:, :, None] * scale[:, None, :], np.eye(values.shape[1]))
    # a group that is nearly all there is has nothing to disagree with
    roots, turns = np.linalg.eigh(unit)
    free = roots > 1e-3
    parts = np.einsum("gkj,gk->gj", turns, along * scale)
    square = np.where(free, parts**2 / np.where(free, roots, 1.0), 0.0).sum(axis=1)
    return square, np.maximum(told.sum(axis=1) - (~free).sum(axis=1), 0)


def solved(problem: Problem, start: State, strokes: np.ndarray, widening: float = 1.0) -> Solution:
    """The most probable recording.

    strokes : (B,) number of each frame's stroke. widening : on the deviations of the calibration.
    """
    weight = np.ones(len(problem.touching))
    belongs = np.ones(len(weight), bool)
    prior = np.full(problem.size, 1.0)
    prior[: problem.axes.shape[1]] /= widening**2
    state = start
    for _ in range(_ROUNDS):
        state, equations, total, converged = _descended(problem, state, weight, prior)
        pull = equations.side - np.einsum("bst,t->bs", equations.information, _ahead(problem, state))
        square, freedom = disagreement(equations.information, pull, total)
        frame_p = np.where(freedom > 0, _p(square, freedom), 1.0)
        labels = np.unique(strokes)
        sums = np.array([(weight * (strokes == label)) for label in labels])
        stroke_square, stroke_freedom = disagreement(
            np.einsum("gb,bst->gst", sums, equations.information), sums @ pull, total
        )
        stroke_p = np.where(stroke_freedom > 0, _p(stroke_square, stroke_freedom), 1.0)
        renewed = np.where(frame_p < _DOUBTED, freedom / np.maximum(square, 1e-9), 1.0)
        renewed[frame_p < _FOREIGN] = 0.0
        worst = int(np.argmin(stroke_p))
        if stroke_p[worst] < _FOREIGN:
            belongs[strokes == labels[worst]] = False
        renewed[~belongs] = 0.0
        change, weight = np.abs(renewed - weight).max(initial=0.0), renewed
        if change < 0.1:
            break
    offset = state.shared[: problem.axes.shape[1]]
    count = len(offset)
    whole = np.zeros((1, problem.size, problem.size))
    whole[0, :count, :count] = np.diag(prior[:count])
    square, freedom = disagreement(whole, -(prior * state.shared)[None] * (np.arange(problem.size) < count), total)
    return Solution(
        state,
        equations,
        np.linalg.inv(total),
        weight,
        frame_p,
        stroke_p[np.searchsorted(labels, strokes)],
        float(_p(square, freedom)[0]),
        float(np.sqrt(square[0] / max(freedom[0], 1))),
        converged,
    )


def _p(square: np.ndarray, freedom: np.ndarray) -> np.ndarray:
    return np.asarray(chdtrc(np.maximum(freedom, 1), square))


def _ahead(problem: Problem, state: State) -> np.ndarray:
    """(S,) the shared steps ahead of where the equations stand: the lines' errors are linear, and taken about 0."""
    first = problem.axes.shape[1]
    ahead = np.zeros(problem.size)
    ahead[first : first + problem.lines] = state.shared[first : first + problem.lines]
    return ahead


def _descended(
    problem: Problem, state: State, weight: np.ndarray, prior: np.ndarray
) -> tuple[State, Equations, np.ndarray, bool]:
    """Gauss–Newton to where no step is longer than a small part of a deviation: state, equations and information."""
    converged = False
    for _ in range(_ITERATIONS):
        equations = problem.equations(state)
        free_information, free_side = problem.free_equations(state)
        total = np.einsum("b,bst->st", weight, equations.information) + free_information.sum(axis=0)
        side = weight @ equations.side + free_side.sum(axis=0)
        begun = state.shared - _ahead(problem, state)
        total = 0.5 * (total + total.T) + np.diag(prior)
        step = np.linalg.solve(total, side - prior * begun)
        own = equations.step - np.einsum("bks,s->bk", equations.through, step)
        length = np.abs(own) / np.sqrt(np.einsum("bii->bi", equations.own_covariance))
        moved = begun + step - state.shared
        far = max(
            float(np.sqrt(moved @ total @ moved / max(len(moved), 1))),
            float(np.quantile(length[:, :3], 0.98)) if len(length) else 0.0,
        )
        if converged:
            break
        state = State(_moved(problem, state.unknowns, own), begun + step)
        converged = far < _ENOUGH
    return state, equations, total, converged


def _moved(problem: Problem, unknowns: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Unknowns (B, 4) after a step, straight in the clamp's moment: in the force its valley is bent."""
    old = unknowns[:, :1]
    limited = np.clip(step[:, :1], -_LONGEST * old, _LONGEST * old)
    share = np.where(step[:, :1] == 0.0, 1.0, limited / np.where(step[:, :1] == 0.0, 1.0, step[:, :1]))
    step = step * share
    distance = np.clip(old + step[:, :1], NEAREST, 1.0)
    distance[problem.held] = 1.0
    force = (unknowns[:, 1:3] * (old + step[:, :1]) + old * step[:, 1:3]) / distance
    return np.concatenate([distance, force, unknowns[:, 3:] + step[:, 3:]], axis=1)
