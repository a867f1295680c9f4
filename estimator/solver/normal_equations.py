"""Robust least squares over points, readings and priors, for a batch of frames on the nodes of their curves."""

from __future__ import annotations

from dataclasses import dataclass, replace

from vbaa_calib.core.arrays import Array, counted, namespace
from vbaa_calib.core.robust import huber_losses, huber_weights

from .prediction import RigTable, View
from .residuals import Match, Sums, sums
from .rig_arrays import LIKELY_SWAY, Known

SETTLED = 1e-4
"""Part of a cost: linear problems are solved once no frame's reweighted step promises more."""
EASE = 1e-12
"""Added to the diagonal of scaled normal equations: what nothing holds stays where it is."""


@dataclass(frozen=True, eq=False)
class Problem:
    """B frames linearised about a view: residuals as they move with K = 4 + R unknowns and rig steps.

    Attributes
    ----------
    found : the points on the view's curves.
    columns : (B, M, K) displacement of the curves along their normals.
    felt : (B, 2, K) of the predicted readings, in deviations.
    misfit : (B, 2) of the readings, in deviations.
    prior : (B, K) weight of the unknowns' own squares: nothing is known of the distance beforehand.
    scatter : (B,) factor on the points' deviations.
    """

    found: Match
    columns: Array
    felt: Array
    misfit: Array
    prior: Array
    scatter: Array

    def residuals(self, moved: Array) -> tuple[Array, Array]:
        """Points' distances (B, N) and readings' misfits (B, 2) after a small move (B, K)."""
        shift = self.found.between((self.columns @ moved[..., None])[..., 0])
        return self.found.distance - shift, self.misfit - (self.felt @ moved[..., None])[..., 0]

    def stepped(self, steps: Array) -> Problem:
        """The same with the rig's steps (B, R) taken out of the residuals."""
        if steps.shape[1] == 0:
            return self
        still = namespace(steps).zeros_like(self.prior[:, : self.prior.shape[1] - steps.shape[1]])
        distance, misfit = self.residuals(namespace(steps).concat([still, steps], -1))
        return replace(self, found=replace(self.found, distance=distance), misfit=misfit)

    def weighed(self, distance: Array, whitened: Array) -> Sums:
        """Distances (B, N) and the robust weights of `whitened` ones, summed over the nodes."""
        weights = huber_weights(whitened) * self.found.precision / self.scatter[:, None] ** 2
        return sums(self.found, weights, distance, self.columns.shape[1])

    @property
    def summed(self) -> Sums:
        """The points as they lie, summed over the nodes."""
        return self.weighed(self.found.distance, self.whitened(self.found.distance))

    def whitened(self, distance: Array) -> Array:
        """Distances (B, N) over their deviations; 0 for a missing point."""
        return distance * namespace(distance).sqrt(self.found.precision) / self.scatter[:, None]


@dataclass(frozen=True, eq=False)
class Equations:
    """Normal equations of B frames: information (B, K, K), pull (B, K) = information · step, and the cost (B,)."""

    information: Array
    pull: Array
    cost: Array


def problem(known: Known, view: View, table: RigTable, found: Match, scatter: Array) -> Problem:
    """Join what belongs to the contact and what to the rig."""
    xp = namespace(scatter)
    sway = (known.tip_per_force(view.contact_m / view.length_m) / LIKELY_SWAY) ** 2
    prior = xp.zeros_like(sway)[:, None] + known.prior
    prior[:, 1:3] = sway[:, None]
    columns = xp.concat([view.columns, table.nodes], -1)
    felt = xp.concat([view.by_moment, table.readings], -1)
    return Problem(found, columns, felt, view.misfit, prior, scatter)


def cost(this: Problem, at: Array, moved: Array | None = None) -> Array:
    """(B,) robust cost with the priors of values `at` (B, K), after a small move (B, K) towards them."""
    distance, misfit = (this.found.distance, this.misfit) if moved is None else this.residuals(moved)
    points = huber_losses(this.whitened(distance)).sum(-1)
    return points + huber_losses(misfit).sum(-1) + 0.5 * (this.prior * at * at).sum(-1)


def equations(this: Problem, at: Array, moved: Array | None = None) -> Equations:
    """Normal equations, reweighted at the residuals after a small move (B, K), for a further step from values `at`."""
    distance, misfit = (this.found.distance, this.misfit) if moved is None else this.residuals(moved)
    whitened = this.whitened(distance)
    summed = this.weighed(distance, whitened)
    felt = huber_weights(misfit)[..., None] * this.felt
    information = this.columns.mT @ summed.times(this.columns) + this.felt.mT @ felt
    pull = (this.columns.mT @ summed.load[..., None] + felt.mT @ misfit[..., None])[..., 0]
    diagonal = counted(at, this.columns.shape[-1])
    information[:, diagonal, diagonal] += this.prior
    total = huber_losses(whitened).sum(-1) + huber_losses(misfit).sum(-1) + 0.5 * (this.prior * at * at).sum(-1)
    return Equations(information, pull - this.prior * at, total)


def solved(information: Array, pull: Array, damping: Array | None = None) -> Array:
    """Steps (B, K) of normal equations, scaled to a unit diagonal, to which damping (B,) is added."""
    return solved_columns(information, pull[..., None], damping)[..., 0]


def solved_columns(information: Array, pulls: Array, damping: Array | None = None) -> Array:
    """`solved` for several right sides (B, K, C) at once."""
    xp = namespace(pulls)
    diagonal = counted(pulls, pulls.shape[1])
    scale = xp.sqrt(information[:, diagonal, diagonal])
    scale = xp.where(scale > 0.0, scale, xp.ones_like(scale))
    unit = information / (scale[:, :, None] * scale[:, None])
    unit[:, diagonal, diagonal] += EASE if damping is None else damping[:, None] + EASE
    return xp.linalg.solve(unit, pulls / scale[..., None]) / scale[..., None]


def least_cost(this: Problem, at: Array, rounds: int) -> tuple[Array, Array]:
    """The small move (B, K) of least cost with everything taken as linear, and that cost (B,); `at` (B, K) is where
    the priors stand before it. It is reweighted so many times at most."""
    moved = namespace(at).zeros_like(at)
    for _ in range(rounds):
        now = equations(this, at + moved, moved)
        step = solved(now.information, now.pull)
        moved = moved + step
        if bool(((now.pull * step).sum(-1) < SETTLED * (1.0 + now.cost)).all()):
            break
    return moved, cost(this, at + moved, moved)
