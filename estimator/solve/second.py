"""Is there a second contact? What another force elsewhere would still explain."""

from __future__ import annotations

from vbaa_calib.antenna.shape import aligned_arclength
from vbaa_calib.arrays import Array, like, namespace

from .match import sums
from .normal import huber_weights
from .settle import Settled
from .view import by_point

GRID = 16
"""Places tried for another force, evenly over the antenna."""


def second_force(fits: Settled) -> tuple[Array, Array]:
    """(B,) how much of the cost the best second force takes away, and its place (B,) in antenna lengths.

    A score test: the force's small deflection, with all that the first contact and the rig can do about it taken out.
    """
    xp, known, about = namespace(fits.state.scatter), fits.frames.known, fits.problem
    places = like(about.scatter, [(g + 1.0) / GRID for g in range(GRID)])
    along = aligned_arclength(xp.clip(fits.view.contact_m / known.length_m, None, 1.0 - 1e-6), 1.0)
    near, far = xp.minimum(along[..., None], places), xp.maximum(along[..., None], places)
    # scaled to a like size at the tip
    bent = (3.0 * far - near) * near * near / (places * places * (3.0 - places))
    columns = (bent[..., None] * by_point(known, fits.view)[:, :, None, 1:]).reshape(*along.shape, 2 * GRID)
    weights = huber_weights(about.whitened(about.found.distance)) * about.found.precision / about.scatter[:, None] ** 2
    summed = sums(about.found, weights, about.found.distance, along.shape[1])
    towards = summed.times(columns)
    crossed = about.columns.mT @ towards
    pull = (columns.mT @ summed.load[..., None])[..., 0]
    taken = xp.linalg.solve(fits.equations.information, crossed)

    def inner(first: int, second: int) -> Array:
        own = (columns[..., first::2] * towards[..., second::2]).sum(1)
        return own - (crossed[..., first::2] * taken[..., second::2]).sum(1)

    yy, yz, zz = inner(0, 0), inner(0, 1), inner(1, 1)
    y, z = pull[:, 0::2], pull[:, 1::2]
    # directions along the line of sight, and what the first contact does as well, hold nothing
    floor = 1e-6 * (columns * towards).sum(1).reshape(len(pull), GRID, 2).sum(-1) + 1e-30
    trace, determinant = yy + zz, yy * zz - yz * yz
    larger = 0.5 * trace + xp.sqrt(xp.clip(0.25 * trace * trace - determinant, 0.0, None))
    full = determinant > floor * larger
    both = 0.5 * (zz * y * y - 2.0 * yz * y * z + yy * z * z) / xp.where(full, determinant, 1.0)
    # with one direction held, the gain along it
    along_y, along_z = xp.where(yy > zz, larger - zz, yz), xp.where(yy > zz, yz, larger - yy)
    length = along_y * along_y + along_z * along_z
    one = 0.5 * (along_y * y + along_z * z) ** 2 / xp.clip(length * larger, 1e-300, None)
    gain = xp.where(full, both, xp.where(larger > floor, one, xp.zeros_like(one)))
    best = gain.argmax(-1)
    return gain[xp.arange(len(gain)), best], places[best]
