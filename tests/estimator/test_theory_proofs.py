"""What docs/theory_paper.md, theory_inclined.md and theory_hinge.md derive, beside `test_misprints.py`."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp
from scipy.optimize import least_squares

from benchmarks.estimator.setup import TOWARDS_CLAMP, looking_pose
from estimator.paper import inclined, two_point
from vbaa_calib.antenna import linear
from vbaa_calib.antenna.elastica import normal_load
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


def test_26_as_printed_has_no_deflection_at_the_contact() -> None:
    """It inverts x_p = x + τ·tanφ·l·(x − l)/2EI, whose z is 0 at x = l, where it should be Δz."""
    twist, seen = sp.symbols("t x_p", positive=True)  # τ·tanφ
    printed = (2 * EI_ * seen + twist * ell**2) / (2 * EI_ + twist * ell)
    depth = sp.solve(sp.Eq(printed, x), seen)[0] - x
    assert sp.simplify(depth - twist * ell * (x - ell) / (2 * EI_)) == 0
    assert sp.simplify(depth.subs(x, ell)) == 0


def test_a_clamp_that_gives_looks_like_a_softer_antenna() -> None:
    """It turns by give·f·l/EI: the contact moves by f·l³/3EI·(1 + 3·give/l), as of an EI smaller by 3·give/l."""
    give = sp.symbols("c", positive=True)
    moved = f * ell**3 / (3 * EI_) + give * (f * ell / EI_) * ell
    assert sp.simplify(moved - f * ell**3 / (3 * EI_) * (1 + 3 * give / ell)) == 0


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

    def test_the_straight_part_goes_on_as_a_hyperbola(self) -> None:
        """g = (r − 1)²/3((r − 1)v − 1): (P − v)·g falls where P > 1/(r − 1), the picture not folded, and rises else."""
        x2, d, y2 = v, 1, sp.symbols("y2", positive=True)
        x1, y1, reach = (x2 + d) / r, y2 / r, 3 * sp.Integer(d) / (r - 1)
        pull = 2 * EI_ * (y2 - y1) / (reach**2 * (x2 - x1)) * reach * d**2 / (2 * EI_ * y2)  # l·f_y·d²/(2EI·y2)
        assert sp.simplify(pull - (r - 1) ** 2 / (3 * ((r - 1) * v - 1))) == 0
        slope = sp.diff((P - v) * pull, v)
        assert sp.simplify(slope - (1 / (r - 1) - P) * (r - 1) / (3 * (v - 1 / (r - 1)) ** 2)) == 0

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

    @pytest.mark.parametrize("tilt", [0.0, 0.6])
    def test_mirror_images_differ_by_second_order(self, tilt: float) -> None:
        """Upright, h away over x₀: by 2z/h·(y − (x − x₀)y′); inclined along the antenna by some 2z·tanφ·y′."""
        away, roll, contact = 50.0 if tilt else 0.5, 0.7, 0.15
        pose = looking_pose(tilt, TOWARDS_CLAMP, away)
        at, force = np.linspace(0.02, LENGTH, 60), 1e-3 * 3 * EI / contact**3
        aside, slope = (part(at, contact, force, EI) for part in (linear.deflection, linear.slope))
        seen = []
        for side in (roll, -roll):
            spot = pose.inverse() @ np.stack([at, aside * np.cos(side), aside * np.sin(side)], axis=-1)
            flat = spot[:, :2] / spot[:, 2:] * away
            along = flat[:, 0] / np.cos(tilt) + LENGTH / 2
            seen.append(np.interp(at, along, -flat[:, 1]))
        y, z, slope_y = aside * np.cos(roll), aside * np.sin(roll), slope * np.cos(roll)
        stated = -2 * z * np.tan(tilt) * slope_y if tilt else 2 * z / away * (y - (at - LENGTH / 2) * slope_y)
        inner = slice(3, -6)
        gap = (seen[0] - seen[1])[inner]
        assert np.abs(gap - stated[inner]).max() < 0.06 * np.abs(stated).max()


class TestBeyondSmallDeflections:
    @staticmethod
    def shape(reach: float, load: float, lean: float = 0.0):
        """Places and slopes of points over a unit length, contact at `reach`; load F·l²/EI."""
        at = (np.arange(200) + 0.5) / 200 / reach
        made = normal_load(at, np.array([load]), np.array([lean]))
        return made.x_m[0] * reach, made.w_m[0] * reach, made.theta_rad[0]

    @staticmethod
    def load_of(slope: float) -> float:
        loads = np.linspace(0.0, 3.0, 3000)
        return float(np.interp(slope, normal_load(np.ones(1), loads).theta_rad[:, 0], loads))

    def test_the_contact_comes_nearer_by_three_fifths(self) -> None:
        """Its abscissa is l − 0.6·δ²/l, half the integral of the squared slope; Eq. (20) has l."""
        s = sp.symbols("s", positive=True)
        slope = f * (2 * ell - s) * s / (2 * EI_)
        shift = f * ell**3 / (3 * EI_)
        assert sp.simplify(sp.integrate(slope**2, (s, 0, ell)) / 2 - sp.Rational(3, 5) * shift**2 / ell) == 0

    K_L, K_F = (0.072, 0.081, 0.100, 0.138), (0.31, 0.32, 0.35, 0.41)
    REACH = (0.25, 0.5, 0.75, 0.95)

    @pytest.mark.parametrize("degrees", [5.0, 15.0, 25.0])
    def test_friction_shifts_distance_and_force(self, degrees: float) -> None:
        """docs/theory_estimator.md: Δl/l = k_l·α·θ_c, Δf/f = −k_f·α·θ_c, where it is not modelled."""
        theta, step = np.radians(degrees), 1e-4
        load = self.load_of(theta)
        for reach, k_l, k_f in zip(self.REACH, self.K_L, self.K_F, strict=True):
            _, _, slope = self.shape(reach, load)

            def across(at: float, amount: float, lean: float = 0.0, slope: np.ndarray = slope) -> np.ndarray:
                made = self.shape(at, amount, lean)
                return np.cos(slope) * made[1] - np.sin(slope) * made[0]

            lean = (across(reach, load, step) - across(reach, load, -step)) / (2 * step)
            up, down = 1 + step, 1 - step
            columns = [
                across(reach * up, load * up**2) - across(reach * down, load * down**2),
                across(reach, load * up) - across(reach, load * down),
            ]
            moved = np.linalg.lstsq(np.stack(columns, -1) / (2 * step), lean, rcond=None)[0]
            np.testing.assert_allclose(moved / theta, [k_l, -k_f], rtol=0.04)

    @pytest.mark.parametrize(("reach", "factor"), list(zip(REACH, (0.14, 0.18, 0.28, 0.46), strict=True)))
    def test_a_beam_fitted_to_an_elastica(self, reach: float, factor: float) -> None:
        """docs/ladder.md: the distance is too long by factor·θ_c² of itself, and the misfit hardly shows it."""
        for degrees, slack in ((3.0, 0.02), (8.0, 0.06)):
            theta = np.radians(degrees)
            load = self.load_of(theta)
            at, aside, _ = self.shape(reach, load)

            def misfit(guess: np.ndarray, at: np.ndarray = at, aside: np.ndarray = aside) -> np.ndarray:
                return linear.deflection(at, reach * guess[0], guess[1], 1.0) - aside

            fit = least_squares(misfit, [1.0, load / reach**2], x_scale=[0.01, 0.1], xtol=1e-12, ftol=1e-12)
            assert (fit.x[0] - 1.0) / theta**2 == pytest.approx(factor, abs=slack * factor + 0.005)
            # of an antenna of 240 mm, in µm
            assert 2.4e5 * np.sqrt(np.mean(fit.fun**2)) < 6.0
