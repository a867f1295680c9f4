"""Distorted to ideal points, converged or marked: the solver behind every unprojection. No gradients here."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np

from vbaa_calib.core.arrays import Array, empty, is_tensor, namespace

from .lens import Lens, RadialTable, Sectors, definite, invert_radial, tolerance
from .models import Matrix

_PIECE = 16384  # points in a piece. Smaller ones pay more for calls: with 4096, a fourth to a third more time.

_PieceWork = Callable[[Array, Array, bool], Sequence[Array]]
"""(x, y, whether to spare no effort) → the results of these points, and last which of them deserve more effort."""


def in_pieces(work: _PieceWork, x: Array, y: Array, results: Sequence[Array]) -> None:
    """Work on points (n,) and write into results, each (n,). Points that need more effort are put off and worked on
    together: an effort takes some hundred array operations however few they are. Tensors are one piece."""
    if is_tensor(x) or len(x) <= _PIECE:
        _store(results, ..., work(x, y, True))
        return
    put_off = np.empty(len(x), bool)
    for start in range(0, len(x), _PIECE):
        piece = slice(start, start + _PIECE)
        _store((*results, put_off), piece, work(x[piece], y[piece], False))
    (rest,) = put_off.nonzero()
    if rest.size:
        _store(results, rest, work(x[rest], y[rest], True))


def _store(results: Sequence[Array], where: Any, values: Sequence[Array]) -> None:
    for result, value in zip(results, values, strict=False):
        result[where] = value


_SURE_STEPS = 2
_PLAIN_STEPS = 3
_DAMPED_STEPS = 16
_SHORTEST = 1e-3
_ROUNDINGS = 0.1
_NO_RADIUS = 1e-15  # keeps a start on the axis from being 0/0, also in single precision


class _Inverted(NamedTuple):
    """Points (...) undistorted, in the model's chart; anything where not valid."""

    x: Array
    y: Array
    valid: Array  # inside the region around the axis, residual at the rounding, finite
    jacobian: Matrix  # d(distorted)/d(ideal): (xx, xy, yx, yy), (...) or numbers
    put_off: Array  # which invalid ones more effort might still find


def solve(lens: Lens, x: Array, y: Array) -> tuple[Array, Array, Array]:
    """Ideal points (...) of distorted points (...) on an untilted sensor, and which of them are valid; the others are
    (0, 0)."""
    xp = namespace(x)
    shape = tuple(x.shape)
    x, y = x.reshape(-1), y.reshape(-1)
    ideal_x, ideal_y, valid = (empty(x, x.shape, boolean) for boolean in (False, False, True))
    with np.errstate(all="ignore"):
        in_pieces(partial(_solve_piece, xp, lens), x, y, (ideal_x, ideal_y, valid))
    return ideal_x.reshape(shape), ideal_y.reshape(shape), valid.reshape(shape)


def _solve_piece(xp: ModuleType, lens: Lens, x: Array, y: Array, thorough: bool) -> tuple[Array, Array, Array, Array]:
    found = invert_distortion(xp, lens, x, y, thorough)
    valid = found.valid
    return xp.where(valid, found.x, 0.0), xp.where(valid, found.y, 0.0), valid, found.put_off


def invert_distortion(xp: ModuleType, lens: Lens, x: Array, y: Array, thorough: bool) -> _Inverted:
    """Distorted points (...) undistorted; NaN is not valid. Not thorough: only what a few Newton steps solve, which is
    nearly all; the others are put off."""
    if lens.table is None:
        valid = xp.isfinite(x) & xp.isfinite(y) & (x * x + y * y < lens.ideal_limit**2)
        return _Inverted(x, y, valid, (1.0, 0.0, 0.0, 1.0), False)
    if lens.sectors is None:
        return _along_radius(xp, lens, lens.table, x, y, thorough)
    return _newton(xp, lens, lens.sectors, x, y, thorough)


def _along_radius(xp: ModuleType, lens: Lens, table: RadialTable, x: Array, y: Array, thorough: bool) -> _Inverted:
    distorted = xp.sqrt(x * x + y * y)
    reachable = distorted < table.distorted_limit
    distorted = xp.where(reachable, distorted, 0.0)
    _, solved, gain, d_gain = invert_radial(xp, lens.model, lens.coefficients, table, distorted, thorough)
    valid = reachable & solved
    inverse = 1.0 / gain
    x, y = x * inverse, y * inverse
    bend_x, bend_y = (2.0 * d_gain) * x, (2.0 * d_gain) * y
    shear = bend_x * y
    return _Inverted(x, y, valid, (gain + bend_x * x, shear, shear, gain + bend_y * y), reachable & ~solved)


