"""Gauss–Newton for a whole recording; frames and strokes that contradict the rest are down-weighted or left out."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from vbaa_calib.core.arrays import spread_evenly
from vbaa_calib.core.least_squares import MIN_INFORMATION, Rules, disagreement, disagreement_p, levenberg_marquardt
from vbaa_calib.native import core

from .problem import Equations, RecordingProblem, State
from .settings import RefineSettings

_RULES = Rules(
    iterations=40,
    standstill=RefineSettings.enough**2,
    takes_last=True,
    may_rise=RefineSettings.enough**2,
    growth=2.0,
    relief=0.5,
    after_failure=1.0,
)


@dataclass(frozen=True, eq=False)
class Solution:
    """The solution of a recording."""

    state: State  # where it ended
    equations: Equations  # of the contacts, about that state
    covariance: np.ndarray  # (S, S) of the shared steps
    weight: np.ndarray  # (B,) of each frame in them, 0 for one that does not belong
    prior_p: float  # probability that a rig as calibrated is off by as much
    offness: float  # how far that is, in its deviations
    converged: bool  # whether the steps came to an end
    trend: np.ndarray  # (R,) change of the rig's steps, from the middle of the recording to its end
    trend_p: float  # probability that a rig without any change shows as much

    def changing(self) -> Solution:
        """The solution with the largest difference between a frame's rig and the common one added to the covariance."""
        covariance, count = self.covariance.copy(), len(self.trend)
        covariance[:count, :count] += np.outer(self.trend, self.trend)
        return replace(self, covariance=covariance)


def solved(problem: RecordingProblem, start: State, strokes: np.ndarray, widening: float = 1.0) -> Solution:
    """The most probable recording. The shared steps are solved with at most `most_frames` frames, evenly spaced,
    then fixed while the others are fitted: a frame's bias is of second order in its noise, but the same in many.
    strokes : (B,) index of each frame's. widening : factor on the calibration's standard deviations."""
    rig = problem.axes.shape[1]
    prior = np.ones(problem.size)
    prior[:rig] /= widening**2
    chosen = spread_evenly(len(problem.touching), RefineSettings.most_frames)
    few, labels = problem.picked(chosen, RefineSettings.most_frames), strokes[chosen]
    state = State(start.unknowns[chosen], start.shared)
    weight, foreign = _beginning(few, state, labels), np.zeros(0, strokes.dtype)
    kept = None
    for _ in range(RefineSettings.weighings):
        end, converged = _descended(few, state, weight, prior, kept)
        state, equations, total = end.state, end.equations, end.total
        pull = _pull(few, state, equations)
        renewed = _weights(equations, pull, total)
        each = np.unique(labels)
        sums = np.array([weight * (labels == label) for label in each])
        square, freedom = disagreement(np.einsum("gb,bst->gst", sums, equations.information), sums @ pull, total)
        stroke_p = disagreement_p(square, freedom)
        if stroke_p.min(initial=1.0) < RefineSettings.foreign:
            foreign = np.append(foreign, each[np.argmin(stroke_p)])
        renewed[np.isin(labels, foreign)] = 0.0
        trust = equations.trust if kept is None else np.minimum(kept, equations.trust)
        distrust = np.abs(trust - end.trust).max(initial=0.0)
        kept = None if kept is None and distrust == 0.0 else trust
        change, weight = np.abs(renewed - weight).max(initial=distrust), renewed
        if change < RefineSettings.last_change:
            break
    offset = np.zeros((1, problem.size))
    offset[0, :rig] = -prior[:rig] * state.shared[:rig]
    square, freedom = disagreement(np.diag(prior * (np.arange(problem.size) < rig))[None], offset, total)
    trend = _trend(few, (state, equations, weight, total), labels)
    if len(chosen) < len(problem.touching):
        state, equations = _others(problem, State(start.unknowns, state.shared), state.unknowns, chosen)
        weight = _weights(equations, _pull(problem, state, equations), total)
        weight[np.isin(strokes, foreign)] = 0.0
    return Solution(
        state,
        equations,
        np.linalg.inv(total),
        weight,
        float(disagreement_p(square, freedom)[0]),
        _offness(np.linalg.inv(total), prior, rig, float(square[0] - freedom[0])),
        converged,
        *trend,
    )


