"""The antenna as a static elastic rod in space: large deflection, weight, natural curvature, one point force.

Kirchhoff's rod: inextensible, unshearable, bending stiffness the same in all directions, torsion. With the position r,
the directors d1 (tangent), d2, d3 = d1 × d2, the internal force n(s) and moment M(s) (what the part beyond s exerts on
the part before it), all in the antenna frame and over the arc length s:

    r' = d1      d1' = Ω × d1      d2' = Ω × d2      M' = n × d1
    Ω = M/EI + (1/GJ − 1/EI) (d1·M) d1 + κ_y d2 + κ_z d3

All loads are dead, so n(s) = [s < contact] force + (L − s) m' g is known beforehand and the position decouples. The
clamp gives r, d1, d2 at s = 0; the clamp moment M(0) is shot for, so that M(L) = 0.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from vbaa_calib.core.errors import InputError, SolveError
from vbaa_calib.geometry import Pose

STEPS_PER_SEGMENT = 32
"""Runge-Kutta steps from the clamp to the contact, and again from there to the tip."""
_TOLERANCE = 1e-11
"""On the moment left at the tip, relative to the moment of the loads."""
_LOAD_LADDER = (0.1, 0.25, 0.45, 0.7, 1.0)
_DIFFERENCE = -1e-7
"""Backward, so that a variable at its upper limit is still differentiated from the allowed side."""
_HALVINGS, _ITERATIONS = 8, 30

_Residual = Callable[[np.ndarray, np.ndarray], np.ndarray]


@dataclass(frozen=True, eq=False)
class Rod:
    """What the antenna is made of and how it is held.

    Attributes
    ----------
    length_m : from the clamp to the tip.
    bending_stiffness_Nm2 : EI, the same about every transverse axis (the paper's equal compliance).
    torsional_stiffness_Nm2 : GJ.
    mass_per_length_kg_m : 0 for a weightless antenna.
    T_antenna_clamp : the clamp frame's origin lies at the clamp, its x along the clamped tangent.
    natural_curvature_per_m : (2,) curvature of the unloaded, weightless rod about its own y and z axes, constant along
        it: a positive one about z bends it towards +y, a positive one about y towards −z.
    """

    length_m: float
    bending_stiffness_Nm2: float
    torsional_stiffness_Nm2: float
    mass_per_length_kg_m: float
    T_antenna_clamp: Pose = field(default_factory=Pose.identity)
    natural_curvature_per_m: np.ndarray = field(default_factory=lambda: np.zeros(2))

    def __post_init__(self) -> None:
        for name in ("length_m", "bending_stiffness_Nm2", "torsional_stiffness_Nm2"):
            if not 0.0 < getattr(self, name) < np.inf:
                raise InputError(f"{name} is {getattr(self, name)}", where="antenna", remedy="give a positive number")
        if not 0.0 <= self.mass_per_length_kg_m < np.inf:
            raise InputError(
                f"mass_per_length_kg_m is {self.mass_per_length_kg_m}", where="antenna", remedy="give 0 or more"
            )


@dataclass(frozen=True, eq=False)
class RodShape:
    """B solved rods, at N nodes each.

    Attributes
    ----------
    arclength_m : (B, N) strictly increasing from 0 to the length; the contact is one of the nodes.
    points_m : (B, N, 3) antenna frame.
    tangents : (B, N, 3) unit vectors, antenna frame.
    clamp_moment_Nm : (B, 3) right-handed moment about the antenna frame's origin of all external loads, weight and
        contact force. The paper's moment τ_y = x·f_z − z·f_x is minus its y component.
    """

    arclength_m: np.ndarray
    points_m: np.ndarray
    tangents: np.ndarray
    clamp_moment_Nm: np.ndarray


def solve_rod(
    rod: Rod,
    gravity_m_s2: np.ndarray,
    contact_m: np.ndarray,
    force_N: np.ndarray,
    guess_moment_Nm: np.ndarray | None = None,
) -> RodShape:
    """The rod's shape under its weight and one dead force.

    Parameters
    ----------
    gravity_m_s2 : (B, 3) antenna frame.
    contact_m : (B,) arc length at which the force acts, 0 < contact ≤ length; any such value where the force is 0.
    force_N : (B, 3) antenna frame.
    guess_moment_Nm : (B, 3) the `clamp_moment_Nm` of a neighbouring solution, to start from.

    Raises
    ------
    InputError : an array of the wrong shape, a number that is not finite, a contact off the rod.
    SolveError : the tip's moment could not be brought to zero for some batch element.
    """
    gravity, contact, force = _checked(rod, gravity_m_s2, contact_m, force_N)
    lever = rod.T_antenna_clamp.translation_m
    unit = rod.bending_stiffness_Nm2 / rod.length_m
    weight = rod.mass_per_length_kg_m * rod.length_m * gravity
    load = np.linalg.norm(force, axis=1) * contact + np.linalg.norm(weight, axis=1) * rod.length_m / 2
    scale = np.maximum(load, 1e-6 * unit)[:, None]

    def tip_moment(share: float) -> _Residual:
        def residual(x: np.ndarray, rows: np.ndarray) -> np.ndarray:
            nodes = shoot(rod, share * gravity[rows], contact[rows], share * force[rows], x * unit)
            return nodes[-1, 3].T / scale[rows]

        return residual

    tangent = rod.T_antenna_clamp.rotation[:, 0]
    # the lever shortens as the rod bends: this follows the elastica's up to ten times the force of EI/contact²
    bent = 1.0 + np.linalg.norm(force, axis=1) * contact**2 / (8.0 * rod.bending_stiffness_Nm2)
    start = np.cross(tangent, (contact / bent)[:, None] * force + rod.length_m / 2 * weight)
    if guess_moment_Nm is not None:
        start = guess_moment_Nm - np.cross(lever, force + weight)
    # no lever is longer than the arc, so no component of the clamp moment exceeds the load's
    limit = load[:, None] / unit
    moment, size = newton(tip_moment(1.0), start / unit, tolerance=_TOLERANCE, lower=-limit, upper=limit)
    failed = np.flatnonzero(~(size <= _TOLERANCE))
    if failed.size:
        moment[failed], size[failed] = _climb(tip_moment, failed, limit[failed])
    if not (size <= _TOLERANCE).all():
        worst = int(np.argmax(size))
        raise SolveError(
            f"rod {worst} of {len(size)} found no equilibrium: force {force[worst]} N at {contact[worst]:.4f} m"
            f" leaves {size[worst]:.1e} of its moment at the tip"
        )
    nodes = shoot(rod, gravity, contact, force, moment * unit)
    tangents = np.moveaxis(nodes[:, 1], (0, 1, 2), (1, 2, 0))
    return RodShape(
        arclength_m=node_arclength(rod, contact).T,
        points_m=np.moveaxis(nodes[:, 0], (0, 1, 2), (1, 2, 0)),
        tangents=tangents / np.linalg.norm(tangents, axis=-1, keepdims=True),
        clamp_moment_Nm=moment * unit + np.cross(lever, force + weight),
    )


def shoot(
    rod: Rod, gravity_m_s2: np.ndarray, contact_m: np.ndarray, force_N: np.ndarray, moment_Nm: np.ndarray
) -> np.ndarray:
    """Integrate from the clamp with a supposed moment there; in equilibrium the tip's moment comes out as zero.

    Parameters
    ----------
    gravity_m_s2, contact_m, force_N : as in `solve_rod`, unchecked.
    moment_Nm : (B, 3) M(0), the moment of the loads about the clamp point.

    Returns
    -------
    (N, 4, 3, B): per node the position, the tangent d1, the director d2 and the moment M, antenna frame. Node
    `STEPS_PER_SEGMENT` is the contact, except for a contact at the tip, where the last node is.
    """
    arclength = node_arclength(rod, contact_m)
    before = arclength[1:] <= contact_m
    weight = rod.mass_per_length_kg_m * gravity_m_s2.T
    push = force_N.T
    bend, twist = 1.0 / rod.bending_stiffness_Nm2, 1.0 / rod.torsional_stiffness_Nm2
    curvature_y, curvature_z = rod.natural_curvature_per_m

    left, right = np.empty((2, 3, 3, len(contact_m)))

    def slope(state: np.ndarray, internal: np.ndarray) -> np.ndarray:
        _, d1, d2, moment = state
        turn = bend * moment + ((twist - bend) * (d1 * moment).sum(axis=0)) * d1
        if curvature_y or curvature_z:
            turn = turn + curvature_y * d2 + curvature_z * _cross(d1, d2)
        rates = np.empty_like(state)
        rates[0] = d1
        # Ω × d1, Ω × d2 and n × d1 in one go: the calls cost more than the numbers
        left[0], left[1], left[2] = turn, turn, internal
        right[0], right[1], right[2] = d1, d2, d1
        _cross(left.swapaxes(0, 1), right.swapaxes(0, 1), rates[1:].swapaxes(0, 1))
        return rates

    pose = rod.T_antenna_clamp
    clamp = np.stack([pose.translation_m, pose.rotation[:, 0], pose.rotation[:, 1], np.zeros(3)])
    state = np.repeat(clamp[:, :, None], len(contact_m), axis=2)
    state[3] = moment_Nm.T
    nodes = np.empty((len(arclength), *state.shape))
    nodes[0] = state
    for i, step in enumerate(np.diff(arclength, axis=0)):
        internal = push * before[i] + weight * (rod.length_m - arclength[i])
        middle = internal - weight * (step / 2)
        end = internal - weight * step
        k1 = slope(state, internal)
        k2 = slope(state + step / 2 * k1, middle)
        k3 = slope(state + step / 2 * k2, middle)
        k4 = slope(state + step * k3, end)
        state = state + step / 6 * (k1 + 2 * (k2 + k3) + k4)
        nodes[i + 1] = state
    return nodes


def node_arclength(rod: Rod, contact_m: np.ndarray) -> np.ndarray:
    """(N, B) arc length of the nodes: two equally divided segments that meet at the contact (B,).

    A contact at the tip leaves no second segment; the rod is then split in its middle.
    """
    split = np.where(contact_m < rod.length_m, contact_m, rod.length_m / 2)
    share = np.linspace(0.0, 1.0, STEPS_PER_SEGMENT + 1)[:, None]
    return np.concatenate([share * split, (split + share * (rod.length_m - split))[1:]])


def sample_shape(shape: RodShape, arclength_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points (B, K, 3) and unit tangents (B, K, 3) at arc lengths (B, K), cut off at the ends of the rod.

    Cubic Hermite between the nodes: below 1e-8 of the length for shapes that the nodes resolve.
    """
    at = np.clip(arclength_m, shape.arclength_m[:, :1], shape.arclength_m[:, -1:])
    last = shape.arclength_m.shape[1] - 2
    left = np.array([np.searchsorted(s, x, side="right") for s, x in zip(shape.arclength_m, at, strict=True)]) - 1
    left = np.clip(left, 0, last)
    s0, s1 = (np.take_along_axis(shape.arclength_m, left + i, axis=1) for i in (0, 1))
    p0, p1 = (np.take_along_axis(shape.points_m, (left + i)[..., None], axis=1) for i in (0, 1))
    t0, t1 = (np.take_along_axis(shape.tangents, (left + i)[..., None], axis=1) for i in (0, 1))
    width = (s1 - s0)[..., None]
    x = (at - s0)[..., None] / width
    bend0, bend1 = width * t0 - (p1 - p0), (p1 - p0) - width * t1
    points = p0 + x * (p1 - p0) + x * (1 - x) * ((1 - x) * bend0 + x * bend1)
    slopes = (p1 - p0) + (1 - 2 * x) * ((1 - x) * bend0 + x * bend1) + x * (1 - x) * (bend1 - bend0)
    return points, slopes / np.linalg.norm(slopes, axis=-1, keepdims=True)


def _cross(a: np.ndarray, b: np.ndarray, product: np.ndarray | None = None) -> np.ndarray:
    """a × b over the first axis, without numpy.cross's overhead; written to `product` where there is one."""
    product = np.empty(a.shape) if product is None else product
    product[0] = a[1] * b[2] - a[2] * b[1]
    product[1] = a[2] * b[0] - a[0] * b[2]
    product[2] = a[0] * b[1] - a[1] * b[0]
    return product


def _climb(
    tip_moment: Callable[[float], _Residual], rows: np.ndarray, limit: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Newton again, with the loads brought on in shares."""
    moment, size = np.zeros((rows.size, 3)), np.zeros(rows.size)
    for share in _LOAD_LADDER:
        residual = tip_moment(share)

        def on_rows(x: np.ndarray, at: np.ndarray, residual: _Residual = residual) -> np.ndarray:
            return residual(x, rows[at])

        moment, size = newton(on_rows, moment, tolerance=_TOLERANCE, lower=-limit, upper=limit)
    return moment, size


def _checked(rod: Rod, gravity: np.ndarray, contact: np.ndarray, force: np.ndarray) -> tuple[np.ndarray, ...]:
    gravity, contact, force = (np.asarray(a, float) for a in (gravity, contact, force))
    count = contact.size
    if contact.shape != (count,) or gravity.shape != (count, 3) or force.shape != (count, 3):
        raise InputError(
            f"gravity {gravity.shape}, contact {contact.shape}, force {force.shape}",
            where="rod loads",
            remedy="give (B, 3), (B,) and (B, 3)",
        )
    if not all(np.isfinite(a).all() for a in (gravity, contact, force)):
        raise InputError("a load is not finite", where="rod loads")
    if ((contact <= 0.0) | (contact > rod.length_m)).any():
        raise InputError(
            f"contact at {contact.min():.4g} to {contact.max():.4g} m", where="rod loads", remedy="keep it on the rod"
        )
    return gravity, contact, force


@np.errstate(over="ignore", invalid="ignore")
def newton(
    residual: _Residual,
    start: np.ndarray,
    *,
    tolerance: float,
    lower: np.ndarray | float = -np.inf,
    upper: np.ndarray | float = np.inf,
) -> tuple[np.ndarray, np.ndarray]:
    """Solve B independent systems of n equations by damped Newton with difference quotients.

    Parameters
    ----------
    residual : (x (A, n), rows (A,)) → (A, n); `rows` says to which system each row of x belongs. Variables and
        residuals are scaled by the caller so that 1 is a typical size.
    start : (B, n).
    tolerance : on the largest absolute residual of a system.
    lower, upper : limits on the variables, broadcast to (B, n); steps are cut off there.

    Returns
    -------
    solution (B, n) and its largest absolute residual (B,). Systems that did not converge are returned as they stand:
    the caller compares with the tolerance. A residual that is not finite counts as infinite.
    """
    lower, upper = np.broadcast_to(lower, start.shape), np.broadcast_to(upper, start.shape)
    solution = np.clip(start, lower, upper)
    values = residual(solution, np.arange(len(solution)))
    size = _size(values)
    for _ in range(_ITERATIONS):
        rows = np.flatnonzero((size > tolerance) & np.isfinite(size))
        if rows.size == 0:
            break
        step = _newton_step(residual, solution[rows], values[rows], rows)
        stuck = np.ones(rows.size, bool)
        for halving in range(_HALVINGS):
            at = np.flatnonzero(stuck)
            trial = np.clip(solution[rows[at]] + 0.5**halving * step[at], lower[rows[at]], upper[rows[at]])
            trial_values = residual(trial, rows[at])
            better = _size(trial_values) < size[rows[at]]
            winners = rows[at[better]]
            solution[winners], values[winners] = trial[better], trial_values[better]
            size[winners] = _size(trial_values[better])
            stuck[at[better]] = False
            if not stuck.any():
                break
        if stuck.all():
            break
    return solution, size


def _size(values: np.ndarray) -> np.ndarray:
    size = np.abs(values).max(axis=1, initial=0.0)
    return np.where(np.isfinite(size), size, np.inf)


def _newton_step(residual: _Residual, x: np.ndarray, values: np.ndarray, rows: np.ndarray) -> np.ndarray:
    count, n = x.shape
    moved = (x[None] + _DIFFERENCE * np.eye(n)[:, None]).reshape(n * count, n)
    quotient = (residual(moved, np.tile(rows, n)).reshape(n, count, n) - values) / _DIFFERENCE
    jacobian = np.moveaxis(quotient, 0, -1)
    usable = np.isfinite(jacobian).all(axis=(1, 2))
    step = np.zeros_like(x)
    # the pseudo-inverse never raises: a singular system just fails to improve
    step[usable] = -np.einsum("bij,bj->bi", np.linalg.pinv(jacobian[usable]), values[usable])
    return step
