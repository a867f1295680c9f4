"""The paper's formulas, proved symbolically: which of them hold as printed, and how the others must read.

Everything follows from the beam of Eqs. (6) and (7) and from the projection of Eq. (24).
"""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp

from estimator.paper import inclined
from vbaa_calib.antenna import linear
from vbaa_calib.geometry import rotation_world_antenna

x, x1, x2, ell, EI, f_y = sp.symbols("x x1 x2 l EI f_y", positive=True)
f_z, tau, phi, xp1, xp2, yp1, yp2, kappa = sp.symbols("f_z tau phi xp1 xp2 yp1 yp2 kappa", real=True)


def curved(at, force=f_y):
    """Eq. (6)."""
    return force / (6 * EI) * (3 * ell - at) * at**2


def straight(at, force=f_y):
    """Eq. (7)."""
    return force / (6 * EI) * (3 * at - ell) * ell**2


def vanishes(expression) -> bool:
    return sp.simplify(sp.together(expression)) == 0


class TestUpright:
    y1c, y2c, y1s, y2s = curved(x1), curved(x2), straight(x1), straight(x2)

    def test_10_and_11_hold(self) -> None:
        y1, y2 = self.y1c, self.y2c
        assert vanishes(6 * EI * (x2**2 * y1 - x1**2 * y2) / (x1**2 * x2**2 * (x2 - x1)) - f_y)
        assert vanishes((x1**3 * y2 - x2**3 * y1) / (3 * (x1**2 * y2 - x2**2 * y1)) - ell)

    def test_15_holds(self) -> None:
        y1, y2 = self.y1s, self.y2s
        assert vanishes(3 * (x1 * y2 - x2 * y1) / (y2 - y1) - ell)

    def test_14_needs_a_square(self) -> None:
        y1, y2 = self.y1s, self.y2s
        cross = x1 * y2 - x2 * y1
        printed = 2 * EI * -((y1 - y2) ** 3) / (9 * (x2 - x1) * cross)
        mended = 2 * EI * -((y1 - y2) ** 3) / (9 * (x2 - x1) * cross**2)
        assert vanishes(mended - f_y)
        assert not vanishes(printed - f_y)
        assert vanishes(printed / f_y - cross)  # not even of the unit of a force: it is off by a length squared

    def test_mixed_cubic(self) -> None:
        y1, y2 = self.y1c, self.y2s
        assert vanishes(-y1 * ell**3 + 3 * x2 * y1 * ell**2 - 3 * x1**2 * y2 * ell + x1**3 * y2)


class TestOneCaseApplies:
    """y2/y1 grows with l (`test_theory_proofs.py::TestElasticity`), so its value names the case and l is unique."""

    def test_its_values_where_the_parts_meet(self) -> None:
        assert vanishes(sp.limit(straight(x2) / straight(x1), ell, 0) - x2 / x1)
        assert vanishes((straight(x2) / straight(x1)).subs(ell, x1) - (3 * x2 - x1) / (2 * x1))
        assert vanishes((straight(x2) / curved(x1)).subs(ell, x2) - 2 * x2**3 / ((3 * x2 - x1) * x1**2))
        assert vanishes(sp.limit(curved(x2) / curved(x1), ell, sp.oo) - (x2 / x1) ** 2)


class TestRotation:
    theta, varphi = sp.symbols("theta varphi", real=True)

    def rotation(self, mended: bool):
        c, s, cp, sp_ = sp.cos(self.theta), sp.sin(self.theta), sp.cos(self.varphi), sp.sin(self.varphi)
        last = [-s * cp, -s * sp_] if mended else [-s, 0]
        return sp.Matrix([[c * cp, -sp_, last[0]], [c * sp_, cp, last[1]], [s, 0, c]])

    def test_22_as_printed_is_no_rotation(self) -> None:
        gram = sp.simplify(self.rotation(False).T * self.rotation(False))
        assert gram != sp.eye(3)
        assert sp.simplify(gram.subs(self.varphi, 0)) == sp.eye(3)

    def test_22_mended_is_pan_after_tilt(self) -> None:
        mended = self.rotation(True)
        assert sp.simplify(mended.T * mended) == sp.eye(3)
        assert sp.simplify(mended.det()) == 1
        turned = sp.rot_ccw_axis3(self.varphi) * sp.rot_ccw_axis2(-self.theta)
        assert sp.simplify(mended - turned) == sp.zeros(3)
        expected = np.array(mended.subs({self.theta: 0.4, self.varphi: -0.7}), float)
        np.testing.assert_allclose(rotation_world_antenna(-0.7, 0.4), expected, atol=1e-15)


