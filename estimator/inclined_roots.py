"""Every contact that two points seen by the tilted camera B and the moment allow.

Camera B moves both points along x by κ·y. Whatever κ is, x2 = r·x1 − d with r = y2/y1 and d = r·x_p1 − x_p2 (both
known), so v = x2/d is the one unknown: it fixes q = x1/x2, by the upright camera's formulas l and f_y, and what is left
is the moment, κ·l·f_y = τ_y·tanφ:

    (x_p2/d − v)·g(v) = t·d,    g = l·f_y·d²/(2EI·y2),    t = τ_y·tanφ/2EI.

v runs from l = ∞ to where the straight part begins; beyond, the equation is linear in x. On the curved part it is the
quintic in κ that stands in place of the paper's sextic. g falls with v, so the left side does too and there is one
solution, but for pictures that fold the antenna back (x_p2 < x_p1) under a moment that does so: there it first falls,
then rises, and may give two. `tests/estimator/test_misprints.py` proves it.

All arrays (n,); lengths in m, t in 1/m.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from vbaa_calib.arrays import Array, namespace

from .two_point import Part, bending, elasticity, relative_contact

_CLOSE = 1e-9
"""A step of Newton's, relative, after which one more reaches rounding."""
_ENDLESS = 1e15
"""l/x2 of deflections as if under a pure moment."""
_HALVINGS = 36


def candidates(xp1: Array, xp2: Array, ratio: Array, torque: Array) -> tuple[Array, Array, Array, Array]:
    """Part, l, x1 and x2 (n, 3) of every contact: the first and second not straight, and the straight one; or NaN.

    The point nearer to the clamp is the first; `ratio` is y2/y1, `torque` τ_y·tanφ/2EI.
    """
    xp = namespace(ratio)
    drop = ratio * xp1 - xp2
    drop = xp.where((drop > 0.0) & (ratio > 1.0) & (abs(torque) < np.inf), drop, np.nan)
    place, load = xp2 / drop, torque * drop
    first, last = (xp.sqrt(ratio) + 1.0) / (ratio - 1.0), (2.0 * ratio + 1.0) / (ratio - 1.0)

    def excess(v: Array) -> tuple[Array, Array]:
        pull, growth = _pull(v, ratio)
        return (place - v) * pull - load, pull * ((place - v) * growth - 1.0)

    fold = (xp2 < xp1) & (load < 0.0)
    turn = _turn(place, ratio, xp.maximum(first, place), last, fold)
    at_first, at_turn, at_last = (place - first) / first**2 - load, excess(turn)[0], excess(last)[0]
    guess = xp.minimum(xp.maximum(place, first), turn)
    begin = xp.where((at_first >= 0.0) & (at_turn < 0.0), first, np.nan)
    found = [_root(excess, begin, turn, guess), first * np.nan]
    back = fold & (at_turn < 0.0) & (at_last >= 0.0)
    if bool(back.any()):
        found[1] = _root(excess, xp.where(back, last, np.nan), turn, 0.5 * (turn + last))
    shapes = [_shape(v, ratio) for v in found]
    contact = 3.0 * drop / (ratio - 1.0)
    x1, x2 = ((p + torque * contact**2 / 3.0) / (1.0 + torque * contact) for p in (xp1, xp2))
    beyond = ((at_last < 0.0) == fold) & (x1 >= contact * (1.0 - _CLOSE))
    parts = [part for part, _ in shapes] + [xp.where(beyond, int(Part.STRAIGHT), int(Part.NONE))]
    contacts = [drop * v * reach for v, (_, reach) in zip(found, shapes, strict=True)]
    contacts.append(xp.where(beyond, xp.minimum(contact, x1), np.nan))
    firsts, seconds = [drop * (1.0 + v) / ratio for v in found], [drop * v for v in found]
    return xp.stack(parts, -1), xp.stack(contacts, -1), xp.stack([*firsts, x1], -1), xp.stack([*seconds, x2], -1)


def _shape(v: Array, ratio: Array) -> tuple[Array, Array]:
    """Part and λ = l/x2 at v, short of two straight points."""
    xp = namespace(v)
    spread = (1.0 + v) / (ratio * v)
    known = spread**2 * ratio
    part = xp.where(known * (3.0 - spread) >= 2.0, int(Part.CURVED), int(Part.MIXED))
    return part, xp.where(known < 1.0, relative_contact(part, spread, ratio), _ENDLESS)


def _pull(v: Array, ratio: Array) -> tuple[Array, Array]:
    """g and d ln g/dv. The deflection is homogeneous: ∂ln y/∂ln x = 3 − ∂ln y/∂ln l."""
    xp = namespace(v)
    _, reach = _shape(v, ratio)
    one = xp.ones_like(v)
    e1, e2 = elasticity((1.0 + v) / (ratio * v), reach), elasticity(one, reach)
    lengthening = ((3.0 - e1) / (1.0 + v) - (3.0 - e2) / v) / (e2 - e1)
    return 3.0 * reach / (v**2 * bending(one, reach)), (1.0 - e2) * lengthening - (3.0 - e2) / v


def _turn(place: Array, ratio: Array, first: Array, last: Array, fold: Array) -> Array:
    """Where in [first, last] a folded picture's equation turns; `last` for others."""
    turn = last + 0.0 * first
    if not bool(fold.any()):
        return last
    place, ratio, low, high = place[fold], ratio[fold], first[fold], last[fold]
    xp = namespace(place)
    high = xp.maximum(low, high)
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        before = 1.0 / (middle - place) + _pull(middle, ratio)[1] > 0.0
        low, high = xp.where(before, middle, low), xp.where(before, high, middle)
    turn[fold] = high
    return turn


def _root(function: Callable[[Array], tuple[Array, Array]], above: Array, below: Array, start: Array) -> Array:
    """Root between `above`, where the function (value and slope) is positive, and `below`; NaN where one of them is.

    Newton's steps, held by the bracket.
    """
    xp = namespace(above)
    v, middle = start, 0.5 * (above + below)
    v = xp.where((v - above) * (v - below) < 0.0, v, middle)
    for turn in range(100):
        value, slope = function(v)
        above, below = xp.where(value >= 0.0, v, above), xp.where(value >= 0.0, below, v)
        newton, middle = v - value / slope, 0.5 * (above + below)
        inside = (newton - above) * (newton - below) <= 0.0
        close = inside & (abs(newton - v) <= _CLOSE * abs(v))
        # far into the loop every other step halves: Newton's may swing between two places
        v = xp.where(close | (inside & ((turn < 20) | (turn % 2 == 0))), newton, middle)
        if bool((close | (value != value) | (abs(above - below) <= 1e-15 * abs(v))).all()):
            break
    value, slope = function(v)
    newton = v - value / slope
    return xp.where((newton - above) * (newton - below) <= 0.0, newton, v)