def _trend(
    problem: RecordingProblem, at: tuple[State, Equations, np.ndarray, np.ndarray], strokes: np.ndarray
) -> tuple[np.ndarray, float]:
    """Estimated change of the rig over the recording, linear in time, from the frames' gradients at a solution: its
    steps (R,), and their p-value (score test). Friction angles of a stroke share an error, as neighbours rub alike."""
    state, equations, weight, total = at
    free_information, free_side = problem.free_equations(state)
    ahead, rig = _ahead(problem, state), problem.axes.shape[1]
    information = np.concatenate([weight[:, None, None] * equations.information, free_information])
    pull = np.concatenate([weight[:, None] * equations.side, free_side]) - information @ ahead
    time_s = np.concatenate([problem.time_s, problem.free_s])
    first, last = np.min(time_s, initial=np.inf), np.max(time_s, initial=-np.inf)
    if not last > first:  # nor where times are not known
        return np.zeros(rig), 1.0
    when = (2.0 * time_s - first - last) / (last - first)
    across = np.einsum("b,brs->rs", when, information[:, :rig])
    of_trend = np.einsum("b,brs->rs", when**2, information[:, :rig, :rig])
    of_trend -= across @ np.linalg.solve(total, across.T)
    side = when @ pull[:, :rig]
    ratio = weight * problem.friction_rad / problem.friction.std_rad
    rubbed = ratio[:, None] * equations.through[:, 3]
    in_stroke = (strokes == np.unique(strokes)[:, None]).astype(float)
    alike = in_stroke @ (when[: len(weight), None] * rubbed[:, :rig])
    alike -= in_stroke @ rubbed @ np.linalg.solve(total, across.T)
    values, vectors = np.linalg.eigh(of_trend)
    vectors = vectors[:, values > MIN_INFORMATION]
    along = vectors.T @ side
    square = along @ np.linalg.solve(vectors.T @ (of_trend + alike.T @ alike) @ vectors, along)
    p = disagreement_p(np.array([square]), np.array([len(along)]))[0]
    return np.linalg.solve(of_trend + RefineSettings.trend_information * np.eye(rig), side), float(p)


def _offness(covariance: np.ndarray, prior: np.ndarray, rig: int, excess: float) -> float:
    """Ratio of the rig's change, as the recording determines it, to the standard deviations of its calibration.

    covariance : of all shared unknowns, of which the first `rig` are the rig's. prior : their inverse variances before
    the recording. excess : χ² of the change less its degrees of freedom. A direction that the recording determines in
    part counts in part."""
    determined = rig - float(np.diag(covariance)[:rig] @ prior[:rig])
    return float(np.sqrt(max(1.0 + excess / max(determined, 1e-9), 0.0)))


def _beginning(problem: RecordingProblem, state: State, strokes: np.ndarray) -> np.ndarray:
    """(B,) initial weights: 0 for frames and strokes that clearly contradict the calibration, provided most do not:
    they would mislead the others."""
    equations = problem.equations(state)
    labels, which = np.unique(strokes, return_inverse=True)
    sums = np.eye(len(labels))[:, which]
    weight = np.ones(len(strokes))
    for information, pull, of in (
        (equations.information, equations.side, np.arange(len(strokes))),
        (np.einsum("gb,bst->gst", sums, equations.information), sums @ equations.side, which),
    ):
        values, vectors = np.linalg.eigh(information)
        known = values > MIN_INFORMATION
        along = np.einsum("gsk,gs->gk", vectors, pull)
        square = np.where(known, along**2 / np.where(known, values + values**2, 1.0), 0.0).sum(axis=1)
        weight[(disagreement_p(square, known.sum(axis=1)) < RefineSettings.excluded)[of]] = 0.0
    weight[~equations.sound] = 0.0
    return weight if np.mean(weight) > 1.0 - RefineSettings.most_excluded else np.where(equations.sound, 1.0, 0.0)


