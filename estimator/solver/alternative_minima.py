"""Other contacts that explain the same frames: searched, compared, and remembered."""

from __future__ import annotations

from dataclasses import dataclass

from vbaa_calib.core.arrays import Array, arange_like, like, namespace, true_indices

from .convergence import converge
from .frames import Frames
from .prediction import RigJacobian
from .rows import select
from .state import Fits

_SAME_DISTANCE, _SAME_FORCE = 1e-2, 0.05
"""Contacts closer than this, in antenna lengths and in parts of the force, are taken for the same."""
_LARGE_DEFLECTIONS = (0.1, 0.3, -0.1, -0.3)
"""Deflections of the tip along the line of sight, in antenna lengths, from which other contacts are searched."""
_DISTINGUISHABLE = 5.0
"""Moments that differ by fewer deviations do not distinguish a contact from its mirror image."""


@dataclass(frozen=True, eq=False)
class BestFits:
    """The best fits to B frames so far, and the next best: its cost (B,), infinite without one, and unknowns (B, 4)."""

    fits: Fits
    other_cost: Array
    other_unknowns: Array

    @staticmethod
    def only(fits: Fits) -> BestFits:
        """Without alternatives."""
        return BestFits(
            fits, namespace(fits.state.scatter).full_like(fits.state.scatter, float("inf")), fits.state.unknowns
        )

    @property
    def extra_cost(self) -> Array:
        """(B,) how much more the next best costs."""
        return self.other_cost - self.fits.unscaled_cost

    def try_starts(self, which: Array, *starts: Array) -> BestFits:
        """After fits, for some of the frames (B,), from other unknowns (B, 4), all at once."""
        if not bool(which.any()):
            return self
        xp = namespace(which)
        rows = true_indices(which)
        frames = select(self.fits.frames, xp.concat([rows] * len(starts)))
        others = converge(frames, self.fits.rung, xp.concat([start[rows] for start in starts]))
        best = self
        for number in range(len(starts)):
            part = arange_like(rows, len(rows)) + number * len(rows)
            best = best._compared(rows, select(others, part))
        return best

    def _compared(self, rows: Array, others: Fits) -> BestFits:
        """With other fits to these rows: the better of each pair is kept, the other remembered if it is different."""
        xp = namespace(rows)
        mine, theirs = select(self.fits.state, rows), others.state
        own, other = self.fits.unscaled_cost[rows], others.unscaled_cost
        better = theirs.converged & ((other < own) | ~mine.converged)
        apart = different(mine.unknowns, theirs.unknowns) & mine.converged & theirs.converged
        loser = xp.where(better, own, other)
        nearer = apart & (loser < self.other_cost[rows])
        other_cost, other_unknowns = self.other_cost + 0.0, self.other_unknowns + 0.0
        other_cost[rows] = xp.where(nearer, loser, other_cost[rows])
        lost = xp.where(better[:, None], mine.unknowns, theirs.unknowns)
        other_unknowns[rows] = xp.where(nearer[:, None], lost, other_unknowns[rows])
        if not bool(better.any()):
            return BestFits(self.fits, other_cost, other_unknowns)
        return BestFits(self.fits.with_rows(rows[better], select(others, better)), other_cost, other_unknowns)


def different(first: Array, second: Array) -> Array:
    """(B,) whether unknowns (B, 4) are those of different contacts."""
    xp = namespace(first)
    gap, size = first[:, 1:3] - second[:, 1:3], first[:, 1:3]
    turned = xp.hypot(gap[:, 0], gap[:, 1]) > _SAME_FORCE * xp.hypot(size[:, 0], size[:, 1])
    return (xp.abs(first[:, 0] - second[:, 0]) > _SAME_DISTANCE) | turned


def mirror_ambiguous(frames: Frames, unknowns: Array, by_rig: RigJacobian) -> Array:
    """(B,) frames whose moments do not distinguish contacts (B, 4) from their mirror images.

    The mirror is the plane through the antenna's x axis across the line of sight: small deflections before and behind
    it look alike, but for perspective.
    """
    rig_arrays = frames.rig_arrays
    along = _along_line_of_sight(frames, unknowns)
    # the sensor about y responds to f_z, the one about z to f_y
    response = rig_arrays.force_unit_N * rig_arrays.length_m * unknowns[:, :1] * rig_arrays.gain / rig_arrays.std
    std = namespace(response).sqrt(1.0 + (by_rig.reading[:, :2] ** 2).sum(-1))  # noise and calibration
    change = abs(2.0 * response * along[:, [1, 0]]) * frames.sensor_available / std
    return (change < _DISTINGUISHABLE).all(-1)


def mirror_starts(frames: Frames, unknowns: Array) -> list[Array]:
    """Contacts (B, 4) that may look like these: the mirror image, the least force that the picture asks for, and forces
    that bend the antenna far before and behind the mirror."""
    xp, rig_arrays = namespace(unknowns), frames.rig_arrays
    along = _along_line_of_sight(frames, unknowns)
    side = _to_camera(frames, unknowns) + 0.0 * along
    changes = [-2.0 * along, -along]
    for sway in _LARGE_DEFLECTIONS:
        changes.append(sway / rig_arrays.tip_deflection(unknowns[:, :1]) * side - along)
    return [xp.concat([unknowns[:, :1], unknowns[:, 1:3] + change, unknowns[:, 3:]], -1) for change in changes]


def _to_camera(frames: Frames, unknowns: Array) -> Array:
    """(2,) unit direction across the antenna's x axis to the camera."""
    xp = namespace(unknowns)
    side = like(unknowns, frames.rig_arrays.rig.T_antenna_camera.translation_m[1:])
    return side / xp.clip(xp.hypot(side[0], side[1]), 1e-12, None)


def _along_line_of_sight(frames: Frames, unknowns: Array) -> Array:
    """(B, 2) the lateral force's part along the direction to the camera."""
    side = _to_camera(frames, unknowns)
    return (unknowns[:, 1:3] @ side)[:, None] * side
