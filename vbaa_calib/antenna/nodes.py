"""Where an antenna's shape is computed and where it is given, and the matrices between the two.

Either side of the contact the shape is smooth, so it is computed at a few Chebyshev nodes on each and integrated as the
polynomial through them. The contact is a node of both sides, since forces jump there. It is given at the denser nodes
of `aligned_arclength`.
"""

from __future__ import annotations

import numpy as np
from numpy.polynomial import legendre

NODES_TO_CONTACT, NODES_BEYOND = 40, 17
CONTACT = NODES_TO_CONTACT - 1  # the contact's node
INNER_NODES, OUTER_NODES = 12, 8
"""Nodes at which the shape is computed, from the clamp to the contact and from there to the tip."""
INNER_CURVE = np.linspace(0.0, 1.0, NODES_TO_CONTACT)
OUTER_CURVE = np.linspace(0.0, 1.0, NODES_BEYOND + 1)[1:]
"""Nodes at which the shape is given, as fractions of the way from clamp to contact, and from there to the tip."""
NEAREST_TO_TIP = 1e-6  # contacts are kept this part of the length from the tip


def aligned_arclength(contact_m: np.ndarray, length_m: float) -> np.ndarray:
    """(B, N) nodes from the clamp to the tip, one of them at the contact: the shape is smooth on either side of it."""
    contact = contact_m[:, None]
    beyond = contact + (length_m - contact) * OUTER_CURVE
    return np.concatenate([contact * INNER_CURVE, beyond], -1)


def chebyshev(count: int) -> np.ndarray:
    """Chebyshev-Lobatto nodes (count,) from 0 to 1, ends included."""
    return np.asarray(np.sin(0.5 * np.pi * np.arange(count) / (count - 1)) ** 2)


def interpolation(nodes: np.ndarray, at: np.ndarray) -> np.ndarray:
    """(len(at), len(nodes)) from values at the nodes to those of the polynomial through them."""
    degree = len(nodes) - 1
    return _by_mode(legendre.legvander(2.0 * at - 1.0, degree), nodes)


def integration(nodes: np.ndarray, at: np.ndarray) -> np.ndarray:
    """(len(at), len(nodes)) from values at the nodes to the integral from 0 of the polynomial through them."""
    whole = legendre.legint(np.eye(len(nodes)), lbnd=-1.0, scl=0.5)
    return _by_mode(legendre.legval(2.0 * at - 1.0, whole).T, nodes)


def _by_mode(modes: np.ndarray, nodes: np.ndarray) -> np.ndarray:
    vandermonde = legendre.legvander(2.0 * nodes - 1.0, len(nodes) - 1)
    return np.ascontiguousarray(modes @ np.linalg.inv(vandermonde))