def _weights(equations: Equations, pull: np.ndarray, total: np.ndarray) -> np.ndarray:
    """(B,) weights of frames in the shared steps: below 1 where one disagrees with the rest, 0 where it is foreign."""
    square, freedom = disagreement(equations.information, pull, total)
    p = disagreement_p(square, freedom)
    weight = np.where(p < RefineSettings.doubted, freedom / np.maximum(square, 1e-9), 1.0)
    return np.where((p < RefineSettings.foreign) | ~equations.sound, 0.0, weight)


def _pull(problem: RecordingProblem, state: State, equations: Equations) -> np.ndarray:
    """(B, S) gradient of each frame's cost by the shared steps."""
    return equations.side - np.einsum("bst,t->bs", equations.information, _ahead(problem, state))


def _others(problem: RecordingProblem, state: State, found: np.ndarray, chosen: np.ndarray) -> tuple[State, Equations]:
    """All frames fitted with fixed shared steps; the chosen ones start where they were found. A frame that has
    lengthened its step twice takes half a step, then a quarter, and so on."""
    unknowns, trust = state.unknowns.copy(), np.full((len(state.unknowns), 2), np.nan)
    unknowns[chosen] = found
    rises, before = np.zeros(len(unknowns)), np.full(len(unknowns), np.inf)
    for turn in range(_RULES.iterations):
        state = State(unknowns, state.shared)
        equations = problem.equations(state, trust)
        own = equations.step - np.einsum("bks,s->bk", equations.through, _ahead(problem, state))
        if turn and _length(own, equations.own_covariance) < RefineSettings.enough:
            break
        length = _lengths(own, equations.own_covariance).max(axis=1)
        rises, before = rises + (length > before + RefineSettings.enough), length
        part = 0.5 ** np.maximum(rises - 1.0, 0.0)
        kept = np.where(np.isnan(trust), equations.trust, trust)
        trust = np.where((part < 1.0)[:, None], kept, np.nan)
        unknowns = _moved(problem, unknowns, part[:, None] * own)
    return state, equations