class TestInclined:
    tan = sp.tan(phi)
    gamma = tau * tan / (6 * EI)

    def mended_26(self, position):
        return (6 * EI * position + tau * self.tan * ell**2) / (6 * EI + 3 * tau * self.tan * ell)

    def test_26_mended_inverts_25(self) -> None:
        image = x + tau / (6 * EI) * (3 * x - ell) * ell * self.tan
        printed = (2 * EI * image + tau * self.tan * ell**2) / (2 * EI + tau * self.tan * ell)
        assert vanishes(self.mended_26(image) - x)
        assert not vanishes(printed - x)

    def test_30_follows_from_26_mended_only(self) -> None:
        """Into Eq. (15): the moment cancels from l = 3(x1y2 − x2y1)/(y2 − y1)."""
        formula = 3 * (xp1 * yp2 - xp2 * yp1) / (yp2 - yp1)

        def equation(position):
            return 3 * (position(xp1) * yp2 - position(xp2) * yp1) - ell * (yp2 - yp1)

        def printed(position):
            return (2 * EI * position + tau * self.tan * ell**2) / (2 * EI + tau * self.tan * ell)

        assert vanishes(equation(self.mended_26).subs(ell, formula))
        assert not vanishes(equation(printed).subs(ell, formula))

    def sextic(self, g, p1, p2, y1, y2):
        """Eq. (29) with γ = g."""
        a0, a1, a2, a3 = (p1**k * y2 - p2**k * y1 for k in range(4))
        high = 8 * g**3 * a0 * ell**6 + 3 * g**2 * a0 * ell**5 + 15 * g**2 * a1 * ell**4 + 6 * g * a1 * ell**3
        return high + 6 * g * a2 * ell**2 + 3 * a2 * ell - a3

    def test_29_has_the_coefficients_of_gamma_over_6EI(self) -> None:

        def substituted(position):
            first, second = position(xp1), position(xp2)
            return 3 * ell * (first**2 * yp2 - second**2 * yp1) - (first**3 * yp2 - second**3 * yp1)

        from_mended = substituted(self.mended_26) * (1 + 3 * self.gamma * ell) ** 3
        assert vanishes(from_mended - self.sextic(self.gamma, xp1, xp2, yp1, yp2))
        assert not vanishes(from_mended - self.sextic(tau * self.tan / (2 * EI), xp1, xp2, yp1, yp2))

    def test_29_is_not_solved_by_the_curved_points_it_is_for(self) -> None:
        """Put in what camera B really sees of two curved points: no zero; at zero tilt there is one."""
        first, second = (at + curved(at, force=f_z) * self.tan for at in (x1, x2))  # Eq. (24)
        sextic = self.sextic(ell * f_z * self.tan / (6 * EI), first, second, curved(x1), curved(x2))
        numbers = {x1: sp.Rational(6, 100), x2: sp.Rational(12, 100), ell: sp.Rational(16, 100), EI: 1, f_y: 1, f_z: 1}
        assert sp.simplify(sextic.subs(numbers).subs(phi, sp.pi / 6)) != 0
        assert sp.simplify(sextic.subs(phi, 0)) == 0

    def test_kappa_undoes_the_projection_on_both_parts(self) -> None:
        shift = self.tan * f_z / f_y
        for part in (curved, straight):
            image = x + part(x, force=f_z) * self.tan
            assert vanishes(image - shift * part(x) - x)

    def test_the_moment_closes_two_curved_points(self) -> None:
        """2EI·κ·(x2³y1 − x1³y2) = τ·tanφ·x1²x2²(x2 − x1), a quintic in κ with x_i = x_pi − κ·y_i."""
        y1, y2, closing = curved(x1), curved(x2), self.tan * f_z / f_y
        left = 2 * EI * closing * (x2**3 * y1 - x1**3 * y2)
        assert vanishes(left - ell * f_z * self.tan * x1**2 * x2**2 * (x2 - x1))
        first, second = xp1 - kappa * yp1, xp2 - kappa * yp2
        quintic = 2 * EI * kappa * (second**3 * yp1 - first**3 * yp2) - tau * self.tan * first**2 * second**2 * (
            second - first
        )
        assert sp.degree(quintic, kappa) == 5

    def test_the_code_solves_the_quintic(self) -> None:
        """What the code finds for two curved points, at κ = τ·tanφ/(l·f_y), is a root of it."""
        rng = np.random.default_rng(1)
        contact, at = rng.uniform(0.15, 0.24, 50), np.sort(rng.uniform(0.02, 0.14, (50, 2)))
        force = 0.02 * rng.normal(size=(2, 50, 1))
        y, z = (linear.deflection(at, contact[:, None], part, 3.9e-3) for part in force)
        image = inclined.project(np.stack([at, y, z], -1), 0.6)
        moment = contact * force[1, :, 0]
        found = inclined.inclined_two_point_contact(image[..., 0], y, moment, 3.9e-3, 0.6)
        shift = moment * np.tan(0.6) / (found.contact_m * found.force_y_N)
        (first, y1), (second, y2) = ((image[:, k, 0] - shift * y[:, k], y[:, k]) for k in (0, 1))
        left = 2 * 3.9e-3 * shift * (second**3 * y1 - first**3 * y2)
        right = moment * np.tan(0.6) * first**2 * second**2 * (second - first)
        np.testing.assert_allclose(left, right, rtol=1e-9)


