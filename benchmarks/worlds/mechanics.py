"""Static wires by SciPy's integrator and shooting: shapes that share no code with the rod that is tested.

Inside, lengths are in wire lengths, moments in EI/L, forces in EI/L². The state of a wire at an arc length is its place
(3), the quaternion w, x, y, z of its body frame in the antenna frame, and the moment (3), in the body frame, that the
part beyond exerts. All wires, and all variations for a Newton step, are integrated at once.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicHermiteSpline
from scipy.spatial.transform import Rotation

_NODES, _TOLERANCE, _STEP = 33, 1e-9, 1e-5
_LOAD_STEPS, _NEWTON, _TURNS = (0.35, 0.7, 1.0), 30, 40
"""Parts of the loads that are put on one after the other; most Newton steps, and turns of a follower force."""


@dataclass(frozen=True, eq=False)
class Wire:
    """A round wire and its clamp.

    Attributes
    ----------
    stiffness_Nm2 : EI; GJ is EI/1.3. clamp_yz_m, clamp_yz_rad : (2,) offset and turn of the clamp in the antenna frame.
    bow_yz_per_m : (2,) own curvature about its y and z axes. give_m : the clamp turns by give/EI times its moment.
    """

    length_m: float
    diameter_m: float
    stiffness_Nm2: float
    mass_per_length_kg_m: float
    clamp_yz_m: np.ndarray
    clamp_yz_rad: np.ndarray
    bow_yz_per_m: np.ndarray
    give_m: float


@dataclass(frozen=True, eq=False)
class Bent:
    """One wire at rest: points (N, 3) and unit tangents (N, 3) in the antenna frame at arc lengths (N,), both m.

    force_N : (3,) of its point load. moment_Nm : (3,) of weight and load about the antenna frame's origin.
    """

    arclength_m: np.ndarray
    points_m: np.ndarray
    tangents: np.ndarray
    force_N: np.ndarray
    moment_Nm: np.ndarray

    def at(self, arclength_m: np.ndarray) -> np.ndarray:
        """(..., 3) points at arc lengths (...); beyond the ends along the tangents there."""
        s = np.asarray(arclength_m, float)
        inside = np.clip(s, 0.0, self.arclength_m[-1])
        ends = np.where((s < 0.0)[..., None], self.tangents[0], self.tangents[-1])
        return np.asarray(self._curve(inside) + (s - inside)[..., None] * ends)

    def along(self, arclength_m: float) -> np.ndarray:
        """(3,) unit tangent."""
        found = self._curve(arclength_m, 1)
        return np.asarray(found / np.linalg.norm(found))

    @property
    def _curve(self) -> CubicHermiteSpline:
        return CubicHermiteSpline(self.arclength_m, self.points_m, self.tangents)


def hang(wire: Wire, gravity_m_s2: np.ndarray, load_m: np.ndarray, force_N: np.ndarray) -> list[Bent]:
    """B wires under gravity (B, 3) and dead forces (B, 3) at arc lengths (B,), antenna frame."""
    return _solved(wire, gravity_m_s2, load_m, force_N)[0]


def press(
    wire: Wire, gravity_m_s2: np.ndarray, contact_m: np.ndarray, push_N: np.ndarray, lean_rad: np.ndarray
) -> list[Bent]:
    """B wires pressed by objects: forces of the sizes of push (B, 3), across the wire in the plane of push and tangent.

    lean_rad : (B,) turn of the force from the normal towards the clamp: friction.
    """
    size = np.linalg.norm(push_N, axis=1, keepdims=True)
    force, shots = push_N, None
    for _ in range(_TURNS):
        found, shots = _solved(wire, gravity_m_s2, contact_m, force, shots)
        along = np.array([one.along(s) for one, s in zip(found, contact_m, strict=True)])
        normal = push_N - (push_N * along).sum(axis=1, keepdims=True) * along
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        turned = size * (np.cos(lean_rad)[:, None] * normal - np.sin(lean_rad)[:, None] * along)
        if np.abs(turned - force).max() < 1e-7 * size.max():
            return found
        force = turned
    raise ArithmeticError("a follower force did not come to rest")


def _solved(
    wire: Wire, gravity_m_s2: np.ndarray, load_m: np.ndarray, force_N: np.ndarray, shots: np.ndarray | None = None
) -> tuple[list[Bent], np.ndarray]:
    """The wires, and the clamps' moments (B, 3) in body frames: a start for similar loads."""
    length, unit = wire.length_m, wire.stiffness_Nm2 / wire.length_m**2
    weight = wire.mass_per_length_kg_m * length / unit * np.asarray(gravity_m_s2, float)
    loads = _Loads(wire, weight, np.asarray(load_m, float) / length, np.asarray(force_N, float) / unit)
    parts = _LOAD_STEPS if shots is None else (1.0,)
    shots = np.zeros_like(loads.force) if shots is None else shots
    for part in parts:
        shots = _shot(replace(loads, weight=part * weight, force=part * loads.force), shots)
    first, second = loads.integrated(shots, dense=True)
    arc = np.linspace(0.0, 1.0, _NODES)
    wires = []
    for one in range(len(shots)):
        place = loads.place[one]
        s = length * np.concatenate([arc * place, (place + arc * (1.0 - place))[1:]])
        states = np.concatenate([first[:, one].T, second[:, one].T[1:]])
        points = states[:, :3] * length
        own = Rotation.from_quat(states[:, [4, 5, 6, 3]])
        moment = own[0].apply(shots[one]) * unit * length + np.cross(points[0], unit * (loads.force + weight)[one])
        wires.append(Bent(s, points, own.apply([1.0, 0.0, 0.0]), force_N[one], moment))
    return wires, shots


