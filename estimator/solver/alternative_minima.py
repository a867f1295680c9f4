"""Other contacts that explain the same frames: kept, compared, and remembered."""

from __future__ import annotations

from dataclasses import dataclass

from vbaa_calib.core.arrays import Array, counted, like, namespace, places

from .convergence import settle
from .frames import Frames
from .prediction import RigTable
from .state import Settled, picked

SAME, SAME_FORCE = 1e-2, 0.05
"""Contacts closer than this, in antenna lengths and in parts of the force, are taken for the same."""
FAR_SIDES = (0.1, 0.3)
"""Deflections of the tip along the line of sight, in antenna lengths, from which other contacts are looked for."""
WEAK = 5.0
"""Readings that would change by less than so many deviations do not tell a contact from its mirror image."""


@dataclass(frozen=True, eq=False)
class Best:
    """The best fits to B frames so far, and the next best: its cost (B,), infinite without one, and unknowns (B, 4)."""

    fits: Settled
    rival_cost: Array
    rival_unknowns: Array

    @staticmethod
    def of(fits: Settled) -> Best:
        """Without rivals."""
        xp = namespace(fits.state.scatter)
        return Best(fits, xp.full_like(fits.state.scatter, xp.inf), fits.state.unknowns)

    @property
    def rival(self) -> Array:
        """(B,) how much more the next best costs."""
        return self.rival_cost - self.fits.plain_cost

    def beside(self, which: Array, *starts: Array) -> Best:
        """After a look, for some of the frames (B,), from other unknowns (B, 4), all at once."""
        if not bool(which.any()):
            return self
        xp = namespace(which)
        rows = places(which)
        frames = self.fits.frames.picked(xp.concat([rows] * len(starts)))
        others = settle(frames, self.fits.rung, xp.concat([start[rows] for start in starts]))
        best = self
        for number in range(len(starts)):
            part = counted(rows, len(rows)) + number * len(rows)
            best = best._against(rows, picked(others, part))
        return best

    def _against(self, rows: Array, others: Settled) -> Best:
        """With other fits to these rows: the better of each pair is kept, the other remembered if it is different."""
        xp = namespace(rows)
        mine, theirs = picked(self.fits.state, rows), others.state
        own, other = self.fits.plain_cost[rows], others.plain_cost
        better = theirs.converged & ((other < own) | ~mine.converged)
        apart = different(mine.unknowns, theirs.unknowns) & mine.converged & theirs.converged
        loser = xp.where(better, own, other)
        nearer = apart & (loser < self.rival_cost[rows])
        rival_cost, rival_unknowns = self.rival_cost + 0.0, self.rival_unknowns + 0.0
        rival_cost[rows] = xp.where(nearer, loser, rival_cost[rows])
        lost = xp.where(better[:, None], mine.unknowns, theirs.unknowns)
        rival_unknowns[rows] = xp.where(nearer[:, None], lost, rival_unknowns[rows])
        if not bool(better.any()):
            return Best(self.fits, rival_cost, rival_unknowns)
        return Best(self.fits.having(rows[better], picked(others, better)), rival_cost, rival_unknowns)


def different(first: Array, second: Array) -> Array:
    """(B,) whether unknowns (B, 4) are those of different contacts."""
    xp = namespace(first)
    gap, size = first[:, 1:3] - second[:, 1:3], first[:, 1:3]
    turned = xp.hypot(gap[:, 0], gap[:, 1]) > SAME_FORCE * xp.hypot(size[:, 0], size[:, 1])
    return (xp.abs(first[:, 0] - second[:, 0]) > SAME) | turned


def one_sided(frames: Frames, unknowns: Array, table: RigTable) -> Array:
    """(B,) frames whose readings do not tell contacts (B, 4) from their mirror images.

    The mirror is the plane through the antenna's x axis across the line of sight: small deflections before and behind
    it look alike, but for perspective.
    """
    known = frames.known
    along = _along_sight(frames, unknowns)
    # about y the force's z is felt, about z its y
    lever = known.force_unit_N * known.length_m * unknowns[:, :1] * known.gain / known.std
    xp = namespace(lever)
    # a reading is worth no more than what is known of its sensor
    doubt = xp.sqrt(1.0 + (table.readings * table.readings).sum(-1))
    change = xp.abs(2.0 * lever * along[:, [1, 0]]) * frames.felt / doubt
    return (change < WEAK).all(-1)


def other_sides(frames: Frames, unknowns: Array) -> list[Array]:
    """Contacts (B, 4) that may look like these: the mirror image, the least force that the picture asks for, and forces
    that bend the antenna far before and behind the mirror."""
    xp, known = namespace(unknowns), frames.known
    along = _along_sight(frames, unknowns)
    side = _to_camera(frames, unknowns) + 0.0 * along
    changes = [-2.0 * along, -along]
    for sway in (*FAR_SIDES, *(-far for far in FAR_SIDES)):
        changes.append(sway / known.tip_per_force(unknowns[:, :1]) * side - along)
    return [xp.concat([unknowns[:, :1], unknowns[:, 1:3] + change, unknowns[:, 3:]], -1) for change in changes]


def _to_camera(frames: Frames, unknowns: Array) -> Array:
    """(2,) unit direction across the antenna's x axis to the camera."""
    xp = namespace(unknowns)
    side = like(unknowns, frames.known.rig.T_antenna_camera.translation_m[1:])
    return side / xp.clip(xp.hypot(side[0], side[1]), 1e-12, None)


def _along_sight(frames: Frames, unknowns: Array) -> Array:
    """(B, 2) the lateral force's part along the direction to the camera."""
    side = _to_camera(frames, unknowns)
    return (unknowns[:, 1:3] @ side)[:, None] * side
