"""Antennas that are not uniform: shapes against SciPy's boundary-value problem, and what is refused."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_bvp

from vbaa_calib.antenna.rod import Rod, sample_shape, solve_rod
from vbaa_calib.antenna.shape import bend
from vbaa_calib.antenna.taper import Taper

LENGTH, EI, DENSITY = 0.24, 3.88e-3, 3.97e-3
GRAVITY = np.array([1.0, -3.0, -9.0])
CONES = [[[0.0, 1.0], [LENGTH, 1.0 / ratio]] for ratio in (1.0, 2.0, 5.0, 10.0)]
STEP = [[0.0, 8.0], [0.12, 8.0], [0.12, 4.0], [LENGTH, 4.0]]


def softness(profile: list[list[float]], s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """EI of the clamp over EI, and mass over the clamp's, by the profile itself; `s` keeps off its steps."""
    rows = np.array(profile)
    relative = np.interp(s, rows[:, 0] + 1e-12 * np.arange(len(rows)), rows[:, 1]) / rows[0, 1]
    return relative**-4, relative**2


class Integrated:
    """A rod with a force (3,) that stays (or turns with the antenna) at a place, solved by SciPy on parts of it."""

    def __init__(
        self,
        profile: list[list[float]],
        contact_m: float,
        force_N: np.ndarray,
        lean_rad: float,
        dead: bool,
        pull: float,
    ) -> None:
        self.ends = ends = np.unique([*(row[0] for row in profile), contact_m])
        fine = np.linspace(0.0, LENGTH, 40001)
        middle = 0.5 * (fine[1:] + fine[:-1])
        beyond = np.append(np.cumsum(softness(profile, middle)[1][::-1])[::-1] * fine[1], 0.0)
        last = int(np.argmin(np.abs(ends - contact_m))) - 1

        def rates(x: np.ndarray, y: np.ndarray, push: np.ndarray) -> np.ndarray:
            out = np.empty_like(y)
            for part, (start, end) in enumerate(pairwise(ends)):
                s, rows = start + (end - start) * x, 9 * part
                tangent, moment = y[rows + 3 : rows + 6], y[rows + 6 : rows + 9]
                soft = softness(profile, np.clip(s, start + 1e-10, end - 1e-10))[0]
                internal = DENSITY * np.interp(s, fine, beyond) * pull * GRAVITY[:, None]
                internal = internal + (part <= last) * push[:, None]
                turn = soft / EI * (moment + 0.3 * (tangent * moment).sum(axis=0) * tangent)
                changes = tangent, np.cross(turn, tangent, axis=0), np.cross(internal, tangent, axis=0)
                out[rows : rows + 9] = (end - start) * np.concatenate(changes)
            return out

        def edges(first: np.ndarray, final: np.ndarray, push: np.ndarray) -> np.ndarray:
            joints = [final[:-9] - first[9:]] if len(ends) > 2 else []
            tangent = final[9 * last + 3 : 9 * last + 6]
            normal = np.append(0.0, force_N) - np.tan(lean_rad) * np.hypot(*force_N) * np.eye(3)[0]
            axis = np.cross(np.eye(3)[0], tangent)
            turned = tangent[0] * normal + np.cross(axis, normal) + axis * (axis @ normal) / (1.0 + tangent[0])
            wanted = normal if dead else turned
            return np.concatenate([first[:3], first[3:6] - np.eye(3)[0], *joints, final[-3:], push - wanted])

        x = np.linspace(0.0, 1.0, 41)
        start = np.zeros((9 * (len(ends) - 1), x.size))
        for part, (begin, end) in enumerate(pairwise(ends)):
            start[9 * part], start[9 * part + 3] = begin + (end - begin) * x, 1.0
        self.found = solve_bvp(rates, edges, x, start, p=np.append(0.0, force_N), tol=1e-8, max_nodes=20000)
        assert self.found.success

    def points(self, s: np.ndarray) -> np.ndarray:
        part = np.clip(np.searchsorted(self.ends, s) - 1, 0, len(self.ends) - 2)
        at = (s - self.ends[part]) / (self.ends[part + 1] - self.ends[part])
        return np.array([self.found.sol(x)[9 * p : 9 * p + 3] for x, p in zip(at, part, strict=True)])


@pytest.mark.parametrize("profile", [*CONES, STEP])
@pytest.mark.parametrize(("contact_m", "dead"), [(0.1, False), (0.21, False), (0.17, True)])
def test_shapes_are_those_of_the_boundary_value_problem(
    profile: list[list[float]], contact_m: float, dead: bool
) -> None:
    s, taper = contact_m * (np.arange(2000) + 0.5) / 2000, Taper.of(profile, None, LENGTH)
    slope_per_newton = (softness(profile, s)[0] * (contact_m - s)).mean() * contact_m / EI
    force = (0.4 if dead else 0.7) / slope_per_newton * np.array([0.8, 0.6])
    lean = 0.0 if dead else 0.2
    exact = Integrated(profile, contact_m, force, lean, dead, 1.0)
    parameters, contact = np.array([[0.0] * 6 + [np.log(EI), np.log(DENSITY), 0.0]]), np.array([contact_m])
    curves = bend(
        parameters,
        LENGTH,
        GRAVITY[None],
        contact,
        force[None],
        dead=dead,
        sweeps=4,
        friction_rad=np.array([lean]),
        taper=taper,
    )
    assert np.abs(curves.points_m[0] - exact.points(curves.arclength_m[0])).max() < 1e-6 * LENGTH
    # the simulator's rod, which shares no line with it
    rod = Rod(LENGTH, EI, EI / 1.3, DENSITY, taper=taper)
    shape = solve_rod(rod, GRAVITY[None], contact, curves.force_N)
    bent = sample_shape(shape, curves.arclength_m)[0]
    assert np.abs(bent - curves.points_m).max() < 5e-6 * LENGTH  # between its nodes, next to the step
    assert -shape.clamp_moment_Nm[0, 1] == pytest.approx(curves.moment_Nm[0], rel=1e-5)


def test_a_uniform_antenna_is_the_special_case() -> None:
    """One whose profile says that it is uniform bends as one without."""
    parameters = np.array([[0.0, 0.0, 0.01, -0.02, 0.1, 0.2, np.log(EI), np.log(DENSITY), 1e-3]])
    given = parameters, LENGTH, GRAVITY[None], np.array([0.15]), np.array([[0.06, -0.03]])
    uniform = bend(*given, sweeps=4)
    stated = bend(*given, sweeps=6, taper=Taper.of([[0.0, 8e-4], [LENGTH, 8e-4]], None, LENGTH))
    assert np.abs(uniform.points_m - stated.points_m).max() < 1e-7
    assert stated.moment_Nm == pytest.approx(uniform.moment_Nm, rel=1e-6)
