"""The elastica at the nodes on which the antenna's equilibrium is computed: rotations about one axis."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import torch

from vbaa_calib.core.arrays import Array, like, namespace

from .nodes import grid_like
from .universal import SERIES_LOAD, SERIES_TERMS, angle_coefficients, universal_curve


@dataclass(frozen=True, eq=False)
class Hinge:
    """Rotations about z by angles (B, M), as their sine and cosine, and their slopes along the antenna."""

    sin: Array
    cos: Array
    curvature_per_m: Array

    def turned(self, vectors: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        """Components of H·v."""
        x, y, z = vectors
        return self.cos * x - self.sin * y, self.sin * x + self.cos * y, z

    def turned_back(self, vectors: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        """Components of Hᵀ·v."""
        x, y, z = vectors
        return self.cos * x + self.sin * y, self.cos * y - self.sin * x, z

    def at(self, node: int) -> Hinge:
        """At one node, M = 1."""
        one = slice(node, node + 1)
        return Hinge(self.sin[:, one], self.cos[:, one], self.curvature_per_m[:, one])


def elastica_hinge(contact_m: Array, force_per_m2: Array, lean_rad: Array | None) -> Hinge:
    """The elastica's rotations from the contact's section to those at the M nodes of `antenna.nodes`: −ψ.

    Parameters
    ----------
    contact_m : (B, 1) arc length of the contact.
    force_per_m2 : (B, 1) magnitude of the whole contact force over EI, not negative.
    lean_rad : (B,) its angle from the antenna's normal at the contact, see `elastica.planar_elastica`; None for 0.
    """
    xp = namespace(contact_m)
    load = force_per_m2 * contact_m**2
    large = load > SERIES_LOAD
    psi, slope = _by_series(xp.where(large, 0.0, load), lean_rad)
    if large.any():
        exact = _by_curve(xp.where(large, load, SERIES_LOAD), lean_rad)
        psi, slope = xp.where(large, exact[0], psi), xp.where(large, exact[1], slope)
    return Hinge(-xp.sin(psi), xp.cos(psi), slope * (force_per_m2 * contact_m))


def _by_series(load: Array, lean_rad: Array | None) -> tuple[Array, Array]:
    """ψ and θ′·EI/(F·l), each (B, M), for loads (B, 1) that the series serves."""
    powers = load ** like(load, np.arange(SERIES_TERMS))
    if lean_rad is not None:
        both = (powers * angle_coefficients(lean_rad)) @ _by_term_like(load, False)
    else:
        both = powers @ _by_term_like(load, True)
    nodes = both.shape[-1] // 2
    return load * both[:, :nodes], both[:, nodes:]


def _by_curve(load: Array, lean_rad: Array | None) -> tuple[Array, Array]:
    """The same for any load, by the universal curve; ψ′ = C cos α − S sin α."""
    xp = namespace(load)
    lean = xp.zeros_like(load[:, 0]) if lean_rad is None else lean_rad
    root = xp.sqrt(load)
    upsilon = root * (1.0 - grid_like(load).inner)
    psi, along, across = universal_curve(upsilon, lean)
    slope = along * xp.cos(lean)[:, None] - across * xp.sin(lean)[:, None]
    return psi, slope / root


def _by_term_like(values: Array, normal: bool) -> Array:
    return _by_term_of(values.dtype, values.device if namespace(values) is torch else None, normal)


@cache
def _by_term_of(dtype: Any, device: torch.device | None, normal: bool) -> Array:
    """(terms, 2·M): what each term of ψ's series adds to ψ and to θ′; for a force along the normal in full."""
    back = 1.0 - grid_like(np.empty(0)).inner
    power = 2.0 * np.arange(SERIES_TERMS)[:, None]
    table = np.concatenate([back ** (power + 2.0), (power + 2.0) * back ** (power + 1.0)], axis=-1)
    if normal:
        table = angle_coefficients(np.zeros(1)).T * table
    return table.astype(dtype) if device is None else torch.as_tensor(table, dtype=dtype, device=device)
