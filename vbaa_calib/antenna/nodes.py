"""Where an antenna's shape is computed and where it is given, and the matrices between the two.

Either side of the contact the shape is smooth, so it is computed at a few Chebyshev nodes on each and integrated as the
polynomial through them. The contact is a node of both sides, since forces jump there. It is given at the denser nodes
of `aligned_arclength`. Fields are rows (..., M); a matrix on their right integrates or interpolates them.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import torch
from numpy.polynomial import legendre

from vbaa_calib.core.arrays import Array, like, namespace

NODES_TO_CONTACT, NODES_BEYOND = 40, 17
CONTACT = NODES_TO_CONTACT - 1
"""The contact's node."""
INNER_NODES, _OUTER_NODES = 12, 8
"""Nodes at which the shape is computed, from the clamp to the contact and from there to the tip."""


@dataclass(frozen=True, eq=False)
class _Grid:
    """M = INNER_NODES + _OUTER_NODES nodes and the N of `aligned_arclength`, as fractions, and what leads from f to g.

    Attributes
    ----------
    inner, outer : (M,) fraction of the way from clamp to contact, and from there to the tip. What lies inside the
        contact has outer 0, what lies beyond it inner 1.
    before : (M,) 1 up to the contact, 0 beyond it.
    from_contact, from_tip : (M, M) from f times its side's length to ∫ f ds at the M nodes, from the contact to s and
        from s to the tip.
    curve_inner, curve_outer : (N,) as inner and outer, for the N nodes.
    to_curve : (M, N) from f times its side's length to ∫₀ˢ f ds at the N nodes.
    at_curve : (M, N) from f to f at the N nodes.
    """

    inner: Array
    outer: Array
    before: Array
    from_contact: Array
    from_tip: Array
    curve_inner: Array
    curve_outer: Array
    to_curve: Array
    at_curve: Array


def on_shaft(contact_m: Array, length_m: float) -> Array:
    """Contacts (B,) kept from the very tip, which would leave nothing beyond them: a micrometre in a metre."""
    return namespace(contact_m).clip(contact_m, None, (1.0 - 1e-6) * length_m)


def aligned_arclength(contact_m: Array, length_m: float) -> Array:
    """(B, N) nodes from the clamp to the tip, one of them at the contact: the shape is smooth on either side of it."""
    grid = grid_like(contact_m)
    return contact_m[:, None] * grid.curve_inner + (length_m - contact_m[:, None]) * grid.curve_outer


def grid_like(values: Array) -> _Grid:
    """The grid in the kind, dtype and device of these values."""
    if namespace(values) is torch:
        return _grid_of(values.dtype, values.device)
    return _grid_of(values.dtype, None)


@cache
def _grid_of(dtype: Any, device: torch.device | None) -> _Grid:
    reference = np.empty(0, dtype) if device is None else torch.empty(0, dtype=dtype, device=device)
    return _Grid(**{name: like(reference, table) for name, table in vars(_grid()).items()})


@cache
def _grid() -> _Grid:
    inner, outer = _chebyshev(INNER_NODES), _chebyshev(_OUTER_NODES)
    curve_inner, curve_outer = np.linspace(0.0, 1.0, NODES_TO_CONTACT), np.linspace(0.0, 1.0, NODES_BEYOND + 1)[1:]
    from_clamp = _cumulative(inner, outer, inner, outer)
    return _Grid(
        inner=np.concatenate([inner, np.ones(_OUTER_NODES)]),
        outer=np.concatenate([np.zeros(INNER_NODES), outer]),
        before=np.concatenate([np.ones(INNER_NODES), np.zeros(_OUTER_NODES)]),
        from_contact=from_clamp - from_clamp[:, INNER_NODES - 1 : INNER_NODES],
        from_tip=from_clamp[:, -1:] - from_clamp,
        curve_inner=np.concatenate([curve_inner, np.ones(NODES_BEYOND)]),
        curve_outer=np.concatenate([np.zeros(NODES_TO_CONTACT), curve_outer]),
        to_curve=_cumulative(inner, outer, curve_inner, curve_outer),
        at_curve=_interpolated(inner, outer, curve_inner, curve_outer),
    )


def _chebyshev(count: int) -> np.ndarray:
    """Chebyshev-Lobatto nodes (count,) from 0 to 1, ends included."""
    return np.sin(0.5 * np.pi * np.arange(count) / (count - 1)) ** 2


def _cumulative(inner: np.ndarray, outer: np.ndarray, at_inner: np.ndarray, at_outer: np.ndarray) -> np.ndarray:
    """From values at both sides' nodes to integrals from the clamp: inside the contact, then beyond it."""
    inside, whole = _integrals(inner, at_inner), _integrals(inner, np.ones(1))
    beyond = np.repeat(whole, len(at_outer), axis=0)
    return np.block([[inside, np.zeros((len(at_inner), len(outer)))], [beyond, _integrals(outer, at_outer)]]).T


def _interpolated(inner: np.ndarray, outer: np.ndarray, at_inner: np.ndarray, at_outer: np.ndarray) -> np.ndarray:
    """From values at both sides' nodes to values at others."""
    inside, beyond = _values(inner, at_inner), _values(outer, at_outer)
    zeros = np.zeros((len(at_inner), len(outer))), np.zeros((len(at_outer), len(inner)))
    return np.block([[inside, zeros[0]], [zeros[1], beyond]]).T


def _values(nodes: np.ndarray, at: np.ndarray) -> np.ndarray:
    """(len(at), len(nodes)) value of the polynomial through the nodes."""
    degree = len(nodes) - 1
    return legendre.legvander(2.0 * at - 1.0, degree) @ np.linalg.inv(legendre.legvander(2.0 * nodes - 1.0, degree))


def _integrals(nodes: np.ndarray, at: np.ndarray) -> np.ndarray:
    """(len(at), len(nodes)) integral from 0 of the polynomial through the nodes."""
    degree = len(nodes) - 1
    by_mode = legendre.legval(2.0 * at - 1.0, legendre.legint(np.eye(degree + 1), lbnd=-1.0, scl=0.5)).T
    return by_mode @ np.linalg.inv(legendre.legvander(2.0 * nodes - 1.0, degree))
