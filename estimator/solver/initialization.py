"""Where to begin: the free antenna's picture says, for each distance on a grid, what the best force would explain."""

from __future__ import annotations

from dataclasses import dataclass

from vbaa_calib.antenna.linear import deflection
from vbaa_calib.antenna.nodes import aligned_arclength
from vbaa_calib.core.arrays import Array, counted, like, namespace
from vbaa_calib.core.robust import huber_weights

from .curves import cubic, cubics
from .frames import Frames
from .prediction import RigTable, View, by_point, look, rig_table
from .residuals import Match, Sums, along_chord, between_nodes, rows, sums
from .rig_arrays import LIKELY_SWAY, Known

GRID = 24
"""Distances tried, spread over the antenna."""
NEAREST_TRIED = 0.05
ROUNDS = 2
"""Reweightings of the points by what the best distance leaves of them."""
WARM_OBJECTION = 8.0
"""A start from the frame before is taken unless another distance explains the frame better by so much."""
FREE = 0.5
"""The free antenna's contact without a force: where its nodes lie."""


@dataclass(frozen=True, eq=False)
class Free:
    """The free antennas of B frames: their views, the rig's influence on them, and the points held against them."""

    unknowns: Array
    view: View
    table: RigTable
    found: Match


def free_antenna(frames: Frames, rung: str) -> Free:
    """The free antennas; the rig's influence on them is that of small deflections."""
    xp = namespace(frames.points)
    unknowns = xp.zeros_like(frames.gravity_m_s2[:, :1]) + FREE * frames.known.trials[1]
    view = look(frames, rung, unknowns, slopes=False)
    return Free(unknowns, view, rig_table(frames, "linear", unknowns, view), along_chord(frames, view))


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
        every = counted(costs, len(costs))[:, None]
        return self._unknowns(*self._between(every, order)), costs[every, order]

    def _between(self, every: Array, order: Array) -> tuple[Array, Array]:
        """Distances (B, S) and forces (B, S, 2) at the floors of parabolas about minima (B, S) of the grid."""
        xp, last = namespace(self.gains), self.gains.shape[1] - 1
        inside = xp.clip(order, 1, last - 1)
        before, there, after = (self.gains[every, inside + side] for side in (-1, 0, 1))
        bend = 2.0 * there - before - after
        part = xp.where((order == inside) & (bend > 0.0), 0.5 * (after - before) / bend, 0.0 * bend)
        part = xp.clip(xp.nan_to_num(part, nan=0.0), -0.5, 0.5)
        beside = xp.where(part < 0.0, inside - 1, inside + 1)
        beside = xp.where(order == inside, beside, order)
        here, there = self.grid[every, order], self.grid[every, beside]
        distance = here + xp.abs(part) * (there - here)
        # what the tip sways changes little from one distance to the next, the force much
        sway, sway_there = (self.forces[every, at] * _sway(self.grid[every, at]) for at in (order, beside))
        return distance, (sway + xp.abs(part)[..., None] * (sway_there - sway)) / _sway(distance)

    def spread(self, every: int) -> tuple[Array, Array]:
        """Unknowns (B, S, 4) at every so manieth distance, and costs (B, S) of 0."""
        forces = self.forces[:, ::every]
        return self._unknowns(self.grid[:, ::every], forces), 0.0 * forces[..., 0]

    def warmed(self, starts: Array, costs: Array, warm: Array) -> tuple[Array, Array]:
        """Starts and costs with warm ones (B, 4) alone where no other distance explains a frame much better."""
        xp = namespace(costs)
        beside = xp.argmin(xp.abs(self.grid - warm[:, :1]), -1)
        near = self.gains[counted(costs, len(costs)), beside]
        good = xp.isfinite(warm).all(-1) & (near > xp.amax(self.gains, -1) - WARM_OBJECTION)
        starts, costs = starts + 0.0, costs + 0.0
        starts[:, 0] = xp.where(good[:, None], warm, starts[:, 0])
        costs[:, 1:] = xp.where(good[:, None], xp.full_like(costs[:, 1:], xp.inf), costs[:, 1:])
        return starts, costs

    def _unknowns(self, distance: Array, forces: Array) -> Array:
        xp = namespace(forces)
        # where nothing could be tried the free antenna is as good a start as any
        forces = xp.nan_to_num(forces, nan=0.0, posinf=0.0, neginf=0.0)
        return xp.concat([distance[..., None], forces, xp.zeros_like(forces[..., :1])], -1)


def tried(frames: Frames, free: Free, found: Match) -> Trials:
    """The grid's distances, each with its best force, for the points that were found off the free antennas.

    For small deflections the picture is linear in the force once the distance is given, so force and rig are profiled
    out. A force along y or z displaces the picture by one shape for all frames times `by_point` of each frame, so that
    sums over nodes are matrix products with shapes.
    """
    xp = namespace(frames.points)
    grid = like(frames.points, [NEAREST_TRIED + (1.0 - NEAREST_TRIED) * g / (GRID - 1) for g in range(GRID)])
    pushes = _Pushes.of(frames, free, grid)
    every, weights = counted(found.distance, len(frames)), found.precision
    for _ in range(ROUNDS):
        summed = sums(found, weights, found.distance, pushes.shape.shape[0])
        forces, gains, by_rig = pushes.best(free, summed)
        best = gains.argmax(-1)
        shift = (free.table.nodes @ by_rig[2])[..., 0]
        for a in (0, 1):
            taken = (free.table.nodes @ by_rig[a][every, :, best][..., None])[..., 0]
            shift = shift + forces[every, best, a][:, None] * (pushes.sides[a] * pushes.shape.mT[best] - taken)
        left = (found.distance - found.between(shift)) * xp.sqrt(found.precision)
        weights = found.precision * huber_weights(left)
    return Trials(xp.broadcast_to(grid, gains.shape), forces, gains)


