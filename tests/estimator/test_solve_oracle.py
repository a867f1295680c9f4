"""The core's fit against slow plain ones: SciPy's least squares of the static rod, NumPy's polynomials and sorting."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial import cKDTree

from estimator.solver.rig_arrays import RigArrays
from vbaa_calib.antenna.rod import RodShape
from vbaa_calib.core.robust import HUBER
from vbaa_calib.native import core

from ..rod_scenes import (
    BROWN,
    LENGTH_M,
    MATRIX,
    RIG_STD,
    SIGMA_PX,
    Frame,
    World,
    along,
    camera_pose,
    frames,
    gravity_antenna,
    press,
    pushing,
    seen,
)
from .test_uncertainty import solved

WORLD, STD, UNIT_N = World(camera_pose(0.7, 0.8)), 0.3 * RIG_STD, 0.05


def by_differences(values: Callable[[np.ndarray], np.ndarray], x: np.ndarray) -> np.ndarray:
    """Derivatives (N, 20) of values (N,) at x (20,)."""
    steps = np.diag([1e-4] * 3 + [0.02] * 17)
    return np.stack([(values(x + step) - values(x - step)) / (2.0 * step.max()) for step in steps], axis=1)


def fitted(one: Frame, start: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Distance in lengths and force along y and z, N, their standard deviations, and the cost.

    Unknowns are the distance, a lateral force in `UNIT_N` and 17 steps of the rig in standard deviations; the rod is
    solved for each, and seen by OpenCV: the fit's own model has no line in it.
    """
    places = np.linspace(0.0, 1.0, 1500) * LENGTH_M

    def pressed(x: np.ndarray) -> tuple[World, RodShape, np.ndarray]:
        moved = WORLD.moved(STD * x[3:])
        return moved, *press(moved.rod, gravity_antenna(one.tilt_rad)[None], x[:1] * LENGTH_M, UNIT_N * x[None, 1:3])

    def residuals(x: np.ndarray) -> np.ndarray:
        moved, shape, _ = pressed(x)
        curve = seen(moved.T_antenna_camera, along(shape, places))
        nearest = cKDTree(curve).query(one.points_px)[1].clip(1, len(curve) - 2)
        way, off = curve[nearest + 1] - curve[nearest - 1], one.points_px - curve[nearest]
        across = (way[:, 0] * off[:, 1] - way[:, 1] * off[:, 0]) / np.linalg.norm(way, axis=1)
        read = moved.sensor.gain * -shape.clamp_moment_Nm[0, 1] + moved.sensor.offset_Nm
        return np.concatenate([across / SIGMA_PX, [(one.moment_Nm - read) / moved.sensor.std_Nm], x[3:]])

    def touch(x: np.ndarray) -> np.ndarray:
        return np.append(x[0], pressed(x)[2][0, 1:])

    robust = {"loss": "huber", "f_scale": HUBER, "x_scale": "jac", "max_nfev": 12}
    found = least_squares(residuals, start, lambda x: by_differences(residuals, x), **robust)
    # SciPy's Jacobian is scaled by the roots of its own weights
    root = by_differences(touch, found.x) @ np.linalg.pinv(found.jac)
    return touch(found.x), np.sqrt((root**2).sum(axis=1)), found.cost


@pytest.mark.parametrize(("contact", "roll", "tip_m"), [(0.55, 0.6, 0.02), (0.8, -1.2, 0.05)])
def test_scipy_ends_at_the_same_minimum(contact: float, roll: float, tip_m: float) -> None:
    """The same distance, force and standard deviations, though the rod's solver is another."""
    rng, lateral = np.random.default_rng(4), pushing(roll, tip_m, contact * LENGTH_M)
    steps = rng.normal(size=17)
    one = frames(WORLD.moved(STD * steps), [contact * LENGTH_M], [lateral.tolist()], [0.3], rng, points=100)[0]
    numbers = solved([one], WORLD.rig(STD))
    touch, std, cost = fitted(one, np.array([contact, *lateral / UNIT_N, *steps]))
    answer = np.append(numbers.unknowns[0, 0], numbers.force_N[0, 1:])
    said = np.append(numbers.std[0, 0], np.sqrt(np.diag(numbers.covariance[0])[4:]))
    assert (np.abs(answer - touch) < 0.01 * std).all()
    np.testing.assert_allclose(said, std, rtol=0.01)
    assert numbers.cost[0] == pytest.approx(cost, rel=0.01)


def test_ideal_points_are_the_cameras() -> None:
    """Covariances by finite differences of OpenCV's inverse; what is not finite does not count."""
    pixels = np.array([[500.0, 300.0], [12.0, 700.0], [np.nan, 5.0], [900.0, 20.0]])
    several, sigma_px = RigArrays.from_rig(WORLD.rig(), 0.0).core, np.array([[0.1, 0.2, 0.1, np.inf]])
    found = core.solver.ideal_points(several, pixels[None], sigma_px, np.array([4]))
    points, covariance, usable = (each[0] for each in found)
    exact = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 200, 1e-14)

    def undone(at: np.ndarray) -> np.ndarray:
        return cv2.undistortPointsIter(at, MATRIX, BROWN, np.eye(3), np.eye(3), exact)[:, 0]

    np.testing.assert_array_equal(usable, [1.0, 1.0, 0.0, 0.0])
    np.testing.assert_allclose(points[:2], undone(pixels[:2]), atol=1e-9)
    slopes = [(undone(pixels[:2] + step) - undone(pixels[:2] - step)) / 0.02 for step in 0.01 * np.eye(2)]
    whole = np.einsum("kni,knj,n->nij", slopes, slopes, [0.01, 0.04])
    np.testing.assert_allclose(covariance[:2], whole[:, [0, 0, 1], [0, 1, 1]], rtol=1e-5, atol=1e-14)
    assert np.isfinite(points).all()
    assert np.isfinite(covariance).all()
