"""What settled frames are worth: noise and rig together, the evidence for a contact, and what each rung would cost."""

from __future__ import annotations

from dataclasses import dataclass, replace

from vbaa_calib.antenna.rungs import RUNGS
from vbaa_calib.core.arrays import Array, counted, namespace, places
from vbaa_calib.core.robust import huber_weights

from .convergence import SCATTERED
from .descent import moved_unknowns
from .initialization import Free
from .normal_equations import Problem, cost, least_cost, solved
from .prediction import LEANING, View, displaced, look
from .residuals import match
from .rig_arrays import UNKNOWNS
from .state import Settled, linearised, picked

REFERENCE = RUNGS[-1]
"""The rung that the others are held against."""
ROUNDS = 4
CLOSE_ROUNDS = 2
"""Reweightings when all is taken as linear: far from the solution, and beside it."""
LEAST_REDUNDANCY = 0.03
"""A moment whose misfit may be only this part of its own deviation was fitted, not tested: it contradicts nothing."""
OUT = (3.0, 6.0)
"""Deviations from its floor at which a valley's walls are looked at."""
SINGULAR = 1e14
"""Condition number of the scaled information beyond which nothing is said to be known."""


@dataclass(frozen=True, eq=False)
class Worth:
    """First-order uncertainty of B fits.

    Attributes
    ----------
    covariance : (B, 4, 4) of the unknowns, from noise and rig together; infinite where the data do not hold one.
    rig_follows : (B, R, 4) how the rig's likeliest steps go with the unknowns.
    rig_covariance : (B, R, R) of the rig's steps for a contact that is known.
    condition : (B,) condition number of the contact's own information, scaled to a unit diagonal.
    moment_std : (B, 2) deviation of each reading's whitened misfit, below one as far as the reading was fitted.
    """

    covariance: Array
    rig_follows: Array
    rig_covariance: Array
    condition: Array
    moment_std: Array

    @property
    def std(self) -> Array:
        """(B, 4) standard deviations of the unknowns."""
        xp = namespace(self.covariance)
        index = counted(self.covariance, UNKNOWNS)
        return xp.sqrt(self.covariance[:, index, index])

    def with_rig(self, by_unknowns: Array, by_rig: Array) -> Array:
        """Covariance (B, Q, R) of such quantities with the rig's steps."""
        seen = by_unknowns + by_rig @ self.rig_follows
        return seen @ self.covariance @ self.rig_follows.mT + by_rig @ self.rig_covariance

    def of(self, by_unknowns: Array, by_rig: Array) -> Array:
        """Covariance (B, Q, Q) of quantities with slopes (B, Q, 4) and (B, Q, R)."""
        seen = by_unknowns + by_rig @ self.rig_follows
        return seen @ self.covariance @ seen.mT + by_rig @ self.rig_covariance @ by_rig.mT


def worth(fits: Settled) -> Worth:
    """Invert the fits' information, the rig's part first: its prior keeps it regular.

    A distance held at the tip gets the deviation that it would have if it were free: the data allow it that far inside.
    """
    whole = fits.equations.information
    xp = namespace(whole)
    rig_covariance = xp.linalg.inv(whole[:, UNKNOWNS:, UNKNOWNS:])
    follows = -(rig_covariance @ whole[:, UNKNOWNS:, :UNKNOWNS])
    information = whole[:, :UNKNOWNS, :UNKNOWNS] + whole[:, :UNKNOWNS, UNKNOWNS:] @ follows
    index = counted(whole, UNKNOWNS)
    diagonal = information[:, index, index]
    known = (diagonal > 0.0).all(-1) & xp.isfinite(information).all(-1).all(-1)
    scale = xp.sqrt(xp.where(known[:, None], diagonal, xp.ones_like(diagonal)))
    unit = information / (scale[:, :, None] * scale[:, None])
    values, vectors = xp.linalg.eigh(xp.where(known[:, None, None], unit, fits.frames.known.trials[1:]))
    known = known & (values[:, 0] > values[:, -1] / SINGULAR)
    values = xp.clip(values, 1e-300, None)
    covariance = (vectors / values[:, None]) @ vectors.mT / (scale[:, :, None] * scale[:, None])
    felt = fits.problem.felt * xp.sqrt(huber_weights(fits.problem.misfit))[..., None]
    own = felt[..., :UNKNOWNS] + felt[..., UNKNOWNS:] @ follows
    fitted = ((own @ covariance) * own).sum(-1)
    fitted = fitted + ((felt[..., UNKNOWNS:] @ rig_covariance) * felt[..., UNKNOWNS:]).sum(-1)
    covariance = covariance * _clamour(fits.problem)[:, None, None]
    redundant = xp.clip(1.0 - fitted, LEAST_REDUNDANCY**2, None)
    return Worth(
        xp.where(known[:, None, None], covariance, xp.inf),
        follows,
        rig_covariance,
        xp.where(known, values[:, -1] / values[:, 0], xp.inf),
        xp.where(known[:, None], xp.sqrt(redundant), 1.0),
    )