@dataclass(frozen=True, eq=False)
class _Pushes:
    """Unit forces along y and z at each distance of the grid.

    Attributes
    ----------
    shape : (M, G) small deflections of the free antenna's nodes, m. sides : two (B, M), the picture's displacement by a
    metre along y, and z. felt : two (B, 2, G), what the sensors feel, in deviations. likely : (G,) weight of the
    force's square: a direction that neither picture nor reading holds is left near where it is. unit : (R, R).
    """

    shape: Array
    sides: tuple[Array, Array]
    felt: tuple[Array, Array]
    likely: Array
    unit: Array

    @staticmethod
    def of(frames: Frames, free: Free, grid: Array) -> _Pushes:
        """For frames and their free antennas, at distances (G,) in antenna lengths."""
        known, across = frames.known, by_point(frames.known, free.view)
        likely = (known.tip_per_force(grid) / LIKELY_SWAY) ** 2
        return _Pushes(_shapes(known, grid), (across[..., 1], across[..., 2]), _felt(frames, grid), likely, known.unit)

    def best(self, free: Free, summed: Sums) -> tuple[Array, Array, tuple[Array, Array, Array]]:
        """Best forces (B, G, 2), what each takes off the cost (B, G), and the rig steps that go with unit forces along
        y and z (B, R, G) and with none (B, R, 1)."""
        xp, rig, rig_felt = namespace(summed.load), free.table.nodes, free.table.readings
        misfit, towards = free.view.misfit[..., None], summed.times(rig)
        within = rig.mT @ towards + rig_felt.mT @ rig_felt + self.unit
        crossed = [(towards * self.sides[a][..., None]).mT @ self.shape + rig_felt.mT @ self.felt[a] for a in (0, 1)]
        rig_pull = rig.mT @ summed.load[..., None] + rig_felt.mT @ misfit
        taken = xp.linalg.solve(within, xp.concat([*crossed, rig_pull], -1))
        by_rig = taken[..., :GRID], taken[..., GRID : 2 * GRID], taken[..., 2 * GRID :]
        held = [
            _product(summed, self.sides[a], self.sides[b], self.shape)
            + (self.felt[a] * self.felt[b]).sum(1)
            - (crossed[a] * by_rig[b]).sum(1)
            for a, b in ((0, 0), (0, 1), (1, 1))
        ]
        pull = [
            (summed.load * self.sides[a]) @ self.shape
            + (self.felt[a] * misfit).sum(1)
            - (crossed[a].mT @ by_rig[2])[..., 0]
            for a in (0, 1)
        ]
        forces, gains = _best_forces(held[0] + self.likely, held[1], held[2] + self.likely, *pull)
        return forces, gains, by_rig


def _shapes(known: Known, grid: Array) -> Array:
    """(M, G) small deflections of the free antenna's nodes under a unit force at each distance of the grid, m."""
    along = like(grid, aligned_arclength(grid[:1] * 0.0 + FREE, 1.0)[0])
    return deflection(along[:, None], grid, known.load * known.length_m, 1.0)


def _felt(frames: Frames, grid: Array) -> tuple[Array, Array]:
    """What the sensors feel, (B, 2, G) in deviations, of unit forces along y, and along z, at each distance."""
    known = frames.known
    felt = known.felt_by(grid * (known.force_unit_N * known.length_m))
    return felt[..., 0] * frames.felt[..., None], felt[..., 1] * frames.felt[..., None]


def _product(summed: Sums, first: Array, second: Array, shape: Array) -> Array:
    """(B, G) inner products of first·shape and second·shape, (B, M) times (M, G), over the points."""
    own = (summed.diagonal * first * second) @ (shape * shape)
    mixed = summed.beside * (first[:, :-1] * second[:, 1:] + first[:, 1:] * second[:, :-1])
    return own + mixed @ (shape[:-1] * shape[1:])


def _sway(distance: Array) -> Array:
    """(..., 1) by which the tip's deflection by a unit force grows with the force's distance, in antenna lengths."""
    return (distance * distance * (3.0 - distance))[..., None]


def _best_forces(yy: Array, yz: Array, zz: Array, y: Array, z: Array) -> tuple[Array, Array]:
    """Best forces (B, G, 2) at each distance, and how much of the cost each takes away (B, G)."""
    xp = namespace(y)
    over = 1.0 / xp.clip(yy * zz - yz * yz, 1e-300, None)
    forces = xp.stack([(zz * y - yz * z) * over, (yy * z - yz * y) * over], -1)
    return forces, 0.5 * (forces[..., 0] * y + forces[..., 1] * z)
