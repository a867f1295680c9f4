"""Where to begin: the free antenna's picture says, for each distance on a grid, what the best force would explain."""

from __future__ import annotations

from dataclasses import dataclass

from vbaa_calib.antenna.shape import aligned_arclength
from vbaa_calib.arrays import Array, like, namespace

from .cubics import cubic, cubics
from .frames import Frames
from .known import LIKELY_SWAY
from .match import between_nodes, match, nearest_feet, rows, sums
from .normal import huber_weights
from .view import RigTable, View, by_point, look, rig_table

GRID = 24
"""Distances tried, spread over the antenna."""
NEAREST_TRIED = 0.05
ROUNDS = 3
"""Reweightings of the points by what the best distance leaves of them."""
WARM_OBJECTION = 8.0
"""A start from the frame before is taken unless another distance explains the frame better by so much."""
FREE = 0.5
"""The free antenna's contact without a force: where its nodes lie."""


@dataclass(frozen=True, eq=False)
class Free:
    """The free antennas of B frames: their views, and the rig's influence on them."""

    unknowns: Array
    view: View
    table: RigTable
    feet_m: Array


def free_antenna(frames: Frames, rung: str) -> Free:
    """The free antennas; the rig's influence on them is that of small deflections."""
    xp = namespace(frames.points)
    unknowns = xp.zeros_like(frames.gravity_m_s2[:, :1]) + FREE * frames.known.trials[1]
    view = look(frames, rung, unknowns)
    return Free(unknowns, view, rig_table(frames, "linear", unknowns, view), nearest_feet(frames, view))


def free_points(free: Free, arclength_m: Array) -> Array:
    """(B, 3) points of the free antennas at arc lengths (B,), antenna frame."""
    view = free.view
    table = cubics(view.points_m, view.tangents, view.contact_m, view.length_m)
    left, share, _ = between_nodes(view, arclength_m[:, None])
    points = cubic(table, rows(left, table.shape[1]), share)
    return namespace(share).concat([value for value, _, _ in points], -1)


@dataclass(frozen=True, eq=False)
class Trials:
    """Distances (B, G) of the grid, their best forces (B, G, 2), and how much of the cost each takes away (B, G)."""

    grid: Array
    forces: Array
    gains: Array

    def lowest(self, count: int) -> tuple[Array, Array]:
        """Unknowns (B, count, 4) at the lowest local minima over the grid, lowest first, and their costs (B, count).

        A frame with fewer minima has some of infinite cost.
        """
        xp, costs = namespace(self.gains), -self.gains
        edge = xp.full_like(costs[:, :1], xp.inf)
        around = xp.concat([edge, costs, edge], -1)
        floor = (costs <= around[:, :-2]) & (costs <= around[:, 2:])
        costs = xp.where(floor, costs, xp.full_like(costs, xp.inf))
        order = xp.argsort(costs, -1)[:, :count]
        every = xp.arange(len(costs))[:, None]
        return self._unknowns(self.grid[every, order], self.forces[every, order]), costs[every, order]

    def spread(self, every: int) -> tuple[Array, Array]:
        """Unknowns (B, S, 4) at every so manieth distance, and costs (B, S) of 0."""
        forces = self.forces[:, ::every]
        return self._unknowns(self.grid[:, ::every], forces), 0.0 * forces[..., 0]

    def warmed(self, starts: Array, costs: Array, warm: Array) -> tuple[Array, Array]:
        """Starts and costs with warm ones (B, 4) alone where no other distance explains a frame much better."""
        xp = namespace(costs)
        beside = xp.argmin(xp.abs(self.grid - warm[:, :1]), -1)
        near = self.gains[xp.arange(len(costs)), beside]
        good = xp.isfinite(warm).all(-1) & (near > xp.amax(self.gains, -1) - WARM_OBJECTION)
        starts, costs = starts + 0.0, costs + 0.0
        starts[:, 0] = xp.where(good[:, None], warm, starts[:, 0])
        costs[:, 1:] = xp.where(good[:, None], xp.full_like(costs[:, 1:], xp.inf), costs[:, 1:])
        return starts, costs

    def _unknowns(self, distance: Array, forces: Array) -> Array:
        xp = namespace(forces)
        return xp.concat([distance[..., None], forces, xp.zeros_like(forces[..., :1])], -1)