def _clamour(about: Problem) -> Array:
    """(B,) factor on the variance by the points that count linearly: each still pulls, and says nothing.

    Σψ²/Σw of Huber's ψ and weights, which is 1 for noise; noise itself is not taken for outliers.
    """
    xp = namespace(about.scatter)
    whitened = about.whitened(about.found.distance)
    seen = xp.where(about.found.precision > 0.0, xp.ones_like(whitened), xp.zeros_like(whitened))
    weights = huber_weights(whitened) * seen
    factor = (weights * whitened) ** 2
    factor = factor.sum(-1) / xp.clip(weights.sum(-1), 1e-30, None)
    return xp.where(factor > 1.0 + SCATTERED / xp.sqrt(seen.sum(-1) + 1e-30), factor, xp.ones_like(factor))


def stretched(fits: Settled, known: Worth, which: Array) -> Worth:
    """The same, wider where a valley is flatter than its floor promises, for some of the frames (B,).

    Where vision is alone with a small deflection along the line of sight, the picture holds it by second order only:
    some deviations out along the longest axis the cost is then far from what it should have risen by.
    """
    if not bool(which.any()):
        return known
    xp = namespace(which)
    rows = places(which)
    state, covariance = picked(fits.state, rows), known.covariance[rows]
    sound = xp.isfinite(covariance).all(-1).all(-1)
    covariance = xp.where(sound[:, None, None], covariance, fits.frames.known.trials[1:])
    index = counted(covariance, UNKNOWNS)
    std = xp.sqrt(covariance[:, index, index])
    sizes, axes = xp.linalg.eigh(covariance / (std[:, :, None] * std[:, None]))
    axis = std * axes[..., -1] * xp.sqrt(sizes[:, -1:])
    out = xp.concat([far + 0.0 * std[:, :1] for far in (*OUT, *(-far for far in OUT))])
    several = xp.concat([counted(std, len(rows))] * (2 * len(OUT)))
    frames, table, state = fits.frames.picked(rows[several]), picked(fits.table, rows[several]), picked(state, several)
    unknowns = moved_unknowns(frames.known, state.unknowns, out * axis[several])
    steps = state.steps + (known.rig_follows[rows[several]] @ (unknowns - state.unknowns)[..., None])[..., 0]
    there = replace(state, unknowns=unknowns, steps=steps)
    rise = cost(linearised(frames, fits.rung, table, there), there.values) - fits.equations.cost[rows[several]]
    wider = 0.5 * out[:, 0] ** 2 / xp.clip(xp.nan_to_num(rise, nan=0.0), 0.01, None)
    wider = xp.clip(xp.amax(wider.reshape(-1, len(rows)), 0), 1.0, None)
    factor = xp.ones_like(fits.state.scatter)
    factor[rows] = xp.where(sound, wider, 1.0)
    return replace(known, covariance=known.covariance * factor[:, None, None])


def moves(fits: Settled, displacement: Array, felt: Array) -> Array:
    """How far values (B, K) would move, to first order, if the curves really were displaced so far.

    `displacement` (B, M) along the view's normals, `felt` (B, 2) in the readings' deviations.
    """
    about = fits.problem
    pull = (about.columns.mT @ about.summed.times(displacement[..., None]))[..., 0]
    pull = pull + (about.felt.mT @ (huber_weights(about.misfit) * felt)[..., None])[..., 0]
    return solved(fits.equations.information, pull)


