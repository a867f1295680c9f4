"""Where to begin: for each distance on a grid, the best force and the cost it explains, for small deflections."""

from __future__ import annotations

from dataclasses import dataclass

from vbaa_calib.antenna.linear import deflection
from vbaa_calib.antenna.nodes import aligned_arclength
from vbaa_calib.core.arrays import Array, arange_like, like, namespace
from vbaa_calib.core.robust import huber_weights

from .frames import Frames
from .prediction import LINEAR, Prediction, RigJacobian, point_jacobian, predict, rig_jacobian
from .residuals import NodeSums, PointResiduals, node_sums, residuals_along_chord
from .rig_arrays import TIP_DEFLECTION_STD

_GRID = 24
"""Distances, evenly from `_NEAREST` to the tip."""
_NEAREST = 0.05
_ROUNDS = 2
"""Reweightings of the points by the residuals of the best distance."""
_WARM_COST = 8.0
"""A start from the frame before is taken unless another distance explains the frame better by so much."""
_FREE = 0.5
"""The free antenna is a contact here without a force: it only places the nodes."""


@dataclass(frozen=True, eq=False)
class FreeAntenna:
    """The free antennas of B frames: predictions, their derivatives by the rig, and the points' residuals from them."""

    unknowns: Array
    prediction: Prediction
    by_rig: RigJacobian
    points: PointResiduals


def free_antenna(frames: Frames, rung: str) -> FreeAntenna:
    """The free antennas, with the rig's derivatives for small deflections."""
    xp = namespace(frames.points)
    unknowns = xp.zeros_like(frames.gravity_m_s2[:, :1]) + _FREE * frames.rig_arrays.unit_steps[1]
    prediction = predict(frames, rung, unknowns, derivatives=False)
    by_rig = rig_jacobian(frames, LINEAR, unknowns, prediction)
    return FreeAntenna(unknowns, prediction, by_rig, residuals_along_chord(frames, prediction))


@dataclass(frozen=True, eq=False)
class GridSearch:
    """Distances (B, G) of the grid, their best forces (B, G, 2), and the cost that each explains (B, G)."""

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
        minimum = (costs <= around[:, :-2]) & (costs <= around[:, 2:])
        costs = xp.where(minimum, costs, xp.full_like(costs, xp.inf))
        order = xp.argsort(costs, -1)[:, :count]
        every = arange_like(costs, len(costs))[:, None]
        return self._unknowns(*self._interpolated(every, order)), costs[every, order]

    def _interpolated(self, every: Array, order: Array) -> tuple[Array, Array]:
        """Distances (B, S) and forces (B, S, 2) at the minima of parabolas about grid indices (B, S)."""
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
        # the tip's deflection changes little from one distance to the next, the force much
        sway, sway_there = (
            self.forces[every, at] * _deflection_per_force(self.grid[every, at]) for at in (order, beside)
        )
        return distance, (sway + xp.abs(part)[..., None] * (sway_there - sway)) / _deflection_per_force(distance)

    def every(self, step: int) -> tuple[Array, Array]:
        """Unknowns (B, S, 4) at every `step`-th distance, and costs (B, S) of 0."""
        forces = self.forces[:, ::step]
        return self._unknowns(self.grid[:, ::step], forces), 0.0 * forces[..., 0]

    def warm_started(self, starts: Array, costs: Array, warm: Array) -> tuple[Array, Array]:
        """Starts and costs with warm ones (B, 4) alone where no other distance explains a frame much better."""
        xp = namespace(costs)
        beside = xp.argmin(xp.abs(self.grid - warm[:, :1]), -1)
        near = self.gains[arange_like(costs, len(costs)), beside]
        good = xp.isfinite(warm).all(-1) & (near > xp.amax(self.gains, -1) - _WARM_COST)
        starts, costs = starts + 0.0, costs + 0.0
        starts[:, 0] = xp.where(good[:, None], warm, starts[:, 0])
        costs[:, 1:] = xp.where(good[:, None], xp.full_like(costs[:, 1:], xp.inf), costs[:, 1:])
        return starts, costs

    def _unknowns(self, distance: Array, forces: Array) -> Array:
        xp = namespace(forces)
        # where no force could be fitted the free antenna is as good a start as any
        forces = xp.nan_to_num(forces, nan=0.0, posinf=0.0, neginf=0.0)
        return xp.concat([distance[..., None], forces, xp.zeros_like(forces[..., :1])], -1)


