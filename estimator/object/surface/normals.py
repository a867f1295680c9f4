"""The object's normals at the touches, from the solved shape and the antenna's tangents: n ⟂ shape, n ⟂ tangent."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.linalg import eigh

from .equations import IGNORED, LocalTouches, Patch
from .solution import Solution
from .touches import Touches

_UNKNOWN_RAD = 1.0  # the deviation that stands for: not known
_FORCE_STD_RAD = 0.35  # how far the force leans from the normal, where it has to help find the surface
_TANGENT_STD_RAD = 1e-3  # own error of a tangent: the antenna's slope is what its picture shows best
_MODES = 24  # common errors of the normals that are kept apart; the rest counts as each touch's own


@dataclass(frozen=True, eq=False)
class Normals:
    """At P touches, world frame: unit, outward (P, 3); covariance (P, 3, 3), rad²; modes (P, 3, K), its common part."""

    normal: np.ndarray
    covariance: np.ndarray
    modes: np.ndarray = field(default_factory=lambda: np.zeros((0, 3, 0)))

    @property
    def std_rad(self) -> np.ndarray:
        """(P,) the larger of the deviations in the two directions in which a normal can turn."""
        return np.sqrt(np.maximum(np.linalg.eigvalsh(self.covariance)[:, -1], 0.0))

    def best(self, touches: Touches) -> np.ndarray:
        """(P, 3) with the force's direction where the shape says less than that."""
        force = touches.force_N / np.linalg.norm(touches.force_N, axis=1, keepdims=True)
        trust = 1.0 / (1.0 + (self.std_rad / _FORCE_STD_RAD) ** 4)
        mixed = trust[:, None] * self.normal + (1 - trust)[:, None] * force
        return mixed / np.linalg.norm(mixed, axis=1, keepdims=True)


def estimate_normals(
    touches: Touches, patches: tuple[Patch, ...], solution: Solution, seen: list[LocalTouches], *, common: bool = False
) -> Normals:
    """The normals; `common`: with the part of their errors that the touches have in common."""
    count = len(touches)
    normal, own, by_slope = np.empty((count, 3)), np.empty((count, 3, 3)), np.zeros((count, 3, 2))
    views, pair, begin = [], np.empty((count, 2), int), 0
    for index, (patch, shown) in enumerate(zip(patches, seen, strict=True)):
        m, size, frame = patch.members, len(patch.members), patch.frame
        # what is left out of the shape is known as well as it was: to where its normal belongs
        own_m2 = np.where(shown.ignored[:, None, None], shown.own_m2 / IGNORED, shown.own_m2)
        given = replace(shown, own_m2=own_m2)
        rows = patch.slope_rows(given.point_m[:, : patch.dimensions])
        views.append((index, rows))
        slope = solution.mean(index, rows).reshape(2, size).T
        if patch.wide:
            found, turns, left = _of_field(given, slope, solution.patches[index].slack_rad)
        else:
            found, turns, left = _of_curve(given, slope, touches.force_N[m] @ frame.T)
        normal[m], by_slope[m], own[m] = found @ frame, frame.T[None] @ turns, frame.T @ left @ frame
        pair[m] = begin + np.arange(size)[:, None] + [0, size]
        begin += 2 * size
    joint = solution.joint(views)
    shape = by_slope @ joint[pair[:, :, None], pair[:, None, :]] @ np.swapaxes(by_slope, 1, 2)
    values, axes = np.linalg.eigh(shape + own)
    believed = np.minimum(1.0, _UNKNOWN_RAD / np.sqrt(np.maximum(values, 1e-30)))
    # an unknown direction must not take the others along
    held = (axes * believed[:, None]) @ np.swapaxes(axes, 1, 2)
    covariance = held @ (shape + own) @ held
    modes = _principal_modes(joint, pair, held @ by_slope) if common else np.zeros((count, 3, 0))
    return Normals(normal, covariance, modes)


def _principal_modes(joint: np.ndarray, pair: np.ndarray, by_slope: np.ndarray) -> np.ndarray:
    """(P, 3, K) the largest principal parts of the joint covariance of the turns that the shape brings."""
    ordered = joint[np.ix_(pair.ravel(), pair.ravel())].reshape(len(pair), 2, len(pair), 2)
    turned = np.einsum("pia,paqb,qjb->piqj", by_slope, ordered, by_slope, optimize=True)
    size = 3 * len(pair)
    kept = min(_MODES, size)
    variance, axes = eigh(turned.reshape(size, size), subset_by_index=(size - kept, size - 1))
    return (axes * np.sqrt(np.maximum(variance, 0.0))).reshape(len(pair), 3, kept)


