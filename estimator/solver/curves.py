"""The antenna in the ideal picture, the plane one unit before the camera."""

from __future__ import annotations

from vbaa_calib.antenna.nodes import NODES_BEYOND, NODES_TO_CONTACT
from vbaa_calib.core.arrays import Array, namespace, taken

from .rig_arrays import Known

INNER = NODES_TO_CONTACT - 1
LAST = INNER + NODES_BEYOND
"""The contact's node and the tip's."""


def spacing(contact_m: Array, length_m: float) -> tuple[Array, Array, Array]:
    """Arc length of contacts (B,) as (B, 1), and the nodes' spacing before and beyond them: they are equally spaced."""
    contact = contact_m[:, None]
    return contact, contact / INNER, (length_m - contact) / NODES_BEYOND


def cubics(values: Array, slopes: Array, contact_m: Array, length_m: float) -> Array:
    """Coefficients (B, M, 4 D) from values and slopes by arc length (B, M, D) on the nodes; the tip's are not used."""
    xp = namespace(values)
    _, inner, outer = spacing(contact_m, length_m)
    width = xp.concat(
        [xp.broadcast_to(inner, (len(inner), INNER)), xp.broadcast_to(outer, (len(outer), NODES_BEYOND))], 1
    )
    start, end = values[:, :-1], values[:, 1:]
    leave, arrive = slopes[:, :-1] * width[..., None], slopes[:, 1:] * width[..., None]
    gap = end - start
    table = xp.stack([start, leave, 3.0 * gap - 2.0 * leave - arrive, leave + arrive - 2.0 * gap], -1)
    table = table.reshape(*table.shape[:2], -1)
    return xp.concat([table, table[:, -1:]], 1)


def cubic(table: Array, row: Array, share: Array) -> list[tuple[Array, Array, Array]]:
    """Values, slopes and second slopes by the node (B, N) of D curves with coefficients (B, M, 4 D)."""
    size = table.shape[-1]
    columns = taken(table.reshape(-1, size), row).reshape(*share.shape, size)
    found = []
    for first in range(0, size, 4):
        c0, c1, c2, c3 = (columns[..., first + power] for power in range(4))
        rise = c3 * share
        value = ((rise + c2) * share + c1) * share + c0
        found.append((value, (3.0 * rise + 2.0 * c2) * share + c1, 6.0 * rise + 2.0 * c2))
    return found


NEAREST_DEPTH_M = 1e-4
"""Nodes nearer to the camera's plane than this, or behind it, are taken to lie there: their picture is far off."""


def project(known: Known, points_m: Array, pose: int = 0) -> tuple[Array, Array, Array]:
    """Ideal image u, v and depth, (..., M) each, of antenna points (..., M, 3), by one of the known poses."""
    x, y, z = (points_m[..., axis] for axis in range(3))
    rotation, shift = known.rotations[pose], known.translations[pose]
    across, down, ahead = (
        row[0] * x + row[1] * y + (row[2] * z + move) for row, move in zip(rotation, shift, strict=True)
    )
    depth = namespace(ahead).clip(ahead, NEAREST_DEPTH_M, None)
    return across / depth, down / depth, depth


def image_slopes(known: Known, tangents: Array, u: Array, v: Array, depth: Array) -> tuple[Array, Array]:
    """Slopes (..., M) of the image by arc length, of tangents (..., M, 3) at image points and depths (..., M)."""
    x, y, z = (tangents[..., axis] for axis in range(3))
    across, down, ahead = (row[0] * x + row[1] * y + row[2] * z for row in known.rotations[0])
    return (across - u * ahead) / depth, (down - v * ahead) / depth


def dot(first: Array, second: Array) -> Array:
    """Inner products (...) of plane vectors (..., 2): far quicker than a sum over so short an axis."""
    return first[..., 0] * second[..., 0] + first[..., 1] * second[..., 1]