def grid_search(frames: Frames, free: FreeAntenna, points: PointResiduals) -> GridSearch:
    """The best force at each distance of the grid, for residuals from the free antennas.

    For small deflections the picture is linear in the force once the distance is given, so force and rig are profiled
    out. A force along y or z displaces the picture by one shape for all frames times `point_jacobian` of each frame, so
    that sums over nodes are matrix products with shapes.
    """
    xp = namespace(frames.points)
    grid = like(frames.points, [_NEAREST + (1.0 - _NEAREST) * g / (_GRID - 1) for g in range(_GRID)])
    unit_forces = _UnitForces.on_grid(frames, free, grid)
    every, weights = arange_like(points.distance, len(frames)), points.precision
    for _ in range(_ROUNDS):
        sums = node_sums(points, weights, points.distance, unit_forces.shape.shape[0])
        forces, gains, rig_steps = unit_forces.best(free, sums)
        best = gains.argmax(-1)
        shift = (free.by_rig.image @ rig_steps[2])[..., 0]
        for a in (0, 1):
            by_rig = (free.by_rig.image @ rig_steps[a][every, :, best][..., None])[..., 0]
            shift = shift + forces[every, best, a][:, None] * (
                unit_forces.image[a] * unit_forces.shape.mT[best] - by_rig
            )
        left = (points.distance - points.interpolate(shift)) * xp.sqrt(points.precision)
        weights = points.precision * huber_weights(left)
    return GridSearch(xp.broadcast_to(grid, gains.shape), forces, gains)


@dataclass(frozen=True, eq=False)
class _UnitForces:
    """Unit forces along y and z at each distance of the grid.

    Attributes
    ----------
    shape : (M, G) small deflections of the free antenna's nodes, m.
    image : two (B, M), the picture's displacement by a metre along y, and z.
    moment : two (B, 2, G), sensor response in deviations.
    prior : (G,) weight of the force's square. identity : (R, R).
    """

    shape: Array
    image: tuple[Array, Array]
    moment: tuple[Array, Array]
    prior: Array
    identity: Array

    @staticmethod
    def on_grid(frames: Frames, free: FreeAntenna, grid: Array) -> _UnitForces:
        """For frames and their free antennas, at distances (G,) in antenna lengths."""
        rig_arrays = frames.rig_arrays
        image = point_jacobian(rig_arrays, free.prediction)
        along = like(grid, aligned_arclength(grid[:1] * 0.0 + _FREE, 1.0)[0])
        shape = deflection(along[:, None], grid, rig_arrays.unit_load * rig_arrays.length_m, 1.0)
        moment = rig_arrays.moment_response(grid * (rig_arrays.force_unit_N * rig_arrays.length_m))
        available = frames.sensor_available[..., None]
        prior = (rig_arrays.tip_deflection(grid) / TIP_DEFLECTION_STD) ** 2
        moments = moment[..., 0] * available, moment[..., 1] * available
        return _UnitForces(shape, (image[..., 1], image[..., 2]), moments, prior, rig_arrays.identity)

    def best(self, free: FreeAntenna, sums: NodeSums) -> tuple[Array, Array, tuple[Array, Array, Array]]:
        """Best forces (B, G, 2), the cost that each explains (B, G), and the rig steps that go with unit forces along
        y and z (B, R, G) and with none (B, R, 1)."""
        # moments only: where the antenna ends may be wrong
        xp, image, moment = namespace(sums.load), free.by_rig.image, free.by_rig.reading[:, :2]
        residual, weighted = free.prediction.reading_residual[:, :2, None], sums.times(image)
        rig_information = image.mT @ weighted + moment.mT @ moment + self.identity
        crossed = [(weighted * self.image[a][..., None]).mT @ self.shape + moment.mT @ self.moment[a] for a in (0, 1)]
        rig_side = image.mT @ sums.load[..., None] + moment.mT @ residual
        solved = xp.linalg.solve(rig_information, xp.concat([*crossed, rig_side], -1))
        rig_steps = solved[..., :_GRID], solved[..., _GRID : 2 * _GRID], solved[..., 2 * _GRID :]
        yy, yz, zz = (
            _inner_product(sums, self.image[a], self.image[b], self.shape)
            + (self.moment[a] * self.moment[b]).sum(1)
            - (crossed[a] * rig_steps[b]).sum(1)
            for a, b in ((0, 0), (0, 1), (1, 1))
        )
        y, z = (
            (sums.load * self.image[a]) @ self.shape
            + (self.moment[a] * residual).sum(1)
            - (crossed[a].mT @ rig_steps[2])[..., 0]
            for a in (0, 1)
        )
        yy, zz = yy + self.prior, zz + self.prior
        over = 1.0 / xp.clip(yy * zz - yz * yz, 1e-300, None)
        forces = xp.stack([(zz * y - yz * z) * over, (yy * z - yz * y) * over], -1)
        return forces, 0.5 * (forces[..., 0] * y + forces[..., 1] * z), rig_steps


def _inner_product(sums: NodeSums, first: Array, second: Array, shape: Array) -> Array:
    """(B, G) weighted inner products of first·shape and second·shape, (B, M) times (M, G)."""
    own = (sums.diagonal * first * second) @ (shape * shape)
    mixed = sums.off_diagonal * (first[:, :-1] * second[:, 1:] + first[:, 1:] * second[:, :-1])
    return own + mixed @ (shape[:-1] * shape[1:])


def _deflection_per_force(distance: Array) -> Array:
    """(..., 1) how the tip's deflection by a unit force grows with the force's distance, in antenna lengths."""
    return (distance * distance * (3.0 - distance))[..., None]