@dataclass(frozen=True, eq=False)
class _Loads:
    """Weight (B, 3), place (B,) and force (B, 3) of the loads, all in the wire's units."""

    wire: Wire
    weight: np.ndarray
    place: np.ndarray
    force: np.ndarray

    def integrated(self, shots: np.ndarray, dense: bool = False) -> tuple[np.ndarray, np.ndarray]:
        """States (10, B, T) from clamp to load and from load to tip; T is 1, the end, unless `dense`."""
        wire = self.wire
        turn = Rotation.from_rotvec([0.0, *wire.clamp_yz_rad])
        held = turn.apply(shots) * [0.0, 1.0, 1.0] * wire.give_m / wire.length_m
        quaternions = (Rotation.from_rotvec(held) * turn).as_quat()[:, [3, 0, 1, 2]].T
        place = np.append(0.0, wire.clamp_yz_m) / wire.length_m
        start = np.vstack([np.repeat(place[:, None], len(shots), axis=1), quaternions, shots.T])
        times = np.linspace(0.0, 1.0, _NODES) if dense else np.ones(1)
        first = self._run(start, np.zeros_like(self.place), self.place, self.force, times)
        return first, self._run(first[..., -1], self.place, 1.0 - self.place, 0.0 * self.force, times)

    def _run(
        self, start: np.ndarray, begin: np.ndarray, way: np.ndarray, force: np.ndarray, times: np.ndarray
    ) -> np.ndarray:
        """(10, B, T) states along a part that begins there and is so long; `force` acts at its end or beyond."""
        bow, bend = np.append(0.0, self.wire.bow_yz_per_m) * self.wire.length_m, np.array([1.3, 1.0, 1.0])

        def slope(t: float, flat: np.ndarray) -> np.ndarray:
            state = flat.reshape(10, -1)
            w, x, y, z = state[3:7]
            own = state[7:]
            turn = bow[:, None] + bend[:, None] * own
            pull = (force + (1.0 - begin - t * way)[:, None] * self.weight).T
            # the second and third rows of the transposed rotation times the pull
            to_y = 2 * (x * y - w * z) * pull[0] + (1 - 2 * (x * x + z * z)) * pull[1] + 2 * (y * z + w * x) * pull[2]
            to_z = 2 * (x * z + w * y) * pull[0] + 2 * (y * z - w * x) * pull[1] + (1 - 2 * (x * x + y * y)) * pull[2]
            along = np.stack([1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)])
            a, b, c = turn
            spin = 0.5 * np.stack(
                [-x * a - y * b - z * c, w * a + y * c - z * b, w * b + z * a - x * c, w * c + x * b - y * a]
            )
            twist = -np.cross(turn, own, axis=0) - np.stack([np.zeros_like(to_y), -to_z, to_y])
            return np.asarray((way * np.concatenate([along, spin, twist])).ravel())

        found = solve_ivp(slope, (0.0, 1.0), start.ravel(), "DOP853", t_eval=times, rtol=_TOLERANCE, atol=_TOLERANCE)
        return np.asarray(found.y).reshape(10, -1, len(times))


def _shot(loads: _Loads, shots: np.ndarray) -> np.ndarray:
    """(B, 3) the clamps' moments with which no moment is left at the tips, by Newton's method."""
    varied = np.tile(np.eye(4, 3, -1) * _STEP, (len(shots), 1))
    every = _Loads(loads.wire, *(np.repeat(each, 4, axis=0) for each in (loads.weight, loads.place, loads.force)))
    for _ in range(_NEWTON):
        end = every.integrated(np.repeat(shots, 4, axis=0) + varied)[1][7:, :, -1].T.reshape(-1, 4, 3)
        slopes = np.moveaxis(end[:, 1:] - end[:, :1], 1, 2) / _STEP
        step = np.linalg.solve(slopes, -end[:, 0, :, None])[..., 0]
        shots = shots + step * np.minimum(1.0, 2.0 / np.abs(step).max(axis=1, keepdims=True).clip(1e-12))
        if np.abs(step).max() < 1e-8:
            return shots
    raise ArithmeticError("a wire did not come to rest")
