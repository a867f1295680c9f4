"""docs/theory_bounds.md: how well a contact can be known, in closed form, against the bound worked out numerically."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import sympy as sp

from benchmarks.estimator.bound import Bound, bound
from benchmarks.estimator.scenes import Scenes, elastica_shapes, push_for_slope, random_scenes, rolled, scenes
from benchmarks.estimator.setup import (
    ACROSS,
    LENGTH_M,
    RIG_STD,
    SENSOR,
    SIGMA_PX,
    STIFFNESS_NM2,
    TOWARDS_CLAMP,
    Setup,
    looking_pose,
)
from vbaa_calib.antenna import linear
from vbaa_calib.rig import MomentSensor, Rig

from ..beam import deflection_by_contact
from .contact_scenes import answered, fitted_std

POINTS, SLOPE_RAD, REACH = 200, 0.03, 0.5
UNFELT = MomentSensor(1.0, 0.0, 1e6)
"""A sensor that says nothing."""
FAR_M = 2.9
STEEPNESS = 1.5
"""sd(l) = 1.5·K_l·σ/(θ_c·√N): the contact's deflection is 2/3·l·θ_c."""


def moments(far):
    """A, B, C: ∫ s², ∫ s·es and ∫ (es)² over u = x/l from 0 to L/l; s = y/δ_c, e = ∂ln y/∂ln l."""
    u = sp.symbols("u", positive=True)
    parts = (((3 - u) * u**2 / 2, 3 * u**2 / 2, 0, 1), ((3 * u - 1) / 2, sp.Rational(3, 2) * (2 * u - 1), 1, far))
    products = [(s * s, s * es, es * es, low, high) for s, es, low, high in parts]
    return [sum(sp.integrate(part[which], (u, *part[3:])) for part in products) for which in range(3)]


def factors(reach: np.ndarray | float) -> np.ndarray:
    """K_l, K_f and the correlation of l and f, (3, ...), at l/L, by the page's closed form."""
    far = 1.0 / np.asarray(reach, float)
    a = 33 / 140 + ((3 * far - 1) ** 3 - 8) / 36
    b = 13 / 40 + 0.75 * (2 * far**3 - 2.5 * far**2 + far - 0.5)
    c = 9 / 20 + 0.375 * ((2 * far - 1) ** 3 - 1)
    spread = a * c - b * b
    return np.stack([np.sqrt(far * a / spread), np.sqrt(far * c / spread), -b / np.sqrt(a * c)])


def camera_at(away_m: float, tilt: float = 0.0, azimuth: float = TOWARDS_CLAMP, sensor: MomentSensor = SENSOR) -> Rig:
    """A rig without distortion whose camera looks at the antenna's middle from so far away."""
    pose = looking_pose(tilt, azimuth, away_m)
    return replace(Setup("none").rig(), T_antenna_camera=pose, moment_sensor=sensor)


def touched(rig: Rig, roll: float, slope: float = SLOPE_RAD, reach: float = REACH, **changes) -> Scenes:
    distance = np.array([reach * LENGTH_M])
    return scenes(rig, distance, rolled(push_for_slope(np.array([slope]), distance, STIFFNESS_NM2), roll), **changes)


def relative(given: Scenes, known: Bound) -> np.ndarray:
    """Least deviations of l, f_y and f_z, each over its size."""
    with np.errstate(divide="ignore"):
        return known.std[0] / np.abs(np.array([given.distance_m[0], *given.force_N[0, 1:]]))


def expected(reach: float = REACH, slope: float = SLOPE_RAD, away_m: float = FAR_M, points: int = POINTS) -> float:
    """K_l·(σ/δ_c)/√N of a camera that sees all of the deflection."""
    sigma_m = SIGMA_PX * away_m / Setup("none").camera.matrix[0, 0]
    deflection = 2.0 / 3.0 * reach * LENGTH_M * slope
    return float(factors(reach)[0] * sigma_m / deflection / np.sqrt(points))


