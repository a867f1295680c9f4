"""The paper's formulas, proved symbolically: which of them hold as printed, and how the others must read.

Everything follows from the beam of Eqs. (6) and (7) and from the projection of Eq. (24).
"""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp

from estimator import inclined, two_point
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

    def test_17_and_18_are_the_beam_at_its_contact(self) -> None:
        assert vanishes(curved(ell) - f_y * ell**3 / (3 * EI))
        assert vanishes(straight(ell) - curved(ell))


class TestOneCaseApplies:
    """y2/y1 grows with l through all three parts, so its value names the case and l is unique."""

    d = sp.symbols("d", positive=True)  # x2 = x1 + d
    a, b = sp.symbols("a b", positive=True)

    def growth(self, ratio, contact):
        """Numerator and denominator of d(y2/y1)/dl, for x1 < x2 and a contact written in positive symbols."""
        slope = sp.together(sp.diff(ratio, ell).subs(x2, x1 + self.d).subs(ell, contact))
        numerator, denominator = sp.fraction(sp.cancel(slope))
        return sp.expand(numerator), sp.factor(denominator)

    @pytest.mark.parametrize("part", ["straight", "mixed", "curved"])
    def test_the_ratio_grows(self, part: str) -> None:
        a, b, d = self.a, self.b, self.d
        ratio, contact, rename = {
            "straight": (straight(x2) / straight(x1), ell, {x1: ell + a}),
            "mixed": (straight(x2) / curved(x1), x1 + a, {d: a + b}),
            "curved": (curved(x2) / curved(x1), x1 + d + a, {}),
        }[part]
        numerator, denominator = self.growth(ratio, contact)
        for polynomial in (sp.expand(numerator.subs(rename)), sp.expand(denominator.subs(rename))):
            assert all(coefficient > 0 for coefficient in sp.Poly(polynomial).coeffs())

    def test_its_values_where_the_parts_meet(self) -> None:
        assert vanishes(sp.limit(straight(x2) / straight(x1), ell, 0) - x2 / x1)
        assert vanishes((straight(x2) / straight(x1)).subs(ell, x1) - (3 * x2 - x1) / (2 * x1))
        assert vanishes((straight(x2) / curved(x1)).subs(ell, x2) - 2 * x2**3 / ((3 * x2 - x1) * x1**2))
        assert vanishes(sp.limit(curved(x2) / curved(x1), ell, sp.oo) - (x2 / x1) ** 2)


class TestRotation:
    theta, varphi = sp.symbols("theta varphi", real=True)

    def printed(self):
        c, s, cp, sp_ = sp.cos(self.theta), sp.sin(self.theta), sp.cos(self.varphi), sp.sin(self.varphi)
        return sp.Matrix([[c * cp, -sp_, -s], [c * sp_, cp, 0], [s, 0, c]])

    def mended(self):
        matrix = self.printed()
        matrix[:, 2] = sp.Matrix(
            [-sp.sin(self.theta) * sp.cos(self.varphi), -sp.sin(self.theta) * sp.sin(self.varphi), sp.cos(self.theta)]
        )
        return matrix

    def test_22_as_printed_is_no_rotation(self) -> None:
        gram = sp.simplify(self.printed().T * self.printed())
        assert gram != sp.eye(3)
        assert sp.simplify(gram.subs(self.varphi, 0)) == sp.eye(3)

    def test_22_mended_is_pan_after_tilt(self) -> None:
        mended = self.mended()
        assert sp.simplify(mended.T * mended) == sp.eye(3)
        assert sp.simplify(mended.det()) == 1
        turned = sp.rot_ccw_axis3(self.varphi) * sp.rot_ccw_axis2(-self.theta)
        assert sp.simplify(mended - turned) == sp.zeros(3)

    def test_the_code_is_the_mended_one(self) -> None:
        values = {self.theta: 0.4, self.varphi: -0.7}
        expected = np.array(self.mended().subs(values), float)
        np.testing.assert_allclose(rotation_world_antenna(-0.7, 0.4), expected, atol=1e-15)


