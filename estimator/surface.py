"""The object's surface from where it was touched: contact points, shifted onto the object, grouped, smoothed, joined.

A first surface, drawn only as far as the contacts carry it: nothing is closed, extended or guessed between patches.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.cluster.vq import kmeans2
from scipy.interpolate import RBFInterpolator
from scipy.optimize import minimize_scalar
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components, minimum_spanning_tree
from scipy.spatial import Delaunay, QhullError
from scipy.spatial.distance import cdist

from vbaa_calib.errors import InputError

from .table import ContactTable

MAX_POINTS = 500
"""More contacts are thinned evenly: smoothing costs their number cubed."""
LINK_NORMALS_RAD = np.radians(50)
"""Neighbours whose normals differ by more than this lie on different sides of the object."""
PATCH_NORMALS_RAD = np.radians(65)
"""A patch is a height field over its tangent plane: no normal may lean farther than this from its mean."""
LINK_FACTOR = 3.0
"""Gaps up to this many times as wide as the usual ones are bridged ..."""
LINK_EXTENT = 0.25
"""... and those up to this fraction of all that was touched: dense tracks lie far apart, measured by their steps."""
TRIANGLE_FACTOR = 2.5
"""Triangles are kept while edges and circumscribed circle stay within this many median edges."""
RESOLVED = 2.0
"""A patch counts as wide when its width stands out of the contacts' own spread this much; else it is a line."""
NARROW = 0.02
"""... and when it is at least this fraction of its length."""


@dataclass(frozen=True, eq=False)
class Surface:
    """The touched part of the object, world frame.

    Attributes
    ----------
    points_m : (P, 3) on the object, one per used contact.
    normals : (P, 3) unit, out of the object; the force's direction, so within the friction cone of the true normal.
    triangles : (T, 3) indices, counter-clockwise seen from outside; T = 0 where the contacts span no area.
    lines : (E, 2) indices of successive contacts of the patches that are lines.
    patch : (P,) which patch a point belongs to.
    std_m : (P,) standard deviation of a point along its normal, after smoothing; NaN where the contact gives none.
    force_N : (P,) size of the force that was felt there.
    frame : (P,) the frame it comes from.
    notes : what a reader of the surface must know, in words.
    """

    points_m: np.ndarray
    normals: np.ndarray
    triangles: np.ndarray
    lines: np.ndarray
    patch: np.ndarray
    std_m: np.ndarray
    force_N: np.ndarray
    frame: np.ndarray
    notes: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class _Patch:
    """Points (N, 3) after smoothing, standard deviations (N,), triangles (T, 3) and lines (E, 2) by local index."""

    points_m: np.ndarray
    std_m: np.ndarray
    triangles: np.ndarray
    lines: np.ndarray


def reconstruct(table: ContactTable, antenna_radius_m: float) -> Surface:
    """The first surface.

    Parameters
    ----------
    table : the contacts of one object that did not move.
    antenna_radius_m : the contact points lie on the centreline, the object one radius away, against its force.

    Raises
    ------
    InputError : no frame has a contact point with its force.
    """
    force = table.force_world_N
    used = np.flatnonzero(table.located & (np.linalg.norm(force, axis=1) > 0))
    if not len(used):
        raise InputError(
            "no frame has a located contact with a force in the world frame (status ok or tip_contact, FX_N to FZ_N)",
            remedy="record contacts, or see the reason column of contacts.csv",
        )
    notes = []
    if len(used) > MAX_POINTS:
        notes.append(f"{len(used)} contacts were thinned evenly to {MAX_POINTS}")
        used = used[np.round(np.linspace(0, len(used) - 1, MAX_POINTS)).astype(int)]
    size = np.linalg.norm(force[used], axis=1)
    normals = force[used] / size[:, None]
    points = table.point_world_m[used] - antenna_radius_m * normals
    covariance = table.covariance_world_m2[used]

    patch = group(points, normals)
    smoothed, std = points.copy(), np.full(len(points), np.nan)
    triangles, lines = [np.empty((0, 3), int)], [np.empty((0, 2), int)]
    for index in range(patch.max() + 1):
        members = np.flatnonzero(patch == index)
        part = _patch(points[members], normals[members], covariance[members])
        smoothed[members], std[members] = part.points_m, part.std_m
        triangles.append(members[part.triangles])
        lines.append(members[part.lines])
    thin = [int(np.sum(patch == index)) for index, part in enumerate(triangles[1:]) if not len(part)]
    if thin:
        notes.append(
            f"{len(thin)} of {patch.max() + 1} patches ({sum(thin)} of {len(points)} points) span no area that "
            "stands out of the contacts' uncertainty: points and lines without triangles"
        )
    return Surface(
        smoothed,
        normals,
        np.concatenate(triangles),
        np.concatenate(lines),
        patch,
        std,
        size,
        table.frame[used],
        tuple(notes),
    )