_Turned = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Normals (N, 3) of a patch's touches in its frame, (N, 3, 2) how slopes turn them, own covariance (N, 3, 3)."""


def _of_field(seen: LocalTouches, slope: np.ndarray, slack_rad: float) -> _Turned:
    """The field's normal; where the antenna's tangent is known, less its part along that.

    What is left open then is the turn about the tangent, by slopes, and by the touch's own error along what bends.
    """
    raw = np.column_stack([-slope, np.ones(len(slope))])
    length = np.linalg.norm(raw, axis=1)
    normal = raw / length[:, None]
    held = np.isfinite(seen.tangent).all(axis=1)
    tangent = np.where(held[:, None], seen.tangent, 0.0)
    normal = normal - np.sum(normal * tangent, axis=1, keepdims=True) * tangent
    size = np.linalg.norm(normal, axis=1)
    held &= size > 0.2
    tangent = np.where(held[:, None], tangent, 0.0)
    normal = np.where(held[:, None], normal / np.maximum(size, 0.2)[:, None], raw / length[:, None])
    # turns across the normal, and across the tangent where there is one
    free = np.eye(3) - normal[:, :, None] * normal[:, None, :] - tangent[:, :, None] * tangent[:, None, :]
    by_slope = -free[:, :, :2] / length[:, None, None]
    moved = by_slope @ seen.bend_per_m
    own = moved @ seen.own_m2[:, :2, :2] @ np.swapaxes(moved, 1, 2)
    own = own + slack_rad**2 * by_slope @ np.swapaxes(by_slope, 1, 2)
    known = _tangent_variance(seen, normal)
    return normal, by_slope, own + known[:, None, None] * tangent[:, :, None] * tangent[:, None, :]


def _of_curve(seen: LocalTouches, slope: np.ndarray, force: np.ndarray) -> _Turned:
    """Across the curve and the antenna's tangent; without the latter across the curve, towards the force."""
    along = np.column_stack([np.ones(len(slope)), slope])
    length = np.linalg.norm(along, axis=1)
    along = along / length[:, None]
    held = np.isfinite(seen.tangent).all(axis=1)
    tangent = np.where(held[:, None], seen.tangent, 0.0)
    crossed = np.cross(along, tangent)
    sine = np.linalg.norm(crossed, axis=1)
    held &= sine > 1e-3
    towards = force - np.sum(force * along, axis=1, keepdims=True) * along
    fallback = np.cross(along, np.eye(3)[np.argmin(np.abs(along), axis=1)])
    weak = np.linalg.norm(towards, axis=1) < 1e-3 * np.linalg.norm(force, axis=1)
    normal = np.where(held[:, None], crossed, np.where(weak[:, None], fallback, towards))
    normal = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    normal = np.where(np.sum(normal * force, axis=1, keepdims=True) < 0, -normal, normal)
    beside = np.cross(normal, np.where(held[:, None], tangent, along))
    sine = np.where(held, np.sum(along * beside, axis=1), 1.0)
    cosine = np.sum(along * tangent, axis=1)
    rise = -normal[:, 1:] / length[:, None]
    by_slope = np.where(held[:, None], beside / sine[:, None], along)[:, :, None] * rise[:, None, :]
    open_turn = np.where(held[:, None], (cosine / sine)[:, None] * beside - tangent, _UNKNOWN_RAD * beside)
    variance = np.where(held, _tangent_variance(seen, normal), 1.0)
    own = variance[:, None, None] * open_turn[:, :, None] * open_turn[:, None, :]
    # a touch's own error along the curve takes it to where that has another direction
    moved = np.sqrt(seen.own_m2[:, :1, 0]) * np.einsum("nij,nj->ni", by_slope, seen.bend_per_m[:, :, 0])
    return normal, by_slope, own + moved[:, :, None] * moved[:, None, :]


def _tangent_variance(seen: LocalTouches, normal: np.ndarray) -> np.ndarray:
    """(N,) rad², of the tangent's turn towards the normal."""
    common = np.einsum("ni,nis->ns", normal, seen.tangent_modes)
    return _TANGENT_STD_RAD**2 + np.sum(common**2, axis=1)
