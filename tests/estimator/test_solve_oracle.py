"""The core's fit against slow plain ones: SciPy's least squares of the static rod, NumPy's polynomials and sorting."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from estimator.solver.rig_arrays import RigArrays
from vbaa_calib.native import core

from ..rod_scenes import (
    BROWN,
    LENGTH_M,
    MATRIX,
    RIG_STD,
    UNIT_N,
    Guess,
    World,
    camera_pose,
    fitted,
    frames,
    gravity_antenna,
    press,
    pushing,
)
from .test_uncertainty import solved

WORLD, STD = World(camera_pose(0.7, 0.8)), 0.3 * RIG_STD


@pytest.mark.parametrize(("contact", "roll", "tip_m"), [(0.55, 0.6, 0.02), (0.8, -1.2, 0.05)])
def test_scipy_ends_at_the_same_minimum(contact: float, roll: float, tip_m: float) -> None:
    """The same distance, force and standard deviations, though the rod's solver is another."""
    rng, lateral = np.random.default_rng(4), pushing(roll, tip_m, contact * LENGTH_M)
    steps = rng.normal(size=17)
    one = frames(WORLD.moved(STD * steps), [contact * LENGTH_M], [lateral.tolist()], [0.3], rng, points=100)[0]
    numbers = solved([one], WORLD.rig(STD))

    def at(x: np.ndarray) -> Guess:
        moved = WORLD.moved(STD * x[3:])
        shape, force = press(moved.rod, gravity_antenna(0.3)[None], x[:1] * LENGTH_M, UNIT_N * x[None, 1:3])
        read = moved.sensor.gain * -shape.clamp_moment_Nm[:, 1] + moved.sensor.offset_Nm
        return moved.T_antenna_camera, shape, force[0], (one.moment_Nm - read) / moved.sensor.std_Nm

    touch, std, cost = fitted(one, np.array([contact, *lateral / UNIT_N, *steps]), at)
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
