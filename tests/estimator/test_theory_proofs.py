"""What docs/theory_paper.md, theory_inclined.md and theory_hinge.md derive, beside `test_misprints.py`."""

from __future__ import annotations

import numpy as np
import sympy as sp

from estimator.paper import inclined, two_point
from vbaa_calib.antenna import linear
from vbaa_calib.geometry import hinge_plane

EI, LENGTH = 3.9e-3, 0.24
x, ell, EI_, f, u, v, r, P, T = sp.symbols("x l EI f u v r P T", positive=True)


class TestElasticity:
    """e = ∂ln y/∂ln l at constant force, u = l/x."""

    seen_straight, seen_curved = 3 * (2 - u) / (3 - u), 3 * u / (3 * u - 1)

    def test_its_two_branches(self) -> None:
        curved, straight = f * (3 * ell - x) * x**2 / (6 * EI_), f * (3 * x - ell) * ell**2 / (6 * EI_)
        for y, stated in ((curved, self.seen_curved), (straight, self.seen_straight)):
            assert sp.simplify(ell * sp.diff(y, ell) / y - stated.subs(u, ell / x)) == 0

    def test_it_falls_from_2_to_1(self) -> None:
        """So it grows with x, and ln(y2/y1) with l: one contact at most, whatever the case."""
        assert sp.simplify(sp.diff(self.seen_straight, u) + 3 / (3 - u) ** 2) == 0
        assert sp.simplify(sp.diff(self.seen_curved, u) + 3 / (3 * u - 1) ** 2) == 0
        values = [self.seen_straight.subs(u, 0), self.seen_straight.subs(u, 1), self.seen_curved.subs(u, 1)]
        assert values == [2, sp.Rational(3, 2), sp.Rational(3, 2)]
        assert sp.limit(self.seen_curved, u, sp.oo) == 1

    def test_the_code_has_it(self) -> None:
        at = np.array([0.2, 0.7, 1.0, 1.6, 9.0])
        stated = [float((self.seen_straight if value <= 1 else self.seen_curved).subs(u, value)) for value in at]
        np.testing.assert_allclose(two_point.elasticity(np.ones(5), at), stated, rtol=1e-14)


def test_a_small_rotation_field_turns_as_stated() -> None:
    """g′ = ½((δ + b) − g × (δ − b) + (g·(δ + b))g) of Q′ = δ× Q + Q b×, g the Cayley vector of Q."""
    rng, step = np.random.default_rng(0), 1e-6
    for _ in range(5):
        g, delta, bow = rng.normal(size=(3, 3))
        along = 0.5 * ((delta + bow) - np.cross(g, delta - bow) + (g @ (delta + bow)) * g)
        turned = [cayley(g + side * step * along) for side in (1, -1)]
        stated = hat(delta) @ cayley(g) + cayley(g) @ hat(bow)
        np.testing.assert_allclose((turned[0] - turned[1]) / (2 * step), stated, atol=1e-8)


def hat(vector: np.ndarray) -> np.ndarray:
    """(3, 3) whose product with w is vector × w."""
    return np.cross(vector, np.eye(3)).T


def cayley(vector: np.ndarray) -> np.ndarray:
    """The rotation of tan(angle/2)·axis."""
    return np.linalg.solve(np.eye(3) - hat(vector), np.eye(3) + hat(vector))


class TestTheOneUnknown:
    """v = x2/d with x1 = (x2 + d)/r: borders, the straight part, and how many contacts there are in all."""

    spread = (1 + v) / (r * v)  # x1/x2

    def test_its_borders(self) -> None:
        first = (sp.sqrt(r) + 1) / (r - 1)
        assert sp.simplify(self.spread.subs(v, first) ** 2 * r - 1) == 0  # y2/y1 = (x2/x1)²: l → ∞
        last = (2 * r + 1) / (r - 1)
        assert sp.simplify((2 * r * self.spread - 3 + self.spread).subs(v, last)) == 0  # y2/y1 at l = x1

    def test_every_contact_of_a_picture_by_scanning_the_shift(self) -> None:
        """κ from end to end, the upright formulas at each, the moment's misfit: as many zeros as the code finds."""
        rng, several = np.random.default_rng(4), 0
        for number in range(40):
            fold = number % 2 == 0
            contact, x1 = rng.uniform(0.1, 0.2), rng.uniform(0.03, 0.09)
            at = np.array([x1, x1 + rng.uniform(0.02, 0.1)])
            size, tilt = rng.uniform(0.02, 0.08) * 3 * EI / contact**3, rng.uniform(1.2, 1.4) if fold else 0.7
            roll = rng.uniform(-1.2, -0.6) if fold else rng.uniform(-1.0, 1.0)
            y, z = (linear.deflection(at, contact, size * way(roll), EI) for way in (np.cos, np.sin))
            image = inclined.project(np.stack([at, y, z], axis=-1), tilt)
            moment = contact * size * np.sin(roll)
            found = inclined.inclined_two_point_contact(image[:, 0], y, moment, EI, tilt)
            shifts = np.linspace(image[1, 0] - 30.0, image[1, 0], 100_001) / y[1]
            tried = two_point.two_point_contact(image[:, 0] - shifts[:, None] * y, y, EI)
            misfit = shifts * tried.contact_m * tried.force_y_N - moment * np.tan(tilt)
            zeros = np.sum(misfit[1:] * misfit[:-1] < 0.0)
            assert zeros == found.solutions
            assert zeros <= (2 if image[1, 0] < image[0, 0] else 1)
            several += zeros > 1
        assert several > 0


class TestHinge:
    def test_a_picture_of_the_plane_is_a_homography_singular_with_the_camera_in_it(self) -> None:
        """Points x′e₁ + y′e₂ are seen along [e₁ e₂ −c]·(x′, y′, 1), whose determinant is −n·c."""
        roll, *center = sp.symbols("xi c_x c_y c_z", real=True)
        columns = sp.Matrix([[1, 0, -center[0]], [0, sp.cos(roll), -center[1]], [0, sp.sin(roll), -center[2]]])
        height = sp.cos(roll) * center[2] - sp.sin(roll) * center[1]
        assert sp.simplify(columns.det() + height) == 0
        np.testing.assert_allclose(hinge_plane(0.3).normal, [0.0, -np.sin(0.3), np.cos(0.3)])