class TestClosedForm:
    def test_the_integrals(self) -> None:
        far = sp.symbols("Lambda", positive=True)
        a, b, c = moments(far)
        assert sp.expand(a - (sp.Rational(33, 140) + ((3 * far - 1) ** 3 - 8) / 36)) == 0
        half = sp.Rational(1, 2)
        inner = 2 * far**3 - sp.Rational(5, 2) * far**2 + far - half
        assert sp.expand(b - (sp.Rational(13, 40) + sp.Rational(3, 4) * inner)) == 0
        assert sp.expand(c - (sp.Rational(9, 20) + sp.Rational(3, 8) * ((2 * far - 1) ** 3 - 1))) == 0

    @pytest.mark.parametrize(
        ("reach", "unsure"), [(0.1, 23.4), (0.25, 16.9), (0.5, 16.1), (0.75, 21.3), (0.9, 31.0), (1.0, 44.5)]
    )
    def test_against_fishers_information(self, reach: float, unsure: float) -> None:
        """Slopes of the beam itself, point by point; an unknown clamp angle is one column more."""
        x = (np.arange(4000) + 0.5) / 4000
        columns = [deflection_by_contact(x, reach, 1.0, 1.0) * reach, linear.deflection(x, reach, 1.0, 1.0), x]
        table = np.stack(columns) / float(linear.deflection(reach, reach, 1.0, 1.0))
        covariance = np.linalg.inv(table[:2] @ table[:2].T / len(x))
        found = np.sqrt(np.diag(covariance))
        np.testing.assert_allclose(found, factors(reach)[:2], rtol=1e-5)
        assert covariance[0, 1] / np.prod(found) == pytest.approx(factors(reach)[2], abs=1e-6)
        assert np.sqrt(np.linalg.inv(table @ table.T / len(x))[0, 0]) == pytest.approx(unsure, abs=0.05)

    def test_where_a_contact_is_known_best(self) -> None:
        """Of one force: in itself at 0.79 L, in mm at 0.58 L; of one slope there, in mm: nearest the clamp."""
        reach = np.linspace(0.02, 1.0, 2000)
        factor = factors(reach)[0]
        assert reach[(factor / reach**2).argmin()] == pytest.approx(0.785, abs=2e-3)
        assert reach[(factor / reach).argmin()] == pytest.approx(0.583, abs=2e-3)
        assert (np.diff(factor) > 0).all()


class TestAgainstTheNumericalBound:
    @pytest.mark.parametrize("reach", [0.25, 0.5, 0.75, 0.95])
    def test_l_and_its_force(self, reach: float) -> None:
        given = touched(camera_at(FAR_M), 0.0, reach=reach)
        l_std, f_std, _ = relative(given, bound(given))
        assert l_std == pytest.approx(expected(reach), rel=5e-3)
        assert f_std / l_std == pytest.approx(factors(reach)[1] / factors(reach)[0], rel=5e-3)
        absolute = l_std * reach * LENGTH_M
        sigma_m = SIGMA_PX * FAR_M / Setup("none").camera.matrix[0, 0]
        assert absolute == pytest.approx(
            STEEPNESS * factors(reach)[0] * sigma_m / SLOPE_RAD / np.sqrt(POINTS), rel=5e-3
        )

    @pytest.mark.parametrize("tilt", [0.0, 0.3, 0.7, 1.2])
    def test_the_wall_where_the_camera_lies_in_the_plane(self, tilt: float) -> None:
        """1/|sin(ξ − ξ_c)|, ξ_c the roll of the direction to the camera, wherever across the antenna that is."""
        facing = np.pi / 2 - tilt
        for off in (1.5, 0.8, 0.3, 0.1):
            given = touched(camera_at(FAR_M, tilt, ACROSS), facing - off)
            assert relative(given, bound(given))[0] * np.sin(off) == pytest.approx(expected(), rel=5e-3)

    @pytest.mark.parametrize("roll", [0.3, 0.8, 1.3])
    def test_f_z_is_the_moment_over_l(self, roll: float) -> None:
        """Upright: (sd f_z/f_z)² = (σ_τ/τ)² + (sd l/l)², and l is known as well as without a moment."""
        given = touched(camera_at(FAR_M), roll)
        l_std, _, z_std = relative(given, bound(given))
        reading = SENSOR.std_Nm / abs(given.moment_Nm[0])
        assert z_std == pytest.approx(np.hypot(reading, l_std), rel=5e-3)
        assert l_std == pytest.approx(expected() / np.cos(roll), rel=5e-3)

    def test_a_moment_in_the_plane_that_is_seen(self) -> None:
        """l·f read to ρ of itself: 1/var = 1/var without + (ē − 1)²/(ρ² + σ²/N⟨y²⟩), which is most of what is known."""
        x = (np.arange(POINTS) + 0.5) / POINTS
        table = np.stack([deflection_by_contact(x, REACH, 1.0, 1.0) * REACH, linear.deflection(x, REACH, 1.0, 1.0)])
        table /= 2e-2 * float(linear.deflection(REACH, REACH, 1.0, 1.0))
        mean = float(table[0] @ table[1] / (table[1] @ table[1]))
        alone = np.linalg.inv(table @ table.T)[0, 0]
        for read in (0.1, 0.01, 1e-4):
            information = table @ table.T + np.ones((2, 2)) / read**2
            stated = 1.0 / (1.0 / alone + (mean - 1.0) ** 2 / (read**2 + 1.0 / (table[1] @ table[1])))
            assert np.linalg.inv(information)[0, 0] == pytest.approx(stated, rel=1e-9)
        assert mean == pytest.approx(1.707, abs=1e-3)


