"""What frames share of the calibration's errors: against estimates made with rigs that really are off."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.estimator.scenes import Scenes, random_scenes
from benchmarks.estimator.setup import ACROSS, Setup
from benchmarks.object.scenes import contact_table
from estimator import ContactEstimator
from estimator.contact.common_errors import CommonErrors, shared_errors
from estimator.solver.rig_arrays import RigArrays
from estimator.table.contacts import ContactTable
from vbaa_calib.geometry import Kinematics
from vbaa_calib.rig import Rig

RIG = Setup("brown", 0.7, ACROSS, swing_m=0.1, real=True, exact=False).rig()
FRAMES = 12


def scenes_of(true: Rig, given: Rig) -> Scenes:
    rng = np.random.default_rng(5)
    return random_scenes(true, FRAMES, rng, reach=(0.3, 0.8), slope_rad=(0.1, 0.4), given=given)


def table_of(scenes: Scenes) -> ContactTable:
    estimator = ContactEstimator(scenes.rig, "elastica")
    pan, tilt, moment = scenes.pan_rad, scenes.tilt_rad, scenes.moment_Nm
    found = estimator.estimate_batch(scenes.points_px, moment, pan, tilt, sigma_px=scenes.sigma_px)
    return contact_table(found, pan, tilt, moment, 0.1 * np.arange(len(scenes)))


def true_points(scenes: Scenes, kinematics: Kinematics) -> np.ndarray:
    """(B, 3) contact points, world frame."""
    points = [
        [np.interp(distance, scenes.arclength_m, axis) for axis in shape.T]
        for distance, shape in zip(scenes.distance_m, scenes.shapes.points_m, strict=True)
    ]
    rotation, origin = kinematics.world_antenna(scenes.pan_rad, scenes.tilt_rad)
    return np.einsum("bij,bj->bi", rotation, np.array(points)) + origin


def missed(true: Rig, given: Rig) -> tuple[ContactTable, np.ndarray]:
    """The contacts, and how far their world points are off (B, 3)."""
    scenes = scenes_of(true, given)
    table = table_of(scenes)
    return table, table.point_world_m - true_points(scenes, true.kinematics)


@pytest.mark.parametrize("axis", [0, 8, 12, 16])
def test_a_rig_that_is_off_moves_contacts_as_said(axis: int) -> None:
    step = RigArrays.from_rig(RIG, 0.2).axes[:, axis]
    table, before = missed(RIG, RIG)
    _, after = missed(RIG.moved(step), RIG)
    said = shared_errors(RIG, table).point_m[..., axis]
    assert np.isfinite(said).all()
    # one weight a frame stands for the points that it had, wherever they were
    assert np.linalg.norm(after - before - said) < 0.15 * np.linalg.norm(said)


def test_joint_axes_that_are_off_move_contacts_as_said_and_widen_the_covariance() -> None:
    kinematics = Kinematics(axes_std=np.array([2e-3, 5e-4, 3e-3]))
    given = replace(RIG, kinematics=kinematics)
    table, _ = missed(given, given)
    said = shared_errors(given, table).point_m
    for index, name in enumerate(("axis_skew_rad", "axis_offset_m", "tilt_zero_rad")):
        true = replace(given, kinematics=replace(kinematics, **{name: kinematics.axes_std[index]}))
        # the antenna is seen and felt as before; only where it is in the world is off
        still = replace(true, gravity_world_m_s2=np.zeros(3)), replace(given, gravity_world_m_s2=np.zeros(3))
        table_still, after = missed(*still)
        _, straight = missed(still[1], still[1])
        expected = shared_errors(still[1], table_still).point_m[..., len(RIG.covariance) + index]
        np.testing.assert_allclose(after - straight, expected, atol=2e-2 * np.abs(expected).max())
    plain, _ = missed(RIG, RIG)
    wider = table.covariance_world_m2 - plain.covariance_world_m2
    own = said[..., len(RIG.covariance) : len(RIG.covariance) + 3]
    np.testing.assert_allclose(wider, own @ np.swapaxes(own, 1, 2), atol=1e-6 * np.abs(table.covariance_world_m2).max())


def test_own_and_shared_make_the_whole() -> None:
    table = table_of(scenes_of(RIG, RIG).noisy(np.random.default_rng(2)))
    shared = shared_errors(RIG, table)
    whole = shared.own_m2 + shared.point_m @ np.swapaxes(shared.point_m, 1, 2)
    np.testing.assert_allclose(whole, table.covariance_world_m2, rtol=1e-6, atol=1e-12)
    exact = replace(RIG, covariance=np.zeros_like(RIG.covariance))
    alone = shared_errors(exact, table_of(replace(scenes_of(RIG, RIG), rig=exact)))
    assert alone.point_m.shape[-1] == 3 + 1
    assert not alone.point_m[..., :3].any()
    nobody = CommonErrors.none(table)
    assert nobody.point_m.shape[-1] == 0
    np.testing.assert_array_equal(nobody.own_m2, table.covariance_world_m2)