def _lengths(own: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """(B, 3) frames' steps (B, 4) of distance and force, in standard deviations."""
    return np.asarray(np.abs(own / np.sqrt(np.einsum("bii->bi", covariance)))[:, :3])


def _length(own: np.ndarray, covariance: np.ndarray) -> float:
    """Length in standard deviations that nearly all frames' steps (B, 4) do not exceed."""
    return float(np.quantile(_lengths(own, covariance), RefineSettings.nearly_all)) if len(own) else 0.0


def _ahead(problem: RecordingProblem, state: State) -> np.ndarray:
    """(S,) shared steps from where the equations are linearised to the state: those of the lines' errors, which are
    linearised at 0; the others are linearised at the state."""
    first = problem.axes.shape[1]
    ahead = np.zeros(problem.size)
    ahead[first : first + problem.lines] = state.shared[first : first + problem.lines]
    return ahead


@dataclass(frozen=True, eq=False)
class _LinearisedRecording:
    """A recording linearised at a state, with its Gauss–Newton step."""

    state: State
    equations: Equations
    weight: np.ndarray  # (B,) of frames
    total: np.ndarray  # (S, S) information of the shared steps
    own: np.ndarray  # (B, 4) step of the frames' unknowns
    shared: np.ndarray  # (S,) step of what they share
    trust: np.ndarray  # (B, 2) as in `Equations`, by which these were made
    counted: np.ndarray  # (B,) bool, the frames in `length`
    cost: float = 0.0  # of the objective, less where the descent began

    @cached_property
    def length(self) -> float:
        """Length of the step in standard deviations: of the shared part, or of nearly all frames' if longer."""
        along = float(self.shared @ self.total @ self.shared) / max(len(self.shared), 1)
        own, covariance = self.own[self.counted], self.equations.own_covariance[self.counted]
        return max(float(np.sqrt(along)), _length(own, covariance))

    def decrease(self, own: np.ndarray, shared: np.ndarray) -> float:
        """First-order decrease of the objective along small moves (B, 4), (S,) from here."""
        through = self.equations.through
        pull = np.linalg.solve(self.equations.own_covariance, (self.own + through @ self.shared)[..., None])[..., 0]
        return float(self.weight @ (pull * (own + through @ shared)).sum(axis=1) + self.shared @ self.total @ shared)


def _linearised(
    problem: RecordingProblem, state: State, weight: np.ndarray, prior: np.ndarray, trust: np.ndarray | None = None
) -> _LinearisedRecording | None:
    """The recording linearised at a state; None where there is no step. With a fixed `trust`, frames of weight 0 need
    not converge."""
    equations = problem.equations(state, trust)
    free_information, free_side = problem.free_equations(state)
    total = np.einsum("b,bst->st", weight, equations.information) + free_information.sum(axis=0)
    side = weight @ equations.side + free_side.sum(axis=0)
    here = state.shared - _ahead(problem, state)
    total = 0.5 * (total + total.T) + np.diag(prior)
    step = np.linalg.solve(total, side - prior * here) if np.isfinite(total).all() else np.full(len(side), np.nan)
    if not np.isfinite(step).all():
        return None
    own = equations.step - np.einsum("bks,s->bk", equations.through, step)
    counted = (weight > 0.0) | (trust is None)
    trust = equations.trust if trust is None else trust
    return _LinearisedRecording(state, equations, weight, total, own, here + step - state.shared, trust, counted)


def _descended(
    problem: RecordingProblem, state: State, weight: np.ndarray, prior: np.ndarray, trust: np.ndarray | None = None
) -> tuple[_LinearisedRecording, bool]:
    """Iterates until all steps are a small part of a standard deviation; returns the result and whether it
    converged.

    A step along which the objective rises, by its slopes at both ends, is shortened. From the first step on that was,
    or that led to a longer one, the weights of frames and ends stay fixed, because weights that alternate would keep
    the steps from becoming shorter.
    """
    first = _linearised(problem, state, weight, prior, trust)
    if first is None:
        equations, nowhere = problem.equations(state), (np.zeros_like(state.unknowns), np.zeros_like(state.shared))
        return _LinearisedRecording(
            state, equations, weight, np.diag(prior), *nowhere, equations.trust, weight > 0.0
        ), False
    keeps = trust is not None

    def step(now: _LinearisedRecording, damping: float) -> tuple[np.ndarray, float]:
        nonlocal keeps
        keeps = keeps or damping >= _RULES.after_failure
        return np.append(now.own.ravel(), now.shared) / (1.0 + damping), now.length**2

    def moved(now: _LinearisedRecording, move: np.ndarray) -> _LinearisedRecording | None:
        nonlocal keeps
        own, shared = move[: now.own.size].reshape(now.own.shape), move[now.own.size :]
        further = State(_moved(problem, now.state.unknowns, own), now.state.shared + shared)
        trial = _linearised(problem, further, weight, prior, now.trust if keeps else None)
        if trial is None:
            return None
        keeps = keeps or trial.length > now.length + RefineSettings.enough
        way = further.unknowns - now.state.unknowns, shared
        return replace(trial, cost=now.cost - 0.5 * (now.decrease(*way) + trial.decrease(*way)))

    at, promise, _ = levenberg_marquardt(first, step, moved, _RULES)
    return at, promise <= _RULES.standstill


def _moved(problem: RecordingProblem, unknowns: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Unknowns (B, 4) after a step that is linear in the clamp's moment: in the force the valley is curved."""
    old = unknowns[:, :1]
    limited = np.clip(step[:, :1], -RefineSettings.longest * old, RefineSettings.longest * old)
    share = np.where(step[:, :1] == 0.0, 1.0, limited / np.where(step[:, :1] == 0.0, 1.0, step[:, :1]))
    step = step * share
    distance = np.clip(old + step[:, :1], core.solver.NEAREST, 1.0)
    distance[problem.fixed_at_tip] = 1.0
    force = (unknowns[:, 1:3] * (old + step[:, :1]) + old * step[:, 1:3]) / distance
    return np.concatenate([distance, force, unknowns[:, 3:] + step[:, 3:]], axis=1)
