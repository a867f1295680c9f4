"""The paper's formulas, proved symbolically: which of them hold as printed, and how the others must read.

Everything follows from the beam of Eqs. (6) and (7) and from the projection of Eq. (24).
"""

from __future__ import annotations

import numpy as np
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