def _newton(xp: ModuleType, lens: Lens, region: Sectors, x: Array, y: Array, thorough: bool) -> _Inverted:
    """Newton in two unknowns from the radial start; what has not arrived after a few steps goes on damped."""
    reachable = region.reach.encloses(xp, x, y)
    if not bool(reachable.all()):
        x, y = xp.where(reachable, x, 0.0), xp.where(reachable, y, 0.0)
    distorted = xp.sqrt(x * x + y * y)
    allowed = tolerance(xp, distorted)
    ideal_x, ideal_y = _mended_start(xp, lens, x, y, distorted)
    for step in range(_PLAIN_STEPS + 1):
        xd, yd, xx, xy, yx, yy = lens.model.linearize(ideal_x, ideal_y, lens.coefficients)
        rx, ry = x - xd, y - yd
        if step >= _SURE_STEPS:
            solved = xp.maximum(xp.abs(rx), xp.abs(ry)) <= allowed
            if step == _PLAIN_STEPS or bool(solved.all()):
                break
        inverse = 1.0 / (xx * yy - xy * yx)
        ideal_x, ideal_y = ideal_x + (yy * rx - xy * ry) * inverse, ideal_y + (xx * ry - yx * rx) * inverse
    inside = definite(xx, xy, yx, yy) & region.ideal.encloses(xp, ideal_x, ideal_y)
    valid = solved & inside & reachable
    rest = reachable & ~valid
    found = _Inverted(ideal_x, ideal_y, valid, (xx, xy, yx, yy), rest)
    if not thorough or not bool(rest.any()):
        return found
    damped = _damped(xp, lens, x[rest], y[rest], (ideal_x[rest], ideal_y[rest]), inside[rest])
    for whole, part in zip((*found[:3], *found.jacobian), (*damped[:3], *damped.jacobian), strict=True):
        whole[rest] = part
    return found


def _start(xp: ModuleType, lens: Lens, x: Array, y: Array, distorted: Array) -> tuple[Array, Array, Array, Array]:
    """The radial terms undone, roughly; what they cannot reach starts from the rim. Also r/ρ, and the table's step."""
    assert lens.table is not None
    radius, _, step = lens.table.start(xp, distorted.clip(0.0, lens.table.distorted_limit))
    ratio = radius / (distorted + _NO_RADIUS)
    return x * ratio, y * ratio, ratio, step


def _mended_start(xp: ModuleType, lens: Lens, x: Array, y: Array, distorted: Array) -> tuple[Array, Array]:
    """`_start`, and one Newton step in which only the radial terms count as slopes: half a full step's price."""
    assert lens.table is not None
    ideal_x, ideal_y, ratio, step = _start(xp, lens, x, y, distorted)
    dx, dy = lens.model.beside(ideal_x, ideal_y, lens.coefficients)
    distorted = distorted + _NO_RADIUS
    # the table's own slope along the radius, r/ρ across it
    past = 1.0 + distorted
    along = (step * lens.table.nodes_per_unit / (past * past) - ratio) * (x * dx + y * dy) / (distorted * distorted)
    return ideal_x - (ratio * dx + along * x), ideal_y - (ratio * dy + along * y)


def _damped(xp: ModuleType, lens: Lens, x: Array, y: Array, guess: tuple[Array, Array], usable: Array) -> _Inverted:
    """Newton with each step shortened until it stays inside the region and the residual falls; from the guess where
    that is usable, else from deep inside the region."""
    assert lens.sectors is not None
    model, c, region = lens.model, lens.coefficients, lens.sectors
    allowed = tolerance(xp, xp.sqrt(x * x + y * y))
    safe_x, safe_y, *_ = _start(xp, lens, x, y, xp.sqrt(x * x + y * y))
    deep = 0.5 * region.ideal.inner
    shrink = deep / xp.clip(xp.sqrt(safe_x * safe_x + safe_y * safe_y), deep, None)
    ideal_x, ideal_y = xp.where(usable, guess[0], safe_x * shrink), xp.where(usable, guess[1], safe_y * shrink)
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
    # near a pole a rounding of the ideal point alone moves the distorted one by more than that
    steep = (xp.abs(xx) + xp.abs(xy) + xp.abs(yx) + xp.abs(yy)) * xp.maximum(xp.abs(ideal_x), xp.abs(ideal_y))
    solved = xp.maximum(xp.abs(x - xd), xp.abs(y - yd)) <= allowed + _ROUNDINGS * tolerance(xp, steep)
    valid = solved & definite(xx, xy, yx, yy) & region.ideal.encloses(xp, ideal_x, ideal_y)
    return _Inverted(ideal_x, ideal_y, valid, (xx, xy, yx, yy), False)