def tried(frames: Frames, free: Free) -> Trials:
    """The grid's distances, each with its best force.

    For small deflections the picture is linear in the force once the distance is given, so force and rig are profiled
    out.
    """
    xp = namespace(frames.points)
    found = match(frames, free.view, free.feet_m)
    grid = like(frames.points, [NEAREST_TRIED + (1.0 - NEAREST_TRIED) * g / (GRID - 1) for g in range(GRID)])
    columns, felt = _forces(frames, free.view, grid)
    rig, rig_felt, misfit = free.table.nodes, free.table.readings, free.view.misfit[..., None]
    every = xp.arange(len(frames))
    weights = found.precision
    # a direction that neither picture nor reading holds is left near where it is
    likely = (frames.known.tip_per_force(grid) / LIKELY_SWAY) ** 2
    for _ in range(ROUNDS):
        summed = sums(found, weights, found.distance, columns.shape[1])
        towards = summed.times(columns)
        by_rig = rig.mT @ towards + rig_felt.mT @ felt
        within = rig.mT @ summed.times(rig) + rig_felt.mT @ rig_felt + frames.known.unit
        load = summed.load[..., None]
        taken = xp.linalg.solve(within, xp.concat([by_rig, rig.mT @ load + rig_felt.mT @ misfit], -1))
        pull = (columns.mT @ load + felt.mT @ misfit - by_rig.mT @ taken[..., -1:])[..., 0]
        forces, gains = _best_forces(columns, towards, felt, by_rig, taken[..., :-1], pull, likely)
        best = gains.argmax(-1)
        shift = (rig @ taken[..., -1:])[..., 0]
        for axis in (0, 1):
            column = columns[every, :, 2 * best + axis] - (rig @ taken[every, :, 2 * best + axis][..., None])[..., 0]
            shift = shift + forces[every, best, axis][:, None] * column
        left = (found.distance - found.between(shift)) * xp.sqrt(found.precision)
        weights = found.precision * huber_weights(left)
    return Trials(xp.broadcast_to(grid, gains.shape), forces, gains)


def _forces(frames: Frames, view: View, grid: Array) -> tuple[Array, Array]:
    """Columns (B, M, 2G) of unit forces y, z at each distance of the grid, and of the readings (B, 2, 2G)."""
    xp, known = namespace(grid), frames.known
    along = like(grid, aligned_arclength(grid[:1] * 0.0 + FREE, 1.0)[0])
    near, far = xp.minimum(along[:, None], grid), xp.maximum(along[:, None], grid)
    bent = (
        (3.0 * far - near) * near * near * (known.force_unit_N * known.length_m**3 / 6.0) / xp.exp(known.parameters[6])
    )
    columns = bent[:, :, None] * by_point(known, view)[:, :, None, 1:]
    lever = known.gain / known.std * known.force_unit_N * known.length_m
    zero = xp.zeros_like(grid)
    # about y the force's z is felt, about z its y
    felt = xp.stack([xp.stack([zero, grid * lever[0]], -1), xp.stack([grid * lever[1], zero], -1)], 0)
    felt = felt.reshape(2, -1) * frames.felt[..., None]
    return columns.reshape(len(frames), len(along), -1), felt


def _best_forces(
    columns: Array, towards: Array, felt: Array, by_rig: Array, taken: Array, pull: Array, likely: Array
) -> tuple[Array, Array]:
    """Best forces (B, G, 2) at each distance, and how much of the cost each takes away (B, G)."""
    xp = namespace(pull)
    batch = len(pull)

    def inner(a: Array, b: Array, first: int, second: int) -> Array:
        return (a[..., first::2] * b[..., second::2]).sum(1)

    def held(first: int, second: int) -> Array:
        data = inner(columns, towards, first, second) + inner(felt, felt, first, second)
        return data - inner(by_rig, taken, first, second)

    yy, yz, zz = held(0, 0), held(0, 1), held(1, 1)
    pull = pull.reshape(batch, -1, 2)
    y, z = pull[..., 0], pull[..., 1]
    yy, zz = yy * (1.0 + 1e-9) + likely, zz * (1.0 + 1e-9) + likely
    over = 1.0 / xp.clip(yy * zz - yz * yz, 1e-300, None)
    forces = xp.stack([(zz * y - yz * z) * over, (yy * z - yz * y) * over], -1)
    return forces, 0.5 * (forces * pull).sum(-1)