def group(points_m: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Patches: points (P, 3) that hang together and whose normals (P, 3) face alike. Labels (P,) from 0 on."""
    # 0 is no edge, and two contacts may coincide
    distance_m = np.maximum(cdist(points_m, points_m), 1e-12)
    graph = np.where(normals @ normals.T > np.cos(LINK_NORMALS_RAD), distance_m, 0.0)
    gaps = minimum_spanning_tree(graph).data
    usual = float(np.percentile(gaps, 90)) if len(gaps) else 0.0
    gap_m = max(LINK_FACTOR * usual, LINK_EXTENT * float(np.linalg.norm(np.ptp(points_m, axis=0))))
    _, labels = connected_components(csr_array(graph * (graph <= gap_m)), directed=False)
    parts: list[np.ndarray] = []
    for label in range(labels.max() + 1):
        parts += _facing_alike(np.flatnonzero(labels == label), normals)
    result = np.empty(len(points_m), int)
    for label, part in enumerate(parts):
        result[part] = label
    return result


def _facing_alike(members: np.ndarray, normals: np.ndarray) -> list[np.ndarray]:
    """Split until no normal leans too far from the mean of its patch."""
    mean = normals[members].sum(axis=0)
    lean = normals[members] @ mean / max(np.linalg.norm(mean), 1e-12)
    if len(members) < 2 or lean.min() > np.cos(PATCH_NORMALS_RAD):
        return [members]
    first = normals[members[np.argmin(lean)]]
    second = normals[members[np.argmin(normals[members] @ first)]]
    _, half = kmeans2(normals[members], np.stack([first, second]), minit="matrix")
    if half.min() == half.max():
        return [members]
    return [part for side in (0, 1) for part in _facing_alike(members[half == side], normals)]


def _patch(points_m: np.ndarray, normals: np.ndarray, covariance_m2: np.ndarray) -> _Patch:
    """One patch as a height field over its tangent plane, or as a line in it."""
    centre, frame = points_m.mean(axis=0), _tangent_frame(points_m, normals)
    local = (points_m - centre) @ frame.T
    std = np.sqrt(np.einsum("ni,nij,nj->n", normals, covariance_m2, normals))
    scatter = np.sqrt(np.einsum("ai,nij,aj->na", frame, covariance_m2, frame))
    known = bool((np.isfinite(scatter) & (scatter > 0)).all() and (std > 0).all())
    # an error along the surface only slides a point on it: what changes the height is the part along the normal
    lean = normals @ frame[2]
    triangles = _triangulate(local[:, :2]) if _spans_area(local[:, :2], scatter[:, 1]) else np.empty((0, 3), int)
    if len(triangles):
        if known:
            height, height_std = smooth(local[:, :2], local[:, 2], std / lean)
            local, std = np.column_stack([local[:, :2], height]), height_std * lean
        return _Patch(centre + local @ frame, std, triangles, np.empty((0, 2), int))
    if known and len(local) > 3 and local[:, 0].std() > RESOLVED * _rms(scatter[:, 0]):
        across, _ = smooth(local[:, :1], local[:, 1], scatter[:, 1])
        height, height_std = smooth(local[:, :1], local[:, 2], std / lean)
        local, std = np.column_stack([local[:, 0], across, height]), height_std * lean
    steps = np.arange(len(points_m) - 1)
    return _Patch(centre + local @ frame, std, triangles, np.stack([steps, steps + 1], axis=1))


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _tangent_frame(points_m: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """(3, 3) rows: the patch's long direction, its short one, and its mean normal, right-handed."""
    up = normals.sum(axis=0)
    up = up / np.linalg.norm(up)
    flat = (points_m - points_m.mean(axis=0)) @ (np.eye(3) - np.outer(up, up))
    _, _, axes = np.linalg.svd(np.vstack([flat, np.zeros((3, 3))]), full_matrices=False)
    along = axes[0] - up * (axes[0] @ up)
    if np.linalg.norm(along) < 0.5:
        along = np.cross(up, np.eye(3)[np.argmin(np.abs(up))])
    along = along / np.linalg.norm(along)
    return np.stack([along, np.cross(up, along), up])


def _spans_area(flat_m: np.ndarray, std_across_m: np.ndarray) -> bool:
    """Whether points (N, 2) are wider across their long direction, the first axis, than their own scatter explains."""
    if len(flat_m) < 3:
        return False
    length, width = flat_m.std(axis=0)
    scatter = _rms(std_across_m)
    return bool(width > max(RESOLVED * scatter if np.isfinite(scatter) else 0.0, NARROW * length, 1e-9))


def _triangulate(flat_m: np.ndarray) -> np.ndarray:
    """(T, 3) Delaunay triangles of points (N, 2), counter-clockwise, less those that bridge gaps or are slivers.

    A sliver's circumscribed circle grows without limit as its corners fall on a line.
    """
    try:
        triangles = Delaunay(flat_m).simplices
    except QhullError:
        return np.empty((0, 3), int)
    a, b, c = (flat_m[triangles[:, i]] for i in range(3))
    doubled = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    edges = np.stack([np.linalg.norm(b - a, axis=1), np.linalg.norm(c - b, axis=1), np.linalg.norm(a - c, axis=1)])
    circle = edges.prod(axis=0) / np.maximum(2 * np.abs(doubled), 1e-300)
    limit = TRIANGLE_FACTOR * np.median(edges)
    keep = (circle <= limit) & (edges.max(axis=0) <= limit)
    return np.where((doubled < 0)[:, None], triangles[:, ::-1], triangles)[keep]


def smooth(flat_m: np.ndarray, height_m: np.ndarray, std_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Heights with the noise taken out: a thin plate, or a thin strip, on springs of stiffness 1/σ².

    Its stiffness minimises Mallows' Cp, the expected squared error as far as known deviations can tell it. The
    deviations returned are Wahba's, σ·√(influence of a point on itself), which cover what smoothing flattens, too.

    Parameters
    ----------
    flat_m : (N, 2) in the tangent plane, not on a line, or (N, 1) along one; N >= 3.
    height_m, std_m : (N,), std_m > 0.

    Returns
    -------
    smoothed heights (N,) and their standard deviations (N,).
    """
    flat = (flat_m - flat_m.mean(axis=0)) / np.ptp(flat_m, axis=0).max()
    weight = (std_m / np.median(std_m)) ** 2

    def influence(log_stiffness: float) -> np.ndarray:
        stiffness = 10.0**log_stiffness * weight
        return RBFInterpolator(flat, np.eye(len(flat)), kernel="thin_plate_spline", smoothing=stiffness)(flat)

    def expected_error(log_stiffness: float) -> float:
        hat = influence(log_stiffness)
        return float(np.sum(((hat @ height_m - height_m) / std_m) ** 2) + 2 * np.trace(hat))

    best = minimize_scalar(expected_error, bounds=(-7.0, 4.0), method="bounded", options={"xatol": 0.3}).x
    hat = influence(best)
    return hat @ height_m, std_m * np.sqrt(np.clip(np.diag(hat), 0.0, 1.0))