class TestWithoutAMoment:
    def force_z(self, tilt: float, slope: float, away_m: float = 0.4) -> float:
        given = touched(camera_at(away_m, tilt, TOWARDS_CLAMP, UNFELT), np.pi / 4, slope)
        return float(relative(given, bound(given))[2])

    def test_depth_is_seen_to_second_order(self) -> None:
        """Inclined along the antenna: like 1/θ_c² and like σ; upright steeper in both, since perspective fades."""
        inclined = self.force_z(0.7, 0.05, 0.8) / np.array([self.force_z(0.7, 0.1, 0.8), self.force_z(0.7, 0.05, 0.4)])
        np.testing.assert_allclose(inclined, [4.0, 2.0], rtol=0.1)
        upright = self.force_z(0.0, 0.05, 0.8) / np.array([self.force_z(0.0, 0.1, 0.8), self.force_z(0.0, 0.05, 0.4)])
        assert 4.0 < upright[0] < 8.0
        assert 3.0 < upright[1] < 4.0


class TestTwoPointsInsteadOfAll:
    """σ/δ_c = 0.025, l = L/2: the best pair of each case."""

    def best(self, first: tuple[float, float], second: tuple[float, float]) -> float:
        u1, u2 = np.meshgrid(np.linspace(*first, 300), np.linspace(*second, 300), indexing="ij")
        s1, s2 = (linear.deflection(u, 1.0, 3.0, 1.0) for u in (u1, u2))
        e1, e2 = (deflection_by_contact(u, 1.0, 3.0, 1.0) / s for u, s in ((u1, s1), (u2, s2)))
        with np.errstate(divide="ignore"):
            return float(np.nanmin(np.where(u2 > u1, 0.025 * np.hypot(1 / s1, 1 / s2) / np.abs(e2 - e1), np.nan)))

    def test_the_pages_numbers(self) -> None:
        assert self.best((0.05, 1.0), (0.05, 1.0)) == pytest.approx(0.25, abs=0.005)
        assert self.best((1.0, 2.0), (1.0, 2.0)) == pytest.approx(0.090, abs=0.0005)
        assert self.best((0.05, 1.0), (1.0, 2.0)) == pytest.approx(0.083, abs=0.001)
        assert factors(0.5)[0] * 0.025 / np.sqrt(480) == pytest.approx(0.0077, abs=5e-5)


AWAY_M, ALLOWED = 0.6, 1 / 3
STEPS = [(0.25, 0.139, 6.1), (0.5, 0.184, 4.9), (0.75, 0.276, 4.4), (0.95, 0.458, 4.2)]
"""l/L, the factor k of Δl/l = k·θ_c², and the slope in degrees at which the beam is a third of a deviation off."""


@pytest.mark.parametrize(("reach", "factor", "degrees"), STEPS)
def test_a_third_of_a_deviation(reach: float, factor: float, degrees: float) -> None:
    """The distance that the rung `linear` finds in a picture of the elastica without noise, beside the closed form."""
    rig = camera_at(AWAY_M)
    sigma_m = SIGMA_PX * AWAY_M / rig.camera.matrix[0, 0]
    least = STEEPNESS * factors(reach)[0] * sigma_m / np.sqrt(POINTS)
    slope = (ALLOWED * least / (factor * reach * LENGTH_M)) ** (1 / 3)
    assert np.degrees(slope) == pytest.approx(degrees, abs=0.06)
    for times in (0.7, 1.0, 1.5):
        given = touched(rig, 0.0, times * slope, reach)
        found = answered(given, "linear", 0.0)
        off = (found.distance_m[0] - given.distance_m[0]) / fitted_std(found, given, "linear", 0.0)[0, 0]
        assert off == pytest.approx(ALLOWED * times**3, rel=0.06)
        assert found[0].bias["linear"] >= 0.95 * off


def stated(noise: float, height: float, width: float, blur: float) -> float:
    return float(noise / height * np.sqrt(blur * np.sqrt(np.pi) / -np.expm1(-((width / (2.0 * blur)) ** 2))))


def test_what_is_known_less_well_widens_the_bound() -> None:
    exact = random_scenes(Setup("brown", 0.5, swing_m=0.1).rig(), 12, np.random.default_rng(5), made_by=elastica_shapes)
    least = bound(exact).std
    assert (bound(exact, friction_std_rad=0.2).std >= least * (1 - 1e-9)).all()
    assert (bound(exact, friction_std_rad=0.2).std[:, 0] > 1.01 * least[:, 0]).any()
    rough = replace(exact, rig=replace(exact.rig, covariance=np.diag(RIG_STD**2)))
    assert (bound(rough).std[:, :2] > least[:, :2]).all()
