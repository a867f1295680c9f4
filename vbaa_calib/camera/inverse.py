"""Distorted to ideal points, converged or marked: the solver behind every unprojection. No gradients here."""

from __future__ import annotations

from types import ModuleType

import numpy as np

from ..arrays import Array, namespace
from .lens import Lens
from .radial import invert_radial, tolerance
from .sectors import Sectors, definite

_CHUNK = 16384
"""Points worked on at once in NumPy: the temporaries of one piece stay in the processor's cache."""

_PLAIN_STEPS = 3
_DAMPED_STEPS = 16
_SHORTEST = 1e-3


def solve(lens: Lens, x: Array, y: Array) -> tuple[Array, Array, Array]:
    """Ideal points (...) of distorted points (...) on an untilted sensor, and which of them are valid.

    Valid means: inside the region that hangs together with the axis, residual at the rounding, finite. The others
    are (0, 0).
    """
    if lens.path == "none":
        return _bounded(lens, x, y)
    xp = namespace(x)
    shape = tuple(x.shape)
    x, y = x.reshape(-1), y.reshape(-1)
    with np.errstate(all="ignore"):
        in_pieces = xp is np and x.size > _CHUNK
        ideal_x, ideal_y, valid = _in_pieces(lens, x, y) if in_pieces else _solve_flat(xp, lens, x, y)
    return ideal_x.reshape(shape), ideal_y.reshape(shape), valid.reshape(shape)


def _bounded(lens: Lens, x: Array, y: Array) -> tuple[Array, Array, Array]:
    xp = namespace(x)
    valid = xp.isfinite(x) & xp.isfinite(y)
    if lens.ideal_limit < np.inf:
        valid = valid & (x * x + y * y < lens.ideal_limit**2)
    return xp.where(valid, x, 0.0), xp.where(valid, y, 0.0), valid


def _in_pieces(lens: Lens, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    ideal_x, ideal_y, valid = np.empty_like(x), np.empty_like(y), np.empty(x.shape, bool)
    for start in range(0, x.size, _CHUNK):
        piece = slice(start, start + _CHUNK)
        ideal_x[piece], ideal_y[piece], valid[piece] = _solve_flat(np, lens, x[piece], y[piece])
    return ideal_x, ideal_y, valid


def _solve_flat(xp: ModuleType, lens: Lens, x: Array, y: Array) -> tuple[Array, Array, Array]:
    assert lens.table is not None
    if lens.sectors is None:
        return invert_radial(xp, lens.model, lens.coefficients, lens.table, x, y)
    return _newton(xp, lens, lens.sectors, x, y)


def _newton(xp: ModuleType, lens: Lens, region: Sectors, x: Array, y: Array) -> tuple[Array, Array, Array]:
    """Newton in two unknowns from the radial start; what has not arrived after a few steps goes on damped."""
    distorted = xp.sqrt(x * x + y * y)
    reachable = region.reach.encloses(xp, x, y)
    x, y, distorted = (xp.where(reachable, values, 0.0) for values in (x, y, distorted))
    allowed = tolerance(xp, distorted)
    ideal_x, ideal_y = _start(xp, lens, x, y, distorted)
    for step in range(_PLAIN_STEPS + 1):
        xd, yd, xx, xy, yx, yy = lens.model.linearize(ideal_x, ideal_y, lens.coefficients)
        rx, ry = x - xd, y - yd
        solved = xp.maximum(xp.abs(rx), xp.abs(ry)) <= allowed
        if step == _PLAIN_STEPS or bool(solved.all()):
            break
        inverse = 1.0 / (xx * yy - xy * yx)
        ideal_x, ideal_y = ideal_x + (yy * rx - xy * ry) * inverse, ideal_y + (xx * ry - yx * rx) * inverse
    inside = definite(xx, xy, yx, yy) & region.ideal.encloses(xp, ideal_x, ideal_y)
    valid = solved & inside & reachable
    if not bool(valid.all()):
        rest = ~valid & reachable
        ideal_x[rest], ideal_y[rest], valid[rest] = _damped(
            xp, lens, region, x[rest], y[rest], ideal_x[rest], ideal_y[rest], inside[rest]
        )
        ideal_x, ideal_y = xp.where(valid, ideal_x, 0.0), xp.where(valid, ideal_y, 0.0)
    return ideal_x, ideal_y, valid


def _start(xp: ModuleType, lens: Lens, x: Array, y: Array, distorted: Array) -> tuple[Array, Array]:
    """The radial terms undone, roughly; what they cannot reach starts from the rim."""
    assert lens.table is not None
    within = xp.clip(distorted, 0.0, lens.table.distorted_limit)
    radius, _, _ = lens.table.bracket(xp, within)
    ratio = radius / (distorted + 1e-300)
    return x * ratio, y * ratio


def _damped(
    xp: ModuleType, lens: Lens, region: Sectors, x: Array, y: Array, guess_x: Array, guess_y: Array, usable: Array
) -> tuple[Array, Array, Array]:
    """Newton with each step shortened until it stays inside the region and the residual falls.

    It starts from the guess where that is usable, else from deep inside the region.
    """
    model, c = lens.model, lens.coefficients
    allowed = tolerance(xp, xp.sqrt(x * x + y * y))
    safe_x, safe_y = _start(xp, lens, x, y, xp.sqrt(x * x + y * y))
    deep = 0.5 * region.ideal.inner
    shrink = deep / xp.clip(xp.sqrt(safe_x * safe_x + safe_y * safe_y), deep, None)
    ideal_x, ideal_y = xp.where(usable, guess_x, safe_x * shrink), xp.where(usable, guess_y, safe_y * shrink)
    length = xp.ones_like(x)
    xd, yd, xx, xy, yx, yy = model.linearize(ideal_x, ideal_y, c)
    for _ in range(_DAMPED_STEPS):
        rx, ry = x - xd, y - yd
        residual = xp.maximum(xp.abs(rx), xp.abs(ry))
        if bool(((residual <= allowed) | (length < _SHORTEST)).all()):
            break
        inverse = length / (xx * yy - xy * yx)
        next_x, next_y = ideal_x + (yy * rx - xy * ry) * inverse, ideal_y + (xx * ry - yx * rx) * inverse
        trial = model.linearize(next_x, next_y, c)
        fell = xp.maximum(xp.abs(x - trial[0]), xp.abs(y - trial[1])) < residual
        taken = fell & definite(*trial[2:]) & region.ideal.encloses(xp, next_x, next_y)
        ideal_x, ideal_y = xp.where(taken, next_x, ideal_x), xp.where(taken, next_y, ideal_y)
        old = (xd, yd, xx, xy, yx, yy)
        xd, yd, xx, xy, yx, yy = (xp.where(taken, new, kept) for new, kept in zip(trial, old, strict=True))
        length = xp.where(taken, xp.clip(2.0 * length, 0.0, 1.0), 0.5 * length)
    solved = xp.maximum(xp.abs(x - xd), xp.abs(y - yd)) <= allowed
    valid = solved & definite(xx, xy, yx, yy) & region.ideal.encloses(xp, ideal_x, ideal_y)
    return ideal_x, ideal_y, valid
