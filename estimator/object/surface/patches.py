"""Patches: contacts that hang together and whose normals face alike."""

from __future__ import annotations

import numpy as np
from scipy.cluster.vq import kmeans2
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components, minimum_spanning_tree
from scipy.spatial.distance import cdist

_LINK_NORMALS_RAD = np.radians(50)  # neighbours whose normals differ by more lie on different sides of the object
_PATCH_NORMALS_RAD = np.radians(65)  # a patch is a height field: no normal may lean farther than this from its mean
# gaps up to so many times as wide as the usual ones are bridged, and those up to this fraction of all that was touched:
# dense tracks lie far apart, measured by their steps
LINK_FACTOR, _LINK_EXTENT = 3.0, 0.25
# so many neighbours, when they face alike within this, tell a contact's side: friction cancels in them
_NEIGHBOURS, _ALIKE_RAD = 8, np.radians(75)
# a patch is wide when its width stands out of the contacts' own spread this much, is at least this fraction of its
# length, and has at least so many contacts
_RESOLVED, _NARROW, _LEAST_TOUCHES = 4.0, 0.02, 4


def facing(force_N: np.ndarray, tangent: np.ndarray, points_m: np.ndarray) -> np.ndarray:
    """(P, 3) unit, roughly out of the object: the forces' directions across the antenna, averaged over neighbours.

    Averaging takes out friction where strokes go both ways. Where the tangent (P, 3) is NaN the force counts as it is.
    """
    along = np.where(np.isfinite(tangent), tangent, 0.0)
    across = force_N - np.sum(force_N * along, axis=1, keepdims=True) * along
    size, whole = np.linalg.norm(across, axis=1, keepdims=True), np.linalg.norm(force_N, axis=1, keepdims=True)
    single = np.where(size > 0.1 * whole, across / np.maximum(size, 1e-300), force_N / whole)
    near = np.argsort(cdist(points_m, points_m), axis=1, kind="stable")[:, :_NEIGHBOURS]
    alike = np.einsum("ni,nki->nk", single, single[near]) > np.cos(_ALIKE_RAD)
    mean = np.einsum("nk,nki->ni", alike.astype(float), single[near])
    return mean / np.linalg.norm(mean, axis=1, keepdims=True)


def group(points_m: np.ndarray, normals: np.ndarray) -> list[np.ndarray]:
    """Indices of points (P, 3) that hang together and whose normals (P, 3) face alike, for each group."""
    # 0 is no edge, and two contacts may coincide
    distance_m = np.maximum(cdist(points_m, points_m), 1e-12)
    graph = np.where(normals @ normals.T > np.cos(_LINK_NORMALS_RAD), distance_m, 0.0)
    gap_m = bridged_gap(minimum_spanning_tree(graph).data, float(np.linalg.norm(np.ptp(points_m, axis=0))))
    _, labels = connected_components(csr_array(graph * (graph <= gap_m)), directed=False)
    joined = (np.flatnonzero(labels == label) for label in range(labels.max() + 1))
    return [part for members in joined for part in _facing_alike(members, normals)]


def bridged_gap(gaps_m: np.ndarray, extent_m: float) -> float:
    """The widest gap that is bridged, from those of the points' minimum spanning tree and from their extent."""
    usual = float(np.percentile(gaps_m, 90)) if len(gaps_m) else 0.0
    return max(LINK_FACTOR * usual, _LINK_EXTENT * extent_m)


def tree_gaps(points: np.ndarray) -> np.ndarray:
    """(N − 1,) edges of the minimum spanning tree of points (N, D)."""
    return minimum_spanning_tree(np.maximum(cdist(points, points), 1e-12)).data


def _facing_alike(members: np.ndarray, normals: np.ndarray) -> list[np.ndarray]:
    """Split until no normal leans too far from the mean of its patch."""
    mean = normals[members].sum(axis=0)
    lean = normals[members] @ mean / max(np.linalg.norm(mean), 1e-12)
    if len(members) < 2 or lean.min() > np.cos(_PATCH_NORMALS_RAD):
        return [members]
    first = normals[members[np.argmin(lean)]]
    second = normals[members[np.argmin(normals[members] @ first)]]
    _, half = kmeans2(normals[members], np.stack([first, second]), minit="matrix")
    if half.min() == half.max():
        return [members]
    return [part for side in (0, 1) for part in _facing_alike(members[half == side], normals)]


def tangent_frame(points_m: np.ndarray, normals: np.ndarray, own_m2: np.ndarray) -> tuple[np.ndarray, np.ndarray, bool]:
    """Centre (3,) of a patch; rows (3, 3) its long direction, its short one, its mean normal; whether it is an area.

    Points (N, 3) count by how well they are known along the surface, and their own scatter (N, 3, 3) is taken off.
    """
    up = normals.sum(axis=0)
    up = up / np.linalg.norm(up)
    first = np.cross(up, np.eye(3)[np.argmin(np.abs(up))])
    first = first / np.linalg.norm(first)
    plane = np.stack([first, np.cross(up, first)])
    own = plane @ own_m2 @ plane.T
    variance = np.trace(own, axis1=1, axis2=2)
    weight = 1.0 / (variance + max(float(np.median(variance)), 1e-16))
    weight = weight / weight.sum()
    center = weight @ points_m
    flat = (points_m - center) @ plane.T
    spread, noise = np.einsum("n,ni,nj->ij", weight, flat, flat), np.einsum("n,nij->ij", weight, own)
    axes = np.linalg.eigh(spread - noise)[1].T[::-1]
    (length, width), scatter = np.einsum("ai,ij,aj->a", axes, spread, axes), float(axes[1] @ noise @ axes[1])
    wide = width > max(_RESOLVED**2 * scatter, _NARROW**2 * length, 1e-18) and len(points_m) >= _LEAST_TOUCHES
    along = axes[0] @ plane
    return center, np.stack([along, np.cross(up, along), up]), bool(wide)