class TestInclined:
    tan = sp.tan(phi)
    gamma = tau * tan / (6 * EI)

    def mended_26(self, position):
        return (6 * EI * position + tau * self.tan * ell**2) / (6 * EI + 3 * tau * self.tan * ell)

    def test_25_holds_on_the_straight_part(self) -> None:
        z = straight(x, force=tau / ell)
        assert vanishes(z - tau / (6 * EI) * (3 * x - ell) * ell)

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

    def test_29_has_the_coefficients_of_gamma_over_6EI(self) -> None:
        g = sp.symbols("gamma", real=True)
        a0, a1, a2, a3 = (xp1**k * yp2 - xp2**k * yp1 for k in range(4))
        sextic = 8 * g**3 * a0 * ell**6 + 3 * g**2 * a0 * ell**5 + 15 * g**2 * a1 * ell**4 + 6 * g * a1 * ell**3
        sextic += 6 * g * a2 * ell**2 + 3 * a2 * ell - a3

        def substituted(position):
            first, second = position(xp1), position(xp2)
            return 3 * ell * (first**2 * yp2 - second**2 * yp1) - (first**3 * yp2 - second**3 * yp1)

        from_mended = substituted(self.mended_26) * (1 + 3 * self.gamma * ell) ** 3
        assert vanishes(from_mended - sextic.subs(g, self.gamma))
        assert not vanishes(from_mended - sextic.subs(g, tau * self.tan / (2 * EI)))

    def test_29_is_not_solved_by_the_curved_points_it_is_for(self) -> None:
        """Put in what camera B really sees of two curved points: no zero; at zero tilt there is one."""
        a = [self.seen(at) ** k for at in (x1, x2) for k in range(4)]
        g = ell * f_z * self.tan / (6 * EI)
        a0, a1, a2, a3 = (a[k] * curved(x2) - a[4 + k] * curved(x1) for k in range(4))
        sextic = 8 * g**3 * a0 * ell**6 + 3 * g**2 * a0 * ell**5 + 15 * g**2 * a1 * ell**4 + 6 * g * a1 * ell**3
        sextic += 6 * g * a2 * ell**2 + 3 * a2 * ell - a3
        numbers = {x1: sp.Rational(6, 100), x2: sp.Rational(12, 100), ell: sp.Rational(16, 100), EI: 1, f_y: 1, f_z: 1}
        assert sp.simplify(sextic.subs(numbers).subs(phi, sp.pi / 6)) != 0
        assert sp.simplify(sextic.subs(phi, 0)) == 0

    def seen(self, at):
        """Eq. (24) on the curved part."""
        return at + curved(at, force=f_z) * self.tan

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

    def test_the_codes_polynomials(self) -> None:
        """The quintic and the sextic of the code, in units of |x_p2|, y2 and 2EI, vanish at M = l·f_y."""
        torque = sp.Rational(3, 10)
        for second, polynomial in ((curved, inclined._curved_quintic), (straight, inclined._mixed_sextic)):
            y = [part(at, force=1).subs(EI, sp.Rational(1, 2)) for part, at in ((curved, x1), (second, x2))]
            unit_y = y[1]
            p = [at + torque * value / ell for at, value in zip((x1, x2), y, strict=True)]
            contact = sp.Rational(9, 10) if second is curved else sp.Rational(1, 2)
            numbers = {x1: sp.Rational(3, 10), x2: sp.Rational(8, 10), ell: contact}
            p1, p2, e1, m_true = (np.array([[float(v.subs(numbers))]]) for v in (p[0], p[1], y[0] / y[1], ell / unit_y))
            # p is not rescaled here: lengths stay in their own unit, y2 = 1 is reached by M → M/y2
            rising = polynomial(p1, p2, e1, np.array([[float(torque)]]))[0]
            value = np.polynomial.polynomial.polyval(m_true[0, 0], rising)
            scale = np.abs(rising * m_true[0, 0] ** np.arange(rising.size)).max()
            assert abs(value) < 1e-13 * scale


def test_the_code_of_14_is_the_mended_one() -> None:
    positions = np.array([0.12, 0.2])
    _, force = two_point.straight(positions, linear.deflection(positions, 0.1, 0.37, 3.9e-3), 3.9e-3)
    assert force == pytest.approx(0.37)