def predicted_bias(fits: Settled, known: Worth, reference: View, rungs: tuple[str, ...] = RUNGS) -> dict[str, Array]:
    """Each rung's bias (B,) at the fitted contacts: the largest of distance, f_y and f_z, in standard deviations.

    How far a fit on it would move if the antenna were the highest rung's, whose view is the `reference`; on rungs
    without friction, also what the friction that is thought possible would do. Infinite where the deviations are not
    known.
    """
    xp = namespace(known.covariance)
    frames, unknowns, view = fits.frames, fits.state.unknowns, fits.view
    force = slice(4, 6)
    touch = known.of(view.by_touch[:, force], fits.table.touch[:, force])
    std = xp.sqrt(xp.concat([known.covariance[:, :1, 0], touch[:, :1, 0], touch[:, 1:, 1]], -1))
    sound = xp.isfinite(std).all(-1)

    def in_std(shape: Array, felt: Array, touched: Array) -> Array:
        moved = moves(fits, shape, felt)[:, :UNKNOWNS, None]
        forces = (view.by_touch[:, force] @ moved)[..., 0] - touched[:, force]
        off = xp.concat([moved[:, 0], forces], -1)
        return xp.where(sound[:, None], xp.abs(off) / xp.where(sound[:, None], std, 1.0), xp.inf)

    truth = displaced(view, reference)
    friction = 0.0
    if frames.known.friction_rad > 0.0 and not set(rungs) <= set(LEANING):
        leant = displaced(view, look(frames, REFERENCE, unknowns + frames.known.trials[UNKNOWNS], slopes=False))
        friction = in_std(*(a - b for a, b in zip(leant, truth, strict=True)))
    found = {}
    for rung in rungs:
        if rung == REFERENCE:
            found[rung] = xp.where(sound, xp.zeros_like(std[:, 0]), xp.full_like(std[:, 0], xp.inf))
            continue
        own = (0.0, 0.0, 0.0)
        if rung != fits.rung:
            own = displaced(view, look(frames, rung, unknowns, slopes=False))
        shape = in_std(*(a - b for a, b in zip(truth, own, strict=True)))
        both = shape if rung in LEANING else xp.sqrt(shape**2 + friction**2)
        found[rung] = xp.amax(both, -1)
    return found


def misled(fits: Settled, reference: View) -> Array:
    """(B, 2, 10) by how much unknowns (4), contact point and force (6) come out wrong on a rung.

    By what the rung leaves out of the highest one, and by one deviation of the friction that it does not know.

    To first order, as `predicted_bias`, of which these are the parts with their signs.
    """
    xp, frames, view = namespace(fits.state.scatter), fits.frames, fits.view

    def wrong(shape: Array, felt: Array, touched: Array) -> Array:
        moved = moves(fits, shape, felt)[:, :UNKNOWNS]
        return xp.concat([moved, (view.by_touch @ moved[..., None])[..., 0] - touched], -1)

    truth = displaced(view, reference)
    shape = wrong(*truth)
    if fits.rung in LEANING or frames.known.friction_rad == 0.0:
        return xp.stack([shape, xp.zeros_like(shape)], 1)
    leant = look(frames, REFERENCE, fits.state.unknowns + frames.known.trials[UNKNOWNS], slopes=False)
    # its force leans by the friction angle, which the touch's own covariance has already
    friction = wrong(*(a - b for a, b in zip(displaced(view, leant), truth, strict=True)))
    return xp.stack([shape, xp.concat([friction[:, :7], 0.0 * friction[:, :1], friction[:, 8:]], -1)], 1)


def held_against(fits: Settled, view: View) -> Problem:
    """The fits' problem with the residuals that another rung's view of the same unknowns leaves."""
    found = match(fits.frames, view, fits.state.foot_m)
    return replace(fits.problem, found=found, misfit=view.misfit).stepped(fits.state.steps)


def evidence(fits: Settled, about: Problem, free: Free) -> Array:
    """(B,) how much better a contact explains the frames than the free antenna: half the difference of squared misfits.

    Both may bend the rig's parameters within their joint covariance first, so that a clamp angle that is known badly is
    not taken for a contact. Without contact it is 1.5 to 2 (three unknowns fitted to noise). Both are held against
    the highest rung, `about` the problem with its residuals: what a lower one leaves out of the weight must not pass
    for a force.
    """
    _, touching = least_cost(about, fits.state.values, CLOSE_ROUNDS)
    alone = Problem(
        free.found,
        free.table.nodes,
        free.table.readings,
        free.view.misfit,
        about.prior[:, UNKNOWNS:],
        about.scatter,
    )
    _, without = least_cost(alone, 0.0 * fits.state.steps, ROUNDS if alone.columns.shape[-1] else 0)
    return without - touching