class TestOneUnknownOfTheInclinedCamera:
    """`estimator.inclined_roots`: with x2 = r·x1 − d the left side (P − v)·g(v) crosses a moment once, folded twice."""

    a, b, r, far = sp.symbols("a b r L", positive=True)

    def case(self, part: str):
        """x2 and l written in positive symbols, y2/y1, and ∂ln y/∂ln l at both points; in units of d everything."""
        contact = {"curved": x2 + self.b, "mixed": x1 + self.a}[part]
        second = {"curved": x1 + self.a, "mixed": contact + self.b}[part]
        y1, y2 = curved(x1), (curved if part == "curved" else straight)(x2)
        e1, e2 = (sp.simplify(ell * sp.diff(y, ell) / y) for y in (y1, y2))
        return {x2: second}, contact, y2 / y1, e1, e2

    def growth(self, e1, e2):
        """d ln g/dx2 and dl/dx2 while x1 = (x2 + d)/r follows; s = 3 − e is ∂ln y/∂ln x."""
        longer = ((3 - e1) / (self.r * x1) - (3 - e2) / x2) / (e2 - e1)
        return (1 - e2) * longer - (3 - e2) / x2, ell * longer

    def sign(self, expression, where, contact, ratio) -> set[int]:
        """Signs of all coefficients in positive symbols: one sign is one sign of the expression."""
        value = expression.subs(self.r, ratio).subs(ell, contact).subs(where)
        numerator, denominator = sp.fraction(sp.cancel(sp.together(value)))
        top, bottom = ({int(sp.sign(c)) for c in sp.Poly(sp.expand(p)).coeffs()} for p in (numerator, denominator))
        return {x * y for x in top for y in bottom}

    @pytest.mark.parametrize("part", ["curved", "mixed"])
    def test_g_falls_so_one_root_where_the_moment_pushes_on(self, part: str) -> None:
        where, contact, ratio, e1, e2 = self.case(part)
        assert self.sign(self.growth(e1, e2)[0], where, contact, ratio) == {-1}

    @pytest.mark.parametrize("part", ["curved", "mixed"])
    def test_one_root_where_the_picture_is_not_folded(self, part: str) -> None:
        """x_p2 > x_p1 bounds 1/(v − P) from below by (r − 1)/(r·(x2 − x1)): more than g falls."""
        where, contact, ratio, e1, e2 = self.case(part)
        bound = (self.r - 1) / (self.r * (x2 - x1))
        assert self.sign(self.growth(e1, e2)[0] + bound, where, contact, ratio) == {1}

    @pytest.mark.parametrize("part", ["curved", pytest.param("mixed", marks=pytest.mark.slow)])
    def test_at_most_two_roots_in_a_folded_picture(self, part: str) -> None:
        """(v − P)·g turns where v + 1/(ln g)′ = P, and that grows with v."""
        where, contact, ratio, e1, e2 = self.case(part)
        g, longer = self.growth(e1, e2)
        change = sp.diff(g, x2) + sp.diff(g, x1) / self.r + sp.diff(g, ell) * longer
        assert self.sign(1 - change / g**2, where, contact, ratio) == {1}
