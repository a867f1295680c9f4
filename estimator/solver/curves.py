"""The antenna in the ideal picture, the plane one unit before the camera: cubics between its nodes.

Places along a curve are counted in nodes: 3.4 is four tenths of the way from node 3 to node 4. Nodes are equally spaced
on either side of the contact.
"""

from __future__ import annotations

from vbaa_calib.antenna.nodes import NODES_BEYOND, NODES_TO_CONTACT
from vbaa_calib.core.arrays import Array, namespace, take_rows

from .rig_arrays import RigArrays

INNER = NODES_TO_CONTACT - 1
LAST = INNER + NODES_BEYOND
"""The contact's node and the tip's."""
_NEAREST_DEPTH_M = 1e-4
"""Nodes nearer to the camera's plane than this, or behind it, are taken to lie there: their picture is far off."""


def spacing(contact_m: Array, length_m: float) -> tuple[Array, Array, Array]:
    """Contacts (B, 1), and the nodes' spacing before and beyond them."""
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


def evaluate_cubics(table: Array, row: Array, share: Array) -> list[tuple[Array, Array, Array]]:
    """Values, slopes and second slopes by the node (B, N) of D curves with coefficients (B, M, 4 D)."""
    size = table.shape[-1]
    columns = take_rows(table.reshape(-1, size), row).reshape(*share.shape, size)
    found = []
    for first in range(0, size, 4):
        c0, c1, c2, c3 = (columns[..., first + power] for power in range(4))
        rise = c3 * share
        value = ((rise + c2) * share + c1) * share + c0
        found.append((value, (3.0 * rise + 2.0 * c2) * share + c1, 6.0 * rise + 2.0 * c2))
    return found


def flat_rows(node: Array, count: int) -> Array:
    """(B·N,) rows of nodes (B, N) in arrays (B·count, ...)."""
    xp = namespace(node)
    return (node + (count * xp.cumsum(xp.ones_like(node[:, :1]), 0) - count)).reshape(-1)


def project(rig_arrays: RigArrays, points_m: Array, pose: int = 0) -> tuple[Array, Array, Array]:
    """Ideal image u, v and depth, (..., M) each, of antenna points (..., M, 3), by one of the rig's poses."""
    x, y, z = (points_m[..., axis] for axis in range(3))
    rotation, shift = rig_arrays.rotations[pose], rig_arrays.translations[pose]
    across, down, ahead = (
        row[0] * x + row[1] * y + (row[2] * z + move) for row, move in zip(rotation, shift, strict=True)
    )
    depth = namespace(ahead).clip(ahead, _NEAREST_DEPTH_M, None)
    return across / depth, down / depth, depth


def image_slopes(rig_arrays: RigArrays, tangents: Array, u: Array, v: Array, depth: Array) -> tuple[Array, Array]:
    """Slopes (..., M) of the image by arc length, of tangents (..., M, 3) at image points and depths (..., M)."""
    x, y, z = (tangents[..., axis] for axis in range(3))
    across, down, ahead = (row[0] * x + row[1] * y + row[2] * z for row in rig_arrays.rotations[0])
    return (across - u * ahead) / depth, (down - v * ahead) / depth


def dot(first: Array, second: Array) -> Array:
    """Inner products (...) of plane vectors (..., 2): far quicker than a sum over so short an axis."""
    return first[..., 0] * second[..., 0] + first[..., 1] * second[..., 1]
